"""Sensor noise: normally distributed numbers of a NumPy generator, drawn by compiled code.

Method          calls NumPy's own C function on the memory of a bit generator ("Extending" in the manual of numpy.random). The
                numbers equal those of `Generator.standard_normal`. Passing a Generator to Numba leaks 62 bytes a call
Assumptions     the generator lives as long as its address is used
"""

import numpy as np
from llvmlite.binding import load_library_permanently
from numba import njit, types
from numpy.random import _generator

from protocols.buses.exchange import load_system_function

load_library_permanently(_generator.__file__)  # before a kernel that calls it is loaded from disk
_INT64 = types.int64  # type of addresses and counts in the C function
_fill = load_system_function("random_standard_normal_fill", types.void, _INT64, _INT64, _INT64)


def find_address(generator: np.random.Generator) -> int:
    """Return the memory address of a generator's state, for `draw`."""
    return int(generator.bit_generator.ctypes.bit_generator.value)


@njit
def draw(source, numbers):
    """Fill the array `numbers` with standard normal numbers from the generator at the address `source`."""
    _fill(source, numbers.size, numbers.ctypes.data)
