"""JSON: rows and columns as programs write them; what is no table, or only a part of one, is refused or told."""

import gc
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording, recognise
from protocols.errors import InputError
from tests.clutch_hil.recordings.maps import find_refusal, import_by
from tests.clutch_hil.recordings.text_files import MAP, NAMES, ROWS, SPEED, TIME, TORQUE, assert_right, convert_run

COLUMNS = dict(zip(NAMES, (TIME.tolist(), TORQUE.tolist(), SPEED.tolist()), strict=True))
OBJECTS = [dict(zip(NAMES, row, strict=True)) for row in zip(*COLUMNS.values(), strict=True)]
LISTS = [list(row) for row in zip(*COLUMNS.values(), strict=True)]
FRAME = pandas.DataFrame(COLUMNS)
LINES = "".join(json.dumps(one) + "\n" for one in OBJECTS)
FORMS = {
    "objects, one a line": LINES,
    "without a last line end": LINES[:-1],
    "windows, with a mark": "\ufeff" + LINES.replace("\n", "\r\n"),
    "objects over several lines": "\n".join(json.dumps(one, indent=2) for one in OBJECTS),
    "objects in a list": json.dumps(OBJECTS),
    "indented": json.dumps(OBJECTS, indent=2),
    "objects below a name": json.dumps({"bench": "7", "samples": OBJECTS}),
    "lists that are columns": json.dumps(COLUMNS),
    "columns below a name": json.dumps({"bench": 7, "data": COLUMNS, "tags": ["cold"]}),
    "lists that are rows": json.dumps([list(NAMES), *LISTS]),
    **{f"pandas, {orient}": FRAME.to_json(orient=orient) for orient in ("columns", "index", "records", "split", "table")},
    "pandas, lines": FRAME.to_json(orient="records", lines=True),
}  # fmt: skip

pytestmark = pytest.mark.usefixtures("folder")  # conftest.py


def save(tmp_path: Path, content: str | bytes) -> Path:
    path = tmp_path / "a recording.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("content", FORMS.values(), ids=FORMS)
def test_every_form_is_the_same_recording(tmp_path: Path, content: str) -> None:
    assert_right(import_by(tmp_path, save(tmp_path, content), MAP))


def test_members_of_objects_within_objects_are_columns(tmp_path: Path) -> None:
    lines = [
        {"time": row["time"], "clutch": {"torque": row["torque"], "n": {"speed": row["speed"]}}} for row in OBJECTS
    ]
    path = save(tmp_path, "".join(json.dumps(one) + "\n" for one in lines))
    assert_right(
        import_by(tmp_path, path, MAP.replace('"torque"', '"clutch.torque"').replace('"speed"', '"clutch.n.speed"'))
    )


def test_a_member_that_comes_late_is_a_column_with_missing_values(tmp_path: Path) -> None:
    late = [{k: v for k, v in row.items() if k != "speed" or n > 4} for n, row in enumerate(OBJECTS)]
    late[20]["torque"] = None
    path = save(tmp_path, json.dumps(late))
    text = MAP.replace("[columns]", "[file]\nresample_hz = 100.0\n[columns]")
    run = import_by(tmp_path, path, text)
    assert "speed_rad_s: 5 of 60 samples are not numbers, and count as missing" in convert_run(run)
    assert "torque_nm: 1 of 60 samples are not numbers, and count as missing" in convert_run(run)
    np.testing.assert_allclose(run["speed_rad_s"], SPEED[5:])


def test_units_and_single_numbers_beside_the_table_count(tmp_path: Path) -> None:
    beside = {"sample_rate": 100.0, "units": {"time": "s", "torque": "kNm", "speed": "rad/s"}}
    recording = open_recording(save(tmp_path, json.dumps(beside | COLUMNS)))
    assert [(channel.name, channel.unit) for channel in recording.channels] == [
        ("time", "s"), ("torque", "kNm"), ("speed", "rad/s"),
    ]  # fmt: skip
    assert recording.numbers["sample_rate"] == 100.0
    wrong = MAP.replace('"time", unit = "s"', '"time", unit = "ms"')
    path = save(tmp_path, json.dumps({"sample_rate_hz": 100.0} | COLUMNS))
    assert "by the map, and by the file sample_rate_hz is 100 Hz; set unit = 's'" in find_refusal(tmp_path, path, wrong)


def test_times_numbers_and_flags_as_text_are_read(tmp_path: Path) -> None:
    rows = [
        {"time": f"2026-11-30T10:00:{t:06.3f}Z", "torque": repr(m), "speed": s, "on": n > 9}
        for n, (t, m, s) in enumerate(LISTS)
    ]
    path = save(tmp_path, "".join(json.dumps(one) + "\n" for one in rows))
    run = import_by(tmp_path, path, MAP + 'on_1 = { from = "on" }\n')
    assert_right(run)
    np.testing.assert_array_equal(run["on_1"], np.arange(ROWS) > 9)
    drafted = draft_map(path, open_recording(path))
    assert 'time_s = { from = "time"' in drafted


def test_a_word_among_numbers_is_refused_by_its_row(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = [dict(row) for row in OBJECTS]
    rows[20]["torque"] = "broken"
    assert "'torque' holds text, 'broken' in row 20, which is no number" in find_refusal(
        tmp_path, save(tmp_path, json.dumps(rows)), MAP
    )


def test_an_object_that_was_cut_is_left_out_and_told(tmp_path: Path) -> None:
    run = import_by(tmp_path, save(tmp_path, LINES[:-10]), MAP)
    assert_right(run, slice(ROWS - 1))
    assert f"left out line {ROWS}, the last one, which is cut" in convert_run(run)
    zeros = import_by(tmp_path, save(tmp_path, LINES + "\0" * 50), MAP)
    assert_right(zeros)
    damaged = LINES.replace('"torque": ', "torque ", 1)
    assert "cannot be read: line 1, " in find_refusal(tmp_path, save(tmp_path, damaged), MAP)
    assert "cannot be read: line 1, " in find_refusal(tmp_path, save(tmp_path, json.dumps(OBJECTS)[:-10]), MAP)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ('{"time": 0.0, "torque": 1.0}\n', "it is JSON without a table"),
        ('{"name": "bench", "notes": {"a": "b"}}', "it is JSON without a table"),
        ('[[1, 2], [3]]', "it is JSON without a table"),
        (json.dumps({"t": [0.0, 0.1], "m": [1.0, 2.0, 3.0]}), "its lists have different lengths (t has 2, m has 3)"),
        (json.dumps({"a": OBJECTS, "b": OBJECTS}), "it is JSON without a table"),
        ('{"columns": ["t", "m", "m"], "data": [[0, 1, 2], [1, 2, 3]]}', "its column 'm' is there twice"),
        ('[["t", "m", "m"], [0, 1, 2], [1, 2, 3]]', "its column 'm' is there twice"),
        pytest.param('{"a": ' * 100_000, "nested too deep", id="deep"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_refused(tmp_path: Path, content: str, why: str) -> None:
    path = save(tmp_path, content)
    assert recognise(path).name == "JSON"
    with pytest.raises(InputError) as refused:
        open_recording(path)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)


def test_one_value_a_row_is_refused_by_what_it_is(tmp_path: Path) -> None:
    long = [
        {"time": t, "name": name, "value": row[name]}
        for t, row in zip(TIME, OBJECTS, strict=True)
        for name in NAMES[1:]
    ]
    path = save(tmp_path, "".join(json.dumps(one) + "\n" for one in long))
    sentence = find_refusal(tmp_path, path, MAP.replace('"torque"', '"value"').replace('"speed"', '"value"'))
    assert "has one value a row, of the signal that column 'name' names (torque, speed)" in sentence


def test_the_table_is_removed(tmp_path: Path, folder: Path) -> None:
    recording = open_recording(save(tmp_path, LINES))
    assert len(list(folder.iterdir())) == 1
    del recording
    gc.collect()
    assert not list(folder.iterdir())
