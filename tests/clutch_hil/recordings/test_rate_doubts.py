"""A rate that a map states, or a number of the row that it takes for seconds: what the file says of its times is told."""

from pathlib import Path

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter

from tests.clutch_hil.recordings.maps import import_by

ROWS = 60
TORQUE = np.round(np.sin(0.01 * np.arange(ROWS)), 4)
DOUBT = "by the file the rate is another one"


def make_map(time: str) -> str:
    return f'[columns]\ntime_s = {{ {time} }}\ntorque_nm = {{ from = "torque", unit = "Nm" }}\n'


def write_text(tmp_path: Path, above: str, first: str, step: float) -> Path:
    rows = (f"{step * row:g},{torque:.4f}" for row, torque in enumerate(TORQUE))
    path = tmp_path / "recording.csv"
    path.write_text("\n".join([*([above] if above else []), f"{first},torque", *rows, ""]))
    return path


def import_told(tmp_path: Path, path: Path, time: str) -> str:
    return "; ".join(import_by(tmp_path, path, make_map(time)).metadata["import"]["done"])


@pytest.mark.parametrize(
    ("above", "rate", "doubt"),
    [
        ("Sample rate [Hz]: 200", 100.0, True),
        ("Sample rate [Hz]: 100", 100.0, False),
        ("Abtastrate: 0.1", 100.0, False),
    ],
)
def test_a_rate_that_the_head_denies_is_told(tmp_path: Path, above: str, rate: float, doubt: bool) -> None:
    told = import_told(tmp_path, write_text(tmp_path, above, "count", 2.0), f"rate_hz = {rate}")
    assert (DOUBT in told) == doubt


def test_a_rate_that_increments_deny_is_told(tmp_path: Path) -> None:
    path = tmp_path / "recording.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("bench", "torque", TORQUE, {"wf_increment": 0.01, "unit_string": "Nm"})])
    told = import_told(tmp_path, path, "rate_hz = 50.0")
    assert f"{DOUBT}: torque is 100 Hz" in told
    assert "'bench/time', which are times by the file, are not used" in told
    assert DOUBT not in import_told(tmp_path, path, "rate_hz = 100.0")


@pytest.mark.parametrize(("name", "step", "doubt"), [("Sample", 1.0, True), ("No.", 1.0, True), ("Sample", 0.5, False)])
def test_a_number_of_the_row_that_is_taken_for_seconds_is_told(
    tmp_path: Path, name: str, step: float, doubt: bool
) -> None:
    told = import_told(tmp_path, write_text(tmp_path, "", name, step), f'from = "{name}", unit = "s"')
    assert (f"{name!r} counts rows, perhaps; set time_s = {{ rate_hz = ... }} then" in told) == doubt
