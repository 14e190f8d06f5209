"""Delay line: what a signal was a fixed time ago.

Equation        y(t) = u(t - T), linear between the values taken, so exact for ramps; before the first of them y is the first
Integration     one value each step of length h. A value is `age` steps old when its step ends: torques are taken at mid-step
Assumptions     steps of one length
Valid range     T from 0 to (size - 1) h
Not modelled    -
References      Laakso, Valimaki, Karjalainen, Laine 1996: Splitting the unit delay, IEEE Signal Processing Magazine 13(1)

`past` is a ring of 2^k values; the record `x` holds `taken`, the number of values so far, and `step` [s], the time between
them. Rings of one rig may share them.
"""

from numba import njit

AT_END, AT_MID_STEP = 0.0, 0.5  # age of a signal: pressure and temperature; torques


@njit(inline="always")
def count(x, h):
    """Begin a step of `h` [s]; with h = 0 none begins."""
    if h > 0.0:
        x.taken += 1.0
        x.step = h


@njit(inline="always")
def delayed(past, x, now, delay, age, h):
    """The signal `delay` [s] ago; `now` is its value in the step that `count` began or, where h is 0, after the last one."""
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
