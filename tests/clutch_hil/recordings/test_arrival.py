"""Text with the time at which a serial monitor received each line, as that of Arduino writes it."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.text_files import (
    MAP,
    SPEED,
    TIME,
    TORQUE,
    assert_right,
    make_table,
    read,
)


def stamp(table: str) -> str:
    """The table as a serial monitor shows it: each line is received 3 ms late."""
    return "".join(f"{write_arrival(10 * n - 7)} -> {line}\n" for n, line in enumerate(table.splitlines()))


def write_arrival(ms: int) -> str:
    """A time of day so many ms after 23:59:59.700."""
    return f"23:59:59.{ms + 700:03d}" if ms < 300 else f"00:00:00.{ms - 300:03d}"


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_the_times_of_arrival_are_a_column(tmp_path: Path, delimiter: str) -> None:
    table = stamp(make_table(delimiter, header=delimiter.join(["time", "torque", "speed"])))
    assert_right(read(tmp_path, table))
    run = read(tmp_path, table, columns=MAP.replace('"time"', '"arrival_time"'))
    np.testing.assert_allclose(run["time_s"], TIME, atol=1e-9)
    np.testing.assert_array_equal(run["torque_nm"], TORQUE)
    np.testing.assert_array_equal(run["speed_rad_s"], SPEED)


def test_a_draft_takes_the_time_of_the_sender_if_there_is_one(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_text(stamp(make_table(header="millis,torque,speed")))
    assert 'time_s = { from = "millis", unit = "ms" }' in draft_map(path, open_recording(path))
    path.write_text(stamp(make_table(header="force,torque,speed")))
    assert 'time_s = { from = "arrival_time" }' in draft_map(path, open_recording(path))
