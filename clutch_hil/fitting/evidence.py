"""Evidence: residuals of measured runs and a model, in multiples of the noise floor.

Equation        r = (mean over a block of samples of (measured - predicted))/sigma_b: unit variance for a correct model
                sigma_b: noise floor of the block means (noise.py), median over the runs with the same rate; a run that is
                  clearly noisier has its own. It includes coloured noise
                  at most 1.5 floor/sqrt(block): otherwise fast physics would count as noise
                  at least floor/sqrt(block): the rounding of a difference is small in the mean, but not random
                  at least the known `rounding` of a coarse converter, which block means do not reduce
                  at least the accuracy of the simulation (`Output.accuracy`), for recordings with very little noise
                times known to `timing` only: sigma^2 = sigma_b^2 + (timing dy/dt)^2, y the measured block means. The times
                  of fast events have such an error in a simulation by steps and on a rig. They would outweigh slow dynamics
                start known to tau floors: r - (1 - 1/sqrt(1 + n tau^2 block)) mean(r), n residuals of the run. This is r
                  whitened for a constant offset of that size. Also for a coarse output, because its levels are uneven
                0 in rows that the model does not predict (`model.Partial`)
                `with_tolerance`: sigma^2 = sigma_b^2 + (0.1 g)^2, g the root mean square excess of the re-fitted baseline.
                  No law of the catalogue explains completely an output that is off by hundreds of floors. The rest must not
                  outweigh the other outputs
Assumptions     effects differ at time scales longer than a block of 4 ms
                the laws of a rig differ from those of the model by a tenth, and this error is correlated over 0.4 s.
                  `redundancy` neighbouring residuals therefore have the information of one about the calibration. Counted as
                  independent, they would outweigh all prior knowledge of the baseline, and an unlikely calibration would be
                  preferred to an effect whose law is slightly wrong
References      Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63 (model discrepancy as variance in addition to the noise);
                Miller and Dunson 2019, J. Am. Stat. Assoc. 114 (a likelihood to a power below 1 tolerates model errors)
"""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from os import cpu_count

import numpy as np

from clutch_hil.fitting.model import Columns, Model, Partial, Timed, Values
from clutch_hil.fitting.noise import estimate_noise, estimate_own_noise
from protocols.errors import InputError

BLOCK = 4e-3  # s: see Assumptions
# Least number of block means of a run, with --force too: with fewer there is no noise floor (noise.py)
LEAST_BLOCKS = 8
# s, correlation time of errors of the laws. Development: without it a wrong calibration masked valve_gain, internal_leakage and
# piston changes
CORRELATION_TIME = 0.4
_MOST_COLOURED = 1.5  # largest ratio of the floor of block means to that of white noise
# Relative error of a law. Development: 0 refused true laws at 5 % noise, 0.25 gave more wrong names at 2 %
_LAW_ERROR = 0.1
_POOL = ThreadPoolExecutor(cpu_count() or 1)  # threads are enough: simulations release the interpreter lock

Point = tuple[Values, Values]  # parameters of the baseline and of the effects


class Evidence:
    """Residuals of `runs` and a model, with the noise `floors` by output column. Raises InputError for no or too short runs.

    pieces: slice of a residual vector (size,) for each run. lengths [s]: duration of a block, by run.
    count: number of residuals, without those that are always 0, because the model does not predict them (`Partial`).
    redundancy: number of neighbouring residuals that have the information of one about the calibration, 1 for slow sampling.
    rounding: root mean square of a coarse converter by column, in the unit of the output. timing [s]: uncertainty of times.
    """

    def __init__(
        self, model: Model, runs: Sequence[Columns], floors: Values, rounding: Values | None = None, timing: float = 0.0
    ) -> None:
        if not runs:
            raise InputError("no run was given; at least one is needed")
        for run in runs:
            if len(run["time_s"]) < LEAST_BLOCKS * max(1, round(BLOCK / _compute_period(run))):
                raise InputError(
                    f"a run has {len(run['time_s'])} rows, {len(run['time_s']) * _compute_period(run):.3g} s;"
                    f" at least {LEAST_BLOCKS} means over {1e3 * BLOCK:g} ms are needed to compare it with anything"
                )
        self.model, self.runs, self.floors = model, list(runs), dict(floors)
        self.rounding = dict(rounding or {})
        self.columns = [output.column for output in model.outputs]
        self.blocks = [max(1, round(BLOCK / _compute_period(run))) for run in self.runs]
        self.lengths = [b * _compute_period(run) for run, b in zip(self.runs, self.blocks, strict=True)]
        self.redundancy = max(1.0, CORRELATION_TIME / float(np.median(self.lengths)))
        self._measured = [
            np.concatenate([_average_blocks(run[c], b) for c in self.columns])
            for run, b in zip(self.runs, self.blocks, strict=True)
        ]
        noise = {c: self._compute_block_noise(c) for c in self.columns}
        self.weights = np.concatenate(
            [
                np.full(len(run["time_s"]) // b, 1.0 / noise[c][k])
                for k, (run, b) in enumerate(zip(self.runs, self.blocks, strict=True))
                for c in self.columns
            ]
        )
        moved = [
            _estimate_shift(_average_blocks(run[c], b), b * _compute_period(run), timing, self._estimate_timing(run))
            for run, b in zip(self.runs, self.blocks, strict=True)
            for c in self.columns
        ]
        self.weights /= np.hypot(1.0, np.concatenate(moved) * self.weights)
        ends = np.cumsum([len(m) for m in self._measured])
        self.pieces = [slice(e - len(m), e) for e, m in zip(ends, self._measured, strict=True)]
        self.size = int(ends[-1])
        self._counts = np.array(
            [np.full(len(self.columns), len(r["time_s"]) // b) for r, b in zip(self.runs, self.blocks, strict=True)]
        )
        if isinstance(model, Partial):
            for k, (run, block) in enumerate(zip(self.runs, self.blocks, strict=True)):
                for column, unseen in model.find_unseen(run).items():
                    count = len(unseen) // block
                    whole = unseen[: count * block].reshape(count, block).any(axis=1)
                    self.weights[self.find_part(k, column)][whole] = 0.0
                    self._counts[k, self.columns.index(column)] -= np.count_nonzero(whole)
        self.count = max(int(self._counts.sum()), 1)
        self._noise = np.ones(len(self.columns))  # mean square by output of a residual that is only noise

    def _estimate_timing(self, run: Columns) -> float:
        """Return the uncertainty of the times of events between the rows of a run [s], according to the model."""
        return self.model.estimate_timing(run) if isinstance(self.model, Timed) else 0.0

    def with_tolerance(self, residual: np.ndarray) -> "Evidence":
        """Return a copy with lower weights of outputs whose baseline `residual` (size,) is far above the floor."""
        tolerant = copy(self)
        counts = np.maximum(self._counts.sum(axis=0), 1)
        tolerant._noise = self._noise / (
            1.0 + _LAW_ERROR**2 * np.maximum(self._compute_excess_squares(residual).sum(axis=0), 0.0) / counts
        )
        shares = tolerant._noise / self._noise
        tolerant._multiply_weights(dict(zip(self.columns, np.sqrt(shares), strict=True)))
        return tolerant

    def leave_out(self, left_out: np.ndarray) -> "Evidence":
        """Return a copy in which the residuals of the mask `left_out` (size,) are 0 at every point."""
        less = copy(self)
        less.weights = np.where(left_out, 0.0, self.weights)
        return less

    def with_noise(self, factors: Values) -> "Evidence":
        """Return a copy weighted as if the outputs had `factors` times the noise, by column."""
        noisier = copy(self)
        noisier._multiply_weights({column: 1.0 / factor for column, factor in factors.items()})
        return noisier

    def take_as_independent(self) -> "Evidence":
        """Return a copy with independent residuals (redundancy 1), for fits whose intervals account for correlation
        themselves."""
        independent = copy(self)
        independent.redundancy = 1.0
        return independent

    def _multiply_weights(self, factors: Values) -> None:
        """Multiply the weights of each output by its factor."""
        self.weights = self.weights.copy()
        for k in range(len(self.runs)):
            for column, factor in factors.items():
                self.weights[self.find_part(k, column)] *= factor

    def _compute_block_noise(self, column: str) -> list[float]:
        """Compute sigma_b of an output for each run, in its unit."""
        floor = self.floors[column]
        own = [estimate_own_noise(run[column], floor) for run in self.runs]
        estimates = np.array([
            np.clip(
                estimate_noise(_average_blocks(run[column], block)), floor / np.sqrt(block),
                _MOST_COLOURED * noise / np.sqrt(block),
            )
            for run, block, noise in zip(self.runs, self.blocks, own, strict=True)
        ])  # fmt: skip
        usual, blocks = np.array(own) == floor, np.array(self.blocks)
        accuracy = next(output.accuracy for output in self.model.outputs if output.column == column)
        least = max(self.rounding.get(column, 0.0), accuracy)
        return [
            max(float(np.median(estimates[usual & (blocks == blocks[k])]) if usual[k] else estimates[k]), least)
            for k in range(len(self.runs))
        ]

    def find_part(self, run: int, column: str) -> slice:
        """Return the slice of a residual vector (size,) for an output in a run, given by its index."""
        n = len(self.runs[run]["time_s"]) // self.blocks[run]
        begin = self.pieces[run].start + n * self.columns.index(column)
        return slice(begin, begin + n)

    def compute_excess(self, residual: np.ndarray) -> float:
        """Return the mean square of `residual` (size,) above the floor; an output below the floor counts as 0."""
        return float(np.maximum(self._compute_excess_squares(residual).sum(axis=0), 0.0).sum()) / self.count

    def compute_excess_by_run(self, residual: np.ndarray) -> np.ndarray:
        """Return the mean square (k,) above the floor in each run; negative below it."""
        return self._compute_excess_squares(residual).sum(axis=1) / np.maximum(self._counts.sum(axis=1), 1)

    def compute_contradiction(self, residual: np.ndarray, before: np.ndarray) -> float:
        """Return the sum of squares by which outputs of `residual` (size,) exceed floor and `before`, over its count.

        A true effect makes no output worse.
        """
        now, then = (np.maximum(self._compute_excess_squares(r).sum(axis=0), 0.0) for r in (residual, before))
        return float(np.maximum(now - then, 0.0).sum()) / self.count

    def _compute_excess_squares(self, residual: np.ndarray) -> np.ndarray:
        """Return the sum of squares above the floor (runs, outputs)."""
        squares = np.array(
            [[np.sum(residual[self.find_part(k, c)] ** 2) for c in self.columns] for k in range(len(self.runs))]
        )
        return squares - self._counts * self._noise

    def compute_residuals(self, points: Iterable[Point]) -> list[np.ndarray]:
        """Compute the residual vectors (size,) at several points; NaN for a run that cannot be simulated."""
        points = list(points)
        jobs = [(i, k) for i in range(len(points)) for k in range(len(self.runs))]
        stacked = [np.empty(self.size) for _ in points]
        for (i, k), part in zip(
            jobs, _POOL.map(lambda job: self._simulate_residual(points[job[0]], job[1]), jobs), strict=True
        ):
            stacked[i][self.pieces[k]] = part
        return stacked

    def predict(self, point: Point, run: int) -> Columns:
        """Return the outputs (n,) of a run at `point`, by column, at the rate of the run."""
        return self.model.simulate(self.runs[run], *point)

    def _simulate_residual(self, point: Point, k: int) -> np.ndarray:
        try:
            shown = self.model.simulate(self.runs[k], *point)
        except (InputError, ArithmeticError, ValueError):  # of a user's model, such as the root of a negative number
            return np.full(len(self._measured[k]), np.nan)
        predicted = np.concatenate([_average_blocks(shown[c], self.blocks[k]) for c in self.columns])
        residual = (self._measured[k] - predicted) * self.weights[self.pieces[k]]
        for output in self.model.outputs:
            # Variance of a constant offset, relative to that of a residual
            known = self.blocks[k] * output.beginning**2
            known = max(known, float(output.column in self.rounding))
            if known > 0.0:
                part = self.find_part(k, output.column)
                own = residual[part.start - self.pieces[k].start : part.stop - self.pieces[k].start]
                own -= (1.0 - 1.0 / np.sqrt(1.0 + len(own) * known)) * own.mean()
        return residual


def _compute_period(run: Columns) -> float:
    return float(run["time_s"][1] - run["time_s"][0])


def _average_blocks(values: np.ndarray, block: int) -> np.ndarray:
    n = len(values) // block
    return values[: n * block].reshape(n, block) @ np.full(block, 1.0 / block)  # eight times as fast as its `mean`


def _estimate_shift(means: np.ndarray, step: float, timing: float, between: float) -> np.ndarray:
    """Return the standard deviations (n,) of `means` (n,), `step` [s] apart, from the uncertainty of times [s].

    timing: of all times. between: of events between rows. A jump between two rows is taken as steep as on its steeper side; the
    slope over both sides is half of that.
    """
    moved = timing * np.gradient(means, step)
    if between == 0.0:
        return moved
    change = np.abs(np.diff(means))
    steepest = np.maximum(np.append(change, 0.0), np.insert(change, 0, 0.0)) / step
    return np.hypot(moved, between * steepest)
