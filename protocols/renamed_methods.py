"""Renamed methods in classes of users: a method with an old name would silently never be called."""

from collections.abc import Mapping

from protocols.errors import InputError


def refuse_old_methods(thing: object, what: str, names: Mapping[str, str]) -> None:
    """Raise InputError if `thing`, called `what`, has a method with an old name. names: new names by old ones."""
    for old, new in names.items():
        if callable(getattr(thing, old, None)):
            raise InputError(f"{what}: its method {old}() is called {new}() now")
