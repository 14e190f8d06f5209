"""Limit: the allowed range of a measure of a run, and the judgement of a run by it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from clutch_hil.bench.judgement.measures import Columns
from clutch_hil.bench.rig import Rig
from protocols.errors import InputError
from protocols.files.units import space_unit


@dataclass(frozen=True)
class Limit:
    """A measure of a rig with its allowed range `least` to `most`, in its unit, or the word `equal`. Raises InputError."""

    rig: Rig
    measure: str
    least: float | None = None
    most: float | None = None
    equal: str | None = None

    def __post_init__(self) -> None:
        known = self.rig.measure(self.measure)
        if known.words:
            if self.equal not in known.words():
                given = repr(self.equal) if self.equal else "no word"
                raise InputError(f"limit {self.measure} is {given}; allowed are {', '.join(known.words())}")
        elif self.least is None and self.most is None:
            raise InputError(f"limit {self.measure} has neither least nor most; one of them is needed, in {known.unit}")
        elif self.least is not None and self.most is not None and self.least > self.most:
            raise InputError(
                f"limit {self.measure} has least = {self.least:g} above most = {self.most:g}; no value would be allowed"
            )

    def __str__(self) -> str:
        """Return the condition as text."""
        if self.equal is not None:
            return f"{self.measure} = {self.equal}"
        unit = self.rig.measure(self.measure).unit
        low = "" if self.least is None else f"{self.least:g} <= "
        high = "" if self.most is None else f" <= {self.most:g}"
        return f"{low}{self.measure}{high}{space_unit(unit)}"

    def judge(self, columns: Columns) -> "Judgement":
        """Judge the `columns` of a run. A measure that is NaN violates every limit."""
        return self.judge_value(self.rig.compute_measure(self.measure, columns))

    def judge_value(self, value: float | str) -> "Judgement":
        """Judge a measured `value`, in the measure's unit."""
        if isinstance(value, str):
            return Judgement(self, value, value == self.equal)
        low, high = self.least is None or value >= self.least, self.most is None or value <= self.most
        return Judgement(self, value, low and high)


@dataclass(frozen=True)
class Judgement:
    """The value of a limit's measure in a run, and whether the limit `holds`."""

    limit: Limit
    value: float | str
    holds: bool

    def __str__(self) -> str:
        if isinstance(self.value, str):
            value_text = self.value
        else:
            value_text = f"{self.value:.4g}" if isfinite(self.value) else "cannot be measured in this run"
        return f"{self.limit}: {value_text}"

    def make_document(self) -> dict[str, Any]:
        """Return limit and value, for JSON."""
        limit = self.limit
        return {
            "measure": limit.measure,
            "unit": limit.rig.measure(limit.measure).unit,
            "least": limit.least,
            "most": limit.most,
            "equal": limit.equal,
            "value": self.value,
            "holds": self.holds,
        }


def judge_limits(limits: Sequence[Limit], columns: Columns) -> tuple[Judgement, ...]:
    """Judge the `columns` of a run by every limit."""
    return tuple(limit.judge(columns) for limit in limits)
