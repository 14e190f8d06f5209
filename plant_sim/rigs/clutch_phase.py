"""Phase of the clutch: what valve, piston and plates are doing, determined from the rig's state alone.

    phase    plates       definition
    rest     apart        piston at its rest, and the valve gives less than the springs' preload: nothing will move
    fill     apart        the valve drives oil in: above the preload with the piston at rest, above the cylinder off its rest
    touch    pressed      friction builds up: |m| below half of the static friction (m of eq. 6.9)
    slip     pressed      friction is built up
    stick    pressed      no slip: the plates carry the applied torque, whatever the state m
    release  pressed      the valve gives less than the contact pressure: the plates will part
    drain    apart        the piston goes back and pushes the oil out

An engagement under slip passes them in this order, without stick, and ends at rest.

Assumptions     the springs' preload and contact pressure are the rig's own; friction starts from 0 at each contact
                (docs/rig.md, eq. 4)
Valid range     the wet-clutch rig and each clutch of the power-shift rig
Not modelled    elastic plates (effect `presliding`): they always move, so their phase follows from m alone. A slip that
                reverses passes through touch for about a time constant of the friction (12 ms)
References      Janssens 2010, sec. 6.4.1 and fig 6.10 (filling, piston, contact pressure), eq. 6.9 (m)
"""

from enum import IntEnum

from plant_sim.rigs.wet_clutch import State

# share of the static friction at which touch ends: reached 11 ms after contact at 100 rpm. It is below beta_inf = 0.704,
# so that a change of the slip does not bring touch back.
BUILT_UP_SHARE = 0.5


class Phase(IntEnum):
    """Phases in the order of an engagement; last the phase of sticking plates."""

    REST = 0
    FILL = 1
    TOUCH = 2
    SLIP = 3
    RELEASE = 4
    DRAIN = 5
    STICK = 6


def find_phase(state: State, preload_pressure: float, contact_pressure: float) -> Phase:
    """Return the phase of `state`.

    Pressures [Pa] of the springs with the piston at rest and at the touch (`piston.` parameters).
    """
    if state.normal_force > 0.0:
        if state.valve_pressure < contact_pressure:
            return Phase.RELEASE
        if state.slip_speed == 0.0:
            return Phase.STICK
        return Phase.SLIP if abs(state.friction_state) >= BUILT_UP_SHARE else Phase.TOUCH
    if state.position <= 0.0:
        return Phase.FILL if state.valve_pressure > preload_pressure else Phase.REST
    return Phase.FILL if state.valve_pressure >= state.pressure else Phase.DRAIN
