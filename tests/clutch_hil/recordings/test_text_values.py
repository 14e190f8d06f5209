"""Columns of Parquet, Feather, HDF5, TDMS and MATLAB that have numbers, times or flags as text."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

from tests.clutch_hil.recordings.maps import find_refusal, import_by
from tests.clutch_hil.recordings.text_files import TIME, TORQUE

MAP = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "torque", unit = "Nm" }\n'
FLAG = MAP + 'brake_1 = { from = "brake" }\n'
Columns = dict[str, Sequence[Any]]


def write_parquet(path: Path, columns: Columns) -> None:
    pq.write_table(pa.table({name: list(values) for name, values in columns.items()}), path)


def write_feather(path: Path, columns: Columns) -> None:
    pyarrow.feather.write_feather(pa.table({name: list(values) for name, values in columns.items()}), str(path))


def write_hdf5(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = list(values)


def write_hdf5_table(path: Path, columns: Columns) -> None:
    kinds = [(name, "S40" if isinstance(values[0], str) else "f8") for name, values in columns.items()]
    with h5py.File(path, "w") as file:
        rows = zip(*([v.encode() if isinstance(v, str) else v for v in one] for one in columns.values()), strict=True)
        file["rows"] = np.array(list(rows), kinds)


def write_tdms(path: Path, columns: Columns) -> None:
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("bench", name, list(values)) for name, values in columns.items()])


def write_matlab(path: Path, columns: Columns) -> None:
    scipy.io.savemat(
        path,
        {name: np.array(values, object if isinstance(values[0], str) else float) for name, values in columns.items()},
        appendmat=False,
    )


WRITERS = [write_parquet, write_feather, write_hdf5, write_hdf5_table, write_tdms, write_matlab]
each_format = pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__)
Writer = Callable[[Path, Columns], None]
NUMBERS = [f"{torque:.4f}" for torque in TORQUE]
COMMAS = [f"{torque:.4f}".replace(".", ",") for torque in TORQUE]
ISO = [f"2026-11-29T10:00:{t:06.3f}" for t in TIME]


@each_format
@pytest.mark.parametrize("times", [TIME.tolist(), [f"{t:.2f}" for t in TIME], ISO], ids=["numbers", "text", "dates"])
@pytest.mark.parametrize("torques", [NUMBERS, COMMAS], ids=["point", "comma"])
def test_numbers_and_times_as_text_are_read(
    tmp_path: Path, write: Writer, times: Sequence[Any], torques: Sequence[str]
) -> None:
    path = tmp_path / "recording"
    write(path, {"time": times, "torque": torques})
    run = import_by(tmp_path, path, MAP)
    np.testing.assert_allclose(run["time_s"], TIME, atol=1e-9)
    np.testing.assert_allclose(run["torque_nm"], TORQUE, atol=1e-12)
    assert f"torque: numbers as text, {torques[0][1]!r} as decimal mark" in "; ".join(run.metadata["import"]["done"])


@each_format
def test_on_and_off_as_text_are_flags(tmp_path: Path, write: Writer) -> None:
    path = tmp_path / "recording"
    write(path, {"time": TIME.tolist(), "torque": NUMBERS, "brake": ["Ein" if k % 5 else "Aus" for k in range(60)]})
    np.testing.assert_array_equal(import_by(tmp_path, path, FLAG)["brake_1"], np.arange(60) % 5 > 0)


@each_format
@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ([*NUMBERS[:30], "OL", *NUMBERS[31:]], "holds text, 'OL' in row 30, which is no number"),
        (["cold"] * 60, "holds text, such as 'cold'; allowed are columns of numbers"),
        (["1,234"] * 60, "holds text, such as '1,234'; allowed are columns of numbers"),
        (
            ["998", *["1.234"] * 59],
            "holds text such as '1.234', which can be a fraction or have a mark between thousands",
        ),
        (["03/02/2026"] * 60, "holds text such as '03/02/2026', which can begin with the day or the month"),
        ([*ISO[:30], "later", *ISO[31:]], "holds text, 'later' in row 30, which is no time (ISO 8601)"),
    ],
)
def test_words_and_doubts_are_refused(tmp_path: Path, write: Writer, texts: Sequence[str], message: str) -> None:
    path = tmp_path / "recording"
    write(path, {"time": TIME.tolist(), "torque": texts})
    assert message in find_refusal(tmp_path, path, MAP)


WORDS = FLAG.replace('from = "brake"', 'from = "brake", states = { open = 0, shut = 1 }')


@each_format
def test_words_are_the_numbers_that_the_map_gives_them(tmp_path: Path, write: Writer) -> None:
    words = ["open" if row < 30 else "Shut" for row in range(len(TIME))]
    write(tmp_path / "a.rec", {"time": TIME, "torque": TORQUE, "brake": words})
    run = import_by(tmp_path, tmp_path / "a.rec", WORDS)
    np.testing.assert_array_equal(run["brake_1"], np.arange(len(TIME)) >= 30)
    assert "brake: by the map open is 0, shut is 1" in str(run.metadata["import"])
    write(tmp_path / "b.rec", {"time": TIME, "torque": TORQUE, "brake": [*words[:-1], "stuck"]})
    assert "'stuck' in row 59, which is no number; give its number in `states`" in find_refusal(
        tmp_path, tmp_path / "b.rec", WORDS
    )


@each_format
def test_states_for_numbers_are_told(tmp_path: Path, write: Writer) -> None:
    write(tmp_path / "a.rec", {"time": TIME, "torque": TORQUE, "brake": np.ones(len(TIME))})
    assert "'brake' for brake_1 holds no words" in find_refusal(tmp_path, tmp_path / "a.rec", WORDS)


def test_categories_are_the_numbers_that_the_map_gives_them(tmp_path: Path) -> None:
    words = pa.array(["shut" if row < 30 else "open" for row in range(len(TIME))]).dictionary_encode()
    pq.write_table(pa.table({"time": TIME, "torque": TORQUE, "brake": words}), tmp_path / "a.parquet")
    run = import_by(tmp_path, tmp_path / "a.parquet", WORDS)
    np.testing.assert_array_equal(run["brake_1"], np.arange(len(TIME)) < 30)


@each_format
def test_words_that_come_again_are_told_to_be_states_perhaps(tmp_path: Path, write: Writer) -> None:
    write(tmp_path / "a.rec", {"time": TIME, "torque": TORQUE, "brake": ["left", "right"] * (len(TIME) // 2)})
    assert find_refusal(tmp_path, tmp_path / "a.rec", FLAG).endswith(
        "; set `states` in the map where its words stand for numbers"
    )
