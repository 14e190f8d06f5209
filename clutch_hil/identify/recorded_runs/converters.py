"""Converters: resolution of another rig's data acquisition, found in its runs.

The calibration contains it, so that `discrepancy` does not report it as an effect.
"""

from collections.abc import Sequence
from math import floor
from statistics import median

from clutch_hil.fitting.model import Columns, Model, Witnessing
from protocols.files.parameters import ParameterSet

_EFFECT = "coarse_quantisation"
_SAME = 0.1  # bits, largest difference between runs: a lattice gives them to 0.02
_BITS = {  # parameter of the effect -> parameter of the converter
    f"{_EFFECT}.pressure_bits_lost": "sensors.pressure_bits",
    f"{_EFFECT}.torque_bits_lost": "sensors.clutch_torque_bits",
}


def find_converter_bits(model: Model, runs: Sequence[Columns], declared: ParameterSet) -> dict[str, tuple[float, str]]:
    """Return the bits of converters over the declared range that the runs show, by parameter name, with the reason.

    The bits are integers: for a converter with another range the step is up to twice as fine. Runs with too few or too many
    values are not conclusive. Runs that contradict each other give no result.
    """
    if not isinstance(model, Witnessing):
        return {}
    lost_bits = [one[_EFFECT] for run in runs if _EFFECT in (one := model.find_evident_effects([run]))]
    bits_by_name = {}
    for parameter, name in _BITS.items():
        of_this = [one for one in lost_bits if parameter in one.intervals]
        bits = [declared[name].value - one.intervals[parameter][0] for one in of_this]
        if bits and max(bits) - min(bits) < _SAME:
            low, high = declared[name].bounds
            bits_by_name[name] = min(max(float(floor(median(bits) + _SAME)), low), high), of_this[0].why
    return bits_by_name
