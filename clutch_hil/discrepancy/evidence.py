"""Evidence: measured runs beside a model, as residuals in multiples of the floor.

Equation        r = (mean over a block of samples of measured - predicted)/sigma_b: unit variance where the model is right
                sigma_b: floor of the means themselves (noise.py), so that noise that is not white counts as what it is; at most
                1.5 floor/sqrt(block), else fast physics would pass for noise, and not less than floor/sqrt(block): the rounding
                of a difference is small in the mean but not random; median over the runs; not less than a `rounding` that is
                evident, which no mean over a block takes away
                where the beginning of an output is known to tau floors: r - (1 - 1/sqrt(1 + n tau^2 block)) mean(r), which is r
                whitened for a constant offset of the run with that prior; so, to the `rounding`, of an output that is recorded
                coarsely: uneven levels shift it
                `tolerant`: sigma^2 = sigma_b^2 + (LAW g)^2,  g what the re-fitted baseline is off above the floor (root mean
                square over all runs): of an output that is off by hundreds of floors no law of the catalogue explains all, and
                what it leaves there must not outweigh what the other outputs say
Assumptions     what is slower than a block of 4 ms is what tells effects apart
                the law of a rig is not ours: a tenth of what it does may be otherwise, and that is alike for a while: so many
                neighbouring residuals (`alike`) tell as much about a calibration as one would. Were each a witness of its own,
                a hundred thousand would outweigh all that is known of the baseline, and an unlikely calibration would be
                preferred to an effect whose law is a little off
References      Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63 (model discrepancy as variance beside that of the noise);
                Miller and Dunson 2019, J. Am. Stat. Assoc. 114 (a likelihood to a power below 1 bears what a model lacks)
"""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from os import cpu_count

import numpy as np

from clutch_hil.discrepancy.model import Columns, Model, Values
from clutch_hil.discrepancy.noise import floor_of
from protocols.errors import InputError

BLOCK = 4e-3  # s
ALIKE = 0.4  # s: development, with no such time calibrations hid valve_gain, internal_leakage and the piston's changes
_RED = 1.5  # most of the floor of means over that of white noise
_LAW = 0.1  # development: with 0 other laws were refused behind 5 % noise, with 0.25 more was misnamed behind 2 %
_POOL = ThreadPoolExecutor(cpu_count() or 1)  # simulations leave other threads running

Point = tuple[Values, Values]  # parameters of the baseline and of the effects


class Evidence:
    """`runs` of a model with `floors` by output column. `pieces[i]` is the part of a residual vector that is of run i.

    lengths: of a residual's block in each run, s. alike: residuals that tell as much about a calibration as one; 1 where the
    runs are sampled slowly.
    rounding: of outputs that are recorded coarsely, root mean square in their unit.
    """

    def __init__(self, model: Model, runs: Sequence[Columns], floors: Values, rounding: Values | None = None) -> None:
        if not runs:
            raise InputError("no run was given; at least one is needed")
        self.model, self.runs, self.floors = model, list(runs), dict(floors)
        self._rounding = dict(rounding or {})
        self.columns = [output.column for output in model.outputs]
        self.blocks = [max(1, round(BLOCK / _period(run))) for run in self.runs]
        self.lengths = [b * _period(run) for run, b in zip(self.runs, self.blocks, strict=True)]
        self.alike = max(1.0, ALIKE / float(np.median(self.lengths)))
        self._measured = [
            np.concatenate([_means(run[c], b) for c in self.columns])
            for run, b in zip(self.runs, self.blocks, strict=True)
        ]
        weights = {c: 1.0 / self._spread(c) for c in self.columns}
        self.weights = np.concatenate(
            [
                np.full(len(run["time_s"]) // b, weights[c])
                for run, b in zip(self.runs, self.blocks, strict=True)
                for c in self.columns
            ]
        )
        ends = np.cumsum([len(m) for m in self._measured])
        self.pieces = [slice(e - len(m), e) for e, m in zip(ends, self._measured, strict=True)]
        self.size = int(ends[-1])
        self._noise = np.ones(len(self.columns))  # mean square of a residual that is only noise, by output

    def tolerant(self, residual: np.ndarray) -> "Evidence":
        """The same, weighing an output less that `residual` (size,) of the baseline exceeds by far."""
        found = copy(self)
        counts = sum(self._counts(k) for k in range(len(self.runs)))
        found._noise = self._noise / (1.0 + _LAW**2 * np.maximum(self._above(residual).sum(axis=0), 0.0) / counts)
        found.weights = self.weights.copy()
        for k in range(len(self.runs)):
            for column, share in zip(self.columns, found._noise / self._noise, strict=True):
                found.weights[self.part(k, column)] *= np.sqrt(share)
        return found

    def _spread(self, column: str) -> float:
        """sigma_b of an output, in its unit."""
        found = []
        for run, block in zip(self.runs, self.blocks, strict=True):
            white = self.floors[column] / np.sqrt(block)
            found.append(np.clip(floor_of(_means(run[column], block)), white, _RED * white))
        return max(float(np.median(found)), self._rounding.get(column, 0.0))

    def part(self, run: int, column: str) -> slice:
        """Where the residuals of an output of a run stand in a residual vector."""
        n = len(self.runs[run]["time_s"]) // self.blocks[run]
        begin = self.pieces[run].start + n * self.columns.index(column)
        return slice(begin, begin + n)

    def excess(self, residual: np.ndarray) -> float:
        """What `residual` (size,) has above the floor, as a share of its size; an output below it makes up for no other."""
        return float(np.maximum(self._above(residual).sum(axis=0), 0.0).sum()) / self.size

    def excess_by_run(self, residual: np.ndarray) -> np.ndarray:
        """Mean square (k,) above the floor in each run; negative below it."""
        return self._above(residual).sum(axis=1) / [piece.stop - piece.start for piece in self.pieces]

    def contradicted(self, residual: np.ndarray, before: np.ndarray) -> float:
        """What outputs of `residual` (size,) have above the floor and above those of `before`, as a share of its size: what
        is missing makes no output worse."""
        now, then = (np.maximum(self._above(r).sum(axis=0), 0.0) for r in (residual, before))
        return float(np.maximum(now - then, 0.0).sum()) / self.size

    def _above(self, residual: np.ndarray) -> np.ndarray:
        """Sum of squares above the floor (k, o) of each run and output."""
        squares = np.array(
            [[np.sum(residual[self.part(k, c)] ** 2) for c in self.columns] for k in range(len(self.runs))]
        )
        return squares - [self._counts(k) * self._noise for k in range(len(self.runs))]

    def _counts(self, run: int) -> np.ndarray:
        """Number of residuals (o,) of each output of a run."""
        return np.full(len(self.columns), len(self.runs[run]["time_s"]) // self.blocks[run])

    def residuals(self, points: Iterable[Point]) -> list[np.ndarray]:
        """Residual vectors (size,) at several points; what cannot be simulated there gives not-a-number."""
        points = list(points)
        jobs = [(i, k) for i in range(len(points)) for k in range(len(self.runs))]
        found = [np.empty(self.size) for _ in points]
        for (i, k), part in zip(jobs, _POOL.map(lambda job: self._residual(points[job[0]], job[1]), jobs), strict=True):
            found[i][self.pieces[k]] = part
        return found

    def predicted(self, point: Point, run: int) -> Columns:
        """Outputs of a run at full rate."""
        return self.model.simulate(self.runs[run], *point)

    def _residual(self, point: Point, k: int) -> np.ndarray:
        try:
            shown = self.model.simulate(self.runs[k], *point)
        except InputError:
            return np.full(len(self._measured[k]), np.nan)
        predicted = np.concatenate([_means(shown[c], self.blocks[k]) for c in self.columns])
        residual = (self._measured[k] - predicted) * self.weights[self.pieces[k]]
        for output in self.model.outputs:
            known = self.blocks[k] * output.beginning**2  # variance of a constant, in that of a residual
            known = max(known, float(output.column in self._rounding))
            if known > 0.0:
                part = self.part(k, output.column)
                own = residual[part.start - self.pieces[k].start : part.stop - self.pieces[k].start]
                own -= (1.0 - 1.0 / np.sqrt(1.0 + len(own) * known)) * own.mean()
        return residual


def _period(run: Columns) -> float:
    return float(run["time_s"][1] - run["time_s"][0])


def _means(values: np.ndarray, block: int) -> np.ndarray:
    n = len(values) // block
    return values[: n * block].reshape(n, block) @ np.full(block, 1.0 / block)  # eight times as fast as its `mean`
