"""Monitor screen: a snapshot on 80 x 24 characters, or on one line."""

from collections.abc import Sequence
from datetime import datetime

import numpy as np
from rich.console import Group
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.bars import draw_bar, draw_sparkline
from clutch_hil.live.monitor.collector import POINTS, WINDOW
from clutch_hil.live.monitor.snapshot import QUANTITIES, ClutchSnapshot, Quantity, Snapshot
from clutch_hil.live.tuning.catalogue import format_step, with_unit
from protocols.can.fault_text import WAITS_FOR_IDLE
from protocols.telemetry.keys import find_bus

_LEAST_RANGE = 0.05  # of the full scale: least range of a sparkline, so that noise looks small
_WIDE = 120  # columns of a terminal in which the sparklines of two clutches fit side by side with all points: 108 are needed


def draw_snapshot(snapshot: Snapshot, width: int = 80) -> Group:
    """Return a snapshot as a screen of `width` x 24, at least 80 wide; extra width is for the sparklines of two clutches."""
    two = len(snapshot.clutches) > 1
    return Group(
        _draw_rule(f"clutch-hil monitor, {find_bus(snapshot.bench)}"),
        _make_services(snapshot),
        *(_format_state(clutch) for clutch in snapshot.clutches),
        _draw_rule(f"now, and the last {WINDOW:g} s"),
        _make_quantities_of_two(snapshot.clutches, width) if two else _make_quantities(snapshot.clutches[0]),
        _draw_rule(f"loop timing of the last {WINDOW:g} s [us]"),
        _make_timing(snapshot),
        _draw_rule("last changes of parameters"),
        *_make_changes(snapshot),
    )


def _format_state(clutch: ClutchSnapshot) -> Text:
    return Text.assemble(
        (f"{clutch.name}  " if clutch.name else "", "bold"),
        ("phase ", palette.DIM),
        (clutch.phase or "-", palette.choose_badge(clutch.phase)),
        ("   clutch ", palette.DIM),
        (clutch.state or "-", palette.choose_badge(clutch.state)),
        ("   fault ", palette.DIM),
        (clutch.fault or "-", palette.choose_badge(clutch.fault)),
        (f"   {clutch.notice}", palette.NOTICE),
        no_wrap=True,
        overflow="ellipsis",
    )


def _draw_rule(title: str) -> Rule:
    return Rule(Text(title), align="left", style=palette.DIM)


def _make_services(snapshot: Snapshot) -> Table:
    table = _make_grid(12, 9, 11, 14, 30)
    for name, state in snapshot.nodes.items():
        age = "" if state.age is None else f"newest row {state.age:.1f} s ago"
        table.add_row(
            Text(name, palette.DIM),
            Text.assemble((state.state, palette.choose_badge(state.state))),
            Text(_format_number(state.rate, "{:.1f} Hz")),
            Text(f"lost {state.lost}", palette.WRONG if state.lost else ""),
            Text(age if state.state != "running" else "", palette.WRONG),
        )
    return table


def _make_quantities(clutch: ClutchSnapshot) -> Table:
    table = _make_grid(16, 8, 6, 14, 1, POINTS)
    table.columns[1].justify = "right"
    for quantity in QUANTITIES:
        value, colour = clutch.values[quantity.name], palette.choose_colour(quantity.column)
        table.add_row(
            Text(quantity.name, palette.DIM),
            _format_value(value),
            _format_unit(quantity),
            draw_bar(value, quantity.full, 14, colour),
            "",
            _draw_trace(quantity, clutch, [clutch], 1),
        )
    return table


def _make_quantities_of_two(clutches: Sequence[ClutchSnapshot], width: int) -> Table:
    """Return values and sparklines of two clutches with one scale; in a narrow terminal, every second point is shown."""
    step = 1 if width >= _WIDE else 2
    table = _make_grid(16, 8, 8, 6, 1, POINTS // step, 1, POINTS // step)
    for column in table.columns[1:3]:
        column.justify = "right"
    names = [Text(clutch.name, palette.DIM) for clutch in clutches]
    table.add_row("", *names, "", "", names[0], "", names[1])
    for quantity in QUANTITIES:
        if quantity.group == "level":  # two clutches have no adaptation, so it is constant
            continue
        first, second = (_draw_trace(quantity, clutch, clutches, step) for clutch in clutches)
        table.add_row(
            Text(quantity.name, palette.DIM),
            *(_format_value(clutch.values[quantity.name]) for clutch in clutches),
            _format_unit(quantity),
            "",
            first,
            "",
            second,
        )
    return table


def _draw_trace(quantity: Quantity, clutch: ClutchSnapshot, scaled: Sequence[ClutchSnapshot], step: int) -> Text:
    """Return a sparkline of the last 10 s with every `step`-th point, on the scale of the quantity's group in all `scaled`."""
    shared = np.concatenate([each.traces[q.name] for each in scaled for q in QUANTITIES if q.group == quantity.group])
    low = float(np.nanmin(shared, initial=quantity.full))
    high = max(float(np.nanmax(shared, initial=0.0)), low + _LEAST_RANGE * quantity.full)
    newest_last = clutch.traces[quantity.name][step - 1 :: step]
    return Text(draw_sparkline(newest_last, low, high), palette.choose_colour(quantity.column))


def _format_value(value: float) -> Text:
    return Text("-" if np.isnan(value) else f"{value:z.2f}", "bold")  # z: no -0.00


def _format_unit(quantity: Quantity) -> str:
    return "" if quantity.unit == "1" else quantity.unit


def _make_timing(snapshot: Snapshot) -> Table:
    table = _make_grid(12, 8, 6, 6, 10, 6, 6, 6, 1, 10)
    for column in table.columns[1:-1]:
        column.justify = "right"
    head = ("", "wake p50", "p99", "max", "work p50", "p99", "max", "late", "", "p99/period")
    table.add_row(*(Text(name, palette.DIM) for name in head))
    for name, state in snapshot.nodes.items():
        busy = state.wake.p99 + state.work.p99
        table.add_row(
            Text(name, palette.DIM),
            *(_format_number(value, "{:.0f}") for value in (*state.wake, *state.work)),
            Text(str(state.late) if state.cycles else "-", palette.WRONG if state.late else ""),
            "",
            draw_bar(
                busy,
                state.period_us,
                10,
                palette.choose_colour(f"{name}_wake_us") if busy < state.period_us else palette.WRONG,
            ),
        )
    return table


def _make_changes(snapshot: Snapshot) -> list[Text]:
    lines = [
        Text(
            f"{datetime.fromtimestamp(change['time']):%H:%M:%S}  {change['node']}.{change['name']}  "
            + with_unit(format_step(change["old"], change["new"]), change["unit"])
            + (f"  by {change['by']}" if "by" in change else ""),
            no_wrap=True,
            overflow="ellipsis",
        )
        for change in reversed(snapshot.changes)
    ]
    return lines or [Text("none", palette.DIM)]


def _make_grid(*widths: int) -> Table:
    table = Table.grid(padding=(0, 1))
    for width in widths:
        table.add_column(width=width, no_wrap=True)
    return table


def _format_number(value: float, form: str) -> str:
    return "-" if np.isnan(value) else form.format(value)


def format_snapshot(snapshot: Snapshot) -> str:
    """Return a snapshot on one line."""
    states = "  ".join(f"{name} {state.state}" for name, state in snapshot.nodes.items())
    clutches = "".join(_format_clutch(clutch) for clutch in snapshot.clutches)
    return (
        f"{states}{clutches}"
        f"  late {sum(state.late for state in snapshot.nodes.values())}"
        f"  lost {sum(state.lost for state in snapshot.nodes.values())}"
        f"{f'  {WAITS_FOR_IDLE}' if snapshot.waits_for_idle else ''}"
        f"{f'  last {snapshot.last_fault}' if snapshot.last_fault else ''}"
    )


def _format_clutch(clutch: ClutchSnapshot) -> str:
    value = clutch.values
    return (
        f"  {f'{clutch.name}: ' if clutch.name else ''}{clutch.phase or '-'}  {clutch.state or '-'}"
        f"  fault {clutch.fault or '-'}"
        f"  torque demand {value['torque demand']:z.2f} estimate {value['torque estimate']:z.2f}"
        f" true {value['torque true']:z.2f} Nm  pressure {value['pressure']:z.2f} bar  slip {value['slip']:z.2f} rad/s"
    )
