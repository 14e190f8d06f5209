"""Faults of a controller, told to people: one line for each when it comes, with reason and measured values, and when it goes.

The names are those of CONTROLLER_STATUS.FAULT in the DBC; each has its reason here. Whoever has rows of a controller, a
telemetry process, a recorder, a monitor or a run file, tells faults by these words.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, nan
from typing import NamedTuple

import numpy as np

from protocols.can.frames import load_frames
from protocols.can.request import Request

_PHASE_IDLE = 0


class Reason(NamedTuple):
    """Why a fault is one: `text`, filled in with columns of the record; the parameter that is the limit, and its unit."""

    text: str
    limit: str
    unit: str


REASONS: Mapping[str, Reason] = {
    "stale sensors": Reason("no believable sample for {sample_age:g} cycles", "guard.stale_cycles", "cycles"),
    "overpressure": Reason("the cylinder pressure is too high", "guard.pressure", "bar"),
    "overtemperature": Reason("the oil is too hot", "guard.temperature", "degC"),
    "overspeed": Reason("the slip is too fast", "guard.slip_speed", "rad/s"),
    "fill timeout": Reason("the clutch was not filled in time", "phases.fill_timeout", "s"),
    "pressure lost": Reason("the pressure fell while the clutch was closed", "phases.lost_pressure", "bar"),
    "torque implausible": Reason(
        "the torque seen at the motor, {observed_torque_nm:.2f} Nm, and the estimate differ",
        "phases.torque_mismatch",
        "Nm",
    ),
}
# What is said of every fault: name, column, unit
MEASURED = (
    ("pressure", "pressure_bar", "bar"),
    ("pressure demand", "pressure_demand_bar", "bar"),
    ("slip", "slip_rad_s", "rad/s"),
    ("oil", "temperature_degc", "degC"),
    ("torque demand", "torque_demand_nm", "Nm"),
    ("estimate", "torque_estimate_nm", "Nm"),
)
_NEEDED = ("sample_tick", "sample_age", "observed_torque_nm", *(column for _, column, _ in MEASURED))
WAITS_FOR_IDLE = "the controller waits for a request for idle before it closes the clutch"


class Told(NamedTuple):
    """A fault that came: its `name`, the time [s] of the samples, and the line; `name` none: the one before is cleared."""

    name: str
    time: float
    line: str


class FaultWatch:
    """Faults in the rows of a controller, given piece by piece; `columns` are their names, without the node's.

    `rate` [Hz] makes time of ticks; `parameters` in their units tell limits, where they are known; `clutch` says whose they
    are, where there are two.
    """

    def __init__(
        self,
        columns: Sequence[str],
        rate: float,
        parameters: Mapping[str, float] | None = None,
        clutch: str | None = None,
    ) -> None:
        self._place = {name: i for i, name in enumerate(columns)}
        self._names = load_frames()["CONTROLLER_STATUS"].choices("fault")
        self._rate, self._parameters = rate, parameters or {}
        self._of, self._for = (f" of clutch {clutch}", f" for clutch {clutch}") if clutch else ("", "")
        self._last: float | None = None  # before the first row
        self.count = 0
        self.first: Told | None = None

    def take(self, rows: np.ndarray) -> list[Told]:
        """What begins and ends in further rows, (rows, columns)."""
        told = [self._tell(rows[at]) for at in self._changes(rows)]
        for fault in told:
            if fault.name != "none":
                self.count += 1
                self.first = self.first or fault
        return told

    @property
    def stands(self) -> bool:
        """Whether there was one in the newest row."""
        return bool(self._last)

    @property
    def verdict(self) -> str:
        """What has been seen, for a verdict; empty without a fault."""
        if self.first is None:
            return ""
        return self.first.line if self.count == 1 else f"{self.count} faults{self._of}, the first: {self.first.line}"

    def _changes(self, rows: np.ndarray) -> Iterator[int]:
        faults = np.nan_to_num(rows[:, self._place["fault"]])
        for at in np.flatnonzero(np.diff(faults, prepend=self._last or 0.0)):
            if at > 0 and self._last is None:
                self._last = faults[0]
            yield int(at)
            self._last = faults[at]
        if len(faults):
            self._last = faults[-1]

    def _tell(self, row: np.ndarray) -> Told:
        values = dict.fromkeys(_NEEDED, nan) | {name: float(row[i]) for name, i in self._place.items()}
        name = self._names[int(values["fault"])]
        tick, age = values["sample_tick"], max(values["sample_age"], 0.0)
        time = max(tick + (age if isfinite(age) else 0.0), 0.0) / self._rate
        when = "at" if self._last is not None else "before"  # who comes later sees it last
        if name == "none":
            return Told(name, time, f"cleared{self._for} at {time:.2f} s")
        reason = REASONS[name]
        limit = self._parameters.get(reason.limit)
        why = reason.text.format(**values)
        said = f" (limit {limit:g} {reason.unit})" if limit is not None else ""
        measured = ", ".join(
            f"{what} {values[column]:.2f} {unit}" for what, column, unit in MEASURED if isfinite(values[column])
        )
        return Told(name, time, f"fault{self._of} {when} {time:.2f} s: {name}: {why}{said}; {measured}")


def waits_for_idle(phase: float, request: float) -> bool:
    """Whether a controller in this `phase`, idle, does not close the clutch though the `request` is to close it.

    A cycle closes it at once where it may; so it may not, until it is asked for idle.
    """
    return phase == _PHASE_IDLE and request in (Request.ENGAGE, Request.PRESSURE)


def clutch_of(node: str) -> str | None:
    """Whose controller a node of the telemetry is, for people: b; None for the one of a single clutch, or of a."""
    return "b" if node == "controller_b" else None


def faults_of(
    columns: Mapping[str, np.ndarray], rate: float, parameters: Mapping[str, float], clutch: str | None = None
) -> FaultWatch:
    """The faults in the columns of a run file; rate [Hz], `parameters` of the controller.

    `clutch`: a or b, where there are two; the columns of b's controller begin with `controller_b_`, all others' with
    `controller_`.
    """
    prefix = "controller_b_" if clutch == "b" else "controller_"
    names = [name for name in columns if name.startswith(prefix)]
    watch = FaultWatch([name.removeprefix(prefix) for name in names], rate, parameters, clutch)
    rows = np.column_stack([columns[name] for name in names])
    watch.take(rows[~np.isnan(rows[:, names.index(f"{prefix}fault")])])
    return watch
