"""User's code: nodes, rigs, profiles, effects, models, formats and commands of other people. Their errors in one sentence.

A user's package may raise anything. The sentence names the user's function with file and line, as a traceback would.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import distributions
from pathlib import Path
from traceback import walk_tb
from types import FrameType

from protocols.errors import InputError
from protocols.moved_modules import describe_moves

OWN_PACKAGES = ("protocols", "plant_sim", "rt_controller", "clutch_hil")  # the bench itself
FILE_GROUPS = ("clutch_hil_effects", "clutch_hil_models")  # in which `load_user_file` puts modules


def describe_error(error: BaseException, path: Path | None = None) -> str:
    """Return type and text of a user's error, the user's line that raised it, and new names of what it lacks, on one line.

    path: the user's file that was being loaded, if known; the message names it anyway.
    """
    text = " ".join(str(error).split())
    said = f"{type(error).__name__}: {text}" if text else type(error).__name__
    line = find_user_line(error).removeprefix(f"{path} ")
    moves = describe_moves(error, path) if isinstance(error, Exception) else ""
    return f"{said}{f', in {line}' if line else ''}{moves}"


def find_user_line(error: BaseException) -> str:
    """Return function, file and line of the innermost frame of a user's code that `error` passed; '' if there is none."""
    frames = [(frame, number) for frame, number in walk_tb(error.__traceback__) if not _is_ours(frame)]
    packages = _list_user_packages() if frames else set()
    for frame, number in reversed(frames):
        if str(frame.f_globals.get("__name__")).partition(".")[0] in packages:
            name = frame.f_code.co_qualname
            place = f"{frame.f_code.co_filename} line {number}"
            return place if name == "<module>" else f"{name} of {place}"
    return ""


def locate_class(of: type) -> str:
    """Return name and file of a user's class; '' for a class of the bench."""
    if of.__module__.partition(".")[0] in OWN_PACKAGES:
        return ""
    file = getattr(sys.modules.get(of.__module__), "__file__", None)
    return f"{of.__qualname__} of {file or of.__module__}"


@contextmanager
def tell_node_failure(node: object) -> Iterator[None]:
    """Raise InputError for any error raised within by the node of a user's class. Errors of the bench's own nodes pass."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        place = locate_class(type(node))
        if not place or (isinstance(error, OSError) and not find_user_line(error)):  # the bus is gone
            raise
        raise InputError(f"the node {place} raises {describe_error(error)}") from error


def _is_ours(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__")).partition(".")[0] in OWN_PACKAGES


def _list_user_packages() -> set[str]:
    """Return the first names of the modules that other packages offer to the bench, and of files loaded from a path."""
    points = (point for package in distributions() for point in package.entry_points)
    offered = {point.module.partition(".")[0] for point in points if point.group.startswith("clutch_hil.")}
    return offered - {*OWN_PACKAGES} | {*FILE_GROUPS}
