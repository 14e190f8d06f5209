"""Record of a sample of the power-shift rig: driveline and both clutches. The columns are declared and filled here.

A column is declared once; run files, telemetry and docs/columns.md follow. Columns of a clutch are declared once for both.
"""

from typing import Any

import numpy as np
from numba import njit

from plant_sim.node.clutch_record import note_clutch
from protocols.can.two_clutches import CLUTCHES
from protocols.node import Column, make_record_type

_INPUT_COLUMNS = (
    Column("time_s", "s", "time since the run's start"),
    Column("input_speed_demand_rad_s", "rad/s", "speed demand of the motor, acting from this row on"),
    Column("motor_torque_nm", "Nm", "measured torque of the motor"),
)
_CLUTCH_COLUMNS = (  # {} is the clutch, a or b
    Column("valve_voltage_{}_v", "V", "voltage to the V/A converter, acting from this row on"),
    Column("torque_demand_{}_nm", "Nm", "the supervisor's demand to the controller"),
    Column("cylinder_pressure_{}_bar", "bar", "measured oil pressure behind the piston"),
    Column("slip_speed_{}_rad_s", "rad/s", "measured slip speed, from encoder counts"),
    Column("slip_angle_{}_rad", "rad", "encoder angle of the clutch's input against its output"),
    Column("oil_temperature_{}_degc", "degC", "measured oil temperature"),
    Column("clutch_torque_{}_nm", "Nm", "measured clutch torque, for validation"),
    Column(
        "actuators_{}",
        "1",
        "valve: 0 no command yet, 1 commanded, 2 stale; 3 lost, 4 late, 5 from two senders: closed until a command to close",
    ),
    Column("truth_valve_pressure_{}_bar", "bar", "pressure after the valve"),
    Column("truth_cylinder_pressure_{}_bar", "bar", "pressure behind the piston"),
    Column("truth_piston_position_{}_m", "m", "position of the piston, 0 at rest"),
    Column("truth_normal_force_{}_n", "N", "force on the plates"),
    Column("truth_friction_state_{}", "1", "m of eq. 6.9"),
    Column("truth_clutch_torque_{}_nm", "Nm", "torque that the clutch transmits, M"),
    Column("truth_slip_speed_{}_rad_s", "rad/s", "input speed minus ratio times output speed"),
    Column("truth_oil_temperature_{}_degc", "degC", "oil temperature, T"),
    Column("truth_heat_{}_j", "J", "friction heat since the start"),
)
_DRIVELINE_COLUMNS = (
    Column("truth_motor_torque_nm", "Nm", "torque of the motor, M_m"),
    Column("truth_input_speed_rad_s", "rad/s", "speed of the motor and of both clutches' inputs"),
    Column("truth_output_speed_rad_s", "rad/s", "speed of the output shaft"),
    Column("truth_vehicle_speed_m_s", "m/s", "speed of the vehicle: output speed times the wheel's radius"),
    Column("truth_output_torque_nm", "Nm", "torque of the output shaft, i_a M_a + i_b M_b"),
    Column("truth_road_torque_nm", "Nm", "torque of rolling resistance, drag and grade about the output shaft"),
    Column("truth_input_work_j", "J", "work of the motor since the start"),
    Column("truth_road_work_j", "J", "work into the road since the start"),
)
COLUMNS = (
    *_INPUT_COLUMNS,
    *(column._replace(name=column.name.format(clutch)) for clutch in CLUTCHES for column in _CLUTCH_COLUMNS),
    *_DRIVELINE_COLUMNS,
)
_CLUTCH = make_record_type([column._replace(name=column.name.replace("_{}", "")) for column in _CLUTCH_COLUMNS])
RECORD = np.dtype(
    [
        *make_record_type(_INPUT_COLUMNS).descr,
        *((clutch, _CLUTCH) for clutch in CLUTCHES),
        *make_record_type(_DRIVELINE_COLUMNS).descr,
    ]
)  # fmt: skip


@njit(cache=True, nogil=True)
def note_sample(
    row: Any, time: Any, interfaces: Any, driveline: Any, rig_a: Any, rig_b: Any, wheel_radius: Any
) -> None:
    """Fill `row` (columns,), the memory of a RECORD.

    time [s] of the run; interfaces (1,) of INTERFACE; driveline (1,) of DRIVELINE; rig_a, rig_b (1,) of STATE; wheel_radius
    [m].
    """
    record, interface, line = row.view(RECORD)[0], interfaces[0], driveline[0]
    record.time_s = time
    record.input_speed_demand_rad_s = interface.speed_demand
    record.motor_torque_nm = interface.clutches[0].motor_torque
    _note_clutch(record.a, interface.clutches[0], rig_a[0], line.heat_a)
    _note_clutch(record.b, interface.clutches[1], rig_b[0], line.heat_b)
    record.truth_motor_torque_nm = line.motor_torque
    record.truth_input_speed_rad_s = line.input_speed
    record.truth_output_speed_rad_s = line.output_speed
    record.truth_vehicle_speed_m_s = line.output_speed * wheel_radius
    record.truth_output_torque_nm = line.output_torque
    record.truth_road_torque_nm = line.road_torque
    record.truth_input_work_j = line.input_work
    record.truth_road_work_j = line.road_work


@njit
def _note_clutch(record, shown, y, heat):
    """Fill the part of a clutch from its CLUTCH record `shown`, its STATE `y` and its heat [J]."""
    note_clutch(record, shown, y)
    record.torque_demand_nm = shown.torque_demand
    record.slip_angle_rad = shown.angle
    record.truth_heat_j = heat
