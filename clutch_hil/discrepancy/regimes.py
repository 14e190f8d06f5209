"""Regimes: samples of a run that belong to "phase=fill", "direction=release", "slip=low" and so on.

Wet clutch      u: pressure demand to the valve; p: measured cylinder pressure, smoothed; contact and preload pressure: from
                the parameters
                phase=fill       u is above the contact pressure, p below
                phase=engage     the first 0.3 s in contact
                phase=slip       in contact after that
                phase=release    u is below the contact pressure, p still above a tenth of the preload pressure
                phase=open       the rest: plates apart, piston at rest or returning without pressure
                direction=apply, direction=release: p rises, falls by more than 0.2 bar/s while the plates are in contact
                pressure=low, mid, high, slip=low, mid, high: terciles of all runs in contact, slip without its sign
                temperature=cold, warm, hot: terciles of all runs
                slip=forward, slip=backward: its sign; slip=reversal: in contact within 0.1 s of a change of its sign
Other models    direction=forward, backward, reversal of an input that is a position; terciles of each other input, and
                NAME=rising, falling for the sign of its slope; NAME is the column, without its unit where two inputs then
                have different names
Assumptions     the window of a slope is so wide that noise alone rarely gives a slope its sign
Not modelled    terciles depend on the runs, not on physics: they differ between rigs
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from clutch_hil.fitting.model import Columns, Model, Values
from clutch_hil.fitting.noise import estimate_noise
from clutch_hil.recordings.foreign_column import UNITS

ALL = "all"
Masks = dict[str, np.ndarray]

_ENGAGING = 0.3  # s after contact: slip and the motor's speed control have settled by then
_EMPTY = 0.1  # of the preload pressure: below it the piston is at rest and the line nearly empty
_LEAST_SLOPE = 0.2  # bar/s: a smaller slope has no direction; steps and sines of an experiment are faster
_SLOPE_NOISE = 0.35  # of _LEAST_SLOPE: standard deviation of the slope; noise alone exceeds it in 0.5 % of the samples
# s, standard deviation of the narrowest window: shorter movements are the end of a stroke, not a direction
_NARROWEST = 1e-2
_WIDEST = 0.1  # s: a wider window would miss a reversal
_REVERSAL = 0.1  # s before and after a change of sign
_LEAST_SLIP = 0.05  # rad/s: 4 times the encoder's noise in the narrowest window; a shaft at rest has no direction
_LEAST_SLOPE_SHARE = 0.05  # of the 95 % quantile of a column's slope: a smaller slope counts as standstill
_TERCILES = (1.0 / 3.0, 2.0 / 3.0)
_CLUTCH = {"valve_voltage_v", "cylinder_pressure_bar", "slip_speed_rad_s", "oil_temperature_degc"}
_POSITION = ("position_m", "displacement_m")


class Regimes:
    """Regimes of the runs of a model. `regimes(run)` returns the samples (n,) of each by name; terciles are those of `runs`.

    parameters: of the baseline; they give the pressures at which the phases change.
    """

    def __init__(self, model: Model, runs: Sequence[Columns], parameters: Values) -> None:
        # decide by columns and parameters, not by the model's name: a user's own wet clutch has phases as well
        clutch = set(runs[0]) >= _CLUTCH and {"valve.gain", "piston.contact_pressure"} <= set(parameters)
        self._find: Callable[[Columns], Masks] = (
            _ClutchRegimes(runs, parameters) if clutch else _InputRegimes(runs, model.inputs)
        )

    def __call__(self, run: Columns) -> Masks:
        """Return the samples (n,) of each regime, "all" first."""
        return {ALL: np.ones(len(run["time_s"]), bool), **self._find(run)}


class _ClutchRegimes:
    """Regimes of the wet clutch."""

    def __init__(self, runs: Sequence[Columns], parameters: Values) -> None:
        self._gain = parameters["valve.gain"]
        self._contact = parameters["piston.contact_pressure"]
        self._preload = parameters.get("piston.preload_pressure", self._contact)
        self._noise = max(float(np.median([estimate_noise(run["cylinder_pressure_bar"]) for run in runs])), 1e-6)
        touching = [self._find_phases(run)[1] for run in runs]
        self._thirds = {
            "pressure": _find_terciles([r["cylinder_pressure_bar"][on] for r, on in zip(runs, touching, strict=True)]),
            "slip": _find_terciles([np.abs(r["slip_speed_rad_s"][on]) for r, on in zip(runs, touching, strict=True)]),
            "temperature": _find_terciles([_smooth(r["oil_temperature_degc"], 0.1, r) for r in runs]),
        }

    def __call__(self, run: Columns) -> Masks:
        phases, contact = self._find_phases(run)
        needed = _choose_slope_window(self._noise, _SLOPE_NOISE * _LEAST_SLOPE, _compute_period(run))
        window = float(np.clip(needed, _NARROWEST, _WIDEST))
        slope = np.gradient(_smooth(run["cylinder_pressure_bar"], window, run), _compute_period(run))
        masks = {f"phase={name}": inside for name, inside in phases.items()}
        masks["direction=apply"], masks["direction=release"] = (
            contact & (slope > _LEAST_SLOPE),
            contact & (slope < -_LEAST_SLOPE),
        )
        slip = _smooth(run["slip_speed_rad_s"], _NARROWEST, run)
        warm = _smooth(run["oil_temperature_degc"], 0.1, run)
        masks |= _split_thirds("pressure", run["cylinder_pressure_bar"], self._thirds["pressure"], contact)
        masks |= _split_thirds("slip", np.abs(slip), self._thirds["slip"], contact)
        masks |= _split_thirds(
            "temperature", warm, self._thirds["temperature"], np.ones(len(warm), bool), "cold warm hot"
        )
        turning = np.zeros(len(slip), bool)
        turning[1:] = slip[1:] * slip[:-1] < 0.0
        masks["slip=forward"], masks["slip=backward"] = slip > _LEAST_SLIP, slip < -_LEAST_SLIP
        masks["slip=reversal"] = contact & maximum_filter1d(turning, 2 * round(_REVERSAL / _compute_period(run)) + 1)
        return masks

    def _find_phases(self, run: Columns) -> tuple[Masks, np.ndarray]:
        period = _compute_period(run)
        pressure = _smooth(run["cylinder_pressure_bar"], _NARROWEST, run)
        asked = self._gain * run["valve_voltage_v"] >= self._contact
        touching = pressure >= self._contact
        last = np.maximum.accumulate(np.where(touching, -1, np.arange(len(pressure))))  # the last sample out of contact
        engaging = touching & (np.arange(len(pressure)) - last <= _ENGAGING / period) & (last >= 0)
        release = ~asked & (pressure > _EMPTY * self._preload)
        contact = touching & asked
        phases = {
            "fill": asked & ~touching,
            "engage": contact & engaging,
            "slip": contact & ~engaging,
            "release": release,
            "open": ~asked & ~release,
        }
        return phases, touching


class _InputRegimes:
    """Regimes of any other model, from its inputs."""

    def __init__(self, runs: Sequence[Columns], inputs: Sequence[str]) -> None:
        self._inputs = [name for name in inputs if any(float(np.ptp(run[name])) > 0.0 for run in runs)]
        short = [_strip_unit(name) for name in self._inputs]
        self._names = {n: one if short.count(one) == 1 else n for n, one in zip(self._inputs, short, strict=True)}
        self._thirds = {name: _find_terciles([run[name] for run in runs]) for name in self._inputs}
        self._still = {
            name: _LEAST_SLOPE_SHARE * _find_quantile([np.abs(_compute_slope(run, name)) for run in runs], 0.95)
            for name in self._inputs
        }

    def __call__(self, run: Columns) -> Masks:
        masks: Masks = {}
        for name in self._inputs:
            slope, still = _compute_slope(run, name), self._still[name]
            rising, falling = slope > still, slope < -still
            if name in _POSITION:
                turning = np.zeros(len(slope), bool)
                turning[1:] = slope[1:] * slope[:-1] < 0.0
                reach = 2 * round(_REVERSAL / _compute_period(run)) + 1
                masks |= {"direction=forward": rising, "direction=backward": falling}
                masks["reversal"] = maximum_filter1d(turning, reach) & (np.abs(slope) < 4.0 * still)
            else:
                masks |= {f"{self._names[name]}=rising": rising, f"{self._names[name]}=falling": falling}
            masks |= _split_thirds(self._names[name], run[name], self._thirds[name], np.ones(len(slope), bool))
        return masks


def find_family(name: str) -> str:
    """Return the family of a regime. Regimes of one family exclude each other: "phase", "direction", "slip", "slip sign" ..."""
    head, _, word = name.partition("=")
    return head if head == "direction" else head + _FAMILY_SUFFIX.get(word, "")


_FAMILY_SUFFIX = {
    "forward": " sign", "backward": " sign", "rising": " slope", "falling": " slope", "reversal": " turn",
}  # fmt: skip


def _compute_period(run: Columns) -> float:
    return float(run["time_s"][1] - run["time_s"][0])


def _smooth(values: np.ndarray, window: float, run: Columns) -> np.ndarray:
    """Smooth by a Gaussian of standard deviation `window` [s]."""
    return gaussian_filter1d(values, window / _compute_period(run), mode="reflect", truncate=3.0)


def _choose_slope_window(noise: float, wanted: float, period: float) -> float:
    """Return the window [s] for which the slope of white noise `noise` has a standard deviation of `wanted` per second.

    Variance of a Gaussian window's derivative: noise^2 T/(4 sqrt(pi) window^3), T the sample period.
    """
    return float((noise / wanted) ** (2.0 / 3.0) * (period / (4.0 * np.sqrt(np.pi))) ** (1.0 / 3.0))


def _compute_slope(run: Columns, name: str) -> np.ndarray:
    return np.gradient(_smooth(run[name], _NARROWEST, run), _compute_period(run))


def _find_terciles(parts: Sequence[np.ndarray]) -> tuple[float, float]:
    low, high = (_find_quantile(parts, q) for q in _TERCILES)
    return low, high


def _find_quantile(parts: Sequence[np.ndarray], q: float) -> float:
    whole = np.concatenate(parts) if parts else np.zeros(0)
    return float(np.quantile(whole, q)) if len(whole) else 0.0


def _split_thirds(
    name: str, values: np.ndarray, bounds: tuple[float, float], within: np.ndarray, words: str = "low mid high"
) -> Mapping[str, np.ndarray]:
    low, high = bounds
    if not high > low:  # too few different values
        return {}
    thirds = values < low, (values >= low) & (values <= high), values > high
    return {f"{name}={word}": within & third for word, third in zip(words.split(), thirds, strict=True)}


def _strip_unit(name: str) -> str:
    """Return a column's name without its unit: valve_voltage for valve_voltage_v."""
    ends = [f"_{unit}" for unit in UNITS if name.endswith(f"_{unit}")]
    return name.removesuffix(max(ends, key=len, default=""))
