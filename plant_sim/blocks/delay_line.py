"""Delay line: the value that a signal had a fixed time ago.

Equation        y(t) = u(t - T), linear between stored values, so exact for ramps; before the first of them y is the first
Integration     one value each step of length h. A value is `age` steps old when its step ends: torques are stored at mid-step
Assumptions     steps of one length
Valid range     T from 0 to (size - 1) h
Not modelled    -
References      Laakso, Valimaki, Karjalainen, Laine 1996: Splitting the unit delay, IEEE Signal Processing Magazine 13(1)

`past` is a ring of 2^k values. The record `x` holds `taken`, the number of values so far, and `step` [s], the time between
them. Several rings of one rig may share a record.
"""

from numba import njit

AT_END, AT_MID_STEP = 0.0, 0.5  # age of a signal: pressure and temperature; torques


@njit(inline="always")
def begin_step(x, h):
    """Begin a step of `h` [s]; h = 0 begins no step."""
    if h > 0.0:
        x.taken += 1.0
        x.step = h


@njit(inline="always")
def read_delayed(past, x, now, delay, age, h):
    """Value of the signal `delay` [s] ago.

    now: its value in the step that `begin_step` began or, where h is 0, after the last step.
    """
    newest, mask = int(x.taken) - 1, past.size - 1
    if h > 0.0:
        past[newest & mask] = now
    if newest < 0 or delay == 0.0:
        return now
    steps = delay / x.step - (0.0 if h > 0.0 else age)  # before the newest value
    if steps < 0.0:
        recent = past[newest & mask]
        return recent - (now - recent) * (steps / age)
    oldest = min(newest, mask)
    whole = min(int(steps), oldest)
    recent, before = past[(newest - whole) & mask], past[(newest - min(whole + 1, oldest)) & mask]
    return recent + (before - recent) * (steps - whole)
