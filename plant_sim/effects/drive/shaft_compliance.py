"""Elastic shaft between motor and plate.

What            motor and turning plate are two inertias on a shaft that twists, so that the plate swings against the motor
Equation        J_m dw_m/dt = M_m - T,  J_p dw_p/dt = T - M,  lambda = dphi/dt = w_m - w_p
                T = phi/e + 2 zeta sqrt(J_r/e) lambda;  eigenfrequency 1/sqrt(e J_r), damping ratio zeta
                J_p = share J,  J_m = (1 - share) J,  J_r = J_p J_m/J;  while the plate sticks w_p = 0, J_m in place of J_r
Assumptions     massless linear shaft; damping as a ratio, of the shaft with both ends free; when the effect is switched on, the
                shaft is twisted as its torques require
Integration     exact at constant M_m and M; the plate gets the mean torque over the step, so that momentum is kept
Valid range     e 0..0.1 rad/Nm: stable over all of it; samples of the motor's speed show oscillations up to about 1 kHz
Not modelled    inertia of the shaft, torsional modes beyond the first, clearance (backlash)
References      Inman 2014, Engineering vibration, ch. 4 (two-degree-of-freedom systems)
"""

from math import cos, exp, sin, sqrt

from plant_sim.effects.effect import Effect, Shape, State, Strength
from plant_sim.effects.signals import DRIVE


def twist(s, c, p, x, h):
    """Drive the plate through the shaft."""
    if p.compliance == 0.0:
        return
    plate = p.share * c.motor_inertia
    reduced = (1.0 - p.share) * plate
    damping = 2.0 * p.damping * sqrt(reduced / p.compliance)  # Nm s/rad
    push = s.drive_torque / (c.motor_inertia - plate) + s.torque / plate  # rad/s^2, of the lead on a slack shaft
    if s.still > 0.0:
        reduced = c.motor_inertia - plate
        push = s.drive_torque / reduced
    settled = reduced * push  # Nm, in a shaft that does not swing
    spring = x.spring if x.wound > 0.0 else settled
    decay = 0.5 * damping / reduced
    s.inertia = plate
    if h == 0.0:
        s.drive_torque, s.lead = spring + damping * x.lead, x.lead
        return
    swing = sqrt(1.0 / (p.compliance * reduced) - decay * decay)
    left = exp(-decay * h)
    cosine, sine = left * cos(swing * h), left * sin(swing * h) / swing
    away, before = spring - settled, x.lead
    x.spring = settled + away * cosine + (before / p.compliance + decay * away) * sine
    x.lead = before * cosine - (away / reduced + decay * before) * sine
    x.wound = 1.0
    s.drive_torque, s.lead = reduced * (push - (x.lead - before) / h), x.lead


EFFECT = Effect(
    block="drive",
    laws={DRIVE: twist},
    parameters=(
        Strength(
            "compliance", "rad/Nm", off=0.0, typical=3e-3, bounds=(0.0, 0.1),
            source="[D] 50 cm of steel shaft 20 mm thick have 4e-4, a torque sensor as much again, the rest is the couplings'",
        ),
        Shape("share", "1", typical=0.2, bounds=(0.05, 0.95), source="[D] a light plate behind a motor's rotor"),
        Shape("damping", "1", typical=0.03, bounds=(0.001, 0.9), source="[D] steel shaft with couplings"),
    ),
    states=(State("spring", "Nm"), State("lead", "rad/s"), State("wound", "1")),
    rank=10,  # after the effects that change the motor's torque
    excludes=("backlash",),
)  # fmt: skip
