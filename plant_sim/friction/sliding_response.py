"""Friction as a damper: how the force follows small changes of the speed in steady sliding.

What            the linear response of a friction model about a sliding speed v, for stability, judder and loop gain
Equation        dF/dv (j omega) = s'(v) (1 + j omega T_1)/(1 + j omega T) + f'(v)
                s'(v) = F_S (beta - 1) V_S/v^2 exp(-V_S/|v|),  f'(v) = gamma C_v |v|^(gamma - 1)              (1.4 by v)
                T = s/C of `gms` (5.4), s/(F_s C) of `xgms` (6.9), s/(sigma_0 |v|) of `lugre`, 0 of `coulomb`;
                T_1 = sigma_1/sigma_0 of `lugre`, else 0
                a resonance at omega with damping c in series with the contact grows where c + Re dF/dv < 0
Assumptions     all elements slip, the load is constant, the change of the speed is small beside v
Valid range     v not 0; for `passive_xgms` where its springs can follow (k_i |v| above the rate of the slip law)
Not modelled    the lag of the normal direction (`lift_up`), changes of the load
References      derived here from the laws of the models; the friction lag: Janssens 2010, secs. 1.6.3.4, 5.4 and 6.4.4
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from plant_sim.friction.model import Array, check_real, require
from protocols.errors import InputError


@dataclass(frozen=True)
class SlidingResponse:
    """Response of friction to small changes of the sliding speed.

    `falling` s'(v) [Ns/m] is the part that lags by `lag` T [s], with the `lead` T_1 [s]; `viscous` f'(v) [Ns/m] acts at once.
    """

    falling: float
    viscous: float
    lag: float = 0.0
    lead: float = 0.0

    @property
    def damping(self) -> float:
        """Slope of the Stribeck curve dS/dv [Ns/m], what slow changes see; negative where friction falls with the speed."""
        return self.falling + self.viscous

    def at(self, frequency: Array | float) -> Array:
        """Return dF/dv [Ns/m], complex, at `frequency` [Hz] of 0 or more, same shape. Raises InputError."""
        frequencies = check_real("frequency", frequency)
        require("least frequency", float(frequencies.min(initial=0.0)), least=0.0, unit="Hz")
        s = 2j * pi * frequencies
        return self.falling * (1.0 + s * self.lead) / (1.0 + s * self.lag) + self.viscous

    def needed_damping(self, frequency: Array | float) -> Array:
        """Return the least damping [Ns/m] with which a resonance at `frequency` [Hz] does not grow, same shape; 0 if none is.

        Raises InputError.
        """
        return np.maximum(0.0, -np.real(self.at(frequency)))


def require_sliding(velocity: object) -> float:
    """Return the sliding `velocity` [m/s], one number that is not 0. Raises InputError."""
    value = check_real("sliding velocity", velocity)
    if value.shape != () or value == 0.0:
        raise InputError(f"sliding velocity is {velocity!r:.60}; allowed is one number that is not 0")
    return float(value)
