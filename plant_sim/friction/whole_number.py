"""Check of counts that a user gives: whole numbers only."""

from numbers import Integral

from protocols.errors import InputError


def require_whole(name: str, value: object, least: int = 1) -> int:
    """Return `value`, a whole number of `least` or more. Raises InputError."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(f"{name} is {value!r:.60}; allowed is a whole number of {least} or more")
    return int(value)
