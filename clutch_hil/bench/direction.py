"""Direction in which a clutch slips, +1 or -1. A demand is a magnitude; times the direction it is comparable with a torque."""

import numpy as np

MOVING_SLIP = 0.1  # rad/s: two encoder counts per sample at 1 kHz; the sign of a smaller slip may come from noise
SIGNED_TORQUE = 0.5  # Nm, the required accuracy of the estimate; the sign of a smaller torque may come from that error
_AXIS_MARGIN = 1.08  # length of an axis divided by the largest value on it


def find_directions(slip: np.ndarray, torque: np.ndarray, before: float | None = None) -> np.ndarray:
    """Return the direction of each sample, +1 or -1, shape (samples,).

    It is the sign of `slip` [rad/s] or, where the plates stick, of `torque` [Nm], both of shape (samples,). A sample in which
    both are small or NaN keeps the direction of the previous sample. `before` is the direction before the first sample. If it
    is None, the first samples have the first known direction, or +1 where none is known.
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
    """Return the half length [rad/s] of a symmetric axis for these speeds; None where no speed is negative."""
    values = np.concatenate([line[np.isfinite(line)] for line in lines])
    return _AXIS_MARGIN * float(np.abs(values).max()) if np.any(values <= -MOVING_SLIP) else None
