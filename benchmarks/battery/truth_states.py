"""States of the truth's rig, by their place in a vector (STATES,): of rig.md, then of effects. SI units."""

PV, PV_RATE, P, X, M, KELVIN, SLIP, INTEGRAL, ANGLE = range(9)  # of rig.md
SEAL, SPUN, M_SLOW, LOAD_1, LOAD_2, HEAT_1, HEAT_2, HEAT_3, FILM, BENT = range(9, 19)
TWIST, MOTOR, LINE, DRIVE, ASKED, WORK = range(19, 25)
STATES = 25
