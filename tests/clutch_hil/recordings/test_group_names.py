"""Text with two lines of names: groups, and names that come again in each, as merged cells of a spreadsheet leave them."""

from pathlib import Path

import pytest

from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.text.group_names import name_by_groups
from tests.clutch_hil.recordings.text_files import MAP, SPEED, TIME, TORQUE, assert_right, convert_run, make_table, read

FULL = ["time", "Clutch A Torque", "Clutch A Speed", "Clutch B Torque", "Clutch B Speed"]


def list_names(tmp_path: Path, *above: str) -> list[str]:
    """Names of the columns of a table of five columns below these lines."""
    rows = [f"{t:.2f},{m},{n},{2 * m},{3 * n}" for t, m, n in zip(TIME, TORQUE, SPEED, strict=True)]
    path = tmp_path / "groups.csv"
    path.write_text("\n".join([*above, *rows, ""]))
    recording = open_recording(path)
    assert [channel.unit for channel in recording.channels] in (["s", "Nm", "rpm", "Nm", "rpm"], [""] * 5)
    return [channel.name for channel in recording.channels]


@pytest.mark.parametrize(
    ("groups", "names"),
    [
        (",Clutch A,,Clutch B,", "time,Torque,Speed,Torque,Speed"),
        (",Clutch A,Clutch A,Clutch B,Clutch B", "time,Torque,Speed,Torque,Speed"),
        ("time,Clutch A,,Clutch B,", ",Torque,Speed,Torque,Speed"),
        ("time,Clutch A,Clutch A,Clutch B,Clutch B", ",Torque,Speed,Torque,Speed"),
    ],
)
@pytest.mark.parametrize("units", [True, False])
def test_a_name_in_several_groups_begins_with_its_group(tmp_path: Path, groups: str, names: str, units: bool) -> None:
    assert list_names(tmp_path, "Bench 7", groups, names, *(["s,Nm,rpm,Nm,rpm"] if units else [])) == FULL


def test_names_that_differ_stay_and_a_missing_one_is_that_of_its_group(tmp_path: Path) -> None:
    assert list_names(tmp_path, "time,Clutch,,Motor,", ",torque,slip,load,speed", "s,Nm,rpm,Nm,rpm") == [
        "time", "torque", "slip", "load", "speed",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "line",
    [
        "Bench 7,,",  # a title
        "Bench 7,,no. 12",  # names are complete, and differ
        "sensor 1,sensor 2,sensor 3",
    ],
)
def test_other_lines_above_the_names_change_nothing(tmp_path: Path, line: str) -> None:
    run = read(tmp_path, make_table(header=f"{line}\ntime,torque,speed\ns,Nm,rad/s"))
    assert_right(run)
    assert "groups" not in convert_run(run).replace("groups.csv", "")


def test_remarks_below_names_are_no_names(tmp_path: Path) -> None:
    assert_right(read(tmp_path, make_table(header="time,torque,speed\nfrom start,clutch,motor"), columns=MAP))


def test_groups_in_which_names_come_twice_are_none() -> None:
    assert name_by_groups(["", "A", "", "B"], ["t", "M", "M", "M"]) is None
    assert name_by_groups(["", "A", "", ""], ["t", "M", "n", "M"]) is None
    assert name_by_groups(["", "A", "", "B"], ["t", "M", "n", "M"]) == ["t", "A M", "n", "B M"]
