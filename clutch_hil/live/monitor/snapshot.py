"""Snapshot: state of a bench at one instant, for the monitor's screen, for a line of text and for JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from plant_sim.profiles.profile import FULL_PRESSURE, SPEED_LIMIT, TORQUE_LIMIT
from protocols.can.claim import CONTESTED_TEXT
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
    Quantity("torque demand", "controller", "controller_torque_demand_nm", "Nm", TORQUE_LIMIT, "torque"),
    Quantity("torque estimate", "controller", "controller_torque_estimate_nm", "Nm", TORQUE_LIMIT, "torque"),
    Quantity("torque true", "plant", "truth_clutch_torque_nm", "Nm", TORQUE_LIMIT, "torque"),
    Quantity("pressure demand", "controller", "controller_pressure_demand_bar", "bar", FULL_PRESSURE, "pressure"),
    Quantity("pressure", "controller", "controller_pressure_bar", "bar", FULL_PRESSURE, "pressure"),
    Quantity("slip", "controller", "controller_slip_rad_s", "rad/s", SPEED_LIMIT, "slip"),
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
    late: int = 0  # of these cycles
    lost: int = 0  # rows that never arrived, since the first row
    wake: Percentiles = NO_TIMES
    work: Percentiles = NO_TIMES


@dataclass(frozen=True)
class ClutchSnapshot:
    """A clutch and its controller at one instant.

    name: a or b; empty for a single clutch. controller: its node. phase, fault, state (open, sliding, sticking, locked): None
    when unknown, because the controller does not run. values, traces: by name of QUANTITIES; a trace has shape (points,) and
    covers the last 10 s. A torque demand is a magnitude; in its trace it has the sign of the slip. last_fault: the line of the
    newest fault, with time, reason and values; fault_stands: it is not cleared.
    """

    name: str
    controller: str
    phase: str | None
    fault: str | None
    state: str | None
    values: Mapping[str, float]
    traces: Mapping[str, np.ndarray]
    last_fault: str | None = None
    fault_stands: bool = False
    waits_for_idle: bool = False
    contested: bool = False  # one supervisor is followed, and the claim of another is refused

    @property
    def notice(self) -> str:
        """Return what a reader must know besides the state; empty if nothing."""
        if self.waits_for_idle:
            return WAITS_FOR_IDLE
        return CONTESTED_TEXT if self.contested else self.last_fault or ""


@dataclass(frozen=True)
class Snapshot:
    """A bench at one instant: its nodes, its clutch or two clutches, the last changes of parameters.

    last_fault: the line of the newest fault of any clutch.
    """

    bench: str
    nodes: Mapping[str, NodeState]
    clutches: Sequence[ClutchSnapshot]
    changes: Sequence[Mapping[str, Any]]
    last_fault: str | None = None

    @property
    def waits_for_idle(self) -> bool:
        """Return whether a controller waits for a request for idle."""
        return any(clutch.waits_for_idle for clutch in self.clutches)

    @property
    def standing_faults(self) -> list[str]:
        """Return the lines of the faults that are not cleared, of any clutch."""
        return [clutch.last_fault for clutch in self.clutches if clutch.fault_stands and clutch.last_fault]

    def list_troubles(self) -> list[str]:
        """Return what needs attention, one phrase each."""
        troubles = [
            f"the {name} is {state.state}" for name, state in self.nodes.items() if state.state in ("stalled", "gone")
        ]
        for clutch in self.clutches:
            state = self.nodes[clutch.controller].state
            if clutch.fault is None and state != "gone":
                troubles.append(f"{clutch.controller} {state}: phase and fault unknown")
            if clutch.fault_stands or clutch.fault not in (None, "none"):
                troubles.append(clutch.last_fault or f"fault: {clutch.fault}")
        if self.waits_for_idle:
            troubles.append(WAITS_FOR_IDLE)
        if any(clutch.contested for clutch in self.clutches):
            troubles.append(CONTESTED_TEXT)
        if all(state.state in ("absent", "gone") for state in self.nodes.values()):
            troubles.append("no service runs")
        return troubles


def make_document(snapshot: Snapshot) -> dict[str, Any]:
    """Return a snapshot for JSON. Top-level state and values are those of clutch a or a single clutch; `clutches` has both."""
    nodes = {
        name: asdict(state) | {part: getattr(state, part)._asdict() for part in ("wake", "work")}
        for name, state in snapshot.nodes.items()
    }
    return {
        "bench": snapshot.bench,
        "nodes": nodes,
        **_describe_clutch(snapshot.clutches[0]),
        "clutches": {clutch.name: _describe_clutch(clutch) for clutch in snapshot.clutches if clutch.name},
        "last_fault": snapshot.last_fault,
        "standing_faults": snapshot.standing_faults,
        "waits_for_idle": snapshot.waits_for_idle,
        "changes": list(snapshot.changes),
        "troubles": snapshot.list_troubles(),
    }


def _describe_clutch(clutch: ClutchSnapshot) -> dict[str, Any]:
    return {
        "phase": clutch.phase,
        "fault": clutch.fault,
        "clutch": clutch.state,
        "values": {q.name: {"value": clutch.values[q.name], "unit": q.unit} for q in QUANTITIES},
    }
