"""Truth of a case: its rig, its runs, and its effects at the strengths that give the severity."""

import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from itertools import chain

import numpy as np

from benchmarks.battery import excitation
from benchmarks.battery.cases import Case
from benchmarks.battery.floors import compute_gap
from benchmarks.battery.truth_laws import LAWS, Law
from benchmarks.battery.truth_rig import draw_rig
from benchmarks.battery.truth_simulation import (
    COLUMNS,
    OPEN,
    HiddenEffects,
    Inputs,
    Response,
    simulate,
)

# relative error of the difference that a strength is to make; chosen: small beside 1.3, the least gap
_STRENGTH_TOLERANCE = 0.01
_MOST_TRIES = 25  # simulations of the five runs to find a strength; chosen by judgement
# K; chosen: twice that of other cases, so the oil of warm ones starts at 55..95 degC, not at 65..85
_WARM_SPREAD = 20.0


class Truth:
    """The hidden part of a `case`: its rig, its runs, and its effects at the strengths that give the severity."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.plant = draw_rig(int(case.make_generator(1).integers(2**31)))
        seed = int(case.make_generator(2).integers(2**31))
        self.inputs, self.held_out = excitation.draw_runs(
            seed, closed_loop=case.family == "closed", spread=_WARM_SPREAD if case.family == "warm" else 10.0
        )
        self.severities: dict[str, float] = {}  # severity that each effect reaches alone
        self._baselines: dict[int, np.ndarray] = {}

    @cached_property
    def hidden(self) -> HiddenEffects:
        """All effects of the case, each at the strength that gives the severity alone."""
        alone = [self.scale_effect(name) for name in self.case.effects]
        return HiddenEffects(
            *(dict(chain.from_iterable(getattr(one, part).items() for one in alone)) for part in _PARTS)
        )

    def scale_effect(self, name: str) -> HiddenEffects:
        """Scale one effect to the strength that gives the severity, or to the largest possible one."""
        law = LAWS[name]
        random = np.random.default_rng([zlib.crc32(self.case.name.encode()), 3, zlib.crc32(name.encode())])
        sign = -1.0 if law.signed and random.random() < 0.5 else 1.0
        second = int(self.case.split == "evaluation" and law.variants > 1)
        unit = HiddenEffects({name: sign}, {name: float(random.uniform(-1.0, 1.0))}, {name: second})
        target = np.sqrt(self.case.severity**2 - 1.0)

        def measure_size(strength: float) -> float:
            rms = self.compute_rms_difference(replace(unit, strengths={name: sign * strength * law.si}))
            return float(np.sqrt(compute_gap(rms, self.case.noise) ** 2 - 1.0))

        start = law.usual * target * self.case.noise / _USUAL_SIZE
        strength, reached = _solve_strength(measure_size, target, law, start)
        self.severities[name] = float(np.sqrt(1.0 + reached**2))
        return replace(unit, strengths={name: sign * strength * law.si})

    def compute_rms_difference(self, hidden: HiddenEffects) -> np.ndarray:
        """Compute the rms (6,) over the five runs, without noise, of the difference that `hidden` makes in each of COLUMNS.

        Both simulations of a run have the same voltage.
        """
        squares = []
        for k, inputs in enumerate(self.inputs):
            response = simulate(inputs, hidden, self.plant)
            squares.append(
                np.mean((response.rows - self._simulate_without(k, inputs, response))[:, : len(COLUMNS)] ** 2, axis=0)
            )
        return np.sqrt(np.mean(squares, axis=0))

    def _simulate_without(self, k: int, inputs: Inputs, response: Response) -> np.ndarray:
        if inputs.mode != OPEN:
            return simulate(inputs.with_voltage(response.voltage), plant=self.plant).rows
        if k not in self._baselines:
            self._baselines[k] = simulate(inputs, plant=self.plant).rows
        return self._baselines[k]


_PARTS = "strengths", "forms", "laws"  # fields of HiddenEffects
# difference (over the floor) times noise that the usual strength of a law makes: a gap of 2 at 2 % noise
_USUAL_SIZE = np.sqrt(2.0**2 - 1.0) * 0.02


def _solve_strength(size: Callable[[float], float], target: float, law: Law, start: float) -> tuple[float, float]:
    """Find the strength at which `size` is `target`; return the strength and its size.

    Strengths are in the unit of the law, and at most its largest one. The search starts at `start`. It is regula falsi in
    logarithms, because the size is nearly a power of the strength.
    """
    below, above = (0.0, 0.0), None  # (strength, size) on either side of the target
    next_strength = min(start, law.most)
    for _ in range(_MOST_TRIES):
        strength = next_strength
        reached = size(strength)
        if abs(reached - target) <= _STRENGTH_TOLERANCE * target:
            break
        if reached < target:
            if strength >= law.most:
                break
            below = strength, reached
        else:
            above = strength, reached
        if above is None:
            growth = min(max(target / reached, 1.05), 10.0) if reached > 0.0 else 10.0
            next_strength = min(strength * growth, law.most)
        elif below[0] == 0.0:
            next_strength = above[0] * max(min(target / above[1], 0.95), 0.05)
        else:
            slope = np.log(above[1] / max(below[1], 1e-9)) / np.log(above[0] / below[0])
            share = np.log(target / max(below[1], 1e-9)) / slope / np.log(above[0] / below[0]) if slope > 0.0 else 0.5
            next_strength = below[0] * (above[0] / below[0]) ** min(max(share, 0.1), 0.9)
        if above is not None and above[0] - below[0] < 1e-6 * above[0]:
            break
    return strength, reached
