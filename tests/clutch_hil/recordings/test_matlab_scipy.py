"""The MATLAB reader agrees with scipy.io on scipy's own files."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from clutch_hil.recordings.matlab.bytes import BinaryFile
from clutch_hil.recordings.matlab.level4 import is_level4, read_level4
from clutch_hil.recordings.matlab.level5 import is_level5, read_level5
from clutch_hil.recordings.matlab.value import Cell, Line, Numbers, Struct, Text
from tests import needs


@pytest.mark.needs("scipy's files")
@pytest.mark.parametrize("file", needs.SCIPY_FILES, ids=lambda file: file.stem)
def test_all_values_are_those_that_scipy_reads(file: Path) -> None:
    head = file.read_bytes()[:4096]
    try:
        wanted = loadmat(file)
    except NotImplementedError:  # 7.3
        return
    with BinaryFile(file) as binary:
        variables = read_level5(binary) if is_level5(head) else read_level4(binary)
        assert is_level5(head) or is_level4(head)
        assert set(variables) == {name for name in wanted if not name.startswith("__")}
        for name, value in variables.items():
            check_equal(value, wanted[name])


def check_equal(value: Any, wanted: Any) -> None:
    if isinstance(value, Numbers):
        if not value.size or value.imaginary:
            assert value.imaginary == np.iscomplexobj(wanted)
            return
        assert value.shape == wanted.shape
        for axis in (0, len(value.shape) - 1):
            lines = [
                Line(axis, fixed)
                for fixed in product(*(range(1 if i == axis else n) for i, n in enumerate(value.shape)))
            ]
            for line, numbers in zip(lines, value.read(lines), strict=True):
                index = tuple(slice(None) if i == axis else n for i, n in enumerate(line.fixed))
                np.testing.assert_array_equal(numbers, wanted[index].astype(float))
    elif isinstance(value, Text):
        assert [row.rstrip() for row in value.rows] == [str(text).rstrip() for text in wanted.ravel()]
    elif isinstance(value, Struct):
        assert tuple(value.fields) == (wanted.dtype.names or ())
        for number, element in enumerate(wanted.ravel(order="F")):
            for name, inside in value.read_element(number).items():
                check_equal(inside, element[name])
    elif isinstance(value, Cell):
        for inside, element in zip(value.items, wanted.ravel(order="F"), strict=True):
            check_equal(inside, element)
