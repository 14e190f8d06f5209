"""Pre-sliding: plates bend under a torque before they slide. Elements of the XGMS model that stick or slip.

Equation        element i carries the share f_i of its limit M_C/N; m = (f_1 + .. + f_N)/N; b_i = b/r^(N-i)
                stick   df_i = dtheta/b_i; a change of the load does not change the torque of the spring: f_i M_C is constant,
                        |f_i| <= 1
                slip    from |f_i| = s_n on, until the speed is zero or changes its sign: f_i' = sign(omega) C (1 - f_i/s_n),
                        solved over the step
Assumptions     the speed is constant over a step; all elements have the same limit; each breaks away at r times the angle of
                the one before
Valid range     b > 0; with b = 0 the plates are rigid: the motor's torque balance decides when they stick (transmitted.py)
Not modelled    dwell time; the normal motion
References      Janssens 2010, secs 5.4, 5.5, 6.2.3, appendix E; the limits follow plant_sim's effect of the same name
"""

from math import copysign, exp

import numpy as np
from numba import njit

from rt_controller.law.record import make_float_type

ELEMENTS = 4  # elements: four are nearly as good as ten, Janssens 2010, sec. 5.5, after Tjahjowidodo

# Names and units as in `controller.toml`, SI
PRESLIDING_SETTINGS = make_float_type("angle", "spread")
# share: part of its limit that each element carries [-]; latch: direction in which it slips, 0 in stick; capacity: M_C of the
# step before [Nm]; still: time since all elements slipped [s]
PRESLIDING = np.dtype(
    [("share", "f8", (ELEMENTS,)), ("latch", "f8", (ELEMENTS,)), ("capacity", "f8"), ("still", "f8")]
)  # fmt: skip


@njit
def bend(state, settings, turned, level, attraction, capacity, step):
    """Advance PRESLIDING by the angle `turned` [rad] in `step` [s]; return m [-], and whether all elements slip.

    `level` is s_n [-] at this speed; `attraction` is C [1/s]; `capacity` is M_C [Nm] at the end of the step.
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
    """Reset PRESLIDING: plates without contact carry no torque."""
    state.share[:] = 0.0
    state.latch[:] = 0.0
    state.capacity = state.still = 0.0
