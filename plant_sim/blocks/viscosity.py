"""Viscosity of the oil over its temperature, as a ratio.

Equation        eta(T)/eta(T_0) = exp(B [1/(T - T_V) - 1/(T_0 - T_V)])                              (Vogel's law)
Assumptions     B and T_V from 35 mm^2/s at 40 degC and 7.2 mm^2/s at 100 degC, usual for automatic transmission oils [D]; the
                4 % that the density falls in between are left out
Valid range     -20..150 degC
Not modelled    shear thinning, pressure
References      Vogel 1921, Physikalische Zeitschrift 22, p. 645
"""

from math import exp

from numba import njit

from protocols.files.units import ZERO_CELSIUS

SLOPE = 765.0  # K, B
ORIGIN = ZERO_CELSIUS - 103.0  # K, T_V
_NEAREST = 50.0  # K from T_V: a mineral oil no longer flows there


@njit(inline="always", cache=True)
def relative_viscosity(temperature, reference):
    """Viscosity at `temperature` over that at `reference`, both [K]."""
    return exp(SLOPE * (1.0 / max(temperature - ORIGIN, _NEAREST) - 1.0 / (reference - ORIGIN)))
