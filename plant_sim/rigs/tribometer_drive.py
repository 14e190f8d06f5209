"""Drives of the tribometer: demands to the motor, and the common control law.

Equation        M_m = torque + stiffness (angle - theta_3) + damping (velocity - omega_3), within the torque limit
Assumptions     an ideal torque source; the proportional loops are analogue (no sampling, no delay)
Not modelled    torque ripple, current loop, trip at overspeed
References      Janssens 2010, secs. 3.9.2 and 3.10: proportional velocity or position controller

Torque control has neither stiffness nor damping; the weak position loop of sec. 3.10 is a torque with a little stiffness.
Velocity control with a proportional gain alone has no stiffness: below break-away it stands still.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plant_sim.friction.model import check_real, require
from protocols.errors import InputError

Array = np.ndarray
Signal = float | Array | Callable[[Array], Array]  # constant, one value a sample, or a function of the time [s] (n,)


@dataclass(frozen=True)
class Drive:
    """Signals `torque` [Nm], `angle` [rad], `velocity` [rad/s] and the gains `stiffness` [Nm/rad], `damping` [Nm s/rad]."""

    torque: Signal = 0.0
    angle: Signal = 0.0
    velocity: Signal = 0.0
    stiffness: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        require("drive stiffness", self.stiffness, least=0.0, most=1e9, unit="Nm/rad")
        require("drive damping", self.damping, least=0.0, most=1e9, unit="Nm s/rad")

    def compute_command(self, time: Array) -> Array:
        """Return the part of the motor torque [Nm] (n,) that does not depend on the motion. Raises InputError."""
        return (
            sample_signal("drive torque", self.torque, time)
            + self.stiffness * sample_signal("drive angle", self.angle, time)
            + self.damping * sample_signal("drive velocity", self.velocity, time)
        )


def sample_signal(name: str, signal: Signal, time: Array) -> Array:
    """Return `signal` at every sample of `time` [s] (n,). Raises InputError."""
    values = check_real(name, signal(time) if callable(signal) else signal)
    if values.shape not in ((), time.shape):
        raise InputError(
            f"{name} has shape {values.shape}; one value is needed, or one for each of {time.size} samples"
        )
    return np.array(np.broadcast_to(values, time.shape))
