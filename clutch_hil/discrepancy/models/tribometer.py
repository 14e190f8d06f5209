"""A tribometer judged by its friction force along the measured displacement, under the measured load.

Equation        F = mu N sign(v)
Assumptions     the friction force is measured behind what little moves with the contact: inertia is left out
Not modelled    the tangential compliance of the instrument, which pre-sliding then includes
References      Coulomb 1785; data: clutch_hil/discrepancy/maps/microtribometer.toml

Serves a simulated tribometer (`plant_sim.rigs.tribometer`) as well: `recorded` makes a run's columns of its `Record`.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from clutch_hil.discrepancy.model import Columns, Output
from clutch_hil.discrepancy.models.measured_motion import Motion, path
from clutch_hil.discrepancy.models.slide import Drive, Slide
from clutch_hil.discrepancy.models.straight import Scale, candidates
from protocols.files.parameters import ParameterSet

if TYPE_CHECKING:
    from plant_sim.rigs.tribometer import Record


class Tribometer(Slide):
    """A contact whose displacement, load and friction force were measured."""

    name = "tribometer"
    inputs = ("displacement_m", "normal_load_n")
    output = Output("friction_force_n", "N", "friction")
    defaults = "tribometer_model.toml"
    known = candidates(
        Scale(force=3.0, speed=1e-3, path=1e-3, load=5.0),
        (
            "direction_asymmetry", "position_ripple", "presliding", "stribeck_change", "friction_lag", "friction_level",
            "friction_fade", "load_dependent_friction", "torque_sensor_offset", "torque_sensor_leakage",
            "torque_time_offset",
        ),
    )  # fmt: skip

    def _moved(self, run: Columns, own: ParameterSet, period: float) -> Motion:
        return path(run["displacement_m"], period, own["motion.flicker"].si)

    def _drive(self, run: Columns, own: ParameterSet, moved: Motion) -> Drive:
        load = np.ascontiguousarray(run["normal_load_n"], float)
        return Drive(load, *np.zeros((2, load.size)))

    def _contact(self, own: ParameterSet) -> Mapping[str, float]:
        return {"clutch_coulomb_slope": own["friction.coefficient"].si}


def recorded(record: "Record", radius: float) -> dict[str, np.ndarray]:
    """Columns of a run, as files have them, of what a simulated tribometer measured; `radius` [m]: mean of the disks."""
    return {
        "time_s": record.time_s,
        "displacement_m": radius * record.angle_measured,
        "normal_load_n": record.normal_measured,
        "friction_force_n": record.torque_measured / radius,
    }
