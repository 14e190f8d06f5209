"""Zero error of the speed that the drive regulates on.

What            the drive's own tachometer or its speed demand is off by a constant, so the motor holds another speed
Equation        M_m = k_p e + k_i int e dt,  e = omega_d - (omega + offset)
Assumptions     constant; sensors of the rig are unaffected
Valid range     offset -5..5 rad/s
Not modelled    an error in proportion to the speed
References      docs/rig.md, 8
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Strength
from plant_sim.effects.signals import DRIVE


def add(s, c, p, x, h):
    """Add the zero error to the motor speed that the drive's regulator uses."""
    s.lead += p.offset


EFFECT = Effect(
    block="drive",
    laws={DRIVE: add},
    rank=20,  # after elastic shafts, which set the lead
    candidate=False,
    parameters=(
        Strength(
            "offset", "rad/s", off=0.0, typical=0.3, bounds=(-5.0, 5.0),
            source="[D] 1 % of the 26 rad/s of the maps",
        ),
    ),
    display=Display("engagement", column="slip_speed_rad_s"),
)  # fmt: skip
