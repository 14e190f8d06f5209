"""Direction in which a clutch slips, +1 or -1. A demand, a magnitude, times the direction can be drawn over a signed torque."""

import numpy as np

MOVING_SLIP = 0.1  # rad/s: two counts of the encoder in a sample at 1 kHz; a smaller slip may have the sign of noise
SIGNED_TORQUE = 0.5  # Nm, the goal for the error of the estimate; a smaller torque may have the sign of that error
_AXIS_MARGIN = 1.08  # length of an axis over the largest value on it


def find_directions(slip: np.ndarray, torque: np.ndarray, before: float | None = None) -> np.ndarray:
    """Direction of each sample, +1 or -1, shape (samples,).

    It is the sign of `slip` [rad/s], or, where the plates stand, of `torque` [Nm], both of shape (samples,). A sample in which
    both are small, or NaN, has the direction of the sample before. `before` is the direction before the first sample. If it is
    None, the first samples have the first direction that is known, or +1 where none is.
    """
    signs = np.where(
        np.abs(slip) >= MOVING_SLIP, np.sign(slip), np.where(np.abs(torque) >= SIGNED_TORQUE, np.sign(torque), 0.0)
    )
    known = np.flatnonzero(signs)
    last = np.searchsorted(known, np.arange(len(signs)), side="right") - 1
    if before is None:
        before = float(signs[known[0]]) if len(known) else 1.0
    return np.where(last >= 0, signs[known[last]], before) if len(known) else np.full(len(signs), before)


def find_symmetric_reach(*lines: np.ndarray) -> float | None:
    """Half length [rad/s] of a symmetric axis for these speeds; None where none of them is negative."""
    values = np.concatenate([line[np.isfinite(line)] for line in lines])
    return _AXIS_MARGIN * float(np.abs(values).max()) if np.any(values <= -MOVING_SLIP) else None
