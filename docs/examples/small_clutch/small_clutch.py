"""A wet clutch of half as many plates: the same valve, piston and oil, half the friction (docs/add_a_rig.md)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from clutch_hil.bench.judgement.measures import MEASURES as OF_ONE_CLUTCH
from clutch_hil.bench.judgement.measures import Columns, Measure
from clutch_hil.bench.rig import Rig
from plant_sim.effects.table import list_active_effects
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.plant_rig import PlantRig
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.files.parameters import ParameterSet, load_overlay

PLATES = 0.5  # of those of the wet-clutch rig; friction and drag are in proportion to them
_FRICTION = ("coulomb_slope", "coulomb_intercept", "viscous_slope", "viscous_intercept")


def load_nominal(changed: Path | None = None) -> ParameterSet:
    """Its parameters with every effect off, or as the user's file `changed` has them. Raises InputError."""
    whole = wet_clutch.load_nominal()
    small = whole.with_values({f"clutch.{name}": PLATES * whole[f"clutch.{name}"].value for name in _FRICTION})
    return load_overlay(changed, small) if changed else small


def peak_power(columns: Columns) -> float:
    """Highest friction power [W] of the run."""
    return float(np.max(np.abs(columns["truth_clutch_torque_nm"] * columns["truth_slip_speed_rad_s"])))


MEASURES: Mapping[str, Measure] = {
    **OF_ONE_CLUTCH,
    "peak_power_w": Measure("W", "highest friction power", peak_power),
}

PLANT = PlantRig(
    name="small_clutch",
    node=PlantNode,
    nominal=load_nominal,
    load_profile=load_profile,
    list_active_effects=list_active_effects,
)
RIG = Rig(
    plant=PLANT,
    measures_at="small_clutch:MEASURES",
    sheet_at="clutch_hil.bench.pictures.picture:make_run_sheet",
    judge_at="clutch_hil.bench.result:judge_run",
    status_at="clutch_hil.bench.status:StatusLine",
    figures=("regime_error_nm", "peak_power_w"),
    missed="never reached 90 % of the demand",
)
