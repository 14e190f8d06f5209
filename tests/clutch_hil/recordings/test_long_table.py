"""Long tables: one value a row, of the signal that a column names. They are refused, not read as one column of all signals."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 60
TIME = 0.01 * np.arange(ROWS)
VALUES = np.round(np.sin(TIME), 4)
MAP = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "value", unit = "Nm" }\n'


def write_text(path: Path, column: str, words: Sequence[str]) -> None:
    rows = (f"{time:.4f},{word},{value:.4f}" for time, word, value in zip(TIME, words, VALUES, strict=True))
    path.write_text("\n".join([f"time,{column},value", *rows, ""]))


def write_parquet(path: Path, column: str, words: Sequence[str]) -> None:
    pq.write_table(pa.table({"time": TIME, column: list(words), "value": VALUES}), path)


def write_categories(path: Path, column: str, words: Sequence[str]) -> None:
    pq.write_table(pa.table({"time": TIME, column: pa.array(words).dictionary_encode(), "value": VALUES}), path)


WRITERS: dict[str, Callable[[Path, str, Sequence[str]], None]] = {
    "text": write_text, "Parquet": write_parquet, "Parquet, categories": write_categories,
}  # fmt: skip


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("column", ["signal", "_field", "VarName", "what"])
def test_values_of_several_signals_in_one_column_are_refused(tmp_path: Path, kind: str, column: str) -> None:
    WRITERS[kind](tmp_path / "recording", column, ["torque", "speed"] * (ROWS // 2))
    sentence = find_refusal(tmp_path, tmp_path / "recording", MAP)
    assert f"has one value a row, of the signal that column {column!r} names (torque, speed)" in sentence


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    "words",
    [["open"] * 20 + ["slip"] * 20 + ["open"] * 20, ["run 7"] * ROWS, ["0x1F", "2A"] * 30, ["", "mark"] * 30,
     [f"row {row}" for row in range(ROWS)]],
    ids=["a phase", "one name", "numbers", "remarks", "all different"],
)  # fmt: skip
def test_other_columns_of_words_do_not_matter(tmp_path: Path, kind: str, words: list[str]) -> None:
    WRITERS[kind](tmp_path / "recording", "name", words)
    np.testing.assert_array_equal(import_by(tmp_path, tmp_path / "recording", MAP)["torque_nm"], VALUES)
