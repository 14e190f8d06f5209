"""Entry points: parts that an installed package, ours or a user's, offers by name in a group of its pyproject.toml."""

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from protocols.errors import InputError, join_names
from protocols.user_code import OWN_PACKAGES, describe_error


def list_entries(group: str) -> tuple[str, ...]:
    """Return the names that installed packages offer in `group`, sorted."""
    return tuple(sorted(entry_points(group=group).names))


def list_points(group: str) -> list[EntryPoint]:
    """Return the entry points of `group`: first those of the bench, then those of other packages, each sorted by name."""
    return sorted(entry_points(group=group), key=lambda point: (not comes_with_bench(point), point.name))


def comes_with_bench(point: EntryPoint) -> bool:
    """Return whether an entry point leads to the bench's own code.

    The package metadata are not read, which would take tens of ms.
    """
    return point.module.partition(".")[0] in OWN_PACKAGES


def find_package(point: EntryPoint) -> str:
    """Return the name of the package that offers an entry point."""
    return point.dist.name if point.dist else "unknown"


def load_point(point: EntryPoint, what: str) -> Any:
    """Return the object that an entry point offers. Raises InputError, which calls it `what`, if it fails to load."""
    try:
        return point.load()
    except (Exception, SystemExit) as error:  # a package of a user may raise anything
        raise InputError(
            f"{what} cannot be loaded from {point.value} of the package {find_package(point)}: {describe_error(error)}"
        ) from None


def load_entry(group: str, kind: str, name: str) -> Any:
    """Return the object called `name` in `group`. Raises InputError, which calls it a `kind`, if it is missing or fails."""
    if name not in (known := list_entries(group)):
        raise InputError(f"{kind} is {name!r}; allowed are {', '.join(known)}")
    first, *others = (point for point in list_points(group) if point.name == name)
    if others:
        packages = join_names(find_package(point) for point in (first, *others))
        raise InputError(f"{kind} {name} is offered by more than one package, {packages}; remove all but one")
    return load_point(first, f"{kind} {name}")
