"""The one signature of every friction law, so that a rig that is compiled once runs with any of them.

    force = law(parameters, state, displacement, dt, load, new_state)

`displacement` [m] is made during the step `dt` [s] at constant velocity; `load` [N] is the normal force at its end. A law
without load dependence ignores it. `new_state` is written and may be `state` itself. A solver may call a law many times from
one state with trial displacements. In a rotational rig read rad, Nm and Nm/rad for m, N and N/m.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import config, njit, types
from numba.core.entrypoints import init_all
from numba.core.types import float64

if not config.DISABLE_JIT:  # type: ignore[attr-defined]
    init_all()  # installs `protocols.kernels.compiling`; Numba itself does so after the first function with a signature

Law = Callable[[np.ndarray, np.ndarray, float, float, float, np.ndarray], float]

VECTOR = types.Array(types.float64, 1, "C")
SIGNATURE = float64(VECTOR, VECTOR, float64, float64, float64, VECTOR)
LAW = types.FunctionType(SIGNATURE)  # the type of a law as an argument of a jitted function


def law(function: Any) -> Any:
    """Compile a friction law with the signature of all laws. A division by 0 gives infinity: asking costs 20 ns a step.

    Laws of this package are kept on disk; a user's are compiled anew in each process, so that none is older than its source.
    """
    ours = (function.__module__ or "").startswith("plant_sim.")  # None in `exec`
    return njit(SIGNATURE, cache=ours, error_model="numpy")(function)


_TRACE_SIGNATURE = types.void(LAW, VECTOR, VECTOR, VECTOR, float64, VECTOR, VECTOR, types.Array(types.float64, 2, "C"))


@njit(_TRACE_SIGNATURE, cache=True)
def trace(law, parameters, state, position, dt, load, force, states):
    """Play `position` [m] (n,) through a law from `state`; write `force` [N] (n,) and `states` (n, m).

    The first sample is the start: no step is made, the force there is 0.
    """
    force[0] = 0.0
    states[0] = state
    for i in range(1, position.size):
        displacement = position[i] - position[i - 1]
        force[i] = law(parameters, states[i - 1], displacement, dt, load[i], states[i])
