"""Defaults of the omitted arguments of a demand, for the command and for Python. This module imports nothing."""

SPEED = 10.47  # rad/s of the motor, 100 rpm: initial speed of the profile `engagement`
TORQUE_RAMP = 40.0  # Nm/s: same rise as in the profile `engagement`
PRESSURE_RAMP = 4.0  # bar/s: same rise as in the experiments (clutch_hil/bench/experiments.py)
