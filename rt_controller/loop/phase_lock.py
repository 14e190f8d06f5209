"""Phase lock: a time grid that follows the arrival of the samples, a quarter of a period behind.

Equation        e = arrival + T/4 - slot, within +-T/2;  I += K_I e;  next slot = slot + T + K_P e + I;
                |I| and |K_P e + I| are limited to T/50
Assumptions     the samples have nearly the period of the controller
References      Gardner 2005, Phaselock Techniques, ch. 2 (loop of second order, damped by 1/sqrt 2: K_P^2 = 2 K_I)
"""

from typing import Any

from numba import njit

_K_P, _K_I = 0.02, 0.0002  # bandwidth of some 3 Hz at 1 kHz: far below the jitter, far above the drift of crystals
_STEP_DIVISOR = 50  # the grid moves by at most a period / 50 in a cycle


@njit(cache=True, nogil=True)
def follow(clocks: Any, drifts: Any, complete: Any, arrived_ns: Any) -> None:
    """Move the grid of `clocks`, shape (1,) of CLOCK, after a cycle.

    `complete`: the cycle had a sample, which arrived at `arrived_ns` [ns of the same clock]. `drifts`, shape (1,), is I [ns per
    period].
    """
    clock, error = clocks[0], 0
    period = clock.period
    if complete:
        error = (arrived_ns + period // 4 - clock.deadline + period // 2) % period - period // 2
    most = period / _STEP_DIVISOR
    drifts[0] = min(max(drifts[0] + _K_I * error, -most), most)
    shift = round(min(max(_K_P * error + drifts[0], -most), most))
    clock.deadline += shift
    clock.first += shift
