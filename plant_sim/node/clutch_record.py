"""Record of a clutch in a sample: the values that rigs of one and of two clutches have. Each rig declares its columns."""

from numba import njit

from protocols.files.units import BAR, ZERO_CELSIUS


@njit(inline="always")
def note_clutch(record, shown, y):
    """Fill the columns of a clutch in `record`, from its CLUTCH record `shown` and its STATE `y`.

    `record` is of a type that has these columns, under the names of a single clutch.
    """
    record.valve_voltage_v = shown.voltage
    record.cylinder_pressure_bar = shown.pressure
    record.slip_speed_rad_s = shown.slip_speed
    record.oil_temperature_degc = shown.temperature
    record.clutch_torque_nm = shown.clutch_torque
    record.actuators = shown.actuators
    record.truth_valve_pressure_bar = y.valve_pressure / BAR
    record.truth_cylinder_pressure_bar = y.pressure / BAR
    record.truth_piston_position_m = y.position
    record.truth_normal_force_n = y.normal_force
    record.truth_friction_state = y.friction_state
    record.truth_clutch_torque_nm = y.clutch_torque
    record.truth_slip_speed_rad_s = y.slip_speed
    record.truth_oil_temperature_degc = y.temperature - ZERO_CELSIUS
