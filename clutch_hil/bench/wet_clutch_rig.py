"""The wet-clutch rig: a motor, one clutch, a fixed output shaft (docs/rig.md)."""

from clutch_hil.bench.rig import Rig
from plant_sim.node.plant_node import RIG as PLANT

RIG = Rig(
    plant=PLANT,
    measures_at="clutch_hil.bench.judgement.measures:MEASURES",
    sheet_at="clutch_hil.bench.pictures.picture:make_run_sheet",
    judge_at="clutch_hil.bench.result:judge_run",
    status_at="clutch_hil.bench.status:StatusLine",
    figures=("regime_error_nm", "rise_time_s"),
    missed="never reached 90 % of the demand",
    model_at="clutch_hil.discrepancy.models.wet_clutch:WetClutch",
    clutch_model_at="clutch_hil.discrepancy.models.shaft_clutch:ShaftClutch",
)
