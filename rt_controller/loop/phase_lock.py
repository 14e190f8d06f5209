"""Phase lock: a grid that follows the samples' arrival, a quarter of a period behind it.

Equation        e = arrival + T/4 - slot, within +-T/2;  I += K_I e;  next slot = slot + T + K_P e + I, the last two together
                at most T/50
Assumptions     sample times are a grid of nearly our period
References      Gardner 2005, Phaselock Techniques, ch. 2 (loop of second order, damped by 1/sqrt 2: K_P^2 = 2 K_I)
"""

from typing import Any

from numba import njit

from protocols.realtime.clock import Word

_K_P, _K_I = 0.02, 0.0002  # bandwidth of some 3 Hz at 1 kHz: far below the jitter, far above the drift of crystals
_FURTHEST = 50  # part of a period that the grid moves at most in a cycle
_PERIOD, _FIRST, _DEADLINE = int(Word.PERIOD), int(Word.FIRST), int(Word.DEADLINE)


@njit(cache=True, nogil=True)
def follow(words: Any, drifts: Any, complete: Any, arrived_ns: Any) -> None:
    """Move the grid of the clock that has `words` after a cycle, in which a sample that `arrived_ns` was `complete`, or none.

    `drifts`, shape (1,), is I [ns a period].
    """
    period, error = words[_PERIOD], 0
    if complete:
        error = (arrived_ns + period // 4 - words[_DEADLINE] + period // 2) % period - period // 2
    most = period / _FURTHEST
    drifts[0] = min(max(drifts[0] + _K_I * error, -most), most)
    by = round(min(max(_K_P * error + drifts[0], -most), most))
    words[_DEADLINE] += by
    words[_FIRST] += by
