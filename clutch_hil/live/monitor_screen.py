"""Monitor screen: a snapshot on 80 x 24 characters, or on one line."""

from datetime import datetime

import numpy as np
from rich.console import Group
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from clutch_hil.bench import palette
from clutch_hil.bench.bars import bar, sparkline
from clutch_hil.live.catalogue import with_unit
from clutch_hil.live.collector import POINTS, WINDOW
from clutch_hil.live.snapshot import QUANTITIES, Snapshot
from protocols.can.fault_text import WAITS_FOR_IDLE
from protocols.telemetry.keys import bus_of

_LEAST_RANGE = 0.05  # of the full scale, from bottom to top of a sparkline, so that noise looks small


def draw_snapshot(snapshot: Snapshot) -> Group:
    """A snapshot as a screen of 80 x 24."""
    phase = Text.assemble(
        ("phase ", palette.DIM),
        (snapshot.phase or "-", palette.badge(snapshot.phase)),
        ("   clutch ", palette.DIM),
        (snapshot.clutch or "-", palette.badge(snapshot.clutch)),
        ("   fault ", palette.DIM),
        (snapshot.fault or "-", palette.badge(snapshot.fault)),
        (f"   {_notice(snapshot)}", palette.NOTICE),
        no_wrap=True,
        overflow="ellipsis",
    )
    return Group(
        _rule(f"clutch-hil monitor, {bus_of(snapshot.bench)}"),
        _services(snapshot),
        phase,
        _rule(f"now, and the last {WINDOW:g} s"),
        _quantities(snapshot),
        _rule(f"loop timing of the last {WINDOW:g} s [us]"),
        _timing(snapshot),
        _rule("last changes of parameters"),
        *_changes(snapshot),
    )


def _notice(snapshot: Snapshot) -> str:
    return WAITS_FOR_IDLE if snapshot.waits_for_idle else snapshot.last_fault or ""


def _rule(title: str) -> Rule:
    return Rule(Text(title), align="left", style=palette.DIM)


def _services(snapshot: Snapshot) -> Table:
    table = _grid(12, 9, 11, 14, 30)
    for name, state in snapshot.nodes.items():
        age = "" if state.age is None else f"newest row {state.age:.1f} s ago"
        table.add_row(
            Text(name, palette.DIM),
            Text.assemble((state.state, palette.badge(state.state))),
            Text(_number(state.rate, "{:.1f} Hz")),
            Text(f"lost {state.lost}", palette.WRONG if state.lost else ""),
            Text(age if state.state != "running" else "", palette.WRONG),
        )
    return table


def _quantities(snapshot: Snapshot) -> Table:
    table = _grid(16, 8, 6, 14, 1, POINTS)
    table.columns[1].justify = "right"
    for quantity in QUANTITIES:
        value, trace = snapshot.values[quantity.name], snapshot.traces[quantity.name]
        shared = np.concatenate([snapshot.traces[q.name] for q in QUANTITIES if q.group == quantity.group])
        low = float(np.nanmin(shared, initial=quantity.full))
        high = max(float(np.nanmax(shared, initial=0.0)), low + _LEAST_RANGE * quantity.full)
        colour = palette.of(quantity.column)
        table.add_row(
            Text(quantity.name, palette.DIM),
            Text("-" if np.isnan(value) else f"{value:.2f}", "bold"),
            "" if quantity.unit == "1" else quantity.unit,
            bar(value, quantity.full, 14, colour),
            "",
            Text(sparkline(trace, low, high), colour),
        )
    return table


def _timing(snapshot: Snapshot) -> Table:
    table = _grid(10, 9, 6, 6, 11, 6, 6, 6, 1, 10)
    for column in table.columns[1:-1]:
        column.justify = "right"
    head = ("", "wake p50", "p99", "max", "work p50", "p99", "max", "late", "", "p99/period")
    table.add_row(*(Text(name, palette.DIM) for name in head))
    for name, state in snapshot.nodes.items():
        busy = state.wake.p99 + state.work.p99
        table.add_row(
            Text(name, palette.DIM),
            *(_number(value, "{:.0f}") for value in (*state.wake, *state.work)),
            Text(str(state.late) if state.cycles else "-", palette.WRONG if state.late else ""),
            "",
            bar(busy, state.period_us, 10, palette.of(f"{name}_wake_us") if busy < state.period_us else palette.WRONG),
        )
    return table


def _changes(snapshot: Snapshot) -> list[Text]:
    lines = [
        Text(
            f"{datetime.fromtimestamp(change['time']):%H:%M:%S}  {change['node']}.{change['name']}  "
            + with_unit(f"{change['old']:g} -> {change['new']:g}", change["unit"]),
            no_wrap=True,
            overflow="ellipsis",
        )
        for change in reversed(snapshot.changes)
    ]
    return lines or [Text("none", palette.DIM)]


def _grid(*widths: int) -> Table:
    table = Table.grid(padding=(0, 1))
    for width in widths:
        table.add_column(width=width, no_wrap=True)
    return table


def _number(value: float, form: str) -> str:
    return "-" if np.isnan(value) else form.format(value)


def snapshot_line(snapshot: Snapshot) -> str:
    """A snapshot on one line."""
    states = "  ".join(f"{name} {state.state}" for name, state in snapshot.nodes.items())
    value = snapshot.values
    return (
        f"{states}  {snapshot.phase or '-'}  {snapshot.clutch or '-'}  fault {snapshot.fault or '-'}"
        f"  torque demand {value['torque demand']:.2f} estimate {value['torque estimate']:.2f}"
        f" true {value['torque true']:.2f} Nm  pressure {value['pressure']:.2f} bar  slip {value['slip']:.2f} rad/s"
        f"  late {sum(state.late for state in snapshot.nodes.values())}"
        f"  lost {sum(state.lost for state in snapshot.nodes.values())}"
        f"{f'  {WAITS_FOR_IDLE}' if snapshot.waits_for_idle else ''}"
        f"{f'  last {snapshot.last_fault}' if snapshot.last_fault else ''}"
    )
