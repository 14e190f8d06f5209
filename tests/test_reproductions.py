"""Every reproduction runs and draws; the claims hold, except those that are known not to, with the reason."""

import json
from pathlib import Path

import pytest

from plant_sim.reproduce import Entry, entries, entry
from plant_sim.reproduce.contradicted import CONTRADICTED
from plant_sim.reproduce.measured_data import MissingDataError
from plant_sim.reproduce.result import Result, checks_text, run, run_all
from plant_sim.reproduce.sheet import Sheet
from protocols.errors import InputError
from tests import needs

# the figures and tables that make a physical claim
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
    except MissingDataError:
        needs.skip("data")
    assert result.as_known, checks_text(result)
    assert result.picture.stat().st_size > 10_000  # bytes: not an empty canvas
    json.dumps(result.document(), default=float)


@pytest.mark.parametrize("name", [*(f"figure-{n}" for n in FIGURES), *(f"table-{n}" for n in TABLES)])
def test_what_was_asked_for_is_there(name: str) -> None:
    assert name in ENTRIES
    assert ENTRIES[name].claim
    assert ENTRIES[name].title


def test_a_number_means_the_figure_or_the_table() -> None:
    assert entry("2.12") is entry("figure-2.12")
    assert entry("6.4") is entry("table-6.4")
    assert entry("d.4") is entry("figure-D.4")


def test_every_known_contradiction_has_its_entry() -> None:
    assert CONTRADICTED.keys() <= ENTRIES.keys()


def test_all_goes_on_after_an_entry_without_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(sheet: Sheet) -> None:
        raise MissingDataError("measured data are not here")

    def fine(sheet: Sheet) -> None:
        sheet.axes().plot([0.0, 1.0])
        sheet.check("one [N]", True, measured=1.23456789)

    def wrong(sheet: Sheet) -> None:
        fine(sheet)
        sheet.check("two", False)

    made = [
        Entry("gone", "no data", "claim", missing),
        Entry("fine", "title", "claim", fine),
        Entry("wrong", "t", "c", wrong),
    ]
    monkeypatch.setattr("plant_sim.reproduce.result.entries", lambda: {e.name: e for e in made})
    document, text, verdict, good = run_all(tmp_path, lambda done, total: None)
    assert not good
    assert verdict == "1 of 2 claims hold, 0 known not to; unexpected: wrong; 1 skipped"
    assert "skipped: gone: measured data are not here" in text
    assert document["results"][0]["checks"][0]["measured"] == 1.23456789
    assert document["skipped"] == {"gone": "measured data are not here"}
    page = (tmp_path / "index.html").read_text()
    assert 'href="#wrong"' in page
    assert "measured data are not here" in page


def test_a_picture_that_cannot_be_written_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "fine.png").mkdir()
    with pytest.raises(InputError, match=r"picture .*fine\.png cannot be written"):
        run(
            Entry("fine", "title", "claim", lambda sheet: sheet.axes().plot([0.0, 1.0])),
            tmp_path,
            lambda done, total: None,
        )


def test_an_unknown_name_is_refused_with_what_exists() -> None:
    with pytest.raises(
        InputError, match="reproduction 'nothing' does not exist; `clutch-hil reproduce --list` names all"
    ):
        entry("nothing")
    with pytest.raises(InputError, match=r"'figure-2\.122' does not exist; did you mean figure-2\.12 or"):
        entry("figure-2.122")


def test_a_claim_without_a_check_does_not_hold() -> None:
    sheet = Sheet()
    assert not sheet.holds
    sheet.check("one", True)
    assert sheet.holds
    sheet.check("another", False, measured=[1.0, 2.0])
    assert not sheet.holds
    result = Result(Entry("x", "title", "claim", lambda sheet: None), sheet, Path("x.png"), 0.0)
    assert "another  1, 2              NO" in checks_text(result)
