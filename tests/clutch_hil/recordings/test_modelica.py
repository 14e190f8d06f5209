"""Results of Modelica tools in MATLAB files: names and units, as tables stand or lie, events, constants, minus another one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.maps import import_by

ROWS = 60
TIME = np.round(0.01 * np.arange(ROWS), 2)
TORQUE, SPEED = np.sin(TIME), 100.0 + TIME
NAMES = ("Time", "clutch.tau", "motor.w", "flange.tau", "inertia.J")
TEXTS = ("Time in [s]", "Torque [N.m]", "Speed [rad/s|rpm]", "Torque [N.m]", "Inertia [kg.m2]")
INFO = np.array([[0, 1, 0, -1], [2, 2, 0, -1], [2, 3, 0, -1], [2, -2, 0, -1], [1, 2, 0, 0]], "i4")


def write(path: Path, lying: bool, event: int = 0, **others: Any) -> Path:
    """A result whose row `event` stands twice, as before and after an event."""
    rows = [*range(event + 1), *range(event, ROWS)] if event else list(range(ROWS))
    courses = np.column_stack([TIME, TORQUE, SPEED])[rows]
    if event:
        courses[event, 1] = 1e3  # before the event
    tables = {"dataInfo": INFO, "data_1": np.array([[0.0, 0.5], [0.59, 0.5]]), "data_2": courses}
    texts = {"name": [n.ljust(10) for n in NAMES], "description": [t.ljust(20) for t in TEXTS]}
    if lying:
        tables = {name: table.T for name, table in tables.items()}
        texts = {name: ["".join(column) for column in zip(*rows, strict=True)] for name, rows in texts.items()}
    kind = [text.ljust(11) for text in ("Atrajectory", "1.1", "", "binTrans" if lying else "binNormal")]
    with path.open("wb") as file:
        savemat(file, {"Aclass": kind, **texts, **tables, **others}, format="4")
    return path


@pytest.mark.parametrize("lying", [True, False])
@pytest.mark.parametrize("event", [0, 30])
def test_a_draft_reads_the_result_of_a_modelica_tool(tmp_path: Path, lying: bool, event: int) -> None:
    path = write(tmp_path / "result.mat", lying, event)
    recording = open_recording(path)
    assert [(c.name, c.unit) for c in recording.channels] == [
        ("Time", "s"),
        ("clutch.tau", "N.m"),
        ("motor.w", "rad/s"),
    ]
    assert {channel.rows for channel in recording.channels} == {ROWS}
    assert recording.numbers == {"inertia.J": 0.5}
    assert "flange.tau (minus clutch.tau: take that with scale = -1)" in "; ".join(recording.notes)
    run = import_by(tmp_path, path, draft_map(path, recording))
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["clutch_tau_nm"], TORQUE, rtol=1e-12)
    np.testing.assert_allclose(run["motor_w_rad_s"], SPEED, rtol=1e-12)
    sentence = "left out rows just before an event, at the time of the next one: 1"
    assert (sentence in run.metadata["import"]["done"]) is bool(event)


@pytest.mark.parametrize("info", [INFO[:3], np.empty((0, 4)), INFO + 90.0, np.full((5, 4), np.nan)])
def test_a_table_of_places_that_does_not_fit_makes_no_wrong_column(tmp_path: Path, info: np.ndarray) -> None:
    recording = open_recording(write(tmp_path / "result.mat", False, dataInfo=info))
    assert not {"clutch.tau", "motor.w"} & {channel.name for channel in recording.channels}
