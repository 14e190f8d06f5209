"""Sensors of the tribometer: three ring dynamometers, three capacitive gap sensors, encoder.

Equation        a ring measures its share of torque and load plus noise, in steps of its resolution; outputs are sums of three
                gap sensor i sees the gap plus (tilt/2) sin(phi + 2 pi i/3), phi the angle between the disks
                encoder: whole counts, 2 pi/163840 rad
Assumptions     the resolution is the standard deviation of white noise before rounding to it (which makes the rounding
                harmless for averages); load and torque shared equally by the rings
Not modelled    amplifier bandwidth, cross-talk, drift
References      Janssens 2010, secs. 3.9 and 4.2.1
"""

from math import pi

import numpy as np

from protocols.files.parameters import ParameterSet

Array = np.ndarray
RINGS = 3


class Sensors:
    """Noise source and resolutions of one rig; `seed` makes the noise reproducible."""

    def __init__(self, parameters: ParameterSet, seed: int) -> None:
        s = parameters.list_si("sensors")
        self._torque_step = s["tangential_resolution"] * s["tangential_torque"]  # Nm, one ring
        self._load_step = s["normal_resolution"] * s["normal_range"]  # N, one ring
        self._torque_limit, self._load_limit = s["tangential_torque"], s["normal_range"]
        self._gap_noise, self._tilt = s["gap_noise"], 0.5 * parameters["disks.tilt"].si
        self._count = 2.0 * pi / parameters["motor.encoder_counts"].si  # rad
        self._random = np.random.default_rng(seed)

    def read_torque(self, true: Array) -> Array:
        """Return the torque of the three rings [Nm] (n,); beyond its range a ring saturates."""
        return self._read_rings(true, self._torque_step, self._torque_limit)

    def load(self, true: Array) -> Array:
        """Return the normal load of the three rings [N] (n,); beyond its range a ring saturates."""
        return self._read_rings(true, self._load_step, self._load_limit)

    def read_gap(self, true: Array, angle: Array) -> Array:
        """Return the three gap readings [m] (3, n) for the mean gap [m] (n,) and the angle between the disks [rad] (n,)."""
        phase = 2.0 * pi * np.arange(RINGS)[:, None] / RINGS
        wobble = self._tilt * np.sin(angle + phase)
        return true + wobble + self._gap_noise * self._random.standard_normal((RINGS, true.size))

    def read_encoder(self, true: Array) -> Array:
        """Return the motor angle [rad] (n,) in whole counts."""
        return np.floor(true / self._count) * self._count

    def _read_rings(self, true: Array, step: float, limit: float) -> Array:
        noisy = true / RINGS + step * self._random.standard_normal((RINGS, true.size))
        rounded = np.round(noisy / step) * step if step > 0.0 else noisy
        return np.clip(rounded, -limit, limit).sum(axis=0)
