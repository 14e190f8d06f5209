"""A command with an option that takes several paths."""

from itertools import pairwise
from typing import Any

from typer.core import TyperCommand

from protocols.errors import InputError

_MANY = "--holdout"  # this option takes every path up to the next option


class ManyPaths(TyperCommand):
    """A command in which `--holdout A B C` means `--holdout A --holdout B --holdout C`, as click needs it.

    So does `--holdout=A B C`. After `--` every word is a run.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """See `TyperCommand`. Raises InputError for `--holdout` without a path: nothing would be held out."""
        end = args.index("--") if "--" in args else len(args)
        spread: list[str] = []
        within = False
        for arg, following in pairwise([*args[:end], "--"]):
            if arg == _MANY and following.startswith("-"):
                raise InputError(f"{_MANY} has no run; give one or more after it, or leave it out")
            if arg.startswith("-"):
                within = arg.partition("=")[0] == _MANY
                spread += [] if arg == _MANY else [arg]
            else:
                spread += [_MANY, arg] if within else [arg]
        return super().parse_args(ctx, [*spread, *args[end:]])
