"""The power-shift rig: a motor, two clutches for two gears, and a vehicle (docs/power_shift.md)."""

from clutch_hil.bench.rig import Rig
from plant_sim.node.power_shift_node import RIG as PLANT

RIG = Rig(
    plant=PLANT,
    measures_at="clutch_hil.bench.judgement.power_shift_measures:MEASURES",
    sheet_at="clutch_hil.bench.pictures.shift_picture:make_shift_sheet",
    judge_at="clutch_hil.bench.shift:judge_shift",
    status_at="clutch_hil.bench.shift:ShiftStatus",
    figures=("torque_gap", "shift_time_s"),
    missed="handed no torque over",
    clutch_model_at="clutch_hil.discrepancy.models.shaft_clutch:ShaftClutch",
    identify_at="clutch_hil.identify.two_clutches.power_shift:identify_power_shift",
)
