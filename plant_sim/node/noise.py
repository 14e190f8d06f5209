"""Noise: the numbers of NumPy's generator, drawn by compiled code.

Method          NumPy's own function, from the library that has it, on the memory of a bit generator, as "Extending" of NumPy's
                manual has it: number for number what `Generator.standard_normal` gives. A Generator handed over to Numba would
                keep 62 bytes a call
Assumptions     whoever has the address keeps the generator, too
"""

import numpy as np
from llvmlite.binding import load_library_permanently
from numba import njit, types
from numpy.random import _generator

from protocols.buses.exchange import system

load_library_permanently(_generator.__file__)  # before a kernel that calls it is loaded from disk
_LONG = types.int64  # of addresses and counts, too
_fill = system("random_standard_normal_fill", types.void, _LONG, _LONG, _LONG)


def address(generator: np.random.Generator) -> int:
    """Where the state of a generator is, for `draw`."""
    return int(generator.bit_generator.ctypes.bit_generator.value)


@njit
def draw(source, numbers):
    """Fill an array with standard normal numbers from the generator at the address `source`."""
    _fill(source, numbers.size, numbers.ctypes.data)
