"""A pneumatic cylinder moved against its own pressure. The output is the rod's force, which includes the seal friction.

Equation        F = p A + F_c sign(v),  v and F positive as the rod is pushed in
Assumptions     slow motion: no inertia, and the pressure in the cylinder is that at the sensor
Not modelled    leakage, weight of the rod
References      Zillen 2021, TU Delft (clutch_hil/recordings/maps/pneumatic_seal.toml)
"""

from collections.abc import Mapping
from math import pi

import numpy as np

from clutch_hil.discrepancy.models.linear_motion import Scale, make_candidates
from clutch_hil.discrepancy.models.sliding_contact import Drive, SlidingContact
from clutch_hil.fitting.model import Columns, Output
from clutch_hil.recordings.measured_motion import Motion, smooth
from protocols.files.parameters import ParameterSet
from protocols.files.units import BAR


class PneumaticCylinder(SlidingContact):
    """A cylinder whose position, pressure and rod force were measured."""

    name = "pneumatic_cylinder"
    inputs = ("position_m", "pressure_bar")
    output = Output("rod_force_n", "N", "piston")
    defaults = "pneumatic_cylinder_model.toml"
    scale = Scale(force=30.0, speed=0.02, path=0.04)
    known = make_candidates(
        scale,
        (
            "piston_seal_friction", "direction_asymmetry", "position_ripple", "shaft_angle_ripple", "presliding",
            "stribeck_change", "friction_lag", "friction_level", "friction_fade", "torque_sensor_offset",
            "torque_sensor_gain", "torque_sensor_leakage", "torque_time_offset",
        ),
    )  # fmt: skip

    def _track_motion(self, run: Columns, own: ParameterSet, period: float) -> Motion:
        return smooth(run["position_m"], period, own["motion.window"].si)

    def _list_loads(self, run: Columns, own: ParameterSet, moved: Motion) -> Drive:
        pressure = BAR * np.ascontiguousarray(run["pressure_bar"], float)
        area = 0.25 * pi * own["cylinder.bore"].si ** 2
        return Drive(np.ones(pressure.size), pressure, area * pressure)

    def _list_contact(self, own: ParameterSet) -> Mapping[str, float]:
        return {"clutch_coulomb_intercept": own["friction.coulomb"].si}
