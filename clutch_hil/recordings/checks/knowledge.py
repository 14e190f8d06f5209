"""Knowledge: what is known of a column before any fit, from the rig, from its model, from the converters."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan

import numpy as np

BASELINE = "the baseline"


@dataclass(frozen=True)
class Limits:
    """What a rig can do in one column, in the column's unit.

    low, high: no sample of a sound recording lies outside. span: size of the movement that the rig is made for, NaN if not
    known. delay [s]: the longest by which a sound channel may be late, its sensor's own lag with it. rest: of a channel that
    keeps one value, what else it may be than a fault of the channel; the end of a sentence.
    """

    low: float = -inf
    high: float = inf
    span: float = nan
    rest: str = ""
    delay: float = 0.1  # s: twice the longest delay of the catalogue, 50 ms


@dataclass(frozen=True)
class Knowledge:
    """What is known of one column of one run.

    unit: of the column. floor: standard deviation of its noise and rounding. predicted: (n,) by `source`, None for an input or
    where there is no baseline. limits: of the rig. clips: whether a saturated channel is a candidate that the discrepancy
    workflow can name. source: what predicts it, the baseline from the inputs or another measured column. All in the column's
    unit.
    """

    unit: str = ""
    floor: float = 0.0
    predicted: np.ndarray | None = None
    limits: Limits = Limits()
    clips: bool = False
    source: str = BASELINE

    @property
    def slow(self) -> bool:
        """Whether a sound channel may lag behind by a second and more, so that its movement in a run says little."""
        return self.limits.delay >= 1.0

    @property
    def may_rest(self) -> bool:
        """Whether a sound channel may hardly move while the rig does: it is slow, or may be saturated. Its level is right."""
        return self.clips or self.slow


@dataclass(frozen=True)
class Implied:
    """What an output tells of an input, by the baseline turned round.

    source: the output. values: what the input must be, (n,) in its unit, where the output tells it, else NaN; None for a
    position. friction, speed: of a position, the force that must have the sign of its speed, (n,) each. floor: standard
    deviation of the noise of `values`, or of `friction`.
    """

    source: str
    floor: float
    values: np.ndarray | None = None
    friction: np.ndarray | None = None
    speed: np.ndarray | None = None


@dataclass(frozen=True)
class Recorded:
    """One run to be checked.

    columns: (n,) by name, with time_s in equal steps. known: by column; a column without an entry is not looked at. inputs:
    columns that drive the prediction. latitude: factor, 1 or more, by which the baseline's own uncertainty may scale it.
    implied: what outputs tell of inputs, by input. identification: command that identifies such a rig, "" without one.
    """

    name: str
    columns: Mapping[str, np.ndarray]
    known: Mapping[str, Knowledge]
    inputs: tuple[str, ...] = ()
    latitude: float = 1.0
    implied: Mapping[str, Implied] = field(default_factory=dict)
    identification: str = ""
    period: float = field(init=False)

    def __post_init__(self) -> None:
        time = self.columns["time_s"]
        object.__setattr__(self, "period", float(time[-1] - time[0]) / max(len(time) - 1, 1))

    @property
    def rows(self) -> tuple[int, int]:
        """The first and the last row."""
        return 0, len(self.columns["time_s"]) - 1

    @property
    def of_unknown_rig(self) -> str:
        """What to do where the baseline is another rig, to be added to a sentence; "" without a command for it."""
        return f"; of a rig that nobody has calibrated: {self.identification}" if self.identification else ""

    @property
    def predictions(self) -> dict[str, np.ndarray]:
        """Predictions (n,) of the baseline by column."""
        return {name: one.predicted for name, one in self.known.items() if one.predicted is not None}
