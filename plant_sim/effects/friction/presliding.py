"""Stick before slip: the torque rises like a spring before the plates slide.

What            asperities bend before they break, with a memory of every reversal
Equation        M = W (f_1 + ... + f_4)/4 + f(omega);  df_i = dtheta/b_i while |f_i| < 1, else |f_i| = 1
                b_i = b/r^3, b/r^2, b/r, b  (Maxwell-slip elements of equal limits; W and f: Coulomb and viscous
                part of gross sliding; thesis sec. 5.2); r = 1: one spring, as where the frame bends more than the asperities
Assumptions     limits follow the level of sliding without delay, as in sec. 5.5; the level stays the same over a reversal
Integration     elements exact at constant slip. Their torque is that at the end of the step: it is stable for h w < 1.4, and
                damps a plate that swings on them at the frequency w with a ratio of about h w/4. The plates never stick rigidly
Valid range     b 1e-4..0.1 rad, for the plate's inertia and steps of 0.1 ms; below it, plates that stick chatter
Not modelled    a lag of each element (GMS): the level lags as a whole; creep
References      Janssens 2010, secs 5.2 and 5.5, appendix D; Lampaert 2003; Iwan 1966; plant_sim/friction/maxwell_slip.py
"""

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import FRICTION, TORQUE
from plant_sim.friction.maxwell_slip import element

_ELEMENTS = 4  # as good as ten on a measured contact (reproduce microtribometer; Janssens 2010, sec. 5.5)


def keep_level(s, c, p, x, h):
    """Give the sliding level the sign of the slip at once: at a reversal it does not pass through 0."""
    if p.angle > 0.0 and s.friction_state * s.slip < 0.0:
        s.friction_state = -s.friction_state


def bend(s, c, p, x, h):
    """Replace the sliding torque by that of the elements, whose limit it is."""
    if p.angle == 0.0:
        return
    if s.contact == 0.0:
        if h > 0.0:
            x.bent[:] = 0.0
        return
    total, stiffness, turned = 0.0, p.spread * p.spread * p.spread / p.angle, h * s.slip
    for i in range(_ELEMENTS):
        x.bent[i] = element(x.bent[i], turned, stiffness, 1.0)
        total += x.bent[i]
        stiffness /= p.spread
    viscous = s.viscous_share if s.slip >= 0.0 else -s.viscous_share
    s.torque = abs(s.torque) * ((1.0 - s.viscous_share) * (total / _ELEMENTS) + viscous)


EFFECT = Effect(
    block="friction",
    laws={FRICTION: keep_level, TORQUE: bend},
    parameters=(
        Strength(
            "angle", "rad", off=0.0, typical=2e-3, bounds=(0.0, 0.1),
            source="[D] b: some 0.1 mm at the mean radius of 58 mm of Janssens 2010, Table 6.2, as for paper linings",
        ),
        Shape(
            "spread", "1", typical=2.0, bounds=(1.0, 4.0),
            source="[D] r: each element breaks away at twice the angle of the one before",
        ),
    ),
    states=(State("bent", "1", _ELEMENTS),),
    rank=10,  # after the effects that change the sliding torque, which is its limit
    display=Display("reversals", column="shaft_angle_rad", over="clutch_torque_nm"),
)  # fmt: skip
