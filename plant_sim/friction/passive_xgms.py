"""Passive XGMS: the XGMS model that can never give out energy.

What            XGMS in which no spring grows by more than its end moves
Equation        as `xgms`, and in slip F_i = m_i F_s, or less while dF_i = k_i |dx|: the spring follows as fast as it can
Assumptions     as `xgms`; sum F_i^2/(2 k_i) is the stored energy, at each step at most the work done since
Valid range     as `xgms`. Where k_i |v| is below the rate of the slip law (soft springs, slow motion after fast) the force
                comes later than in XGMS: not after the time 1/C, but after the displacement (alpha_i s - F_i)/k_i
Not modelled    as `xgms`
References      the bound is of this project; Janssens 2010, sec. 5.5 for the rest
"""

from dataclasses import dataclass

from plant_sim.friction.kernel import law
from plant_sim.friction.xgms import XGMS, advance


@law
def passive_xgms(parameters, state, displacement, dt, load, new_state):
    """Return the force [N]; state and parameters are those of `xgms.xgms`."""
    return advance(parameters, state, displacement, dt, load, new_state, True)


@dataclass(frozen=True, eq=False)
class PassiveXGMS(XGMS):
    """XGMS with bounded growth; parameters of `XGMS`. Raises InputError."""

    law = staticmethod(passive_xgms)
