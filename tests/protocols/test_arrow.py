"""Numbers to and from Arrow."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from protocols.files.arrow import convert_numbers, from_rows

ROWS = np.array([[1.0, -0.0, np.nan], [2.5, 1e-308, np.inf]])


COLUMNS_TOGETHER = np.asfortranarray(ROWS)
WHOLE = np.array([[1, 2], [3, 4]])


@pytest.mark.parametrize(
    "rows",
    [ROWS, COLUMNS_TOGETHER, COLUMNS_TOGETHER[:1], ROWS[::-1], ROWS[:0], ROWS[:, :1], WHOLE, np.asfortranarray(WHOLE)],
)
def test_columns_come_back_to_the_bit(rows: np.ndarray) -> None:
    back = [convert_numbers(pa.chunked_array([column])) for column in from_rows(rows)]
    assert np.column_stack(back).tobytes() == np.array(rows, dtype=float, order="C").tobytes()


def test_numbers_of_any_kind_in_any_number_of_chunks() -> None:
    column = pa.chunked_array([pa.array([1, None, 2**60], pa.int64()), pa.array([], pa.int64())])
    assert np.array_equal(convert_numbers(column), [1.0, np.nan, 2.0**60], equal_nan=True)
    assert convert_numbers(pa.chunked_array([], pa.float32())).tolist() == []
    assert convert_numbers(pa.chunked_array([pa.array([0.5, 1.5], pa.float16())])).tolist() == [0.5, 1.5]
    convert_numbers(column)[0] = 3.0  # ours to change


def test_a_run_is_written_and_telemetry_published_without_pandas() -> None:
    works = """
import sys, tempfile, pathlib, numpy as np
from protocols.node import Column
from protocols.files.runs import RunWriter, read_columns
from protocols.telemetry.batch import BatchEncoder, decode
columns, path = [Column("a", "1", "")], pathlib.Path(tempfile.mkdtemp()) / "run.parquet"
with RunWriter(path, columns) as writer:
    writer.append(np.ones((3, 1)))
    writer.finish({})
assert read_columns(path)["a"].tolist() == [1.0, 1.0, 1.0]
columns = [Column("time_s", "s", ""), Column("plant_clock_s", "s", "")]
assert decode(BatchEncoder("plant", 1, 1000.0, 0.0, columns).encode(0, np.ones((3, 2)), 0), "plant").rows.shape == (3, 2)
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", works], check=True)
