"""Phase lock: a grid that follows the samples' arrival, a quarter of a period behind it.

Equation        e = arrival + T/4 - slot, within +-T/2;  I += K_I e;  next slot = slot + T + K_P e + I, the last two together
                at most T/50
Assumptions     sample times are a grid of nearly our period
References      Gardner 2005, Phaselock Techniques, ch. 2 (loop of second order, damped by 1/sqrt 2: K_P^2 = 2 K_I)
"""

from typing import Any

from numba import njit

_K_P, _K_I = 0.02, 0.0002  # bandwidth of some 3 Hz at 1 kHz: far below the jitter, far above the drift of crystals
_STEP_DIVISOR = 50  # part of a period that the grid moves at most in a cycle


@njit(cache=True, nogil=True)
def follow(clocks: Any, drifts: Any, complete: Any, arrived_ns: Any) -> None:
    """Move the grid of `clocks` (1,) of CLOCK after a cycle, in which a sample that `arrived_ns` was `complete`, or none.

    `drifts`, shape (1,), is I [ns a period].
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
