"""An effect without its rig: its laws called as plain Python with signals that a test knows."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from plant_sim.effects.catalogue import find_effect
from plant_sim.effects.signals import SIGNALS
from plant_sim.rigs import wet_clutch


class LoneEffect:
    """An effect with its parameters at their typical values, or as `changed` by their names in their units.

    `c`: parameters of the nominal rig; `p`: those of the effect, in SI; `x`: its states, which are 0 at first.
    """

    def __init__(self, name: str, **changed: float) -> None:
        self.effect = find_effect(name)
        values = self.effect.list_typical_values() | {f"{name}.{key}": value for key, value in changed.items()}
        chosen = wet_clutch.load_nominal().with_values(values)
        self.c = SimpleNamespace(**wet_clutch.list_values(chosen))
        self.p = SimpleNamespace(**chosen.list_si(name))
        sizes = {state.name: state.size for state in self.effect.states}
        self.x = SimpleNamespace(**{key: np.zeros(n) if n > 1 else 0.0 for key, n in sizes.items()})

    def __call__(self, hook: int, h: float, **signals: float) -> Any:
        """The signals as the law of `hook` leaves them after a step of `h` [s]; those not given are 0."""
        s = SimpleNamespace(**dict.fromkeys(SIGNALS.names, 0.0) | signals)
        self.effect.laws[hook](s, self.c, self.p, self.x, h)
        return s
