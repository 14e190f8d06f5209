"""The friction library: models from asperities to control, and `simulate` to play a motion through any of them.

    import clutch_hil as ch

    model = ch.friction.Dahl(coulomb_force=10.0, stiffness=1e6)
    trace = ch.friction.simulate(model, position, dt=1e-4)
    trace.force, trace.state

`identify_lift_up` identifies the lift-up force of an oil film from butterflies: docs/identify_friction.md.

SI units; in a rotational contact read rad, Nm and Nm/rad for m, N and N/m. docs/friction.md compares the models.
"""

from numpy.typing import ArrayLike

from clutch_hil.identify.friction.butterflies import read_lift_up
from clutch_hil.identify.friction.lift_up import IdentifiedLiftUp, LiftRecord, identify_lift_up
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.counter_surface import CounterSurface, FlatSurface
from plant_sim.friction.dahl import Dahl
from plant_sim.friction.describing_function import DescribingFunction, describing_function
from plant_sim.friction.elasto_plastic import ElastoPlastic
from plant_sim.friction.generic import DynamicGenericModel, FixedSeparationModel, GenericModel
from plant_sim.friction.generic_rayleigh import GenericRayleighModel
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.stribeck_fit import FittedStribeck, fit_stribeck
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import Array, FrictionModel, Trace, require_type
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.sliding_response import SlidingResponse
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.tip_film import GapThreshold, SlidingThreshold, TipFilm
from plant_sim.friction.xgms import XGMS

__all__ = [
    "GMS", "XGMS", "Amontons", "Asperities", "Coulomb", "CounterSurface", "Dahl", "DescribingFunction", "DynamicGenericModel",
    "ElastoPlastic", "FittedStribeck", "FixedSeparationModel", "FlatSurface", "FrictionModel", "GapThreshold", "GenericModel",
    "GenericRayleighModel", "IdentifiedLiftUp", "Leuven", "LiftRecord", "LiftUp", "LiftingXGMS", "LoadLaw", "LuGre",
    "MaxwellSlip", "PassiveXGMS", "SlidingResponse", "SlidingThreshold", "StickTimeFriction", "Stribeck", "TipFilm", "Trace",
    "describing_function", "fit_stribeck", "identify_lift_up", "read_lift_up", "simulate",
]  # fmt: skip


def simulate(
    model: FrictionModel, position: ArrayLike, dt: float, load: ArrayLike = 1.0, state: Array | None = None
) -> Trace:
    """Play a motion through a friction model.

    `position` [m] (n,) has samples `dt` [s] apart; `load` [N] is the normal load, one value or (n,). Models without load
    dependence ignore it. The contact begins at rest without force, or in `state` (m,), the final state of an earlier trace.

    Return `force` [N] (n,) and `state` (n, m) at every sample. Raises InputError.
    """
    require_type("model", model, FrictionModel)
    return model.trace(position, dt, load, state)  # type: ignore[arg-type]  # `trace` checks its arguments
