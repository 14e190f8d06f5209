"""A tribometer. The output is its friction force, along the measured displacement and under the measured load.

Equation        F = mu N sign(v)
Assumptions     the mass between contact and force sensor is small: no inertia
Not modelled    the tangential compliance of the instrument; a fitted pre-sliding stiffness includes it
References      Coulomb 1785; data: clutch_hil/recordings/maps/microtribometer.toml

A simulated tribometer (`plant_sim.rigs.tribometer`) can be evaluated as well: `to_columns` converts its `Record`.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from clutch_hil.discrepancy.models.linear_motion import Scale, make_candidates
from clutch_hil.discrepancy.models.sliding_contact import Drive, SlidingContact
from clutch_hil.fitting.model import Columns, Output
from clutch_hil.recordings.measured_motion import Motion, compute_path
from protocols.files.parameters import ParameterSet

if TYPE_CHECKING:
    from plant_sim.rigs.tribometer import Record


class Tribometer(SlidingContact):
    """A contact whose displacement, load and friction force were measured."""

    name = "tribometer"
    inputs = ("displacement_m", "normal_load_n")
    output = Output("friction_force_n", "N", "friction")
    defaults = "tribometer_model.toml"
    load = "normal_load_n"
    lag = 0.4  # s: pre-sliding of the micro-tribometer's strokes of 4 s takes 0.27 s
    scale = Scale(force=3.0, speed=1e-3, path=1e-3, load=5.0)
    known = make_candidates(
        scale,
        (
            "direction_asymmetry", "position_ripple", "presliding", "stribeck_change", "friction_lag", "friction_level",
            "friction_fade", "load_dependent_friction", "torque_sensor_offset", "torque_sensor_leakage",
            "torque_time_offset",
        ),
    )  # fmt: skip

    def _track_motion(self, run: Columns, own: ParameterSet, period: float) -> Motion:
        return compute_path(run["displacement_m"], period, own["motion.flicker"].si)

    def _list_loads(self, run: Columns, own: ParameterSet, moved: Motion) -> Drive:
        load = np.ascontiguousarray(run[self.load], float)
        return Drive(load, *np.zeros((2, load.size)))

    def _list_contact(self, own: ParameterSet) -> Mapping[str, float]:
        return {"clutch_coulomb_slope": own["friction.coefficient"].si}


def to_columns(record: "Record", radius: float) -> dict[str, np.ndarray]:
    """Return the columns of a run file from the record of a simulated tribometer; `radius` [m]: mean radius of the disks."""
    return {
        "time_s": record.time_s,
        "displacement_m": radius * record.angle_measured,
        "normal_load_n": record.normal_measured,
        "friction_force_n": record.torque_measured / radius,
    }
