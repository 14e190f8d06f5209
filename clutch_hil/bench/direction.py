"""Direction: which way round a clutch slips, as +1 and -1, so that a demand, a magnitude, is drawn over a signed torque."""

import numpy as np

MOVING_SLIP = 0.1  # rad/s: two counts of the encoder in a sample at 1 kHz; from there on its sign is no noise
SIGNED_TORQUE = 0.5  # Nm, the goal for the estimate's error: from there on a torque has a sign
_AXIS_MARGIN = 1.08  # times what an axis shows at most


def direction(slip: np.ndarray, torque: np.ndarray, before: float | None = None) -> np.ndarray:
    """+1 or -1 of each sample: the sign of the slip [rad/s]; of the torque [Nm] where plates stand; else as it was before.

    `before` is how it was before the first sample; where nobody knows, None, what comes first has the sign that comes next, +1
    where none does. All of shape (samples,); NaN has no sign.
    """
    signs = np.where(
        np.abs(slip) >= MOVING_SLIP, np.sign(slip), np.where(np.abs(torque) >= SIGNED_TORQUE, np.sign(torque), 0.0)
    )
    known = np.flatnonzero(signs)
    last = np.searchsorted(known, np.arange(len(signs)), side="right") - 1
    if before is None:
        before = float(signs[known[0]]) if len(known) else 1.0
    return np.where(last >= 0, signs[known[last]], before) if len(known) else np.full(len(signs), before)


def both_ways(*lines: np.ndarray) -> float | None:
    """How far an axis for these speeds [rad/s] reaches, down as up; None where none of them is negative."""
    values = np.concatenate([line[np.isfinite(line)] for line in lines])
    return _AXIS_MARGIN * float(np.abs(values).max()) if np.any(values <= -MOVING_SLIP) else None
