"""`clutch-hil frames`: the frames of the bus and its worst-case load."""

from pathlib import Path

import typer

from clutch_hil.command import check_rate, report
from clutch_hil.commands.options import JSON, OVERWRITE


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(frames)


def frames(
    rate: int = typer.Option(1000, help="rate of samples and commands, in Hz"),
    dbc: Path | None = typer.Option(None, help="another DBC to check and list"),
    clutches: int = typer.Option(1, help="2: the bus of the power-shift rig", min=1, max=2),
    write: Path | None = typer.Option(None, help="DBC file to write for other tools, as for cantools or candump"),
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """List the frames of the bus and its worst-case load."""
    from clutch_hil.bench.progress import table_text
    from protocols.can.bus_load import BITRATES, bus_load, frame_rate, highest_rate, worst_bits
    from protocols.can.frames import DBC, bus_frames
    from protocols.can.two_clutches import dbc_text
    from protocols.files.output_file import new_file, whole_file

    check_rate(rate)
    path = dbc or DBC
    codecs = bus_frames(path, clutches)
    if write:
        new_file(write, overwrite, [path])
        with whole_file(write) as part:
            part.write_text(dbc_text(path, clutches), encoding="utf-8", newline="\n")
    rows: list[tuple[str, ...]] = [("frame", "id", "bytes", "sender", "frames/s", "worst bits", "signals")]
    for codec in codecs:
        cells = (codec.name, f"0x{codec.can_id:03X}", codec.length, codec.sender, f"{frame_rate(codec, rate):g}")
        rows.append((*map(str, cells), str(worst_bits(codec.length)), " ".join(codec.signals)))
    loads = {bitrate: bus_load(codecs, rate, bitrate) for bitrate in BITRATES}
    lines = [f"read:    {path}", table_text(rows)]
    for bitrate, load in loads.items():
        most = highest_rate(codecs, bitrate)
        lines.append(
            f"{bitrate // 1000} kbit/s: {100 * load:.0f} % of the wire at {rate} Hz; below 80 % up to {most} Hz"
        )
    if write:
        lines.append(f"wrote:   {write}")
    fits = [f"{bitrate // 1000} kbit/s" for bitrate, load in loads.items() if load < 1.0]
    verdict_text = f"{rate} Hz fits {' and '.join(fits) or 'no classic CAN bus'}"
    document = {"frames": rows[1:], "load": loads, "fits": fits, "wrote": str(write) if write else None}
    report(document, "\n".join(lines), verdict_text, True, json_output)
