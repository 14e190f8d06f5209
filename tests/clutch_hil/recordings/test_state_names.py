"""Names of states that are numbers, or on and off: a gear `3` is 3, wherever it stands in the list of names."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import matio
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal

from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 60
TIME = 0.01 * np.arange(ROWS)
GEARS = ["4", "3", "5"]  # in no order, as a table has them that takes names as they come


def write_parquet(path: Path, names: list[str | None]) -> None:
    gear = pa.array(names, pa.string()).dictionary_encode()
    pq.write_table(pa.table({"time": TIME, "gear": gear}), path, row_group_size=25)


def write_matlab(version: str) -> Callable[[Path, list[str | None]], None]:
    def write(path: Path, names: list[str | None]) -> None:
        matio.save_to_mat(path, {"time": TIME[:, None], "gear": pd.Categorical(names)}, version=version)

    return write


WRITERS = {"Parquet": write_parquet, "MATLAB 7": write_matlab("v7"), "MATLAB 7.3": write_matlab("v7.3")}


def read_gear(path: Path) -> tuple[np.ndarray, str, str]:
    recording = open_recording(path)
    (signal,) = recording.read([choose_channel(path, recording.channels, "gear")])
    return signal.values, signal.channel.kind, " ".join([*recording.notes, signal.channel.comment])


@pytest.mark.parametrize("kind", WRITERS)
def test_names_that_are_numbers_are_these_numbers(tmp_path: Path, kind: str) -> None:
    names: list[str | None] = [GEARS[row // 20] for row in range(ROWS)]
    WRITERS[kind](tmp_path / "recording", names)
    values, status, sentence = read_gear(tmp_path / "recording")
    np.testing.assert_array_equal(values, [float(name or "nan") for name in names])
    assert status == "status"
    assert " = " not in sentence  # no list of codes, which the values are not


@pytest.mark.parametrize("kind", WRITERS)
def test_on_is_one_and_off_is_zero_whichever_comes_first(tmp_path: Path, kind: str) -> None:
    WRITERS[kind](tmp_path / "recording", ["On", "Off"] * (ROWS // 2))
    np.testing.assert_array_equal(read_gear(tmp_path / "recording")[0], [1.0, 0.0] * (ROWS // 2))


@pytest.mark.parametrize("kind", WRITERS)
def test_what_has_no_name_is_no_value(tmp_path: Path, kind: str) -> None:
    WRITERS[kind](tmp_path / "recording", ["4", None, "2"] * (ROWS // 3))
    np.testing.assert_array_equal(read_gear(tmp_path / "recording")[0], [4.0, np.nan, 2.0] * (ROWS // 3))


@pytest.mark.parametrize("kind", WRITERS)
def test_other_names_are_counted_and_told(tmp_path: Path, kind: str) -> None:
    WRITERS[kind](tmp_path / "recording", ["D", "N", "3"] * (ROWS // 3))
    values, _, sentence = read_gear(tmp_path / "recording")
    assert len(set(values)) == 3
    assert " = D" in sentence


# --- names of the numbers that a file holds -----------------------------------------------------------------------------

COUNTS = np.arange(ROWS) % 4


def write_log(tmp_path: Path, table: str) -> tuple[Path, str]:
    database = tmp_path / "car.dbc"
    signal = ' SG_ gear : 0|4@1+ (1,0) [0|15] "" E\n'
    database.write_text(f'VERSION ""\nBU_: E\nBO_ 256 ENG: 8 E\n{signal}VAL_ 256 gear {table};\n')
    frames = (f"({time:.6f}) can0 100#{count:02X}00000000000000\n" for time, count in zip(TIME, COUNTS, strict=True))
    (tmp_path / "bus.log").write_text("".join(frames))
    return (
        tmp_path / "bus.log",
        f'[file]\ndbc = "{database}"\n[columns]\ngear_1 = {{ from = "ENG.gear", unit = "1" }}\n',
    )


GEAR = '[columns]\ngear_1 = { from = "gear", unit = "1" }\n'


def write_mdf(version: str, ranged: bool = False) -> Callable[[Path, str], tuple[Path, str]]:
    def write(tmp_path: Path, table: str) -> tuple[Path, str]:
        conversion: dict[str, Any] = {"default": b""}
        for place, (number, name) in enumerate(re.findall(r'(\d+) "(.*?)"', table)):
            ends = ("lower", "upper") if ranged else ("val",)
            conversion |= {f"{end}_{place}": int(number) for end in ends} | {f"text_{place}": name.encode()}
        with MDF(version=version) as mdf:
            mdf.append([Signal(COUNTS.astype("u1"), TIME, name="gear", conversion=conversion)])
            return Path(mdf.save(tmp_path / "bus")), GEAR

    return write


def write_hdf5(tmp_path: Path, table: str) -> tuple[Path, str]:
    names = {
        f"{name}{' ' * int(number)}": int(number) for number, name in re.findall(r'(\d+) "(.*?)"', table)
    }  # unique
    with h5py.File(tmp_path / "bus.h5", "w") as file:
        file["time_s"] = TIME
        file.create_dataset("gear", data=COUNTS.astype("u1"), dtype=h5py.enum_dtype(names, basetype="u1"))
    return tmp_path / "bus.h5", GEAR


NAMED: dict[str, Callable[[Path, str], tuple[Path, str]]] = {
    "bus log": write_log,
    "MDF 4": write_mdf("4.10"),
    "MDF 4, ranges": write_mdf("4.10", ranged=True),
    "MDF 3": write_mdf("3.30"),
    "HDF5": write_hdf5,
}


@pytest.mark.parametrize("write", NAMED.values(), ids=NAMED)
@pytest.mark.parametrize(
    ("table", "wanted"),
    [
        ('0 "4" 1 "3" 2 "2" 3 "1"', [4, 3, 2, 1]),
        ('0 "On" 1 "Off" 2 "On" 3 "Off"', [1, 0, 1, 0]),
        ('0 "0" 1 "1" 2 "2" 3 "3"', [0, 1, 2, 3]),
        ('0 "N" 1 "2" 2 "3" 3 "4"', [0, 1, 2, 3]),  # a word among them: no name counts
    ],
)
def test_names_count_where_they_say_other_values(
    tmp_path: Path, write: Callable[[Path, str], tuple[Path, str]], table: str, wanted: list[int]
) -> None:
    path, columns = write(tmp_path, table)
    run = import_by(tmp_path, path, columns + 'time_s = { from = "time_s", unit = "s" }\n')
    np.testing.assert_array_equal(run["gear_1"], np.array(wanted)[COUNTS])
    sentence = "its names differ from its numbers, and the names are used" in " ".join(run.metadata["import"]["done"])
    assert sentence == (wanted != [0, 1, 2, 3])


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ('0 "Neutral" 1 "Gear 2" 2 "Gear 1" 3 "Reverse"', "1 is 'Gear 2', 2 is 'Gear 1'"),
        ('0 "Neutral" 1 "Gear 1" 2 "Gear 2" 3 "Reverse"', ""),
        ('0 "Neutral" 1 "Mode 7" 2 "Gear 9" 3 "Reverse"', ""),
    ],
)
@pytest.mark.parametrize("write", [write_log, write_mdf("4.10")], ids=["bus log", "MDF"])
def test_other_numbers_in_names_are_told(
    tmp_path: Path, write: Callable[[Path, str], tuple[Path, str]], table: str, sentence: str
) -> None:
    path, columns = write(tmp_path, table)
    run = import_by(tmp_path, path, columns + 'time_s = { from = "time_s" }\n')
    np.testing.assert_array_equal(run["gear_1"], COUNTS)
    notes = " ".join(run.metadata["import"]["done"])
    assert (
        (f"although its names contain others: {sentence}" in notes)
        if sentence
        else ("names contain others" not in notes)
    )


def test_a_word_for_several_numbers_names_none(tmp_path: Path) -> None:
    conversion: dict[str, Any] = {"default": b"", "lower_0": 0, "upper_0": 1, "text_0": b"5"}
    conversion |= {"lower_1": 2, "upper_1": 3, "text_1": b"7"}
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(COUNTS.astype("u1"), TIME, name="gear", conversion=conversion)])
        path = Path(mdf.save(tmp_path / "bus"))
    np.testing.assert_array_equal(import_by(tmp_path, path, GEAR + 'time_s = { from = "time_s" }\n')["gear_1"], COUNTS)


BY_WORDS = 'states = { open = 10, "HALF open" = 15, closed = 20 }'


@pytest.mark.parametrize("write", NAMED.values(), ids=NAMED)
def test_states_of_the_map_give_the_names_of_a_file_other_numbers(
    tmp_path: Path, write: Callable[[Path, str], tuple[Path, str]]
) -> None:
    path, columns = write(tmp_path, '0 "Open" 1 "Half open" 2 "Closed" 3 "Half Open "')
    columns = columns.replace('unit = "1"', BY_WORDS) + 'time_s = { from = "time_s", unit = "s" }\n'
    run = import_by(tmp_path, path, columns)
    np.testing.assert_array_equal(run["gear_1"], np.array([10.0, 15.0, 20.0, 15.0])[COUNTS])
    assert "by the map open is 10, HALF open is 15, closed is 20" in " ".join(run.metadata["import"]["done"])


@pytest.mark.parametrize("write", NAMED.values(), ids=NAMED)
def test_a_name_without_a_number_is_refused_and_one_for_no_value_is_none(
    tmp_path: Path, write: Callable[[Path, str], tuple[Path, str]]
) -> None:
    path, columns = write(tmp_path, '0 "Open" 1 "Half open" 2 "Closed" 3 "SNA"')
    columns += 'time_s = { from = "time_s", unit = "s" }\n'
    without = columns.replace('unit = "1"', "states = { open = 10, closed = 20 }")
    refusal = find_refusal(tmp_path, path, without)
    assert "gear' holds 'Half open' for 1; give its number in `states` of the map" in refusal
    assert "gear_1 is not a number in row 3" in find_refusal(tmp_path, path, columns.replace('unit = "1"', BY_WORDS))
    path, columns = write(tmp_path, '0 "Open" 1 "Half open" 2 "Closed"')
    columns = columns.replace('unit = "1"', BY_WORDS) + 'time_s = { from = "time_s", unit = "s" }\n'
    assert "gear' holds 3, which has no name; give its number in" in find_refusal(tmp_path, path, columns)
