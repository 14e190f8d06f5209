"""A position axis. The output is the motor's force, because the closed loop hides missing effects in the position.

Equation        F_m = M x'' + F_c sign(v) + F_v v, x later by the delay of drive and sample
                                                                     (inverse dynamics; Janot, Gautier and Brunot 2019)
                F_c proportional to the load where the run has a column `normal_load_n`
Inputs          the measured position; speed and acceleration are derived from it without delay (`measured_motion.py`)
Assumptions     rigid; the column of the force is the force of the motor, in most rigs its current or its demand
Valid range     motions slower than the window of the differentiator (`motion.window`), noise well below them
Not modelled    flexible modes
References      Janot, Gautier and Brunot 2019, Data set and reference models of EMPS, Workshop on Nonlinear System
                Identification Benchmarks; Gautier 1997

A simulated axis (`plant_sim.rigs.position_axis`) can be evaluated as well: `to_columns` converts its `Run`.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from clutch_hil.discrepancy.models.linear_motion import Scale, make_candidates
from clutch_hil.discrepancy.models.sliding_contact import Drive, SlidingContact
from clutch_hil.fitting.model import Columns, Output
from clutch_hil.recordings.measured_motion import Motion, smooth
from protocols.files.parameters import ParameterSet

if TYPE_CHECKING:
    from plant_sim.rigs.position_axis import Run

_LOAD = "normal_load_n"  # column that a run may have


class PositionAxis(SlidingContact):
    """An axis whose position and motor force were measured."""

    name = "position_axis"
    inputs = ("position_m",)
    output = Output("motor_force_n", "N", "friction")
    defaults = "position_axis_model.toml"
    load = _LOAD
    scale = Scale(force=50.0, speed=0.15, path=0.25, load=150.0)
    known = make_candidates(
        scale,
        (
            "direction_asymmetry", "position_ripple", "shaft_angle_ripple", "presliding", "stribeck_change",
            "friction_lag", "friction_level", "friction_fade", "load_dependent_friction", "motor_torque_ripple",
            "torque_sensor_offset", "torque_sensor_leakage", "torque_time_offset",
        ),
    )  # fmt: skip

    def _track_motion(self, run: Columns, own: ParameterSet, period: float) -> Motion:
        time = run["time_s"]
        at = time + own["motor.delay"].si  # time of the motion that belongs to the recorded force
        return Motion(*(np.interp(at, time, one) for one in smooth(run["position_m"], period, own["motion.window"].si)))

    def _list_loads(self, run: Columns, own: ParameterSet, moved: Motion) -> Drive:
        n = moved.position.size
        load = np.ascontiguousarray(run[_LOAD], float) if _LOAD in run else np.full(n, own["friction.load"].si)
        return Drive(load, np.zeros(n), own["table.mass"].si * moved.acceleration)

    def _list_contact(self, own: ParameterSet) -> Mapping[str, float]:
        p = own.list_si("friction")
        return {"clutch_coulomb_slope": p["coulomb"] / p["load"], "clutch_viscous_intercept": p["viscous"]}


def to_columns(run: "Run") -> dict[str, np.ndarray]:
    """Return the columns of a run file from the record of a simulated axis."""
    return {
        "time_s": run.time_s,
        "position_m": run.position,
        "motor_force_n": run.motor_force,
        _LOAD: run.normal_load,
    }
