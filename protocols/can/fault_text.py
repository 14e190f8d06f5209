"""Fault messages of a controller: one line when a fault begins, with reason and values, and one when it is cleared.

Measured values are those of the row in which the fault begins. The controller has already reacted in this row, so its
demands and estimates are taken from the row before.
Fault names are those of CONTROLLER_STATUS.FAULT in the DBC; the reasons are here. Telemetry process, recorder, monitor and run
files make their messages from rows of the controller by this module.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, nan
from typing import NamedTuple

import numpy as np

from protocols.can.frames import load_frames
from protocols.can.request import Request

_PHASE_IDLE = 0  # CONTROLLER_STATUS.PHASE
_CLOSING = tuple(request for request in Request if request.closes)


class Reason(NamedTuple):
    """Reason of a fault: `text` is a format string over columns; `limit` names the parameter, in `unit`, "" for none."""

    text: str
    limit: str
    unit: str


REASONS: Mapping[str, Reason] = {
    "stale sensors": Reason("no plausible sample for {sample_age:g} cycles", "guard.stale_cycles", "cycles"),
    "overpressure": Reason("the cylinder pressure is too high", "guard.pressure", "bar"),
    "overtemperature": Reason("the oil is too hot", "guard.temperature", "degC"),
    "overspeed": Reason("the slip is too fast", "guard.slip_speed", "rad/s"),
    "fill timeout": Reason("the clutch was not filled in time", "phases.fill_timeout", "s"),
    "pressure lost": Reason(
        "the pressure fell while the clutch was closed, or its signal stayed constant although its demand changed",
        "phases.lost_pressure",
        "bar",
    ),
    "torque implausible": Reason(
        "the torque seen at the motor, {observed_torque_nm:.2f} Nm, and the estimate differ",
        "phases.torque_mismatch",
        "Nm",
    ),
    "second sender": Reason("another sender uses identifiers of the plant, the supervisor or this controller", "", ""),
    "wrong rate": Reason("the heartbeats of a plant have another rate", "", ""),
    "sensor implausible": Reason(
        "a sensor shows an impossible value: oil too cold or jumping, a pressure below vacuum, or a motor torque at"
        " the end of its range",
        "guard.temperature_step",
        "K",
    ),
    "sensor frozen": Reason(
        "the pressure signal did not change by a single count although the valve command did",
        "guard.frozen_voltage",
        "V",
    ),
}
_UNKNOWN = Reason("this version does not know this fault", "", "")  # sent by a controller of a newer version
# Reasons of "pressure lost": the first if the pressure is below the limit or still changes, the second otherwise. Undecided if
# the limit is not known
_FELL = Reason("the pressure fell while the clutch was closed", "phases.lost_pressure", "bar")
_STOOD_STILL = Reason(
    "the pressure signal stayed constant while the clutch was closed, although its demand changed",
    "phases.frozen_dwell",
    "s",
)
# Values in the message of every fault: name, column, unit
VALUES = (
    ("pressure", "pressure_bar", "bar"),
    ("pressure demand", "pressure_demand_bar", "bar"),
    ("slip", "slip_rad_s", "rad/s"),
    ("oil", "temperature_degc", "degC"),
    ("torque demand", "torque_demand_nm", "Nm"),
    ("estimate", "torque_estimate_nm", "Nm"),
)
_MESSAGE_COLUMNS = ("sample_tick", "sample_age", "observed_torque_nm", *(column for _, column, _ in VALUES))
# Set to 0 by the reaction in the row of the fault: the values of the row before are reported
_COMPUTED = ("pressure_demand_bar", "torque_estimate_nm")
WAITS_FOR_IDLE = "the controller waits for a request for idle before it closes the clutch"


class FaultChange(NamedTuple):
    """A fault that began: its `name`, time [s] in the run, and message. With the `name` none, the last fault was cleared."""

    name: str
    time: float
    line: str


class FaultWatch:
    """Finds faults in the rows of a controller, which arrive in blocks.

    `columns` are the names of the columns, without the name of the node. `rate` [Hz] converts ticks to time. `parameters`, in
    their units, add the limits to the messages; they are read for each message. `clutch` is a or b where there are two.
    """

    def __init__(
        self,
        columns: Sequence[str],
        rate: float,
        parameters: Mapping[str, float] | None = None,
        clutch: str | None = None,
    ) -> None:
        self._index = {name: i for i, name in enumerate(columns)}
        self._names = load_frames()["CONTROLLER_STATUS"].list_choices("fault")
        self._rate, self._parameters = rate, {} if parameters is None else parameters
        self._of, self._for = (f" of clutch {clutch}", f" for clutch {clutch}") if clutch else ("", "")
        self._last: float | None = None  # fault of the last row; None before the first
        self._row = np.full(len(columns), nan)  # the last row
        self.count = 0
        self.first: FaultChange | None = None

    def take(self, rows: np.ndarray) -> list[FaultChange]:
        """Take more rows, shape (rows, columns); return the faults that begin or are cleared in them."""
        changes = [self._describe(rows[at], rows[at - 1] if at else self._row) for at in self._find_changes(rows)]
        if len(rows):
            self._row = rows[-1].copy()
        for fault in changes:
            if fault.name != "none":
                self.count += 1
                self.first = self.first or fault
        return changes

    @property
    def stands(self) -> bool:
        """Whether the last row has a fault."""
        return bool(self._last)

    @property
    def verdict(self) -> str:
        """Summary of the faults so far in one line; empty without a fault."""
        if self.first is None:
            return ""
        return self.first.line if self.count == 1 else f"{self.count} faults{self._of}, the first: {self.first.line}"

    def _find_changes(self, rows: np.ndarray) -> Iterator[int]:
        """Yield the indices of the rows in which the fault changes."""
        faults = np.nan_to_num(rows[:, self._index["fault"]])
        for at in np.flatnonzero(np.diff(faults, prepend=self._last or 0.0)):
            if at > 0 and self._last is None:
                self._last = faults[0]
            yield int(at)
            self._last = faults[at]
        if len(faults):
            self._last = faults[-1]

    def _describe(self, row: np.ndarray, before: np.ndarray) -> FaultChange:
        """Return the FaultChange of this row; `before` is the row before it, NaN if unknown."""
        values, earlier = self._read(row), self._read(before)
        values |= {column: earlier[column] for column in _COMPUTED}
        name = self._names.get(int(values["fault"]), f"fault {values['fault']:.0f}")
        tick, age = values["sample_tick"], max(values["sample_age"], 0.0)
        time = max(tick + (age if isfinite(age) else 0.0), 0.0) / self._rate
        when = "at" if self._last is not None else "before"  # the fault may have begun before the first row
        if name == "none":
            return FaultChange(name, time, f"cleared{self._for} at {time:.2f} s")
        reason = self._find_reason(name, values["pressure_bar"], earlier["pressure_bar"])
        limit = self._parameters.get(reason.limit)
        why = reason.text.format(**values)
        limit_text = f" (limit {limit:g} {reason.unit})" if limit is not None else ""
        causes = ", ".join(
            f"{what} {values[column]:.2f} {unit}" for what, column, unit in VALUES if isfinite(values[column])
        )
        return FaultChange(name, time, f"fault{self._of} {when} {time:.2f} s: {name}: {why}{limit_text}; {causes}")

    def _read(self, row: np.ndarray) -> dict[str, float]:
        """Return the values of a row by column; NaN for a column that the row does not have."""
        return dict.fromkeys(_MESSAGE_COLUMNS, nan) | {name: float(row[i]) for name, i in self._index.items()}

    def _find_reason(self, name: str, pressure: float, before: float) -> Reason:
        """Return the reason of a fault that began at this `pressure` [bar]; `before`: that of the row before."""
        if name != "pressure lost":
            return REASONS.get(name, _UNKNOWN)
        lost = self._parameters.get(_FELL.limit, nan)
        if pressure < lost or abs(pressure - before) > 0.0:
            return _FELL
        return _STOOD_STILL if pressure >= lost else REASONS[name]


def waits_for_idle(phase: float, request: float) -> bool:
    """Return whether a controller in `phase` idle ignores a `request` to close the clutch.

    A controller that may close the clutch does so in the same cycle. One that stays idle first needs a request for idle.
    """
    return phase == _PHASE_IDLE and request in _CLOSING


def find_clutch(node: str) -> str | None:
    """Return the clutch, b, that a telemetry node controls; None for the controller of clutch a or of a single clutch."""
    return "b" if node == "controller_b" else None


def watch_run(
    columns: Mapping[str, np.ndarray], rate: float, parameters: Mapping[str, float], clutch: str | None = None
) -> FaultWatch:
    """Return a FaultWatch with all faults of a run file.

    `columns` have shape (rows,); `rate` [Hz]; `parameters` of the controller in their units. `clutch` is a or b where there are
    two. Columns of b's controller begin with `controller_b_`, all others with `controller_`.
    """
    prefix = "controller_b_" if clutch == "b" else "controller_"
    names = [name for column in ("fault", *_MESSAGE_COLUMNS) if (name := prefix + column) in columns]
    watch = FaultWatch([name.removeprefix(prefix) for name in names], rate, parameters, clutch)
    rows = np.column_stack([columns[name] for name in names])
    watch.take(rows[~np.isnan(rows[:, names.index(f"{prefix}fault")])])
    return watch
