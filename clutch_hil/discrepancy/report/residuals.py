"""Residuals of the traces of a `Result`, for pictures: worst stretch, maps, orders, autocorrelation, spectrum."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import welch

from clutch_hil.discrepancy.report.wording import SIGNIFICANT, compute_ratio
from clutch_hil.discrepancy.result import NOTHING, Claim, Result, Trace
from clutch_hil.discrepancy.sources import select_usual
from clutch_hil.fitting.model import Columns

Regimes = Callable[[Columns], Mapping[str, np.ndarray]]  # columns of a run -> samples (n,) of each regime, by its name
ANGLE = "shaft_angle_rad"
_STRETCH = 0.1  # share of a run in the picture of its worst stretch
_LEAST_SAMPLES = 50  # least samples of a stretch, and of a part of a run for a mean
_BINS = 24  # of a map
_LEAST_IN_BIN = 20  # least samples for the mean of a bin
_TAIL_SHARE = 0.005  # share of samples at either end of an abscissa that a map leaves out
_FAR_FROM_FLOOR = 2.0  # floors: an output with a larger error is examined without a claim
_SAME_COLUMN = 0.9  # correlation of columns above which one map represents both
_PEAK_RATIO = 5.0  # times the level around it: an order that stands out
_AROUND, _BROAD = 12, 3  # steps of 1/8 of an order: range of the level around an order, and width of a peak
_MAP_STRIDE = 4  # samples: for a map every fourth is enough
_SMOOTH = 2e-3  # of a run: standard deviation of the window applied before the sign of a slope
_LONGEST_LAG = 1 / 40  # of a run: longest lag of an autocorrelation
_SEGMENT = 2048  # samples of a spectrum
_SEGMENT_TURNS = 8  # of a segment of an order spectrum
_SAMPLES_A_TURN = 128  # samples a turn, at most
_BENCH_PREFIXES = ("truth_", "controller_", "plant_")  # columns of the bench, not of a rig


@dataclass(frozen=True)
class Stretch:
    """Samples `begin` to `end` of a run. regime: of the claim. inside: samples (n,) of this regime, None if unknown."""

    trace: Trace
    column: str
    begin: int
    end: int
    regime: str = ""
    inside: np.ndarray | None = None


@dataclass(frozen=True)
class Map:
    """Mean residual over bins of a variable while it rises and while it falls. explained: share of the residual's power."""

    over: str
    centres: np.ndarray  # (bins,)
    rising: np.ndarray  # (bins,), not-a-number for too few samples
    falling: np.ndarray
    explained: float


def list_times(trace: Trace) -> np.ndarray:
    """Return the times [s] of a run's samples."""
    return trace.columns["time_s"]


def compute_period(trace: Trace) -> float:
    """Return the sample period [s]."""
    return float(np.median(np.diff(list_times(trace))))


class Residuals:
    """Residuals of the traces of a `Result`. regimes: returns samples (n,) by regime from the columns of a run."""

    def __init__(self, result: Result, regimes: Regimes | None = None) -> None:
        self.result = result
        self._regimes = regimes
        self._masks: dict[str, Mapping[str, np.ndarray]] = {}  # by run
        self._maps: dict[tuple[str, str, str], Map] = {}

    @cached_property
    def outputs(self) -> list[str]:
        """Return the outputs of the traces, the one with the largest error in floors first."""
        columns = dict.fromkeys(column for trace in self.result.traces for column in trace.measured)
        return sorted(columns, key=lambda column: -self.compute_times_floor(column))

    @cached_property
    def disagreeing_outputs(self) -> list[str]:
        """Return the outputs with a significant claim, in the order of `outputs`."""
        claimed = {claim.output for claim in self.result.where if claim.p_value < SIGNIFICANT}
        return [column for column in self.outputs if column in claimed]

    @cached_property
    def outputs_to_examine(self) -> list[str]:
        """Return the outputs to examine: those that disagree, then others far above their floor; at least one."""
        far = [
            c
            for c in self.outputs
            if c not in self.disagreeing_outputs and self.compute_times_floor(c) > _FAR_FROM_FLOOR
        ]
        return [*self.disagreeing_outputs, *far] or self.outputs[:1]

    @cached_property
    def has_changed(self) -> bool:
        """Return whether something was added to the model, so that after differs from before."""
        if self.result.verdict == NOTHING:
            return False
        return any(
            not np.array_equal(t.before[c], t.after[c]) for t in self.result.traces for c in t.before if c in t.after
        )

    @property
    def held_out_traces(self) -> list[Trace]:
        """Return the traces of held-out runs; all traces where each was left out in turn."""
        return [trace for trace in self.result.traces if trace.held_out] or self.result.traces

    def list_held_out_traces(self, column: str) -> list[Trace]:
        """Return the held-out traces with an output."""
        return [trace for trace in self.held_out_traces if column in trace.measured]

    def compute_times_floor(self, column: str) -> float:
        """Return the error before in floors: the largest of its claims, else of the gap, else of all traces."""
        claims = [c.times_floor for c in self.result.where if c.output == column and c.p_value < SIGNIFICANT]
        if claims:
            return max(claims)
        if column in self.result.gap:
            return compute_ratio(self.result.gap[column])
        floor = self.result.floors.get(column, 0.0)
        return (
            max((self.compute_rms(t, column, "before") / floor for t in self.list_traces_with(column)), default=0.0)
            if floor
            else 0.0
        )

    def list_traces_with(self, column: str) -> list[Trace]:
        """Return the traces with an output."""
        return [trace for trace in self.result.traces if column in trace.measured and column in trace.before]

    def compute_error(self, trace: Trace, column: str, when: str) -> np.ndarray:
        """Return measured minus predicted (n,); `when`: "before" or "after"."""
        return np.nan_to_num(trace.measured[column] - getattr(trace, when)[column])

    def compute_rms(self, trace: Trace, column: str, when: str) -> float:
        """Return the root mean square of the residual."""
        return float(np.sqrt(np.mean(self.compute_error(trace, column, when) ** 2)))

    def claim(self, column: str) -> Claim | None:
        """Return the largest significant claim about an output in a regime, else about all samples, else None."""
        claims = [c for c in self.result.where if c.output == column and c.p_value < SIGNIFICANT]
        return max(claims, key=lambda c: (c.regime != "all", c.times_floor), default=None)

    def find_regime_samples(self, trace: Trace, regime: str) -> np.ndarray | None:
        """Return the samples (n,) of a run in a regime; None where they are unknown."""
        if self._regimes is None:
            return None
        if trace.name not in self._masks:
            self._masks[trace.name] = self._regimes(trace.columns)
        mask = self._masks[trace.name].get(regime)
        return None if mask is None else np.asarray(mask, dtype=bool)

    def find_worst_run(self, column: str) -> Trace | None:
        """Return the run with the largest error of an output before."""
        return max(
            self.list_traces_with(column), key=lambda trace: self.compute_rms(trace, column, "before"), default=None
        )

    def find_worst(self, column: str, held_out: bool = False) -> Stretch | None:
        """Return the stretch of a run in which the residual before is largest, in the regime of the claim if known."""
        claim = self.claim(column)
        regime = claim.regime if claim and claim.regime != "all" else ""
        best: tuple[float, Stretch] | None = None
        for trace in self.held_out_traces if held_out else self.result.traces:
            if column not in trace.measured:
                continue
            power = self.compute_error(trace, column, "before") ** 2
            inside = self.find_regime_samples(trace, regime) if regime else None
            if inside is not None and inside.any():
                power = power * inside
            width = min(len(power), max(_LEAST_SAMPLES, round(_STRETCH * len(power))))
            sums = np.concatenate([[0.0], np.cumsum(power)])
            sums = sums[width:] - sums[:-width]
            begin = int(np.argmax(sums))
            if best is None or sums[begin] > best[0]:
                best = float(sums[begin]), Stretch(trace, column, begin, begin + width, regime, inside)
        return best[1] if best else None

    def widen(self, stretch: Stretch) -> Stretch:
        """Return a stretch twice as long about the same middle, so that a loop contains both directions."""
        more = (stretch.end - stretch.begin) // 2
        return replace(
            stretch, begin=max(0, stretch.begin - more), end=min(len(list_times(stretch.trace)), stretch.end + more)
        )

    def list_variables(self, column: str) -> list[str]:
        """Return columns for maps of an output, the one that explains most of the residual first.

        Of similar columns, such as two torques, only the first is returned.
        """
        traces = self.list_traces_with(column)
        names = [name for name in (traces[0].columns if traces else ()) if not name.startswith(_BENCH_PREFIXES)]
        usable = []
        for name in names:
            values = [trace.columns.get(name) for trace in traces]
            if name != "time_s" and all(v is not None and _is_varying(v) for v in values):
                usable.append(name)
        usable.sort(key=lambda name: -self.compute_map(column, name, "before").explained)
        kept: list[str] = []
        for name in usable:
            if all(abs(self._correlate(traces, name, other)) < _SAME_COLUMN for other in kept):
                kept.append(name)
        return kept

    def _correlate(self, traces: list[Trace], name: str, other: str) -> float:
        """Return the correlation of two columns over all runs."""
        x, y = (np.concatenate([trace.columns[n][::_MAP_STRIDE] for trace in traces]) for n in (name, other))
        return float(np.corrcoef(x, y)[0, 1])

    def compute_map(self, column: str, over: str, when: str) -> Map:
        """Return the mean residual of an output over a column, for all runs."""
        key = column, over, when
        if key not in self._maps:
            self._maps[key] = self._compute_map(*key)
        return self._maps[key]

    def _compute_map(self, column: str, over: str, when: str) -> Map:
        abscissas, residuals, rises = [], [], []
        for trace in self.list_traces_with(column):
            values = trace.columns[over]
            rate = np.gradient(gaussian_filter1d(values, max(1.0, _SMOOTH * len(values))))
            abscissas.append((np.mod(values, 2.0 * np.pi) if over == ANGLE else values)[::_MAP_STRIDE])
            residuals.append(self.compute_error(trace, column, when)[::_MAP_STRIDE])
            rises.append((rate >= 0.0)[::_MAP_STRIDE])
        x, r, up = (np.concatenate(parts) for parts in (abscissas, residuals, rises))
        low, high = np.quantile(x, [_TAIL_SHARE, 1.0 - _TAIL_SHARE])
        if not high > low:
            low, high = float(x.min()), float(x.max())
        edges = np.linspace(low, high, _BINS + 1)
        kept = (x >= low) & (x <= high)
        number = np.minimum(np.searchsorted(edges, x[kept], side="right") - 1, _BINS - 1)
        r, up = r[kept], up[kept]
        means, explained = [], 0.0
        for side in (up, ~up):
            count = np.bincount(number[side], minlength=_BINS)
            total = np.bincount(number[side], r[side], minlength=_BINS)
            mean = np.where(count >= _LEAST_IN_BIN, total / np.maximum(count, 1), np.nan)
            means.append(mean)
            explained += float(np.nansum(mean**2 * count))
        power = float(np.sum(r**2))
        centres = 0.5 * (edges[:-1] + edges[1:])
        return Map(over, centres, means[0], means[1], explained / power if power > 0.0 else 0.0)

    def compute_orders(self, column: str, when: str) -> tuple[np.ndarray, np.ndarray] | None:
        """Return orders [periods per turn] and amplitudes of the residual over the shaft's angle, in the worst turning run."""
        trace = self.find_worst_run(column)
        if trace is None or ANGLE not in trace.columns:
            return None
        angle = np.maximum.accumulate(np.abs(trace.columns[ANGLE] - trace.columns[ANGLE][0]))
        turns = angle[-1] / (2.0 * np.pi)
        if not turns > 2.0 * _SEGMENT_TURNS:
            return None
        a_turn = min(_SAMPLES_A_TURN, int(2.0 * np.pi / max(float(np.quantile(np.diff(angle), 0.99)), 1e-9)))
        if a_turn < 8:
            return None
        steps = np.arange(0.0, angle[-1], 2.0 * np.pi / a_turn)
        residual = np.interp(steps, angle, self.compute_error(trace, column, when))
        orders, power = welch(
            residual, fs=a_turn, nperseg=_SEGMENT_TURNS * a_turn, scaling="spectrum", detrend="linear"
        )
        return orders[2:], np.sqrt(2.0 * power[2:])  # the slow part is not an order

    def has_order(self, column: str) -> bool:
        """Return whether an order of the shaft stands out in the residual."""
        spectrum = self.compute_orders(column, "before")
        if spectrum is None:
            return False
        amplitudes = spectrum[1]
        for i in range(_AROUND, len(amplitudes) - _AROUND):
            sides = amplitudes[i - _AROUND : i - _BROAD], amplitudes[i + _BROAD + 1 : i + _AROUND + 1]
            if amplitudes[i] > _PEAK_RATIO * max(np.median(side) for side in sides):
                return True
        return False

    def _list_usual_traces(self, column: str) -> list[Trace]:
        """Return the held-out traces with an output that have the rate of most of the time: lags and lines are theirs."""
        traces = self.list_held_out_traces(column)
        periods, counts = [compute_period(trace) for trace in traces], [len(list_times(trace)) for trace in traces]
        return [traces[k] for k in select_usual(periods, counts)]

    def compute_autocorrelation(self, column: str, when: str) -> tuple[np.ndarray, np.ndarray, float]:
        """Return lags [s], autocorrelation of the residual in the judged runs, and half-width of white noise's 95 % band."""
        traces = self._list_usual_traces(column)
        shortest = min(len(list_times(trace)) for trace in traces)
        lags = max(10, round(_LONGEST_LAG * shortest))
        total, samples = np.zeros(lags), 0
        for trace in traces:
            residual = self.compute_error(trace, column, when)
            residual = residual - residual.mean()
            spectrum = np.fft.rfft(residual, 1 << (2 * len(residual) - 1).bit_length())
            total += np.fft.irfft(np.abs(spectrum) ** 2)[:lags]
            samples += len(residual)
        scale = total[0] if total[0] > 0.0 else 1.0
        return np.arange(lags) * compute_period(traces[0]), total / scale, 1.96 / np.sqrt(samples)

    def compute_spectrum(self, column: str, when: str) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies [Hz] and amplitude density [unit/sqrt(Hz)] of the residual in the judged runs."""
        powers = []
        traces = self._list_usual_traces(column)
        length = min(_SEGMENT, *(len(list_times(trace)) // 2 for trace in traces))
        for trace in traces:
            residual = self.compute_error(trace, column, when)
            frequency, power = welch(residual, fs=1.0 / compute_period(trace), nperseg=length, detrend="constant")
            powers.append(power)
        return frequency[1:], np.sqrt(np.mean(powers, axis=0))[1:]


def _is_varying(values: Any) -> bool:
    return bool(np.all(np.isfinite(values)) and np.ptp(values) > 0.0)
