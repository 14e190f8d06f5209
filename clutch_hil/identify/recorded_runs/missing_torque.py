"""Identification of a clutch without a torque sensor, by the torque of its motor, which drives inertia and clutch.

Equation        M = M_m - J d omega/dt - o replaces the clutch torque in start values, needs and checks. The fit compares the
                  motor torque, and does not use M                                                    docs/rig.md, 8
                J: as declared or held; o: mean of M_m - J d omega/dt where the cylinder is vented
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.clutch_effects import EFFECTS, TORQUE, find_vented
from clutch_hil.identify.recorded_runs.run_evidence import Evidenced
from protocols.errors import name_run

CLUTCH_TORQUE = "clutch_torque_nm"
EFFECTS_WITHOUT_TORQUE = tuple(name for name in EFFECTS if name != TORQUE)
_MOTOR_TORQUE, _SLIP = "motor_torque_nm", "slip_speed_rad_s"
# s, width of the Gaussian filter that differentiates the slip: a noise of 0.02 rad/s at 1 kHz is then 0.3 rad/s^2
_SMOOTH = 0.01


def describe_missing_torque(runs: Evidenced) -> str:
    """Return a sentence if a run has no clutch torque, or one computed from the motor torque; else ""."""
    lacking = [
        f"{name_run(name)} lacks {CLUTCH_TORQUE}" for name, run in runs.measured.items() if CLUTCH_TORQUE not in run
    ]
    if name := runs.find_formula(CLUTCH_TORQUE, _MOTOR_TORQUE):
        lacking.append(f"{CLUTCH_TORQUE} of {name_run(name)} is computed from the motor's torque")
    return f"{lacking[0]}: the clutch is identified by the torque of its motor" if lacking else ""


def complete_torque(runs: Evidenced, inertia: float) -> Evidenced:
    """Return the runs with a clutch torque whose zero is that of the vented rows. inertia [kg m^2]: for a missing torque."""
    return replace(
        runs, measured={name: _remove_zero(complete_torques(run, inertia)) for name, run in runs.measured.items()}
    )


def complete_torques(run: Columns, inertia: float) -> Columns:
    """Return a run with clutch or motor torque from the other one, where one is missing. inertia [kg m^2]."""
    if len({CLUTCH_TORQUE, _MOTOR_TORQUE} & set(run)) != 1 or _SLIP not in run:
        return run
    period = float(run["time_s"][1] - run["time_s"][0])
    turning = inertia * gaussian_filter1d(run[_SLIP], _SMOOTH / period, order=1) / period
    if CLUTCH_TORQUE in run:
        return {**run, _MOTOR_TORQUE: run[CLUTCH_TORQUE] + turning}
    return {**run, CLUTCH_TORQUE: run[_MOTOR_TORQUE] - turning}


def _remove_zero(run: Columns) -> Columns:
    torque, vented = run[CLUTCH_TORQUE], find_vented(run)
    return {**run, CLUTCH_TORQUE: torque - (float(np.mean(torque[vented])) if np.any(vented) else 0.0)}
