"""Display of an effect: the experiment that shows it, and the axes of its picture."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Display:
    """How an effect is shown; needed only if the largest change does not show what the effect does.

    excitation: name of an open-loop experiment; None for the short one in which the effect changes most.
    column: measured quantity, the ordinate; None for the one that the effect changes most.
    over: column of the abscissa; None for that of the experiment.
    beside: name of an effect that is also on, in both curves, if this one has no influence without it.
    Experiments and columns are listed in docs/effects.md.
    """

    excitation: str | None = None
    column: str | None = None
    over: str | None = None
    beside: str | None = None
