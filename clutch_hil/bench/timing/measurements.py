"""Measurements: what `clutch-hil jitter` measures, and its summary in percentiles."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

PERCENTILES = (50.0, 99.0, 99.9, 99.99)


@dataclass(frozen=True)
class Setting:
    """Settings: each phase runs for `seconds` [s] in total, divided into `rounds`, at `rate` [Hz], on `cpu` and `bus`.

    The loop spins for the last `spin_us` [us] before a slot. `telemetry`: whether telemetry is published.
    """

    bus: str
    rate: int
    seconds: float
    rounds: int
    cpu: int
    spin_us: float
    telemetry: bool = True

    @property
    def piece(self) -> float:
        """Return the length of a phase in one round [s]."""
        return self.seconds / self.rounds


@dataclass
class Measurements:
    """Measurements of one phase.

    durations: arrays (n,) [us], one per round, by quantity, such as `wake`. witness: lateness (n,) [us] of the witness, by
    round. cycles, near, late, unexplained: numbers of cycles; see `jitter.py`. footprint: page faults and similar counts of
    each service (`protocols.realtime.footprint`). failure: why the phase could not be measured; empty if it could.
    """

    durations: dict[str, list[np.ndarray]] = field(default_factory=dict)
    witness: list[np.ndarray] = field(default_factory=list)
    cycles: int = 0
    near: int = 0
    late: int = 0
    unexplained: int = 0
    footprint: dict[str, Counter[str]] = field(default_factory=dict)
    failure: str = ""

    def add(self, what: str, values: np.ndarray) -> None:
        """Add the durations of one round, shape (n,) [us]."""
        self.durations.setdefault(what, []).append(values)

    def join_rounds(self, what: str) -> np.ndarray:
        """Return the durations of all rounds, shape (n,) [us]."""
        return np.concatenate(self.durations[what])


def summarise(values: np.ndarray) -> dict[str, float]:
    """Return percentiles and maximum [us] of durations (n,). A percentile with fewer than five values above it is left out."""
    percentiles = {
        f"p{p:g}": float(np.percentile(values, p)) for p in PERCENTILES if len(values) * (100.0 - p) >= 499.9
    }
    return percentiles | {"max": float(values.max())}
