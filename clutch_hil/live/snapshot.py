"""Snapshot: state of a bench at one instant, for the monitor's screen, for a line of text and for JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from protocols.can.fault_text import WAITS_FOR_IDLE


class Quantity(NamedTuple):
    """A number on the screen. full: full scale of its bar. group: quantities that share the scale of their sparklines."""

    name: str
    node: str
    column: str
    unit: str
    full: float
    group: str


QUANTITIES = (
    Quantity("torque demand", "controller", "controller_torque_demand_nm", "Nm", 30.0, "torque"),
    Quantity("torque estimate", "controller", "controller_torque_estimate_nm", "Nm", 30.0, "torque"),
    Quantity("torque true", "plant", "truth_clutch_torque_nm", "Nm", 30.0, "torque"),
    Quantity("pressure demand", "controller", "controller_pressure_demand_bar", "bar", 5.0, "pressure"),
    Quantity("pressure", "controller", "controller_pressure_bar", "bar", 5.0, "pressure"),
    Quantity("slip", "controller", "controller_slip_rad_s", "rad/s", 26.2, "slip"),
    Quantity("oil temperature", "controller", "controller_temperature_degc", "degC", 150.0, "temperature"),
    Quantity("friction level", "controller", "controller_friction_level", "1", 2.0, "level"),
)


class Percentiles(NamedTuple):
    """Percentiles of a duration in the last 10 s [us]; NaN without rows."""

    p50: float
    p99: float
    maximum: float


NO_TIMES = Percentiles(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True)
class NodeState:
    """State of a service: running, stalled, waiting (no row yet), gone or absent; age: of its newest row [s]."""

    state: str
    age: float | None = None
    rate: float = float("nan")  # Hz, measured over the last 10 s
    period_us: float = float("nan")
    cycles: int = 0  # in the last 10 s
    late: int = 0  # of them
    lost: int = 0  # rows that never came, since the first that did
    wake: Percentiles = NO_TIMES
    work: Percentiles = NO_TIMES


@dataclass(frozen=True)
class Snapshot:
    """A bench at one instant.

    values, traces: by name of QUANTITIES; a trace has shape (points,) and covers the last 10 s. A torque demand is a magnitude;
    in its trace it has the sign of the slip. phase, fault, clutch (open, sliding, sticking, locked): None when they are not
    known, because no controller runs.
    """

    bench: str
    nodes: Mapping[str, NodeState]
    phase: str | None
    fault: str | None
    clutch: str | None
    values: Mapping[str, float]
    traces: Mapping[str, np.ndarray]
    changes: Sequence[Mapping[str, Any]]
    last_fault: str | None = None  # the line of the last one that came, of any clutch, with time, reason and values
    waits_for_idle: bool = False
    standing_faults: Sequence[str] = ()  # the lines of those that are not cleared, of any clutch

    def troubles(self) -> list[str]:
        """What needs attention, one phrase each."""
        troubles = [
            f"the {name} is {state.state}" for name, state in self.nodes.items() if state.state in ("stalled", "gone")
        ]
        controller = self.nodes["controller"].state
        if self.fault is None and controller != "gone":
            troubles.append(f"controller {controller}: phase and fault unknown")
        if self.standing_faults:
            troubles += self.standing_faults
        elif self.fault not in (None, "none"):
            troubles.append(self.last_fault or f"fault: {self.fault}")
        if self.waits_for_idle:
            troubles.append(WAITS_FOR_IDLE)
        if all(state.state in ("absent", "gone") for state in self.nodes.values()):
            troubles.append("no service runs")
        return troubles


def document(snapshot: Snapshot) -> dict[str, Any]:
    """A snapshot for JSON."""
    nodes = {
        name: asdict(state) | {part: getattr(state, part)._asdict() for part in ("wake", "work")}
        for name, state in snapshot.nodes.items()
    }
    return {
        "bench": snapshot.bench,
        "nodes": nodes,
        "phase": snapshot.phase,
        "fault": snapshot.fault,
        "clutch": snapshot.clutch,
        "last_fault": snapshot.last_fault,
        "standing_faults": list(snapshot.standing_faults),
        "waits_for_idle": snapshot.waits_for_idle,
        "values": {q.name: {"value": snapshot.values[q.name], "unit": q.unit} for q in QUANTITIES},
        "changes": list(snapshot.changes),
        "troubles": snapshot.troubles(),
    }
