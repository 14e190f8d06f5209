"""Floors of the battery: noise and rounding of each column, and the gap of a difference in multiples of them.

Severity is the gap that each effect makes alone: sqrt(1 + (d/floor)^2) in the analog output where it is largest. d is the root
mean square, over the five runs, of the difference between simulations with and without the effect, at the same voltage and
without noise. Encoder columns do not count: the encoder has no noise, and the motor's integrator turns any change of
torque into an angle of thousands of counts.

Noise is the standard deviation of each analog channel as a share of a typical value of the rig: 3.4 bar and 17 Nm, at
which the thesis measures most (Janssens 2010, ch. 6), and 10 K, by which a run of 24 s heats the oil.
"""

import numpy as np

from benchmarks.battery.truth_simulation import (
    ANALOG_COUNT,
    PERIOD,
)

TYPICAL = np.array([3.4, 10.0, 17.0, 17.0])  # bar, K, Nm, Nm; noise is a share of these, see above
# of the converters: docs/rig.md, eq. 9
_ADC_STEPS = np.array([20 / 4096 / 1.0, 20 / 4096 / 0.05, 20 / 4096 / 0.2, 20 / 65536 / 0.2])
_ENCODER_COUNT = 2.0 * np.pi / 163840  # rad, of the encoder


def compute_noise_floors(noise: float) -> np.ndarray:
    """Return the floor of each of COLUMNS (6,) in its unit: standard deviation of noise and rounding."""
    analog = np.hypot(noise * TYPICAL, _ADC_STEPS / np.sqrt(12.0))
    return np.concatenate([analog, [_ENCODER_COUNT / np.sqrt(12.0), _ENCODER_COUNT / np.sqrt(6.0) / PERIOD]])


def compute_gap(rms: np.ndarray, noise: float) -> float:
    """Return the gap [-] in units of the floor: sqrt(1 + (d/floor)^2), largest of the analog columns.

    rms: d of COLUMNS (6,).
    """
    return float(np.sqrt(1.0 + np.max((rms / compute_noise_floors(noise))[:ANALOG_COUNT]) ** 2))
