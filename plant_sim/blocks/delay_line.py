"""Delay line: the value that a signal had a fixed time ago.

Equation        y(t) = u(t - T), linear between stored values, so exact for ramps; before the first value y is the first value
Integration     one value per step of length h, or per several steps that last at least LEAST_STEP. A value is `age` steps old
                when its step ends: torques are stored at mid-step
Assumptions     steps of one length
Valid range     T from 0 to (size - 1) LEAST_STEP, or (size - 1) h where that is longer
Not modelled    -
References      Laakso, Valimaki, Karjalainen, Laine 1996: Splitting the unit delay, IEEE Signal Processing Magazine 13(1)

`past` is a ring of 2^k values. The record `x` holds `taken`, the number of values so far, and `step` [s], the time between
them. Several rings of one rig may share a record.
"""

from math import ceil

from numba import njit

AT_END, AT_MID_STEP = 0.0, 0.5  # age of a signal: pressure and temperature; torques
LEAST_STEP = (
    5e-5  # s between stored values: the shortest step of a bench; a recording of 50 kHz is played in shorter ones
)
_ROUNDING = 1e-9  # of a number of steps: a period is a difference of times


@njit(inline="always")
def begin_step(x, h):
    """Begin a step of `h` [s]; h = 0 begins no step."""
    if h > 0.0:
        x.taken += 1.0
        x.step = h


@njit(inline="always")
def read_delayed(past, x, now, delay, age, h):
    """Return the value of the signal `delay` [s] ago.

    now: its value in the step that `begin_step` began or, where h is 0, after the last step.
    """
    newest, mask = int(x.taken) - 1, past.size - 1
    if newest < 0:
        return now
    stride = 1 if x.step >= LEAST_STEP else ceil(LEAST_STEP / x.step - _ROUNDING)
    last = newest // stride  # number of the newest stored value, which is `old` steps old
    old = float(newest - last * stride)
    if h > 0.0 and old == 0.0:
        past[last & mask] = now
    if delay == 0.0:
        return now
    passed = 0.0 if h > 0.0 else age  # since the newest step
    steps = delay / x.step - passed - old  # before the newest stored value
    if steps < 0.0:
        recent = past[last & mask]
        return recent - (now - recent) * (steps / (old + passed))
    steps /= stride
    oldest = min(last, mask)
    whole = min(int(steps), oldest)
    recent, before = past[(last - whole) & mask], past[(last - min(whole + 1, oldest)) & mask]
    return recent + (before - recent) * (steps - whole)
