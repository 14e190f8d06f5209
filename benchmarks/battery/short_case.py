"""Short cases for tests: four runs of 6 to 8 s, simulated and investigated within seconds.

Truth, noise and baseline are those of the battery. Effects have a given strength; none is searched for.
"""

from collections.abc import Mapping

import numpy as np

from benchmarks.battery import excitation
from benchmarks.battery.records import record_run
from benchmarks.battery.truth_laws import LAWS
from benchmarks.battery.truth_rig import draw_rig
from benchmarks.battery.truth_simulation import PERIOD, HiddenEffects, Inputs
from clutch_hil.fitting.model import Columns

NOISE = 0.02  # share of the typical values: the middle one of cases.NOISES
# parts of the five runs, (index, begin [s], end [s]); chosen: engagements, triangles, reversals; and a multisine to hold out
_PARTS = ((0, 0.0, 8.0), (1, 9.0, 17.0), (4, 6.0, 14.0))
_HELD_OUT = (3, 1.0, 7.0)


def make_short_case(
    strengths: Mapping[str, float], second_laws: tuple[str, ...] = (), seed: int = 1, lag: float = 0.0
) -> tuple[dict[str, Columns], dict[str, Columns]]:
    """Simulate a short case; return its runs and held-out runs, columns (n,) by name.

    strengths: of the hidden effects, in the units of their laws. second_laws: effects that have their second law. lag:
    `standstill.lag` of the rig.
    """
    five, plant, random = excitation.draw_runs(seed)[0], draw_rig(seed), np.random.default_rng(seed)
    plant["standstill_lag"] = lag
    hidden = HiddenEffects({n: s * LAWS[n].si for n, s in strengths.items()}, {}, dict.fromkeys(second_laws, 1))

    def cut_columns(number: int, begin: float, end: float) -> Columns:
        return record_run(_cut_inputs(five[number], begin, end), hidden, plant, NOISE, random).columns

    return {f"run-{k}": cut_columns(*part) for k, part in enumerate(_PARTS)}, {"held-0": cut_columns(*_HELD_OUT)}


def _cut_inputs(inputs: Inputs, begin: float, end: float) -> Inputs:
    part = slice(round(begin / PERIOD), round(end / PERIOD))
    return Inputs(
        inputs.title, inputs.mode, inputs.command[part], inputs.speed[part], inputs.celsius, inputs.burst[part]
    )
