"""Measures of a run of the power-shift rig: the quality of a hand-over of torque from clutch a to clutch b.

Hand-over       begins where the demand of clutch a first falls while there is a demand for clutch b
Torque phase    ends where the demand of clutch a is 0
Shift           ends, after the torque phase, where clutch a transmits less than 5 % of its previous torque and clutch b is
                synchronous, with a slip below 4 rad/s. So the shift includes the inertia phase, in which the input speed
                changes to the new ratio
Window          begins with the first demand of clutch b, so it includes the fill, and ends 0.2 s after the shift. If the
                shift does not end, the window ends 1 s after the torque phase
Before          mean torque in the 0.2 s before the window
Lock-up         begins where clutch b is first in the phase lock, and ends 0.2 s after its plates stick
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from clutch_hil.bench.judgement.measures import Columns, Measure, is_in_phase, list_faults, name_fault
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS

_BEFORE_TIME = 0.2  # s, long enough to average the noise that the loop transmits from the sensors
_AFTER_TIME = 0.2  # s after the shift: two time constants of the motor's speed loop
_LONGEST_TIME = 1.0  # s, length of the window after the torque phase where the shift does not end
_OPEN_SHARE = 0.05  # of the torque before: below this share clutch a counts as open
SYNCHRONOUS = 4.0  # rad/s: twice the slip of the shipped profile in 2nd gear
_STANDING_SLIP = 0.01  # rad/s: plates with less slip stick; the true slip of sticking plates is 0


class Handover(NamedTuple):
    """Sample indices of a hand-over, and the output torque [Nm] `before` it.

    `shift_end` is None if the shift does not end.
    """

    begin: int
    torque_end: int
    shift_end: int | None
    window: slice
    before: float


def find_handover(columns: Columns) -> Handover | None:
    """Find the hand-over of a run; None if there is none, or no torque before it."""
    time, demand_a, demand_b = (columns[n] for n in ("time_s", "torque_demand_a_nm", "torque_demand_b_nm"))
    falls = np.flatnonzero((np.diff(demand_a) < 0.0) & (demand_b[:-1] > 0.0))
    if not len(falls):
        return None
    begin = int(falls[0])
    ends = np.flatnonzero(demand_a[begin:] <= 0.0)
    torque_end = begin + int(ends[0]) if len(ends) else len(time) - 1
    first = int(np.argmax(demand_b > 0.0))
    past = (time >= time[first] - _BEFORE_TIME) & (time < time[first])
    if not (past.any() and np.mean(columns["truth_output_torque_nm"][past]) > 0.0):
        return None
    level = float(np.mean(columns["truth_clutch_torque_a_nm"][past]))
    open_a = np.abs(columns["truth_clutch_torque_a_nm"]) < _OPEN_SHARE * level
    done = np.flatnonzero((open_a & (np.abs(columns["truth_slip_speed_b_rad_s"]) < SYNCHRONOUS))[torque_end:])
    shift_end = torque_end + int(done[0]) if len(done) else None
    last = time[shift_end] + _AFTER_TIME if shift_end is not None else time[torque_end] + _LONGEST_TIME
    window = slice(first, int(np.searchsorted(time, last, side="right")))
    return Handover(begin, torque_end, shift_end, window, float(np.mean(columns["truth_output_torque_nm"][past])))


def _compute_gap(columns: Columns) -> float:
    shift = find_handover(columns)
    if shift is None:
        return float("nan")
    return max(1.0 - float(columns["truth_output_torque_nm"][shift.window].min()) / shift.before, 0.0)


def _compute_peak(columns: Columns) -> float:
    shift = find_handover(columns)
    if shift is None:
        return float("nan")
    return max(float(columns["truth_output_torque_nm"][shift.window].max()) / shift.before - 1.0, 0.0)


def _compute_tie_up(columns: Columns) -> float:
    shift = find_handover(columns)
    if shift is None:
        return float("nan")
    lowest = min(float(columns[f"truth_clutch_torque_{clutch}_nm"][shift.window].min()) for clutch in CLUTCHES)
    return max(0.0, -lowest)


def _compute_shift_time(columns: Columns) -> float:
    shift = find_handover(columns)
    if shift is None or shift.shift_end is None:
        return float("nan")
    return float(columns["time_s"][shift.shift_end] - columns["time_s"][shift.begin])


def _is_b_in_lock(columns: Columns) -> np.ndarray:
    """Return a mask (n,) of the samples in which clutch b is in the phase lock."""
    return is_in_phase(columns, "lock", CONTROLLERS[1])


def _is_b_locked(columns: Columns) -> np.ndarray:
    """Return a mask (n,) of the samples in which clutch b is locked: in the phase lock with sticking plates."""
    return _is_b_in_lock(columns) & (np.abs(columns["truth_slip_speed_b_rad_s"]) < _STANDING_SLIP)


def _compute_locked_time(columns: Columns) -> float:
    step = float(columns["time_s"][1] - columns["time_s"][0])
    return step * np.count_nonzero(_is_b_locked(columns)) if _is_b_in_lock(columns).any() else float("nan")


def _compute_locking_time(columns: Columns) -> float:
    standing = np.flatnonzero(_is_b_locked(columns))
    if not len(standing):
        return float("nan")
    return float(columns["time_s"][standing[0]] - columns["time_s"][np.argmax(_is_b_in_lock(columns))])


def _compute_lock_up_peak(columns: Columns) -> float:
    standing, time = np.flatnonzero(_is_b_locked(columns)), columns["time_s"]
    if not len(standing):
        return float("nan")
    begin, end = time[np.argmax(_is_b_in_lock(columns))], time[standing[0]] + _AFTER_TIME
    output = columns["truth_output_torque_nm"]
    past = (time >= begin - _BEFORE_TIME) & (time < begin)
    before = float(output[past].mean()) if past.any() else 0.0
    if not before > 0.0:
        return float("nan")
    return float(output[(time >= begin) & (time <= end)].max()) / before - 1.0


def _compute_heat(columns: Columns, clutch: str) -> float:
    shift = find_handover(columns)
    if shift is None:
        return float("nan")
    heat = columns[f"truth_heat_{clutch}_j"][shift.window]
    return float(heat[-1] - heat[0])


def _compute_hottest(columns: Columns, clutch: str) -> float:
    return float(columns[f"truth_oil_temperature_{clutch}_degc"].max())


MEASURES: Mapping[str, Measure] = {
    "torque_gap": Measure("1", "deepest dip of the output torque in the hand-over, share of the torque before", _compute_gap),
    "torque_peak": Measure(
        "1", "highest rise of the output torque in the hand-over, share of the torque before", _compute_peak
    ),
    "tie_up_nm": Measure("Nm", "largest torque of a clutch against its gear in the hand-over; both hold", _compute_tie_up),
    "shift_time_s": Measure("s", "from the start of the hand-over until a is open and b is synchronous", _compute_shift_time),
    "heat_a_j": Measure("J", "friction heat of clutch a in the hand-over", lambda c: _compute_heat(c, "a")),
    "heat_b_j": Measure("J", "friction heat of clutch b in the hand-over", lambda c: _compute_heat(c, "b")),
    "peak_temperature_a_degc": Measure("degC", "highest oil temperature of clutch a", lambda c: _compute_hottest(c, "a")),
    "peak_temperature_b_degc": Measure("degC", "highest oil temperature of clutch b", lambda c: _compute_hottest(c, "b")),
    "locked_s": Measure("s", "time for which clutch b is locked", _compute_locked_time),
    "locking_time_s": Measure("s", "from the start of lock until the plates of clutch b are at rest", _compute_locking_time),
    "lock_up_peak": Measure(
        "1", "highest rise of the output torque in the lock-up, share of the torque before", _compute_lock_up_peak
    ),
    "fault": Measure("", "reason of a controller's fault", lambda c: name_fault(c, CONTROLLERS), list_faults),
}  # fmt: skip
