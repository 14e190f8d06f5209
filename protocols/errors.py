"""The one exception a person causes: wrong input, told in one sentence, exit code 2."""


class InputError(Exception):
    """Input or a command is wrong. The message is one sentence: the thing, its value, what is allowed."""


def listing(names: object) -> str:
    """Names as a sorted, comma-separated list for an error message; `-` when there are none."""
    return ", ".join(sorted(map(str, names))) or "-"  # type: ignore[call-overload]
