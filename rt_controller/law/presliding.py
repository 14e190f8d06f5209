"""Pre-sliding: plates that carry a torque bend before they slide. Elements of the XGMS model between stick and slip.

Equation        shares f_i of the limits M_C/N each carries, m = (f_1 + .. + f_N)/N; b_i = b/r^(N-i)
                stick   df_i = dtheta/b_i; the torque of the spring stays when the load changes: f_i M_C is kept, |f_i| <= 1
                slip    from |f_i| = s_n on, and until the speed turns or is zero: f_i' = sign(omega) C (1 - f_i/s_n),
                        solved over the step
Assumptions     the speed is constant over a step; elements of equal limits, each breaks away at r times the angle of the one
                before
Valid range     b > 0; with b = 0 the plates are rigid: they stick as the motor's torque balance says (transmitted.py)
Not modelled    dwell time; the normal motion
References      Janssens 2010, secs 5.4, 5.5, 6.2.3, appendix E; the limits follow plant_sim's effect of the same name
"""

from math import copysign, exp

import numpy as np
from numba import njit

from rt_controller.law.record import floats

ELEMENTS = 4  # as many do nearly as well as ten: Janssens 2010, sec. 5.5, after Tjahjowidodo

# Names and units as in `controller.toml`, SI
PRESLIDING_SETTINGS = floats("angle", "spread")
# share of its limit that each carries [-], direction in which it slips, 0 in stick; capacity M_C [Nm] that they were shares of;
# still: for how long not all have slipped [s]
PRESLIDING = np.dtype(
    [("share", "f8", (ELEMENTS,)), ("latch", "f8", (ELEMENTS,)), ("capacity", "f8"), ("still", "f8")]
)  # fmt: skip


@njit
def bend(state, settings, turned, level, attraction, capacity, step):
    """Move PRESLIDING on by the angle `turned` [rad] in `step` [s]; return m [-], and whether all elements slip.

    `level` s_n [-] of sliding at that speed, `attraction` C [1/s], `capacity` M_C [Nm] at the end of the step.
    """
    load_ratio = state.capacity / capacity if capacity > 0.0 else 0.0
    state.capacity = capacity
    direction = copysign(1.0, turned)
    stiffness = settings.spread ** (ELEMENTS - 1) / settings.angle
    decay = exp(-attraction * step / level)  # sec. 5.5, solved over the step
    total, slides = 0.0, True
    for i in range(ELEMENTS):
        slips, along = state.latch[i] == direction and turned != 0.0, direction * state.share[i]
        if not slips:
            # A change of the load alone does not change the torque of a spring: sec. 5.5, unloading
            along = min(max(along * load_ratio, -1.0), 1.0)
        if slips or (along >= level and turned != 0.0):
            slips, along = True, level + (along - level) * decay
        elif turned != 0.0:
            along += stiffness * abs(turned)  # sec. 5.4, stick
            slips, along = along >= level, min(along, level)
        slides = slides and slips
        state.latch[i] = direction if slips else 0.0
        state.share[i] = direction * along
        total += state.share[i]
        stiffness /= settings.spread
    state.still = 0.0 if slides else state.still + step
    return total / ELEMENTS, slides


@njit
def straighten(state):
    """Plates that have parted carry nothing."""
    state.share[:] = 0.0
    state.latch[:] = 0.0
    state.capacity = state.still = 0.0
