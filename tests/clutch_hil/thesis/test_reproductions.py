"""Every reproduction runs and draws; the claims hold, except those that are known not to, with the reason.

What docs/reproductions.md, docs/results.md and docs/friction.md tell of each is what it says now.
"""

import json
import re
from itertools import takewhile
from pathlib import Path

import pytest

from clutch_hil.thesis import Entry, find_entry, load_entries, register_reproduction
from clutch_hil.thesis.check_sheet import Sheet
from clutch_hil.thesis.contradictions import CONTRADICTED
from clutch_hil.thesis.control_models import gms
from clutch_hil.thesis.markdown_page import (
    PAGE,
    PICTURED_ENTRIES,
    PICTURES,
    format_claim_row,
    format_failed_checks,
    format_line,
)
from clutch_hil.thesis.measured_data import MissingDataError
from clutch_hil.thesis.reproduction import Result, format_checks, run, run_all
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError
from tests import needs
from tests.processes import play_here

# the figures and tables that make a physical claim
FIGURES = (
    *("1.7", "1.9", "2.3", "2.5", "2.6", "2.7", "2.8", *(f"2.{n}" for n in range(12, 21)), "2.25", "2.26"),
    *(f"3.{n}" for n in range(7, 13)),
    *("4.1", *(f"4.{n}" for n in range(3, 8)), *(f"4.{n}" for n in range(12, 19))),
    *(*(f"5.{n}" for n in range(2, 10)), "6.8", "6.9", *(f"6.{n}" for n in range(11, 16))),
    *(*(f"C.{n}" for n in range(3, 9)), *(f"D.{n}" for n in range(1, 7)), *(f"E.{n}" for n in range(1, 8))),
)
TABLES = tuple(f"6.{n}" for n in range(1, 7))
ENTRIES = load_entries()
RECORD = PAGE.read_text(encoding="utf-8").splitlines()
# entries whose tables stand elsewhere too
REPEATED_ON = {"table-6.6": "docs/results.md", "adaptation": "docs/results.md", "microtribometer": "docs/friction.md"}
NUMBER = re.compile(r"(\d+(?:\.(\d+))?(?:e([-+]\d+))?)")
SHARE = 0.003  # of a number: libraries and processors round otherwise; 9.57 for 9.66 is three times that
# Iterative fits to noisy records end elsewhere where a processor rounds otherwise: without AVX2 and FMA by 4 %, by 13 %,
# and by 33 % of what XGMS misses while the load is taken off; all other entries agree there within SHARE.
SHARES = {"figure-5.10": 0.1, "compensation": 0.25, "microtribometer": 0.5}


def are_alike(kept: str, now: str, share: float = SHARE) -> bool:
    """Whether two lines have the same words, and numbers that differ by two units of the last digit or by `share` at most."""
    if NUMBER.sub("#", kept) != NUMBER.sub("#", now):
        return False
    for one, other in zip(NUMBER.finditer(kept), NUMBER.finditer(now), strict=True):
        unit = 10.0 ** (int(one[3] or 0) - len(one[2] or ""))
        if abs(float(one[1]) - float(other[1])) > max(2.01 * unit * bool(one[2]), share * float(one[1])):
            return False
    return True


def read_recorded_lines(name: str) -> list[str]:
    """The lines of the page on an entry: its rows in the two tables, and those of its own table."""
    rows = [row for row in RECORD if row.startswith(f"| {name} |")]
    headings = [i for i, row in enumerate(RECORD) if row.startswith(f"### {name}: ")]
    own = [row for i in headings for row in takewhile(lambda row: not row.startswith("#"), RECORD[i + 1 :])]
    return rows + [row for row in own if row.startswith("| ")]


@pytest.mark.parametrize("name", ENTRIES)
def test_the_claim_holds(name: str, tmp_path: Path) -> None:
    try:
        result = run(ENTRIES[name], tmp_path, lambda done, total: None)
    except MissingDataError:
        needs.skip("data")
    assert result.is_as_known, format_checks(result)
    assert result.picture.stat().st_size > 10_000  # bytes: not an empty canvas
    json.dumps(result.make_document(), default=float)
    table = [format_line(row) for row in result.sheet.table]
    now = [*map(format_line, (format_claim_row(result), *format_failed_checks(result))), *table]
    kept, share = read_recorded_lines(name), SHARES.get(name, SHARE)
    hint = "`python -m clutch_hil.thesis` writes the page anew"
    assert len(kept) == len(now), f"{PAGE.name}: {kept} is now {now}; {hint}"
    for one, other in zip(kept, now, strict=True):
        assert are_alike(one, other, share), f"{PAGE.name}: {one} is now {other}; {hint}"
    if page := REPEATED_ON.get(name):
        rows = (PAGE.parents[1] / page).read_text(encoding="utf-8").replace("±", "+-").splitlines()
        for row in table:
            assert any(are_alike(one, row, share) for one in rows), f"not in {page}: {row}"


def test_the_page_tells_every_entry_and_no_other() -> None:
    begun = RECORD.index("## Claims that do not hold, and why")
    assert [row.split(" | ")[0][2:] for row in RECORD[:begun] if row.startswith("| ")] == ["name", *ENTRIES]
    holding = sum(" | yes | " in row for row in RECORD[:begun])
    assert f"{holding} of {len(ENTRIES)} claims hold, {len(CONTRADICTED)} known not to." in RECORD[2]
    failed = {
        row.split(" | ")[0][2:]
        for row in RECORD[begun : RECORD.index("## Measured values of the entries with a table")]
    }
    assert {name for name in failed if name in ENTRIES} == CONTRADICTED.keys()
    assert all((PICTURES / f"{name}.png").stat().st_size > 10_000 for name in PICTURED_ENTRIES)


@pytest.mark.parametrize("name", ["figure-5.4", "figure-5.9"])
def test_friction_that_does_not_lag_has_no_lag(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample is made in a step, so that a loop is open by a step even without lag: that is no lag."""
    monkeypatch.setattr(gms, "XGMS", lambda *given, attraction, **kept: XGMS(*given, **kept))
    sheet = Sheet()
    ENTRIES[name].run(sheet)
    assert any("accelerating" in check.statement and not check.holds for check in sheet.checks)


@pytest.mark.parametrize(
    ("kept", "now", "same"),
    [
        ("| 9.57 Hz |", "| 9.66 Hz |", False),
        ("| 9.8 |", "| 9.57 |", False),
        ("| 0.080 | 0.4 |", "| 0.081 | 0.4 |", True),
        ("| 129.8 |", "| 129.5 |", True),
        ("| 2.9e-06 |", "| 3.0e-06 |", True),
        ("| 2.9e-06 |", "| 3.9e-06 |", False),
        ("| 20 seeds |", "| 19 seeds |", False),
        ("| holds |", "| holds not |", False),
        ("| -0.25 |", "| 0.25 |", False),
    ],
)
def test_lines_are_alike_in_words_and_in_numbers_but_for_rounding(kept: str, now: str, same: bool) -> None:
    assert are_alike(kept, now) is same


@pytest.mark.parametrize("name", [*(f"figure-{n}" for n in FIGURES), *(f"table-{n}" for n in TABLES)])
def test_what_was_asked_for_is_there(name: str) -> None:
    assert name in ENTRIES
    assert ENTRIES[name].claim
    assert ENTRIES[name].title


def test_two_functions_cannot_be_one_reproduction() -> None:
    def other(sheet: Sheet) -> None: ...

    other.__module__ = ENTRIES["figure-2.12"].run.__module__
    with pytest.raises(ValueError, match=r"reproduction figure-2\.12 is defined twice"):
        register_reproduction("figure-2.12", "", "")(other)


def test_a_number_means_the_figure_or_the_table() -> None:
    assert find_entry("2.12") is find_entry("figure-2.12")
    assert find_entry("6.4") is find_entry("table-6.4")
    assert find_entry("d.4") is find_entry("figure-D.4")


def test_every_known_contradiction_has_its_entry() -> None:
    assert CONTRADICTED.keys() <= ENTRIES.keys()


def judge(name: str, failing: list[str]) -> Result:
    """The result of the entry `name` with one check that holds and those that do not."""
    sheet = Sheet()
    sheet.check("what holds", True)
    for statement in failing:
        sheet.check(statement, False)
    return Result(ENTRIES[name], sheet, None, 0.0)


@pytest.mark.parametrize("name", CONTRADICTED)
def test_a_contradicted_claim_is_as_known_only_if_the_known_checks_fail_and_no_other(name: str) -> None:
    known = [f"{begin} and so on" for begin in CONTRADICTED[name].failing]
    assert judge(name, known).is_as_known
    assert "other than known" not in judge(name, known).verdict
    for failing, news in (([*known, "what held"], "what held"), (known[1:], CONTRADICTED[name].failing[0])):
        result = judge(name, failing)
        assert not result.is_as_known
        assert f"; other than known: {news})" in result.verdict
    assert not judge(name, []).is_as_known  # it holds now: the contradiction is out of date


def test_all_goes_on_after_an_entry_without_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(sheet: Sheet) -> None:
        raise MissingDataError("measured data are not here")

    def fine(sheet: Sheet) -> None:
        sheet.make_axes().plot([0.0, 1.0])
        sheet.check("one [N]", True, measured=1.23456789)

    def wrong(sheet: Sheet) -> None:
        fine(sheet)
        sheet.check("two", False)

    made = [
        Entry("gone", "no data", "claim", missing),
        Entry("fine", "title", "claim", fine),
        Entry("wrong", "t", "c", wrong),
    ]
    monkeypatch.setattr("clutch_hil.thesis.reproduction.load_entries", lambda: {e.name: e for e in made})
    document, text, verdict, good = run_all(tmp_path, lambda done, total: None)
    assert not good
    assert verdict == "1 of 2 claims hold, 0 known not to; unexpected: wrong; 1 skipped"
    assert "skipped: gone: measured data are not here" in text
    assert document["results"][0]["checks"][0]["measured"] == 1.23456789
    assert document["skipped"] == {"gone": "measured data are not here"}
    page = (tmp_path / "index.html").read_text()
    assert 'href="#wrong"' in page
    assert "measured data are not here" in page


def test_a_page_that_cannot_be_written_leaves_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "index.html"
    page.write_text("before", encoding="utf-8")
    monkeypatch.setattr("clutch_hil.thesis.reproduction.load_entries", dict)
    monkeypatch.setattr("clutch_hil.thesis.reproduction.format_html_page", lambda *of: "no character: \ud800")
    with pytest.raises(UnicodeEncodeError):
        run_all(tmp_path, lambda done, total: None)
    assert page.read_text(encoding="utf-8") == "before"


def test_a_picture_that_cannot_be_written_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "fine.png").mkdir()
    with pytest.raises(InputError, match=r"file .*fine\.png cannot be written"):
        run(
            Entry("fine", "title", "claim", lambda sheet: sheet.make_axes().plot([0.0, 1.0])),
            tmp_path,
            lambda done, total: None,
        )


def test_an_unknown_name_is_refused_with_what_exists() -> None:
    with pytest.raises(
        InputError, match="reproduction 'nothing' does not exist; `clutch-hil reproduce --list` lists all"
    ):
        find_entry("nothing")
    with pytest.raises(InputError, match=r"'figure-2\.122' does not exist; did you mean figure-2\.12 or"):
        find_entry("figure-2.122")


def test_a_claim_without_a_check_does_not_hold() -> None:
    sheet = Sheet()
    assert not sheet.holds
    sheet.check("one", True)
    assert sheet.holds
    sheet.check("another", False, measured=[1.0, 2.0])
    assert not sheet.holds
    result = Result(Entry("x", "title", "claim", lambda sheet: None), sheet, Path("x.png"), 0.0)
    assert "another  1, 2              NO" in format_checks(result)


@pytest.mark.parametrize("words", [("--list", "--all"), ("--list", "figure-2.12")])
def test_a_list_is_nothing_but_a_list(words: tuple[str, ...]) -> None:
    done = play_here("reproduce", *words)
    assert done.returncode == 2
    assert f"--list and {words[1]} were both given; only one of them is allowed" in done.stderr


def test_a_repetition_is_shown_and_keeps_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = Entry("fine", "title", "claim", lambda sheet: sheet.check("one is one", True, 1.0))
    monkeypatch.setattr("clutch_hil.thesis.find_entry", lambda name: entry)
    monkeypatch.setattr("clutch_hil.thesis.reproduction.find_entry", lambda name: entry)
    first = play_here("reproduce", "fine", "--out", tmp_path)
    picture = tmp_path / "fine.png"
    picture.write_bytes(b"kept")
    again = play_here("reproduce", "fine", "--out", tmp_path)
    assert (first.returncode, again.returncode) == (0, 0)
    assert f"wrote:   {picture}\n" in first.stdout
    assert f"wrote:   nothing; {picture} exists already, --overwrite replaces it\n" in again.stdout
    assert picture.read_bytes() == b"kept"
    assert play_here("reproduce", "fine", "--out", tmp_path, "--overwrite").returncode == 0
    assert picture.read_bytes() != b"kept"
