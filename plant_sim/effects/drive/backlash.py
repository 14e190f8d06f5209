"""Backlash between motor and plate.

What            splines or gears with clearance: no torque passes until a flank is met, then it comes with an impact
Equation        J_m dw_m/dt = M_m - T,  J_p dw_p/dt = T - M,  dphi/dt = lambda = w_m - w_p
                T = max(k (phi - b/2) + d lambda, 0) for phi > b/2, its mirror image below -b/2, 0 between;  d = 0.2 sqrt(k J_r)
                J_p = share J,  J_m = (1 - share) J,  J_r = J_p J_m/J;  while the plate sticks w_p = 0
Assumptions     flanks linear, without adhesion, with a damping ratio of 0.1; when the effect is switched on, the flank that
                carries the torque is in contact
Integration     leapfrog with 8 sub-steps at constant M_m and M; the plate gets the mean torque of the step, which keeps
                the momentum
Valid range     k 100..1e5 Nm/rad
Not modelled    oil between the flanks, friction of the flanks, the shaft (shaft_compliance; the two exclude each other)
References      Nordin and Gutman 2002, Automatica 38(10), Controlling mechanical systems with backlash - a survey
"""

from math import copysign, sqrt

from numba import njit

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import DRIVE

# the fastest flank within bounds, 46000 rad/s, turns 0.6 rad in a sub-step of a 0.1 ms step; stable below 2 rad
_SUBSTEPS = 8
_DAMPING = 0.1  # [D] ratio of the engaged flank


@njit(inline="always")
def _flank(twist, lead, half, stiffness, damping):
    """Torque of the flanks [Nm]."""
    if twist > half:
        return max(stiffness * (twist - half) + damping * lead, 0.0)
    if twist < -half:
        return min(stiffness * (twist + half) + damping * lead, 0.0)
    return 0.0


def rattle(s, c, p, x, h):
    """Drive the plate through the clearance."""
    if p.gap == 0.0:
        return
    plate = p.share * c.motor_inertia
    reduced = (1.0 - p.share) * plate
    push = s.drive_torque / (c.motor_inertia - plate) + s.torque / plate  # rad/s^2, of the lead in the gap
    half, damping = 0.5 * p.gap, 2.0 * _DAMPING * sqrt(p.stiffness * reduced)
    if s.still > 0.0:
        reduced = c.motor_inertia - plate
        push = s.drive_torque / reduced
    turned, lead = x.twist, x.lead
    if x.wound == 0.0:
        settled = reduced * push
        turned = settled / p.stiffness + (copysign(half, settled) if settled != 0.0 else 0.0)
    s.inertia = plate
    if h == 0.0:
        s.drive_torque, s.lead = _flank(turned, lead, half, p.stiffness, damping), lead
        return
    short = h / _SUBSTEPS
    for _ in range(_SUBSTEPS):
        turned += 0.5 * short * lead
        lead += short * (push - _flank(turned, lead, half, p.stiffness, damping) / reduced)
        turned += 0.5 * short * lead
    s.drive_torque, s.lead = reduced * (push - (lead - x.lead) / h), lead
    x.twist, x.lead, x.wound = turned, lead, 1.0


EFFECT = Effect(
    block="drive",
    laws={DRIVE: rattle},
    parameters=(
        Strength(
            "gap", "rad", off=0.0, typical=0.02, bounds=(0.0, 0.2),
            source="[D] b: 1.1 degrees, splines in series with 0.4 mm of clearance at 20 mm",
        ),
        Shape("stiffness", "Nm/rad", typical=5e3, bounds=(100.0, 1e5), source="[D] short splined shaft"),
        Shape("share", "1", typical=0.2, bounds=(0.05, 0.95), source="[D] a light plate behind a motor's rotor"),
    ),
    states=(State("twist", "rad"), State("lead", "rad/s"), State("wound", "1")),
    rank=10,  # after the effects that change the motor's torque
    excludes=("shaft_compliance",),
    display=Display("slip_steps"),
)  # fmt: skip
