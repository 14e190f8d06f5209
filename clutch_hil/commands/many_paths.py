"""A command with an option that takes several paths."""

from typing import Any

from typer.core import TyperCommand

_MANY = "--holdout"  # this option takes every path up to the next option


class ManyPaths(TyperCommand):
    """A command in which `--holdout A B C` means `--holdout A --holdout B --holdout C`, as click needs it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """See `TyperCommand`."""
        spread: list[str] = []
        within = False
        for arg in args:
            if arg.startswith("-"):
                within = arg == _MANY
                if not within:
                    spread.append(arg)
            else:
                spread += [_MANY, arg] if within else [arg]
        return super().parse_args(ctx, spread)
