"""Defaults of a demand that its caller leaves out, for the command and for Python. This module imports nothing."""

SPEED = 10.47  # rad/s of the motor, 100 rpm: where the profile `engagement` begins
TORQUE_RAMP = 40.0  # Nm/s: as the profile `engagement` rises
PRESSURE_RAMP = 4.0  # bar/s: as the experiments rise (clutch_hil/bench/experiments.py)
