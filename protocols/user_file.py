"""User's file: Python code that is loaded from a path, and not from an installed package.

The module gets a unique name, so that a file named like a Python module does not replace that module.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from protocols.errors import InputError
from protocols.user_code import describe_error


def load_user_file(path: Path, group: str, what: str) -> ModuleType:
    """Return the module `group.STEM` of a user's file STEM.py. Raises InputError, which calls the file `what`."""
    name = f"{group}.{path.stem}"
    specification = importlib.util.spec_from_file_location(name, path)
    assert specification is not None  # of a path that ends in .py
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except BaseException as error:
        sys.modules.pop(name, None)  # it is incomplete
        if isinstance(error, InputError) or not isinstance(error, (Exception, SystemExit)):
            raise
        raise InputError(f"{what} cannot be loaded: {describe_error(error, path)}") from None
    return module
