"""TOML text: what is written is read again, whatever a name contains, and a comment stays one line."""

import os
import tomllib
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.identify.calibration import Calibration
from clutch_hil.identify.friction.result import as_toml
from protocols.files.toml_text import make_comment, quote_text

# Names that a file may have
ODD = ["two\nlines", "a\rb", "bell\x07", "rub\x7fout", 'quote"d \\', "Kupplung ä µ", "zero\u200bwidth", "\u2028"]


@pytest.mark.parametrize("name", ODD)
def test_a_text_is_read_as_it_was_written(name: str) -> None:
    assert tomllib.loads(f"{make_comment(name)}\nname = {quote_text(name)}\n") == {"name": name}
    assert tomllib.loads(as_toml({"name": name, "runs": [{"source": name}]})) == {
        "name": name,
        "runs": [{"source": name}],
    }


def test_a_file_name_that_is_no_text_leaves_a_file_that_can_be_read(tmp_path: Path) -> None:
    name = os.fsdecode(b"K\xfcpplung.parquet")  # of Latin-1
    assert tomllib.loads(f"{make_comment(name)}\nname = {quote_text(name)}\n") == {"name": "K\ufffdpplung.parquet"}


@pytest.mark.parametrize("name", [*ODD, os.fsdecode(b"K\xfcpplung")])
def test_a_calibration_can_be_read_whatever_its_runs_are_called(tmp_path: Path, name: str) -> None:
    warned = [f"run {name} lacks the speed demand"]
    Calibration("wet_clutch", [], {}, np.zeros((0, 0)), {name: "00"}, {name: "why"}, warned).write(
        path := tmp_path / "c.toml"
    )
    (run,) = tomllib.loads(path.read_text(encoding="utf-8"))["calibration"]["runs"]
    assert run["file"] == name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
