"""Level of the friction torque, drifting in time.

Equation        M = (level + drift t) (M_C m + f)
Assumptions     Coulomb and viscous part change alike
Valid range     level 0.3..3; off at level 1, drift 0
Not modelled    the wear that causes it
References      Janssens 2010, sec. 6.2.2 (friction material and oil) and chapter 7 (changing parameters)
"""

from numba import njit


@njit(inline="always")
def factor(time, level, drift):
    """Factor on the clutch torque [-] at `time` [s]; `drift` [1/s]. Never below 0."""
    return max(level + drift * time, 0.0)
