"""Entry points: parts that an installed package, ours or a user's, offers by name in a group of its pyproject.toml."""

from importlib.metadata import entry_points
from typing import Any

from protocols.errors import InputError
from protocols.moved_modules import describe_moves


def list_entries(group: str) -> tuple[str, ...]:
    """Names that installed packages offer in `group`, sorted."""
    return tuple(sorted(entry_points(group=group).names))


def load_entry(group: str, kind: str, name: str) -> Any:
    """The part called `name` in `group`. Raises InputError, in which it is a `kind`, when it is not there or fails to load."""
    if name not in (known := list_entries(group)):
        raise InputError(f"{kind} is {name!r}; allowed are {', '.join(known)}")
    point = entry_points(group=group)[name]
    try:
        return point.load()
    except (ImportError, AttributeError, TypeError) as error:
        raise InputError(f"{kind} {name} cannot be loaded from {point.value}: {error}{describe_moves(error)}") from None
