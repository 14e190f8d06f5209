"""Effects of the truth: those of the catalogue by independent laws, and others that are not in the catalogue.

The laws, their sources, and how they differ from those of the catalogue are in truth_valve, truth_clutch, truth_drive and
truth_sensors. Unknown effects are in truth_motion, truth_plates and truth_simulation.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Law:
    """An effect of the truth.

    `unit`, `si`: unit of its strength and factor to SI. `usual`: strength that gives a gap of about 2 at 2 % noise.
    `most`: largest strength that is physically possible. `signed`: both signs are possible. `variants`: number of laws.
    `reach`: gap at 2 % noise with the largest strength, with a margin for seeds; infinite stands for far above 4 at any
    noise.
    """

    name: str
    block: str
    unit: str
    si: float
    usual: float
    most: float
    signed: bool = False
    variants: int = 2
    reach: float = np.inf


_BAR = 1e5
CATALOGUE_LAWS = (
    Law("valve_deadband", "valve", "V", 1.0, 0.0174, 1.0),
    Law("valve_hysteresis", "valve", "bar", _BAR, 0.11, 2.0),
    Law("spool_stiction", "valve", "bar", _BAR, 0.1, 2.0),
    Law("valve_delay", "valve", "ms", 1e-3, 10.0, 50.0, reach=6.2),
    Law("slower_valve", "valve", "ms", 1e-3, 8.0, 150.0),
    Law("valve_gain", "valve", "1", 1.0, 0.014, 0.3, signed=True),
    Law("supply_sag", "valve", "1", 1.0, 0.085, 0.8, reach=7.2),
    Law("entrapped_air", "hydraulics", "cm^3", 1e-6, 15.0, 50.0, reach=4.8),
    Law("internal_leakage", "hydraulics", "m^3/(s bar)", 1.0 / _BAR, 2.6e-06, 1e-4),
    Law("centrifugal_pressure", "hydraulics", "bar/(rad/s)^2", _BAR, 0.00018, 0.001, reach=5.2),
    Law("piston_seal_friction", "piston", "N", 1.0, 48.0, 1000.0),
    Law("clearance_change", "piston", "mm", 1e-3, 0.064, 2.0),
    Law("return_spring_change", "piston", "1", 1.0, 0.026, 0.5, signed=True),
    Law("plate_waviness", "piston", "mm", 1e-3, 0.12, 0.5, reach=8.5),
    Law("coulomb_temperature", "friction", "1/K", 1.0, 0.0065, 0.01, signed=True, reach=2.0),
    Law("friction_level", "friction", "1", 1.0, 0.038, 0.5, signed=True),
    Law("load_dependent_friction", "friction", "1", 1.0, 0.04, 0.9),
    Law("friction_fade", "friction", "1/J", 1.0, 8e-05, 0.01),
    Law("stribeck_change", "friction", "1", 1.0, 0.26, 3.0),
    Law("friction_lag", "friction", "1", 1.0, 3.0, 19.0, reach=5.7),
    Law("squeeze_film", "friction", "1", 1.0, 3.0, 20.0, reach=2.9),
    Law("shaft_angle_ripple", "friction", "1", 1.0, 0.05, 0.5),
    Law("drag_torque", "friction", "Nm s/rad", 1.0, 0.11, 0.5, reach=7.1),
    Law("direction_asymmetry", "friction", "1", 1.0, 0.05, 0.5, signed=True),
    Law("position_ripple", "friction", "Nm", 1.0, 0.83, 10.0),
    Law("presliding", "friction", "rad", 1.0, 0.068, 0.1, reach=2.4),
    Law("shaft_compliance", "drive", "rad/Nm", 1.0, 0.0032, 0.1),
    Law("backlash", "drive", "rad", 1.0, 0.04, 0.2, reach=4.5),
    Law("motor_torque_ripple", "drive", "1", 1.0, 0.06, 0.5),
    Law("pressure_sensor_gain", "sensors", "1", 1.0, 0.039, 0.5, signed=True),
    Law("pressure_sensor_offset", "sensors", "bar", _BAR, 0.12, 2.0, signed=True),
    Law("torque_sensor_gain", "sensors", "1", 1.0, 0.033, 0.5, signed=True),
    Law("torque_sensor_offset", "sensors", "Nm", 1.0, 0.6, 20.0, signed=True),
    Law("torque_sensor_leakage", "sensors", "1/s", 1.0, 0.0055, 10.0),
    Law("torque_time_offset", "sensors", "ms", 1e-3, 9.0, 50.0, reach=6.7),
    Law("pressure_time_offset", "sensors", "ms", 1e-3, 17.0, 50.0, reach=3.6),
    Law("temperature_sensor_lag", "sensors", "s", 1.0, 1.4, 60.0),
    Law("sensor_saturation", "sensors", "1/V", 1.0, 0.2, 1.0),
    Law("coarse_quantisation", "sensors", "V", 1.0, 0.33, 1.25, reach=6.5),
)
UNKNOWN_LAWS = (
    Law("line_resonance", "hydraulics", "bar s^2/m^3", _BAR, 70.0, 2000.0, variants=1),
    Law("valve_asymmetry", "valve", "1", 1.0, 0.3, 0.9, variants=1, reach=4.1),
    Law("demand_filter", "drive", "ms", 1e-3, 19.0, 1000.0, variants=1),
    Law("torque_flange_speed", "sensors", "Nm/(rad/s)^2", 1.0, 2.5e-3, 0.1, variants=1),
    Law("hydrodynamic_lift", "friction", "bar/(rad/s)^2", _BAR, 0.00018, 5e-3, variants=1),
    Law("torque_bursts", "friction", "Nm", 1.0, 3.8, 60.0, variants=1),
    Law("cooling_flow", "friction", "1", 1.0, 0.85, 40.0, variants=1),
    Law("bearing_drag", "drive", "Nm s/rad", 1.0, 0.045, 1.0, variants=1),
    Law("pump_ripple", "hydraulics", "bar", _BAR, 0.11, 5.0, variants=1),
    Law("ground_loop", "sensors", "bar/Nm", _BAR, 0.0076, 0.2, variants=1),
    Law("drive_lag", "drive", "ms", 1e-3, 12.0, 60.0, variants=1, reach=7.3),
)
LAWS = {law.name: law for law in (*CATALOGUE_LAWS, *UNKNOWN_LAWS)}
# one number for each effect: strengths, forms or laws as the kernel takes them
LAW_RECORD = np.dtype([(name, np.float64) for name in LAWS])
