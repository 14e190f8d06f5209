"""Index of each state of the truth's rig in the state vector (STATES,). SI units.

The first nine states are those of docs/rig.md, the others belong to effects.
"""

# valve pressure and its rate, cylinder pressure, piston position, friction state m, oil temperature, slip speed,
# integral of the motor's speed controller, shaft angle
PV, PV_RATE, P, X, M, KELVIN, SLIP, INTEGRAL, ANGLE = range(9)
SEAL, SPUN, M_SLOW, LOAD_1, LOAD_2, HEAT_1, HEAT_2, HEAT_3, FILM, BENT = range(9, 19)
TWIST, MOTOR, LINE, DRIVE, ASKED, WORK = range(19, 25)
STATES = 25
