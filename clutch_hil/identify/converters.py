"""Converters: the resolution of another rig's data acquisition, as its runs show it.

A calibration has it, so that `discrepancy` does not call it an effect.
"""

from collections.abc import Sequence
from math import floor
from statistics import median

from clutch_hil.fitting.model import Columns, Model, Witnessing
from protocols.files.parameters import ParameterSet

_EFFECT = "coarse_quantisation"
_SAME = 0.1  # bits: a lattice tells them to 0.02
_BITS = {  # parameter of the effect -> that of the converter
    f"{_EFFECT}.pressure_bits_lost": "sensors.pressure_bits",
    f"{_EFFECT}.torque_bits_lost": "sensors.clutch_torque_bits",
}


def find_converter_bits(model: Model, runs: Sequence[Columns], declared: ParameterSet) -> dict[str, tuple[float, str]]:
    """Bits of converters over the declared range, by the parameter's name, each with the reason; where runs tell other ones.

    They are whole: of a converter with another range, the step is up to twice as fine. A run with too few or too many values
    does not tell. Runs that contradict each other tell nothing.
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
