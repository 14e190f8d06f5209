"""Methods whose names have changed, in classes of users: an old one would never be called, without a word."""

from collections.abc import Mapping

from protocols.errors import InputError


def refuse_old_methods(thing: object, what: str, names: Mapping[str, str]) -> None:
    """Raise InputError where `thing`, which is called `what`, has a method by an old name. names: new names by old ones."""
    for old, new in names.items():
        if callable(getattr(thing, old, None)):
            raise InputError(f"{what}: its method {old}() is called {new}() now")
