"""Change: the course of one parameter over time by an injection."""

from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

TIME_TOLERANCE = 1e-9  # s: rounding error of sample times, which are sums of floats


@dataclass(frozen=True)
class Change:
    """A change of one parameter from `old` to `new`, in `unit`; it begins at `at` [s] and is linear over `ramp` [s]."""

    name: str
    unit: str
    old: float
    new: float
    at: float
    ramp: float

    @property
    def end(self) -> float:
        """Time at which the parameter reaches `new` [s]."""
        return self.at + self.ramp

    def compute_value(self, time: float) -> float:
        """Return the parameter at a time [s] not before `at`."""
        if time >= self.end:
            return self.new
        return self.old + (self.new - self.old) * (time - self.at) / self.ramp

    def to_dict(self, rate: int) -> dict[str, Any]:
        """Return the change as a dictionary; `row` is the index of the first record with it, at a `rate` [Hz]."""
        return asdict(self) | {"row": ceil((self.at - TIME_TOLERANCE) * rate)}
