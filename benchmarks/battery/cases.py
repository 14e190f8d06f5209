"""Cases of the battery: hidden effects, their severity, and the noise level.

A case is determined by its name, family/effects/severity/noise/seed, such as `single/piston_seal_friction/2.0/0.02/s1`.
Severity and noise are defined in `benchmarks.battery.floors`.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.battery.truth_laws import CATALOGUE_LAWS, LAWS, UNKNOWN_LAWS
from protocols.errors import InputError, suggest_closest

SEVERITIES = 1.3, 2.0, 4.0  # gaps in floors; chosen: hardly visible, clear, large
NOISES = 0.005, 0.02, 0.05  # share of typical values; chosen: a good, an ordinary, a poor sensor
# severity and noise of pairs and triples; chosen: two of four combinations, to save time
_MIXED_LEVELS = (2.0, 0.02), (4.0, 0.005)
FAMILIES = ("single", "null", "unknown", "pair", "triple", "warm", "closed")
_FIRST_SEED = {"development": 1, "evaluation": 101}  # chosen: no case has 100 seeds, so the splits share none


@dataclass(frozen=True)
class Case:
    """A case: family, names of the hidden effects, severity [-], noise [-], seed."""

    family: str
    effects: tuple[str, ...]
    severity: float
    noise: float
    seed: int

    @property
    def name(self) -> str:
        """Unique name; also the folder that the case is written to."""
        return f"{self.family}/{'+'.join(self.effects) or 'none'}/{self.severity}/{self.noise}/s{self.seed}"

    @classmethod
    def of(cls, name: str) -> "Case":
        """Parse the name of a case. Raises InputError for another form or an unknown effect."""
        parts = name.split("/")
        try:
            family, effects, severity, noise, seed = parts
            hidden = () if effects == "none" else tuple(effects.split("+"))
            case = cls(family, hidden, float(severity), float(noise), int(seed.removeprefix("s")))
        except ValueError:
            raise InputError(f"case {name!r} is not of the form family/effects/severity/noise/sN") from None
        if unknown := [effect for effect in case.effects if effect not in LAWS]:
            raise InputError(f"case {name!r}: the truth has no effect {unknown[0]!r}")
        return case

    @property
    def split(self) -> str:
        """Split that the seed belongs to: development or evaluation."""
        return "evaluation" if self.seed >= _FIRST_SEED["evaluation"] else "development"

    def make_generator(self, purpose: int) -> np.random.Generator:
        """Return a random generator of the case, a different one for each `purpose`."""
        return np.random.default_rng([zlib.crc32(self.name.encode()), purpose])


def list_cases(split: str = "development", families: Sequence[str] = FAMILIES) -> list[Case]:
    """List the cases of a split, development or evaluation. Raises InputError for an unknown split or family.

    The splits have different seeds, and different laws if an effect has two. Single effects have three seeds where
    each severity is possible behind each noise, the others one: an answer takes a minute of CPU time or more, and two
    CPUs are to answer all cases within a day.
    """
    if split not in _FIRST_SEED:
        raise InputError(f"split {split!r} is unknown; {suggest_closest(split, _FIRST_SEED)}")
    if unknown := [family for family in families if family not in FAMILIES]:
        raise InputError(f"family {unknown[0]!r} is unknown; {suggest_closest(unknown[0], FAMILIES)}")
    first = _FIRST_SEED[split]
    names = [law.name for law in CATALOGUE_LAWS]
    always_possible = [
        name for name in names if all(map(_is_possible, _cross_cases("single", [(name,)], SEVERITIES, NOISES, [first])))
    ]
    # the evaluation has more unknown effects: thresholds set on some of them must hold for others
    unknown_names = [law.name for law in (UNKNOWN_LAWS if split == "evaluation" else UNKNOWN_LAWS[:6])]
    random = np.random.default_rng(first)
    pairs, triples = _draw_effect_sets(random, 2, 40), _draw_effect_sets(random, 3, 20)
    listed = [
        *_cross_cases("single", [(name,) for name in names], SEVERITIES, NOISES, [first]),
        *_cross_cases("single", [(name,) for name in always_possible], SEVERITIES, NOISES, range(first + 1, first + 3)),
        *_cross_cases("null", [()], (1.0,), NOISES, range(first, first + 40)),
        *_cross_cases("unknown", [(name,) for name in unknown_names], (2.0, 4.0), NOISES, [first]),
        *(c for s, n in _MIXED_LEVELS for c in _cross_cases("pair", pairs, (s,), (n,), [first])),
        *(c for s, n in _MIXED_LEVELS for c in _cross_cases("triple", triples, (s,), (n,), [first])),
        *_cross_cases("warm", [(name,) for name in names], (2.0, 4.0), (0.02,), [first]),
        *_cross_cases("warm", [()], (1.0,), (0.02,), range(first, first + 10)),
        *_cross_cases("closed", [(name,) for name in names], (2.0, 4.0), (0.02,), [first]),
        *_cross_cases("closed", [()], (1.0,), (0.02,), range(first, first + 10)),
    ]
    return [case for case in listed if case.family in families and _is_possible(case)]


def _cross_cases(
    family: str,
    effects: Sequence[tuple[str, ...]],
    severities: Sequence[float],
    noises: Sequence[float],
    seeds: Sequence[int],
) -> list[Case]:
    return [Case(family, *values) for values in product(effects, severities, noises, seeds)]


def _draw_effect_sets(random: np.random.Generator, size: int, count: int) -> list[tuple[str, ...]]:
    """Draw `count` sets of `size` effects of the catalogue, all effects of a set from different blocks."""
    sets: list[tuple[str, ...]] = []
    while len(sets) < count:
        drawn = tuple(sorted(random.choice([law.name for law in CATALOGUE_LAWS], size, replace=False).tolist()))
        if len({LAWS[name].block for name in drawn}) == size and drawn not in sets:
            sets.append(drawn)
    return sets


def _is_possible(case: Case) -> bool:
    """Return whether physically possible strengths reach the severity. The gap over the floor is in proportion to 1/noise."""
    return all(
        case.severity**2 - 1.0 <= (LAWS[name].reach ** 2 - 1.0) * (0.02 / case.noise) ** 2 for name in case.effects
    )
