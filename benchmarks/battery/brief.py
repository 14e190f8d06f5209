"""Brief cases: four runs of 6 to 8 s with effects of given strength, made and investigated within seconds, for `make test`.

Truth, noise and baseline as those of the battery; no strength is sought.
"""

from collections.abc import Mapping

import numpy as np

from benchmarks.battery import excitation
from benchmarks.battery.cases import recorded
from benchmarks.battery.truth import PERIOD, Hidden, Inputs
from benchmarks.battery.truth_laws import LAWS
from benchmarks.battery.truth_rig import rig
from clutch_hil.discrepancy.model import Columns

NOISE = 0.02
_PARTS = ((0, 0.0, 8.0), (1, 9.0, 17.0), (4, 6.0, 14.0))  # number of the run, s: engagements, triangles, reversals
_HELD_OUT = (3, 1.0, 7.0)  # multisine


def brief(
    strengths: Mapping[str, float], second_laws: tuple[str, ...] = (), seed: int = 1, lag: float = 0.0
) -> tuple[dict[str, Columns], dict[str, Columns]]:
    """Runs and held-out runs with effects of these strengths, in their laws' units; of `second_laws` the second law.

    lag: `standstill.lag` of the rig.
    """
    five, plant, random = excitation.runs(seed)[0], rig(seed), np.random.default_rng(seed)
    plant["standstill_lag"] = lag
    hidden = Hidden({n: s * LAWS[n].si for n, s in strengths.items()}, {}, dict.fromkeys(second_laws, 1))

    def columns(number: int, begin: float, end: float) -> Columns:
        return recorded(_cut(five[number], begin, end), hidden, plant, NOISE, random).columns

    return {f"run-{k}": columns(*part) for k, part in enumerate(_PARTS)}, {"held-0": columns(*_HELD_OUT)}


def _cut(inputs: Inputs, begin: float, end: float) -> Inputs:
    part = slice(round(begin / PERIOD), round(end / PERIOD))
    return Inputs(
        inputs.title, inputs.mode, inputs.command[part], inputs.speed[part], inputs.celsius, inputs.burst[part]
    )
