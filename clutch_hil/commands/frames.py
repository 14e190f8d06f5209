"""`clutch-hil frames`: list the frames of the bus and its worst-case load."""

from pathlib import Path
from shlex import quote

import typer

from clutch_hil.command import check_rate, report
from clutch_hil.commands.options import JSON, OVERWRITE
from protocols.errors import InputError, join_names

_CLASSIC_BYTES = 8  # largest payload of a frame other than CAN FD


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(frames)


def frames(
    rate: int = typer.Option(1000, help="rate of samples and commands, in Hz"),
    dbc: Path | None = typer.Option(None, help="another DBC to check and list"),
    torque: float | None = typer.Option(
        None,
        help="with --write: range of the torque channels of a bench of another size, in Nm; 50 on the shipped one",
    ),
    speed: float | None = typer.Option(
        None, help="the same for the speed demands, in rad/s; 32.768 on the shipped one"
    ),
    pressure: float | None = typer.Option(
        None, help="the same for the pressure channel, in bar; 10 on the shipped one"
    ),
    clutches: int = typer.Option(1, help="2: the bus of the power-shift rig"),
    write: Path | None = typer.Option(None, help="DBC file to write for other tools, such as cantools"),
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """List the frames of the bus and its worst-case load. A DBC that cannot carry the bench is refused by signal and reason."""
    from clutch_hil.bench.arguments import take_whole
    from clutch_hil.bench.progress import format_table
    from protocols.can.bus_load import (
        BITRATES,
        compute_bus_load,
        compute_frame_rate,
        count_worst_bits,
        find_highest_rate,
    )
    from protocols.can.frames import DBC, FrameCodec, OtherFrame, list_bus_frames, list_other_frames, load_frames
    from protocols.can.size import DATABASE, SHIPPED, read_guard_values, write_sized_text
    from protocols.can.two_clutches import CLUTCHES, write_dbc_text
    from protocols.can.version import VERSION_1
    from protocols.files.output_file import check_new_file, whole_file
    from rt_controller.guard.layout import check_layout
    from rt_controller.loop.parameter_sets import OWN_LIMITS, load_limits, select_layout_values

    check_rate(rate)
    take_whole("--clutches", clutches, 1, len(CLUTCHES))
    path = dbc or DBC
    sized = {n: v for n, v in (("torque", torque), ("speed", speed), ("pressure", pressure)) if v is not None}
    if sized:
        if write is None or dbc is not None or clutches != 1:
            raise InputError(
                f"{join_names([f'--{name}' for name in sized])} needs --write, and cannot be combined with --dbc or --clutches"
            )
        check_new_file(write, overwrite, [SHIPPED])
        text = write_sized_text(**sized)
        with whole_file(write) as part:
            part.write_text(text, encoding="utf-8", newline="\n")
        path = write
    values = read_guard_values(path) if sized else select_layout_values(load_limits())
    codecs = list_bus_frames(path, clutches)
    others = [frame for frame in list_other_frames(path) if frame.name not in {codec.name for codec in codecs}]
    check_layout(path, load_frames(path), values)
    if write and not sized:
        check_new_file(write, overwrite, [path])
        with whole_file(write) as part:
            part.write_text(write_dbc_text(path, clutches), encoding="utf-8", newline="\n")
    rows: list[tuple[str, ...]] = [("frame", "id", "bytes", "sender", "frames/s", "worst bits", "signals")]
    every: list[FrameCodec | OtherFrame] = [*codecs, *others]
    for codec in every:
        each = f"{compute_frame_rate(codec, rate):g}" if codec.cycle_time else "unknown"
        bits = count_worst_bits(codec.length, codec.extended) if codec.length <= _CLASSIC_BYTES else "CAN FD"
        cells = (codec.name, f"0x{codec.can_id:03X}", codec.length, codec.sender, each, bits, " ".join(codec.signals))
        rows.append(tuple(map(str, cells)))
    silent = [codec.name for codec in codecs if not codec.cycle_time]
    uncounted = [other.name for other in others if not other.cycle_time or other.length > _CLASSIC_BYTES]
    counted = [codec for codec in every if codec.name not in uncounted]
    loads = {} if silent else {bitrate: compute_bus_load(counted, rate, bitrate) for bitrate in BITRATES}
    lines = [f"read:    {SHIPPED if sized else path}", format_table(rows)]
    version = codecs[0].version.number
    if version == VERSION_1.number:
        lines.append(
            "note:    a database of version 1, with a CRC of 8 bits: it is for reading old logs; the bench sends version 2"
        )
    if silent:
        lines.append(f"note:    {join_names(silent)} have no cycle time (GenMsgCycleTime): the load is unknown")
    for bitrate, load in loads.items():
        most = find_highest_rate(counted, bitrate)
        lines.append(f"{bitrate // 1000} kbit/s: {100 * load:.0f} % bus load at {rate} Hz; below 80 % up to {most} Hz")
    if uncounted and not silent:
        lines.append(
            f"note:    not counted in the load, as they have no cycle time or are CAN FD: {join_names(uncounted)}"
        )
    if write:
        lines.append(f"wrote:   {write}")
    if sized:
        lines.append(
            f"next:    export {DATABASE}={quote(str(path.absolute()))} {OWN_LIMITS}=FILE, in every terminal of the bench; FILE"
            " has the guard's limits: it begins as follows and also has motor_torque, slip_speed and pressure, the limits of"
            " your rig"
        )
        lines += ["[guard]", *(f"{name} = {value:.10g}" for name, value in values.items())]
    fits = [f"{bitrate // 1000} kbit/s" for bitrate, load in loads.items() if load < 1.0]
    verdict_text = f"{rate} Hz fits {' and '.join(fits) or 'no classic CAN bus'}"
    if silent:
        verdict_text = f"load unknown: {len(silent)} of {len(codecs)} frames have no cycle time"
    document = {
        "version": version, "frames": rows[1:], "load": loads or None, "fits": fits, "without_cycle_time": silent,
        "not_counted": uncounted, "wrote": str(write) if write else None,
    }  # fmt: skip
    report(document, "\n".join(lines), verdict_text, not silent, json_output)
