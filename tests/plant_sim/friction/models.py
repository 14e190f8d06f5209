"""Every friction model of the library, with the properties it must have and those it is supposed to fail."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.dahl import Dahl
from plant_sim.friction.elasto_plastic import ElastoPlastic
from plant_sim.friction.gms import GMS
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import FrictionModel
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS

F_S = 3.0  # N, at LOAD; not 1, so that a forgotten normalisation shows
BETA = 0.6
F_C = BETA * F_S
V_S = 0.01  # m/s
K = 3e5  # N/m, stiffness at rest of every model that has one
SPAN = F_S / K  # m, the length of pre-sliding
C = 500.0  # 1/s, attraction of the normalised force
LOAD = 12.0  # N
SLOW = V_S / 50.0  # m/s; s(v) is F_S here to the last digit, so that pre-sliding does not see the Stribeck curve

PROPERTIES = {
    "pre_sliding": "the force changes by no more than stiffness times displacement",
    "masing": "a branch is the virgin curve, doubled",
    "return_point": "inner loops close, and an outer excursion wipes them out",
    "congruency": "loops between the same two positions have the same shape",
    "rate_independent": "slow motion: the force depends on the path, not on the speed",
    "friction_lag": "in sliding, more force accelerating than decelerating",
    "break_away_falls": "the break-away force falls with the rate of the applied force",
    "no_drift": "an oscillation below break-away does not move a biased mass",
    "stick_slip": "a slowly pulled mass sticks and slips, a quickly pulled one slides",
    "passive": "from rest, no motion takes out energy",
    "bounded": "the force without the viscous part stays below the highest friction",
    "load_scaling": "load and stiffness times a number give force times this number",
    "follows_load": "no element above its limit after unloading",
    "sub_steps": "one step at constant velocity equals many",
    "continuous_at_rest": "an ever shorter displacement gives the force of no displacement",
}

NO_LOAD = {"load_scaling": "ignores the load", "follows_load": "ignores the load"}
FLAT = {
    "friction_lag": "no velocity dependence, so nothing lags",
    "break_away_falls": "no velocity dependence, so no peak",
    "stick_slip": "no velocity weakening",
}
LOCAL = {
    "masing": "local memory only",
    "return_point": "local memory only",
    "congruency": "local memory only",
    "no_drift": "plastic from the first displacement",
}
VISCOUS = {"rate_independent": "viscous part"}
ACTIVE = {
    "passive": "in slip an element gains force without displacement",
    "continuous_at_rest": "a slipping element follows time, not displacement",
}


@dataclass(frozen=True)
class Case:
    """One model, and why it fails what it fails: `fails` maps a name of PROPERTIES to one line."""

    name: str
    model: FrictionModel
    fails: Mapping[str, str] = field(default_factory=dict)
    beta: float = BETA
    stribeck_velocity: float = V_S
    viscous: float = 0.0  # N/(m/s)^gamma
    exponent: float = 1.0
    accuracy: float = 1e-11  # of F_S: rounding of a few thousand steps, or the stated error of an integration

    @property
    def highest(self) -> float:
        """N, the highest value of s."""
        return F_S * max(1.0, self.beta)

    def check_gap(self, name: str, gap: float, bound: float, clear: float) -> None:
        """Assert that `gap` is at most `bound`; if the model is declared to fail `name`, that it is above `clear`."""
        assert name in PROPERTIES
        if name in self.fails:
            assert gap > clear, f"{self.name} does not fail {name!r} as declared ({self.fails[name]}): {gap:.3g}"
        else:
            assert gap <= bound, f"{self.name} is not {name!r} ({PROPERTIES[name]}): {gap:.3g} above {bound:.3g}"

    def check_claim(self, name: str, holds: bool) -> None:
        """Assert that `holds`; if the model is declared to fail `name`, that it does not."""
        self.check_gap(name, 0.0 if holds else 1.0, 0.0, 0.5)


def split(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness [N/m] and weights [-] of n elements that differ in both and in their break points."""
    weights = 1.0 + np.arange(n) / n
    weights /= weights.sum()
    reach = np.linspace(0.3, 2.5, n) if n > 1 else np.ones(1)
    stiffness = weights / reach
    return K * stiffness / stiffness.sum(), weights


def make_curve(beta: float = BETA, velocity: float = V_S, viscous: float = 0.0, exponent: float = 1.0) -> Stribeck:
    return Stribeck(F_S, beta, velocity, viscous, exponent)


def _make_gms(n: int, attraction: float = C, **shape: float) -> GMS:
    return GMS(make_curve(**shape), *split(n), attraction * F_S)


def _make_xgms(n: int, attraction: float = C, beta: float = BETA, viscous: float = 0.0, exponent: float = 1.0) -> XGMS:
    return XGMS(Amontons(F_S / LOAD), *split(n), beta, V_S, viscous, exponent, attraction)


def _make_passive(
    n: int, attraction: float = C, beta: float = BETA, viscous: float = 0.0, exponent: float = 1.0
) -> PassiveXGMS:
    return PassiveXGMS(Amontons(F_S / LOAD), *split(n), beta, V_S, viscous, exponent, attraction)


def _make_falling_law() -> LoadLaw:
    return LoadLaw(F_S / LOAD / (1.0 - np.exp(-20.0 / LOAD) / 1.5), 1.5, 20.0)


def _make_maxwell(n: int) -> MaxwellSlip:
    stiffness, weights = split(n)
    return MaxwellSlip(stiffness, F_S * weights)


def _make_leuven(power: float) -> Leuven:
    stiffness, weights = split(4)
    return Leuven(make_curve(), stiffness, 1.2 * F_S * weights, power)


RUNGE_KUTTA = 1e-7  # as elasto_plastic.STEP promises
FIRST_ORDER = 5e-3  # implicit steps of STEP = 5 % of the length over which z settles
CREEP = {
    "masing": "z creeps",
    "return_point": "z creeps",
    "congruency": "z creeps",
    "no_drift": "z creeps",
    "sub_steps": "steps of first order",
}
ONE_BRISTLE = dict.fromkeys(("masing", "return_point", "congruency"), "one bristle")
DAMPED = {"rate_independent": "damping of the bristle"}
RISING = {
    "stick_slip": "velocity strengthening",
    "break_away_falls": "velocity strengthening, so no peak",
    "friction_lag": "velocity strengthening turns the loop round",
}

CASES = [
    Case(
        "coulomb",
        Coulomb(make_curve()),
        NO_LOAD
        | {
            "pre_sliding": "rigid",
            "friction_lag": "a function of velocity",
            "break_away_falls": "rigid: it breaks away at F_S from velocity 0",
            "continuous_at_rest": "a sign of velocity",
        },
    ),
    Case("dahl", Dahl(F_S, K), NO_LOAD | FLAT | LOCAL, beta=1.0),
    Case("dahl-sharp", Dahl(F_S, K, 0.5), NO_LOAD | FLAT | LOCAL, beta=1.0),
    Case("lugre", LuGre(make_curve(), K), NO_LOAD | LOCAL),
    Case(
        "lugre-damped",
        LuGre(make_curve(viscous=8.0), K, 10.0),  # 8 > 10 (1/beta - 1): passive
        NO_LOAD | LOCAL | DAMPED,
        viscous=8.0,
    ),
    Case(
        "lugre-active",
        LuGre(make_curve(), K, 1000.0),
        NO_LOAD
        | LOCAL
        | DAMPED
        | {
            "pre_sliding": "the force of the bristle damping comes at once",
            "break_away_falls": "the force of the bristle damping grows with the rate",
            "bounded": "the force of the bristle damping comes on top",
            "passive": "more bristle damping than Barabanov and Ortega's bound allows",
            "friction_lag": "the bristle damping leads by more than the bristle lags",
        },
    ),
    Case("elasto-plastic", ElastoPlastic(make_curve(), K), NO_LOAD | ONE_BRISTLE, accuracy=RUNGE_KUTTA),
    Case(
        "elasto-plastic-sharp",
        ElastoPlastic(make_curve(), K, break_away=0.99),
        NO_LOAD | ONE_BRISTLE,
        accuracy=RUNGE_KUTTA,
    ),
    Case("maxwell-slip-1", _make_maxwell(1), NO_LOAD | FLAT, beta=1.0),
    Case("maxwell-slip-4", _make_maxwell(4), NO_LOAD | FLAT, beta=1.0),
    Case("maxwell-slip-100", _make_maxwell(100), NO_LOAD | FLAT, beta=1.0),
    Case("gms-1", _make_gms(1), NO_LOAD | ACTIVE),
    Case("gms-4", _make_gms(4), NO_LOAD | ACTIVE),
    Case("gms-100", _make_gms(100), NO_LOAD | ACTIVE),
    Case("gms-no-lag", _make_gms(4, np.inf), NO_LOAD | ACTIVE | {"friction_lag": "C is infinite"}),
    Case("gms-flat", _make_gms(4, velocity=np.inf), NO_LOAD | FLAT, stribeck_velocity=np.inf),
    Case(
        "gms-rising",
        _make_gms(4, beta=1.5),
        NO_LOAD | RISING | {"continuous_at_rest": ACTIVE["continuous_at_rest"]},
        beta=1.5,
    ),
    Case(
        "gms-viscous",
        _make_gms(4, viscous=1.0, exponent=0.5),
        NO_LOAD
        | VISCOUS
        | {"continuous_at_rest": ACTIVE["continuous_at_rest"]},  # this much viscosity makes it passive
        viscous=1.0,
        exponent=0.5,
    ),
    Case("xgms-1", _make_xgms(1), ACTIVE),
    Case("xgms-4", _make_xgms(4), ACTIVE),
    Case("xgms-100", _make_xgms(100), ACTIVE),
    Case("xgms-no-lag", _make_xgms(4, np.inf), ACTIVE | {"friction_lag": "C is infinite"}),
    Case(
        "xgms-rising", _make_xgms(4, beta=1.5), RISING | {"continuous_at_rest": ACTIVE["continuous_at_rest"]}, beta=1.5
    ),
    Case(
        "xgms-viscous",
        _make_xgms(4, viscous=1.0 / F_S, exponent=0.5),
        VISCOUS | {"continuous_at_rest": ACTIVE["continuous_at_rest"]},
        viscous=1.0,
        exponent=0.5,
    ),
    Case(
        "xgms-falling",
        XGMS(_make_falling_law(), *split(4), BETA, V_S, attraction=C),
        ACTIVE | {"load_scaling": "its coefficient falls with load"},
    ),
    Case("passive-xgms-1", _make_passive(1)),
    Case("passive-xgms-4", _make_passive(4)),
    Case("passive-xgms-100", _make_passive(100)),
    Case("passive-xgms-no-lag", _make_passive(4, np.inf), {"friction_lag": "C is infinite"}),
    Case(
        "passive-xgms-rising",
        _make_passive(4, beta=1.5),
        RISING | {"continuous_at_rest": "a force above its limit relaxes with time"},
        beta=1.5,
    ),
    Case("passive-xgms-viscous", _make_passive(4, viscous=1.0 / F_S, exponent=0.5), VISCOUS, viscous=1.0, exponent=0.5),
    Case(
        "passive-xgms-falling",
        PassiveXGMS(_make_falling_law(), *split(4), BETA, V_S, attraction=C),
        {"load_scaling": "its coefficient falls with load"},
    ),
    Case("leuven", _make_leuven(2.0), NO_LOAD | CREEP, accuracy=FIRST_ORDER),
    Case("leuven-sharp", _make_leuven(8.0), NO_LOAD | CREEP, accuracy=FIRST_ORDER),
]

every_model = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
every_element_model = pytest.mark.parametrize(
    "case", [case for case in CASES if isinstance(case.model, MaxwellSlip | GMS | XGMS)], ids=lambda case: case.name
)
every_loaded_model = pytest.mark.parametrize(
    "case", [case for case in CASES if isinstance(case.model, XGMS)], ids=lambda case: case.name
)


def compute_stribeck(case: Case, velocity: np.ndarray | float) -> np.ndarray:
    """Eq 1.4 written out once more [N], the friction that every model must reach in steady sliding."""
    v = np.abs(np.asarray(velocity, float))
    s = F_S * (1.0 + (case.beta - 1.0) * np.exp(-case.stribeck_velocity / v))
    return np.sign(velocity) * (s + case.viscous * v**case.exponent)


def make_path(turns: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] along straight lines through `turns` [m] in steps of at most `step`; indices of the turns."""
    pieces, indices = [np.array(turns[:1], float)], [0]
    for start, end in pairwise(turns):
        count = max(1, int(np.ceil(abs(end - start) / step)))
        pieces.append(start + (end - start) * np.arange(1, count + 1) / count)
        indices.append(indices[-1] + count)
    return np.concatenate(pieces), np.array(indices)


def play_position(case: Case, position: np.ndarray, dt: float) -> np.ndarray:
    """Force [N] of the model moved along `position` [m], without the viscous part, which has no memory."""
    velocity = np.diff(position, prepend=position[:1]) / dt
    return (
        case.model.trace(position, dt, LOAD).force
        - np.sign(velocity) * case.viscous * np.abs(velocity) ** case.exponent
    )


def pull_mass(case: Case, turns: list[float], step: float = SPAN / 50.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position [m], force without viscous part [N] and indices of the turns, in slow motion through `turns` [m]."""
    position, indices = make_path(np.asarray(turns, float), step)
    return position, play_position(case, position, step / SLOW), indices
