"""Record of a sample of the wet-clutch rig: measured values, then true values. The columns are declared and filled here.

A column is declared once; run files, telemetry, live views and docs/columns.md follow. Names of true values begin with
`truth_`: a blind recording seals these columns.
"""

from typing import Any

from numba import njit

from plant_sim.node.clutch_record import note_clutch
from plant_sim.rigs.clutch_phase import Phase, find_phase
from protocols.node import Column, make_record_type

COLUMNS = (
    Column("time_s", "s", "time since the run's start"),
    Column("valve_voltage_v", "V", "voltage to the V/A converter, acting from this row on"),
    Column("motor_speed_demand_rad_s", "rad/s", "speed demand of the motor, acting from this row on"),
    Column("cylinder_pressure_bar", "bar", "measured oil pressure behind the piston"),
    Column("slip_speed_rad_s", "rad/s", "measured slip speed, from encoder counts"),
    Column("shaft_angle_rad", "rad", "encoder angle of the turning plate"),
    Column("oil_temperature_degc", "degC", "measured oil temperature"),
    Column("clutch_torque_nm", "Nm", "measured clutch torque, for validation"),
    Column("motor_torque_nm", "Nm", "measured torque of the motor"),
    Column("motor_torque_limit_nm", "Nm", "limit of the motor's torque, acting from this row on"),
    Column(
        "actuators",
        "1",
        "valve: 0 no command yet, 1 commanded, 2 stale; 3 lost, 4 late, 5 from two senders: closed until a command to close",
    ),
    Column("truth_valve_pressure_bar", "bar", "pressure after the valve"),
    Column("truth_cylinder_pressure_bar", "bar", "pressure behind the piston"),
    Column("truth_piston_position_m", "m", "position of the piston, 0 at rest"),
    Column("truth_normal_force_n", "N", "force on the plates"),
    Column("truth_seal_force_n", "N", "friction of the piston's seals"),
    Column("truth_friction_state", "1", "m of eq. 6.9"),
    Column("truth_clutch_torque_nm", "Nm", "torque that the clutch transmits, M"),
    Column("truth_motor_torque_nm", "Nm", "torque of the motor, M_m"),
    Column("truth_slip_speed_rad_s", "rad/s", "slip speed, omega"),
    Column("truth_oil_temperature_degc", "degC", "oil temperature, T"),
    Column("truth_phase", "1", f"phase of the piston: {', '.join(f'{p.value} {p.name.lower()}' for p in Phase)}"),
)
RECORD = make_record_type(COLUMNS)
_phase = njit(find_phase)


@njit(cache=True, nogil=True)
def note_sample(
    row: Any, time: Any, interfaces: Any, rig_state: Any, preload_pressure: Any, contact_pressure: Any
) -> None:
    """Fill `row` (columns,), the memory of a RECORD, from `interfaces` (1,) of INTERFACE and `rig_state` (1,) of STATE.

    time [s] of the run; preload_pressure and contact_pressure [Pa] of the piston decide its phase.
    """
    record, interface, y = row.view(RECORD)[0], interfaces[0], rig_state[0]
    shown = interface.clutches[0]
    note_clutch(record, shown, y)
    record.time_s = time
    record.motor_speed_demand_rad_s = interface.speed_demand
    record.motor_torque_limit_nm = interface.torque_limit
    record.shaft_angle_rad = shown.angle
    record.motor_torque_nm = shown.motor_torque
    record.truth_seal_force_n = y.seal_force
    record.truth_motor_torque_nm = y.motor_torque
    record.truth_phase = _phase(y, preload_pressure, contact_pressure).value
