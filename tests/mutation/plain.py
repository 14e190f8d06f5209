"""Plain Python: the bench's modules without compilation, so that a mutant of one of them runs at once.

Import it before the bench, in a process of its own: `NUMBA_DISABLE_JIT=1` makes Numba leave functions as they are.
Functions of the C library are called by ctypes. Records need `view_records`: compiled code reads a field as an attribute.
"""

import ctypes
import os
import sys
from typing import Any

import numpy as np

_C_TYPES = {"int32": ctypes.c_int, "int64": ctypes.c_long, "none": None, "int32*": ctypes.POINTER(ctypes.c_int)}


class Fields(np.void):
    """A record whose fields are attributes, whatever their names; np.record hides a field `base`."""

    def __getattribute__(self, name: str) -> Any:
        fields = object.__getattribute__(self, "dtype").fields
        if name not in fields:
            return object.__getattribute__(self, name)
        value = np.void.getfield(self, *fields[name][:2])
        return value.view((Fields, value.dtype)) if value.dtype.names else value

    def __setattr__(self, name: str, value: Any) -> None:
        fields = self.dtype.fields or {}
        self.setfield(value, *fields[name][:2])


def is_plain() -> bool:
    """Whether this process runs the bench without compilation."""
    return os.environ.get("NUMBA_DISABLE_JIT") == "1"


def view_fields(array: np.ndarray) -> np.ndarray:
    """Return an array of records whose fields are attributes, for a function in plain Python."""
    return array.view(np.dtype((Fields, array.dtype)))


def view_records(array: np.ndarray) -> np.ndarray:
    """Return an array of records as the functions of this process want it: fields are attributes in plain Python."""
    return view_fields(array) if is_plain() else array


def make_record(layout: np.dtype, **values: Any) -> Any:
    """Return a record of `layout` for a function of the bench; a field without a value is zero."""
    array = np.zeros(1, layout)
    record = (view_records(array) if is_plain() else array.view(np.recarray))[0]
    for name, value in values.items():
        setattr(record, name, value)
    return record


def leave_uncompiled() -> None:
    """Let the bench run without compilation in this process. Nothing of it may have been imported before."""
    assert "numba" not in sys.modules
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    from numba import types
    from numpy.random import _generator

    libraries = ctypes.PyDLL(None), ctypes.PyDLL(_generator.__file__)  # the lock is kept: errno stays

    def find(name: str, signature: Any) -> Any:
        function = next(getattr(library, name) for library in libraries if hasattr(library, name))
        function.restype = _C_TYPES[str(signature.return_type)]
        function.argtypes = [_C_TYPES[str(one)] for one in signature.args]
        return function

    types.ExternalFunction = find
