"""The page of columns and signals, docs/columns.md, from their declarations: `python -m clutch_hil.bench.columns_page`."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from clutch_hil.command import run_command
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from protocols.can.frames import FrameCodec, load_frames
from protocols.files.output_file import check_new_file, whole_file
from protocols.node import Column
from protocols.realtime.beat import TIMING
from protocols.telemetry.batch import list_run_columns
from rt_controller.loop.node import ControllerNode

PAGE = Path(__file__).parents[2] / "docs" / "columns.md"

_TEXT = """# Columns and signals

Written by `python -m clutch_hil.bench.columns_page` from the declarations in the code. Edit these, not this page.

A run file has the columns of the plant, then `torque_demand_nm`, the controller's M_d, then those of the controller.
Row k has the sensor values at its time, the commands that act from then on, and the results of the controller for this sample.
Columns of true values begin with `truth_`. No real rig has them.

## Plant with one clutch

Declared in `plant_sim/node/plant_record.py`.

{plant}

## Plant with two clutches

Declared in `plant_sim/node/power_shift_record.py`; `_a` and `_b` are the clutches.

{power_shift}

## Controller

Declared in `rt_controller/loop/cycle_record.py`, the terms of the control law in `rt_controller/law/torque_law.py`. With two
clutches those of clutch b begin with `controller_b_`.

{controller}

## Timing

Each service has these columns, declared in `protocols/realtime/beat.py`. In telemetry and in runs of a live bench they are
the last columns of the plant, beginning with `plant_`, and of each controller.

{timing}

## Signals on the bus

Declared in `protocols/can/clutch_rig.dbc`. A value is its raw integer times the step. Every frame begins with `CRC` (16 bits)
and `COUNTER` (8 bits), see [protection.md](protection.md). The frames of clutch b: `clutch-hil frames --clutches 2`.

{frames}
"""


def format_columns(columns: Iterable[Column]) -> str:
    """Format columns as a Markdown table."""
    rows = [f"| `{name}` | {unit} | {meaning} |" for name, unit, meaning in columns]
    return "\n".join(["| column | unit | meaning |", "|---|---|---|", *rows])


def format_frame(codec: FrameCodec) -> str:
    """Format a frame of the DBC and its signals as a section in Markdown."""
    period = f", every {1000.0 * codec.cycle_time:g} ms" if codec.cycle_time else ""
    head = f"### {codec.name}\n\n0x{codec.can_id:03X}, {codec.length} bytes, from {codec.sender}{period}. {codec.comment}\n"
    rows = ["| signal | bits | unit | step | from | to | meaning |", "|---|---|---|---|---|---|---|"]
    for signal in codec.definitions:
        name = signal.name.lower()
        if name not in codec.signals:
            continue
        choices = ", ".join(f"{value} {text}" for value, text in codec.list_choices(name).items())
        meaning = " ".join(part for part in (signal.comment or "", choices) if part)
        last = signal.start + signal.length - 1
        bits = f"{signal.start}..{last}" if last > signal.start else f"{last}"
        ends = f"{signal.minimum:.6g} | {signal.maximum:.6g}"
        rows.append(
            f"| `{signal.name}` | {bits} | {signal.unit or '1'} | {float(signal.scale):.6g} | {ends} | {meaning} |"
        )
    return "\n".join([head, *rows])


def compose_page() -> str:
    """Compose the text of docs/columns.md."""
    controller: Sequence[Column] = ControllerNode.columns
    return _TEXT.format(
        plant=format_columns(PlantNode.columns),
        power_shift=format_columns(PowerShiftNode.columns),
        controller=format_columns(list_run_columns("controller", controller)),
        timing=format_columns(TIMING),
        frames="\n\n".join(format_frame(codec) for codec in load_frames().values()),
    )


def main() -> None:
    """Write docs/columns.md again. Raises InputError where the folder is missing, as in an installed package."""
    with whole_file(check_new_file(PAGE, overwrite=True)) as part:
        part.write_text(compose_page(), encoding="utf-8")
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    run_command(main)
