"""Record of a cycle: inputs, decisions and counters of the controller. The columns are declared and filled here.

A column is declared once; run files, telemetry, live views and docs/columns.md follow. The terms of the law are declared and
filled in `law/torque_law.py`.
"""

from numba import njit

from protocols.can.claim import Supervision
from protocols.can.request import Request
from protocols.node import Column, make_record_type
from rt_controller.law.phases import Fault, Phase
from rt_controller.law.torque_law import TERMS


def _names(states: type[Phase] | type[Fault] | type[Request] | type[Supervision]) -> str:
    """Return the values of an enumeration with their names, as text for a column."""
    return ", ".join(f"{state.value} {state.name.lower()}" for state in states)


COLUMNS = (
    Column("sample_tick", "1", "number of the sample answered, unwrapped; -1 before the first"),
    Column("sample_age", "cycles", "cycles since the last plausible sample"),
    Column("phase", "1", f"phase of the controller: {_names(Phase)}"),
    Column("fault", "1", f"reason of the phase fault: {_names(Fault)}"),
    Column("request", "1", f"request of the supervisor: {_names(Request)}"),
    Column("supervisor", "1", f"whether a supervisor has claimed the set-points: {_names(Supervision)}"),
    *TERMS,
    Column("frames_lost", "1", "frames that are missing according to their counters, total"),
    Column("frames_repeated", "1", "repeated frames, not used, total"),
    Column("frames_out_of_sequence", "1", "frames older than a previous one, or after too long a gap, not used, total"),
    Column("frames_corrupt", "1", "frames of wrong length, CRC or data ID, not used, total"),
    Column("commands_lowered", "1", "commands that the guard has limited, total"),
    Column("commands_replaced", "1", "commands that the guard has replaced by the safe one, total"),
)
RECORD = make_record_type(COLUMNS)


@njit
def note_cycle(record, node, phase, request, supervision):
    """Fill RECORD, except for the terms of the law, from NODE (cycle.py), Phase, Request and Supervision of this cycle."""
    record.sample_tick, record.sample_age = node.sample.tick, node.guard.age
    record.phase, record.fault, record.request = phase, node.phases.fault, request
    record.supervisor = supervision
    record.frames_lost = record.frames_repeated = record.frames_out_of_sequence = record.frames_corrupt = 0.0
    for reception in node.receptions:
        record.frames_lost += reception.lost
        record.frames_repeated += reception.repeated
        record.frames_out_of_sequence += reception.wrong_sequence
        record.frames_corrupt += reception.corrupt + reception.misshapen
    record.commands_lowered, record.commands_replaced = node.guard.lowered, node.guard.replaced
