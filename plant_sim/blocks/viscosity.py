"""Viscosity of the oil over its temperature, as a ratio.

Equation        eta(T)/eta(T_0) = exp(B [1/(T - T_V) - 1/(T_0 - T_V)])                              (Vogel's law)
Assumptions     B and T_V from 35 mm^2/s at 40 degC and 7.2 mm^2/s at 100 degC, usual for automatic transmission oils;
                the density, which falls by 4 % in between, is taken as constant
Valid range     -20..150 degC
Not modelled    shear thinning, pressure
References      Vogel 1921, Physikalische Zeitschrift 22, p. 645
"""

from math import exp

from numba import njit

from protocols.files.units import ZERO_CELSIUS

VOGEL_SLOPE = 765.0  # K, B
VOGEL_ORIGIN = ZERO_CELSIUS - 103.0  # K, T_V
HOTTEST = ZERO_CELSIUS + 150.0  # K, end of fig 6.8 of Janssens 2010
_LEAST_DISTANCE = 50.0  # K above T_V, where a mineral oil no longer flows; keeps the exponent finite


@njit(inline="always", cache=True)
def relative_viscosity(temperature, reference):
    """Return the viscosity at `temperature` over that at `reference`, both [K]."""
    return exp(
        VOGEL_SLOPE * (1.0 / max(temperature - VOGEL_ORIGIN, _LEAST_DISTANCE) - 1.0 / (reference - VOGEL_ORIGIN))
    )


@njit(inline="always", cache=True)
def relative_conductance(temperature, reference, share):
    """Return the conductance of a passage at `temperature` over that at `reference`, both [K].

    share: part [1] of its resistance that is laminar; 0 is an orifice. Above HOTTEST the viscosity is taken as constant.
    """
    return relative_viscosity(min(temperature, HOTTEST), reference) ** -share
