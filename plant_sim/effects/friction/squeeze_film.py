"""Oil film between the plates is squeezed out after they touch.

What            the film carries the load at first; as it thins, summits of the lining touch the plate and the torque rises
Equation        -dh/dt = F h^3/(kappa eta)  (Reynolds, parallel faces), so with lambda = h/sigma, sigma the roughness:
                1/lambda^2 = 1/lambda_0^2 + J,  dJ/dt = p_n eta_ref/(I eta(T)),  I = kappa eta_ref/(2 sigma^2 A_cyl)
                M = M_0 exp(-lambda^2/2),  p_n = F_n/A_cyl = p* - p_contact
Assumptions     the density of Gaussian summits at the height of the film gives their share of the load; once the plates part,
                the film is full again; its viscosity is that at the oil's temperature
Integration     exact at constant force over a step
Valid range     lambda_0 0..20, I 0.001..1 bar s
Not modelled    shear of the film itself, flow factors (Patir and Cheng), relief of the film by the load on the summits, porous
                lining, grooves (except their part in I), stiffness and damping of the film on the piston
References      Reynolds 1886; Patir and Cheng 1978, J. Lubrication Technology 100; Berger, Sadeghi and Krousgrill 1996,
                J. Tribology 118 (engagement of rough and grooved wet clutches)
"""

from math import exp

from plant_sim.blocks.viscosity import relative_viscosity
from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import TORQUE


def squeeze(s, c, p, x, h):
    """Scale the torque by the share of the load that the summits carry."""
    if s.contact == 0.0:
        if h > 0.0:
            x.squeezed = 0.0
        return
    pressed = s.friction_pressure - c.piston_contact_pressure
    half = 0.5 * h * pressed / (p.impulse * relative_viscosity(s.temperature, c.oil_reference))
    middle = x.squeezed + half
    x.squeezed = middle + half
    first = p.film * p.film
    s.torque *= exp(-0.5 * first / (1.0 + first * middle))


EFFECT = Effect(
    block="friction",
    laws={TORQUE: squeeze},
    parameters=(
        Strength(
            "film", "1", off=0.0, typical=3.0, bounds=(0.0, 20.0),
            source="[D] lambda_0: 15 um at touch over 5 um of lining, the orders of Berger 1996",
        ),
        Shape(
            "impulse", "bar s", typical=0.01, bounds=(1e-3, 1.0),
            source="[D] I: kappa = 2 pi r B^3 n for n lands B = 2.8 mm wide on the face of Janssens 2010, Table 6.2 (n = 6),"
            " eta 12 mPa s, sigma 5 um",
        ),
    ),
    states=(State("squeezed", "1"),),
)  # fmt: skip
