"""Size of a clutch: the torque thresholds and torque gains of the controller for one that is much larger or smaller.

Equation        n = slope of M_C(p) over the shipped slope. Where n is not within 1/2 to 2: torque thresholds times n, gains
                of the torque loop, in bar per Nm, over n. So the loop has the same gain, and the checks the same share
Assumptions     noise and errors of the torques are in proportion to the torque
References      docs/identify_method.md, 50 rigs: nearer to the shipped slope the controller follows as designed
"""

# Parameters of the controller, by dotted name
_TORQUES = (
    "phases.torque_mismatch", "phases.touch_torque", "trim.floor", "lock.least", "lock.rate", "adaptation.torque_floor",
)  # fmt: skip
_GAINS = ("torque.proportional_gain", "torque.integral_gain")
_OTHER_SIZE = 2.0  # ratio to the shipped slope, or its inverse, from which they are scaled


def scale_size(size: float) -> dict[str, float]:
    """Return factors of the controller's parameters by dotted name; `size` is n of Equation. Empty if they stay as they are."""
    if 1.0 / _OTHER_SIZE < size < _OTHER_SIZE:
        return {}
    return dict.fromkeys(_TORQUES, size) | dict.fromkeys(_GAINS, 1.0 / size)
