"""Measures: numbers or words by which a run is judged. To add a measure, add one line to MEASURES of its rig.

Torque, slip and pressure are the true values. A run recorded blind has no truth; its measures use the measured values. Torque
and slip are signed. A torque demand is a magnitude, and is compared with the magnitude of the torque. In the phase lock the
clutch follows no demand, so this phase is left out where torque and demand are compared. A turn of the slip is where it
begins, ends or changes its sign.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from clutch_hil.bench.judgement.following import Following, find_regime, judge_following
from protocols.can.frames import load_frames
from protocols.can.two_clutches import CONTROLLERS

Columns = Mapping[str, np.ndarray]
_PRESSURE_BIN = 0.05  # bar, width of a bin of equal pressure: ten quantisation steps of the ADC
_SLIP_BIN = 0.5  # rad/s, width of a bin of equal slip
_LEAST_DEMAND_RATE = 0.05  # bar/s and rad/s^2: a demand that changes more slowly counts as constant
_HOLD_TIME = 0.2  # s at the end of an engagement, in which the torque counts as settled
_EXCITED_POWER_SHARE = 1e-3  # of the power of the strongest line: a weaker line is not part of the multisine
_HALF_POWER = 0.5**0.5  # -3 dB
# rad/s: plates with less slip stick. It is a fifth of the slowest creep; sticking plates have no slip
_STANDING_SLIP = 0.01
_TURN_TIME = 0.03  # s after a turn of the slip, in which friction settles: two friction lags of the thesis, 12 ms each
_EDGE_SHARE = 0.1  # share of the span of slip that counts as slow, and as fast


class Measure(NamedTuple):
    """A measure. `of` computes it from the columns of a run. A word has an empty `unit`; `words` lists the allowed words."""

    unit: str
    what: str
    of: Callable[[Columns], float | str]
    words: Callable[[], tuple[str, ...]] | None = None


def find_torque(columns: Columns) -> np.ndarray:
    """Return the clutch torque (n,) [Nm], with the sign of the slip; the true torque where the run has it."""
    return columns.get("truth_clutch_torque_nm", columns["clutch_torque_nm"])


def measure_following(columns: Columns) -> Following:
    """Return how well the torque followed its demand, without the phase lock."""
    return judge_following(*_read_demand_and_torque(columns))


def find_highest_demand(columns: Columns) -> float:
    """Return the highest torque demand [Nm] without the phase lock; NaN where there is no other phase."""
    return _find_highest(_read_demand_and_torque(columns)[1])


def _compute_magnitude(columns: Columns) -> np.ndarray:
    return np.abs(find_torque(columns))


def _compute_slip(columns: Columns) -> np.ndarray:
    """Return the slip (n,) [rad/s]; the true slip where the run has it."""
    return columns.get("truth_slip_speed_rad_s", columns["slip_speed_rad_s"])


def _compute_pressure(columns: Columns) -> np.ndarray:
    """Return the cylinder pressure (n,) [bar]; the true pressure where the run has it."""
    return columns.get("truth_cylinder_pressure_bar", columns["cylinder_pressure_bar"])


def list_faults() -> tuple[str, ...]:
    """Return the allowed words of the measure `fault`."""
    return tuple(load_frames()["CONTROLLER_STATUS"].list_choices("fault").values())


def _read_demand_and_torque(columns: Columns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time [s], and magnitudes of torque demand and torque [Nm], each (k,), without the phase lock."""
    part = ~_is_in_lock(columns)
    return columns["time_s"][part], np.nan_to_num(columns["torque_demand_nm"][part]), _compute_magnitude(columns)[part]


def _compute_largest_error(columns: Columns) -> float:
    time, demand, moment = _read_demand_and_torque(columns)
    return _find_highest(np.abs(moment - demand)[find_regime(time, demand, moment)])


def _compute_share(error: float, columns: Columns) -> float:
    """Return an error [Nm] divided by the highest demand; NaN where nothing is demanded."""
    highest = find_highest_demand(columns)
    return error / highest if highest > 0.0 else float("nan")


def is_in_phase(columns: Columns, name: str, controller: str = "controller") -> np.ndarray:
    """Return a mask (n,) of the samples in which a controller is in the phase `name`."""
    phases = {text: value for value, text in load_frames()["CONTROLLER_STATUS"].list_choices("phase").items()}
    return columns[f"{controller}_phase"] == phases[name]


def _is_in_slip_control(columns: Columns) -> np.ndarray:
    return is_in_phase(columns, "slip control")


def _is_in_lock(columns: Columns) -> np.ndarray:
    return is_in_phase(columns, "lock")


def _compute_pressure_error(columns: Columns) -> float:
    error = columns["controller_pressure_demand_bar"] - _compute_pressure(columns)
    return _average(np.abs(error[_is_in_slip_control(columns)]))


def _compute_loop(columns: Columns, demand: np.ndarray, value: np.ndarray, width: float) -> float:
    """Return torque at a falling minus torque at a rising `demand` [Nm], averaged over the bins of `value` that have both."""
    slope = np.gradient(demand, columns["time_s"])
    moment, sliding, bins = _compute_magnitude(columns), _is_in_slip_control(columns), np.floor(value / width)
    up, down = sliding & (slope > _LEAST_DEMAND_RATE), sliding & (slope < -_LEAST_DEMAND_RATE)
    both = np.intersect1d(bins[up], bins[down])
    return _average(np.array([moment[down & (bins == b)].mean() - moment[up & (bins == b)].mean() for b in both]))


def _compute_pressure_loop(columns: Columns) -> float:
    return _compute_loop(columns, columns["controller_pressure_demand_bar"], _compute_pressure(columns), _PRESSURE_BIN)


def _compute_slip_loop(columns: Columns) -> float:
    return _compute_loop(columns, columns["motor_speed_demand_rad_s"], columns["slip_speed_rad_s"], _SLIP_BIN)


def _find_stretches(mask: np.ndarray) -> list[slice]:
    """Return the slices in which a mask is true without a gap."""
    edges = np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _compute_held_torque_spread(columns: Columns) -> float:
    samples = round(_HOLD_TIME / float(columns["time_s"][1] - columns["time_s"][0]))
    held = [
        _compute_magnitude(columns)[part][-samples:].mean() for part in _find_stretches(_is_in_slip_control(columns))
    ]
    return float(max(held) - min(held)) if held else float("nan")


def _compute_longest_fill(columns: Columns) -> float:
    step = float(columns["time_s"][1] - columns["time_s"][0])
    return _find_highest(
        np.array([(part.stop - part.start) * step for part in _find_stretches(is_in_phase(columns, "fill"))])
    )


def _compute_pressure_bandwidth(columns: Columns) -> float:
    """Return the bandwidth [Hz] from cross spectrum over power spectrum of the demand, in whole seconds of slip control."""
    rate = round(1.0 / float(columns["time_s"][1] - columns["time_s"][0]))
    part = max(_find_stretches(_is_in_slip_control(columns)), key=lambda s: s.stop - s.start, default=slice(0, 0))
    signals = columns["controller_pressure_demand_bar"], _compute_pressure(columns)
    demand, pressure = (_compute_spectra(signal[part], rate) for signal in signals)
    power = (np.abs(demand) ** 2).sum(axis=0)
    if not len(demand):
        return float("nan")
    excited = np.flatnonzero(power[1:] > _EXCITED_POWER_SHARE * power[1:].max()) + 1  # Hz: the lines are 1 Hz apart
    gain = np.abs((pressure * demand.conj()).sum(axis=0)[excited] / power[excited])
    below = np.flatnonzero(gain < _HALF_POWER * gain[0])
    if not len(below) or below[0] == 0:
        return float("nan")
    last, first = below[0] - 1, below[0]
    return float(np.interp(_HALF_POWER * gain[0], [gain[first], gain[last]], [excited[first], excited[last]]))


def _compute_spectra(signal: np.ndarray, rate: int) -> np.ndarray:
    """Return the spectra (seconds, lines of 1 Hz) of the last whole seconds of a signal."""
    whole = len(signal) // rate
    return np.fft.rfft(signal[len(signal) - whole * rate :].reshape(whole, rate), axis=1)


def _compute_torque_over_slip(columns: Columns) -> float:
    sliding = _is_in_slip_control(columns)
    slip, moment = np.abs(columns["slip_speed_rad_s"][sliding]), _compute_magnitude(columns)[sliding]
    if not len(slip):
        return float("nan")
    low, high = slip.min(), slip.max()
    slow, fast = slip < low + _EDGE_SHARE * (high - low), slip > high - _EDGE_SHARE * (high - low)
    return _average(moment[fast]) - _average(moment[slow])


def name_fault(columns: Columns, controllers: Sequence[str] = CONTROLLERS[:1]) -> str:
    """Return the name of the fault with the highest number that `controllers` had in a run; "none" without a fault."""
    numbers = np.concatenate([np.nan_to_num(columns[f"{controller}_fault"]) for controller in controllers])
    return load_frames()["CONTROLLER_STATUS"].list_choices("fault")[int(_find_highest(numbers))]


def _compute_fault_time(columns: Columns) -> float:
    at = np.flatnonzero(columns["controller_fault"] > 0.0)
    return float(columns["time_s"][at[0]]) if len(at) else float("nan")


def _compute_level(columns: Columns) -> float:
    level = columns["controller_friction_level"][_is_in_slip_control(columns)]
    return float(level[-1]) if len(level) else float("nan")


def _compute_estimate_errors(columns: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Return absolute errors of the estimate [Nm] with the clutch closed: later than _TURN_TIME after a turn, and within it."""
    step = float(columns["time_s"][1] - columns["time_s"][0])
    slip = _compute_slip(columns)
    changes = np.diff(np.sign(np.where(np.abs(slip) < _STANDING_SLIP, 0.0, slip)), prepend=0.0) != 0.0
    turning = np.convolve(changes, np.ones(round(_TURN_TIME / step)))[: len(changes)] > 0.0
    error, closed = np.abs(columns["controller_torque_estimate_nm"] - find_torque(columns)), _is_closed(columns)
    return error[closed & ~turning], error[closed & turning]


def _compute_estimate_error(columns: Columns) -> float:
    return _find_highest(_compute_estimate_errors(columns)[0])


def _compute_turning_error(columns: Columns) -> float:
    return _find_highest(_compute_estimate_errors(columns)[1])


def _is_closed(columns: Columns) -> np.ndarray:
    return _is_in_slip_control(columns) | _is_in_lock(columns)


def _is_standing(columns: Columns) -> np.ndarray:
    return np.abs(_compute_slip(columns)) < _STANDING_SLIP


def _compute_locked_time(columns: Columns) -> float:
    locking = _is_in_lock(columns)
    step = float(columns["time_s"][1] - columns["time_s"][0])
    return step * np.count_nonzero(locking & _is_standing(columns)) if locking.any() else float("nan")


def _compute_standstill_times(columns: Columns, mask: np.ndarray) -> np.ndarray:
    """Return the times from the begin of each stretch of `mask` until the plates stick [s]; NaN where they never do."""
    standing, time = _is_standing(columns), columns["time_s"]
    firsts = [(part, np.flatnonzero(standing[part])) for part in _find_stretches(mask)]
    return np.array([time[p.start + at[0]] - time[p.start] if len(at) else np.nan for p, at in firsts])


def _compute_locking_time(columns: Columns) -> float:
    return _find_highest(_compute_standstill_times(columns, _is_in_lock(columns)))


def _compute_stopping_time(columns: Columns) -> float:
    return _find_highest(_compute_standstill_times(columns, _is_closed(columns)))


def _compute_stopping_spread(columns: Columns) -> float:
    times = _compute_standstill_times(columns, _is_closed(columns))
    return float(np.ptp(times)) if len(times) else float("nan")


def _compute_held_angle(columns: Columns) -> float:
    """Return the largest rotation of the shaft [rad], by the encoder, from the first standstill of a lock to its end."""
    standing, turns = _is_standing(columns), []
    for part in _find_stretches(_is_in_lock(columns)):
        angle = columns["shaft_angle_rad"][part][np.maximum.accumulate(standing[part])]
        turns += [np.ptp(angle)] if len(angle) else []
    return _find_highest(np.array(turns))


def _compute_breakaway(columns: Columns) -> float:
    """Return the largest torque [Nm] in the last sample before sticking plates begin to slip."""
    stands = _is_closed(columns) & _is_standing(columns)
    leaves = np.flatnonzero(stands[:-1] & ~stands[1:] & _is_closed(columns)[1:])
    return _find_highest(_compute_magnitude(columns)[leaves])


def _find_highest(values: np.ndarray) -> float:
    return float(values.max()) if len(values) else float("nan")


def _average(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")


MEASURES: Mapping[str, Measure] = {
    "regime_error_nm": Measure(
        "Nm", "mean error of the torque once 90 % of the demand is reached", lambda c: measure_following(c)[0],
    ),
    "rise_time_s": Measure("s", "from the first demand until 90 % of it is reached", lambda c: measure_following(c)[1]),
    "max_torque_error_nm": Measure(
        "Nm", "largest error of the torque once 90 % of the demand is reached", _compute_largest_error
    ),
    "regime_error_share": Measure(
        "1", "regime error over the highest demand: a limit for a clutch of any size",
        lambda c: _compute_share(measure_following(c)[0], c),
    ),
    "max_torque_error_share": Measure(
        "1", "largest error over the highest demand", lambda c: _compute_share(_compute_largest_error(c), c)
    ),
    "peak_torque_nm": Measure("Nm", "largest torque in either direction", lambda c: _find_highest(_compute_magnitude(c))),
    "peak_pressure_bar": Measure("bar", "highest pressure", lambda c: _find_highest(_compute_pressure(c))),
    "final_pressure_bar": Measure("bar", "pressure at the end", lambda c: float(_compute_pressure(c)[-1])),
    "pressure_error_bar": Measure("bar", "mean error of the pressure in slip control", _compute_pressure_error),
    "pressure_bandwidth_hz": Measure("Hz", "where the pressure follows a multisine with -3 dB", _compute_pressure_bandwidth),
    "longest_fill_s": Measure("s", "longest time in fill", _compute_longest_fill),
    "held_torque_spread_nm": Measure(
        "Nm", "highest minus lowest torque at the ends of the engagements", _compute_held_torque_spread
    ),
    "torque_loop_nm": Measure(
        "Nm", "torque at falling minus torque at rising pressure, at equal pressure", _compute_pressure_loop
    ),
    "slip_loop_nm": Measure("Nm", "torque at falling minus torque at rising slip, at equal slip", _compute_slip_loop),
    "torque_over_slip_nm": Measure(
        "Nm", "torque at fast minus torque at slow slip, in the outer tenths of its range", _compute_torque_over_slip
    ),
    "peak_temperature_degc": Measure(
        "degC", "highest measured oil temperature", lambda c: _find_highest(c["oil_temperature_degc"])
    ),
    "friction_level": Measure("1", "adapted level of the friction when slip control ends", _compute_level),
    "estimate_error_nm": Measure("Nm", "largest error of the estimate, not near a slip reversal", _compute_estimate_error),
    "turning_error_nm": Measure("Nm", "largest error of the estimate in 30 ms after a slip reversal", _compute_turning_error),
    "locked_s": Measure("s", "time for which the clutch is locked: plates at rest in the phase lock", _compute_locked_time),
    "locking_time_s": Measure("s", "longest time from the start of lock until the plates are at rest", _compute_locking_time),
    "stopping_time_s": Measure("s", "longest time from the end of fill until the plates are at rest", _compute_stopping_time),
    "stopping_spread_s": Measure("s", "longest minus shortest of these times", _compute_stopping_spread),
    "held_angle_rad": Measure("rad", "largest rotation of a locked clutch after its plates came to rest", _compute_held_angle),
    "breakaway_torque_nm": Measure("Nm", "highest torque at which plates at rest begin to slide", _compute_breakaway),
    "fault": Measure("", "reason of the controller's fault", name_fault, list_faults),
    "fault_time_s": Measure("s", "time of the controller's first fault", _compute_fault_time),
}  # fmt: skip
