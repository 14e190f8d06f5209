"""Start of a fit: where the search for an effect's parameters begins.

A fit goes downhill from its start, so it misses a parameter on which the residual depends in many waves, like the order
of a ripple. Such an effect states where in a run a good start value can be read. These classes are data; the fitted model
has a method for each.
"""

from collections.abc import Mapping
from dataclasses import dataclass


class Start:
    """Where the fit of an effect begins."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the effect's parameters that are read from a run."""
        return ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Measured columns of the run that they are read from."""
        return ()


@dataclass(frozen=True)
class TypicalValues(Start):
    """The fit begins at the typical values: enough where the residual changes smoothly with every parameter."""


@dataclass(frozen=True)
class StrongestOrder(Start):
    """The fit begins at the strongest order in the residual of `column` over the angle of the shaft.

    The effect has the parameters `amplitude`, `order` [periods a turn] and `phase` [rad] of a cosine. The amplitude is a share
    of the column `share_of`; where that is None, it has the unit of `column`.
    """

    column: str
    share_of: str | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """See `Start`."""
        return "amplitude", "order", "phase"

    @property
    def columns(self) -> tuple[str, ...]:
        """See `Start`."""
        return (self.column, self.share_of) if self.share_of else (self.column,)


@dataclass(frozen=True)
class ChannelEnds(Start):
    """The fit begins once at the end of each channel: one limit at the highest voltage of its channel, the others off.

    limits: column of the channel, by the name of the parameter that limits its voltage.
    """

    limits: Mapping[str, str]

    @property
    def parameters(self) -> tuple[str, ...]:
        """See `Start`."""
        return tuple(self.limits)

    @property
    def columns(self) -> tuple[str, ...]:
        """See `Start`."""
        return tuple(self.limits.values())
