"""Every reproduction runs and draws; the claims hold, except those that are known not to, with the reason."""

import json
from pathlib import Path

import pytest

from plant_sim.reproduce import Entry, entries, entry
from plant_sim.reproduce.measured_data import MissingDataError
from plant_sim.reproduce.result import Result, checks_text, run
from plant_sim.reproduce.sheet import Sheet
from protocols.errors import InputError

# claims of the thesis that do not hold here, and why
DO_NOT_HOLD = {
    "figure-3.6": "misprints: both printed transfer functions contradict the printed system equations",
    "figure-3.10": "a model in one direction has no tilting modes: two resonances below 500 Hz at own weight, not more",
    "figure-3.11": "over the dynamometer torque, which is the friction, sliding is a damper: -22 dB/decade, not -40",
    "figure-4.6": "eq 4.1 scales the viscous part with F_s too: one shape of the curve, one speed of its minimum at all loads",
    "figure-4.15": "eq 4.1 has one a_1 for all loads, and our lift-up takes more of a high load: depth falls with load",
    "figure-4.16": "the level 0.1148 to 0.113 is that of Table 6.3; Table 6.4, which the plant follows, gives 0.086 to 0.082",
    "figure-4.13": "our lift-up is the same at every load, so speed shows at 280 N as much as at higher loads",
    "figure-6.8": "the axis of the figure contradicts eq 6.3 with Table 6.1, which the plant follows",
    "figure-6.9": "with gamma = 1/3 the viscous term is 18 % of the torque at 10 rpm, so temperature shows there",
    "table-6.3": "contradicts Tables 6.4 and 6.5 at 200 rpm, which the plant follows, by 6 % in slope",
    "figure-D.4": "even error needs distances inverse to the root of the second derivative",
}
# the figures and tables that issue 3 asks for
FIGURES = (
    *("1.7", "1.9", "2.3", "2.5", "2.6", "2.7", "2.8", *(f"2.{n}" for n in range(12, 21)), "2.25", "2.26"),
    *(f"3.{n}" for n in range(7, 13)),
    *("4.1", *(f"4.{n}" for n in range(3, 8)), *(f"4.{n}" for n in range(12, 19))),
    *(*(f"5.{n}" for n in range(2, 10)), "6.8", "6.9", *(f"6.{n}" for n in range(11, 16))),
    *(*(f"C.{n}" for n in range(3, 9)), *(f"D.{n}" for n in range(1, 7)), *(f"E.{n}" for n in range(1, 8))),
)
TABLES = tuple(f"6.{n}" for n in range(1, 7))
ENTRIES = entries()


@pytest.mark.parametrize("name", ENTRIES)
def test_the_claim_holds(name: str, tmp_path: Path) -> None:
    try:
        result = run(ENTRIES[name], tmp_path, lambda done, total: None)
    except MissingDataError as error:
        pytest.skip(str(error))
    assert result.holds != (name in DO_NOT_HOLD), checks_text(result)
    assert result.picture.stat().st_size > 10_000  # bytes: not an empty canvas
    json.dumps(result.document(), default=float)


@pytest.mark.parametrize("name", [*(f"figure-{n}" for n in FIGURES), *(f"table-{n}" for n in TABLES)])
def test_what_was_asked_for_is_there(name: str) -> None:
    assert name in ENTRIES
    assert ENTRIES[name].claim
    assert ENTRIES[name].title


def test_a_number_means_the_figure() -> None:
    assert entry("2.12") is entry("figure-2.12")


def test_an_unknown_name_is_refused_with_what_exists() -> None:
    with pytest.raises(InputError, match=r"reproduction '9\.99' does not exist; known are .*table-6\.6"):
        entry("9.99")


def test_a_claim_without_a_check_does_not_hold() -> None:
    sheet = Sheet()
    assert not sheet.holds
    sheet.check("one", True)
    assert sheet.holds
    sheet.check("another", False, measured=[1.0, 2.0])
    assert not sheet.holds
    result = Result(Entry("x", "title", "claim", lambda sheet: None), sheet, Path("x.png"), 0.0)
    assert "another  1, 2              NO" in checks_text(result)
