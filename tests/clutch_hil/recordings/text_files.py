"""One recording in every form that loggers, spreadsheets and people write, for the tests of text files."""

import codecs
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError

ROWS = 60
TIME = np.arange(ROWS) * 0.01
TORQUE = np.round(np.sin(10.0 * TIME), 4)
SPEED = np.round(3.0 * np.arange(ROWS) + 0.25, 4)
NAMES = ("time", "torque", "speed")
MAP = """
[columns]
time_s = { from = "time", unit = "s" }
torque_nm = { from = "torque", unit = "Nm" }
speed_rad_s = { from = "speed", unit = "rad/s" }
"""
TWO = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "torque", unit = "Nm" }\n'
MOST_SECONDS = 20.0  # for one file, as docs/recordings.md promises
BLOCK = 1 << 22  # bytes, as files are read
MOST_BYTES = 1 << 28  # that a small file may take while it is read


def make_table(
    delimiter: str = ",",
    header: str | None = None,
    write: Callable[[float], str] = "{:.4f}".format,
    times: Sequence[str] = (),
    end: str = "",
) -> str:
    """The recording as text. times: other cells of the time column. end: of each row."""
    lines = [delimiter.join(NAMES) if header is None else header] if header != "" else []
    for row in range(ROWS):
        cells = [times[row] if times else write(TIME[row]), write(TORQUE[row]), write(SPEED[row])]
        lines.append(delimiter.join(cells) + end)
    return "\n".join(lines) + "\n"


def make_rows(header: str, *rows: str) -> str:
    return "\n".join([header, *rows, ""])


def write_with_comma(value: float) -> str:
    return f"{value:.4f}".replace(".", ",")


def read(tmp_path: Path, content: str | bytes, file: str = "", columns: str = MAP, required: bool = True) -> Any:
    """The run in a file of this `content`, by a map with the entries `file`."""
    recording, toml = tmp_path / "a recording.csv", tmp_path / "map.toml"
    recording.write_bytes(content if isinstance(content, bytes) else content.encode())
    toml.write_text(f"[file]\n{file}\n{columns}", encoding="utf-8")
    return load_map(str(toml)).read(recording)


def find_refusal(tmp_path: Path, content: str | bytes, file: str = "", columns: str = MAP) -> str:
    with pytest.raises(InputError) as refused:
        read(tmp_path, content, file, columns)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def assert_right(run: Any, rows: slice = slice(None), spacing: float = 1e-9) -> None:
    """The run is the recording, or these `rows` of it. spacing [s]: between the times that its numbers can tell apart."""
    np.testing.assert_allclose(run["time_s"], TIME[rows], rtol=0.0, atol=spacing)
    np.testing.assert_allclose(run["torque_nm"], TORQUE[rows], atol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"], SPEED[rows], atol=1e-12)


def convert_run(run: Any) -> str:
    return "; ".join(run.metadata["import"]["done"])


ISO = [f"2025-03-02T10:11:{12.0 + t:09.6f}" for t in TIME]
PREAMBLE = "Recorder: bench 7\nDate: 2025-03-02 10:11\nSample rate [Hz]: 100\nOperator, Smith\n\n"

FORMS: dict[str, tuple[str | bytes, str]] = {
    "plain": (make_table(), ""),
    "semicolon": (make_table(";"), ""),
    "tab": (make_table("\t"), ""),
    "bar": (make_table("|"), ""),
    "blanks": (make_table("   "), ""),
    "blanks, aligned": ("\n".join("   " + line for line in make_table(" \t ").splitlines()), ""),
    "comma and blank": (make_table(", "), ""),
    "decimal comma": (make_table(";", write=write_with_comma), ""),
    "decimal comma, tabs": (make_table("\t", write=write_with_comma), ""),
    "decimal comma, blanks": (make_table("  ", write=write_with_comma), ""),
    "decimal comma, quoted": (make_table(",", write=lambda value: f'"{write_with_comma(value)}"'), ""),
    "every cell quoted": (make_table('","', '"time","torque","speed', end="").replace("\n", '"\n"')[:-1], ""),
    "sep": ("sep=;\n" + make_table(";"), ""),
    "sep, utf-16": (("sep=;\r\n" + make_table(";", write=write_with_comma).replace("\n", "\r\n")).encode("utf-16"), ""),
    "bom": (make_table().encode("utf-8-sig"), ""),
    "utf-16": (make_table().encode("utf-16"), ""),
    "utf-16, big": (codecs.BOM_UTF16_BE + make_table().encode("utf-16-be"), ""),
    "utf-16 without a mark": (make_table().encode("utf-16-le"), ""),
    "utf-32": (make_table().encode("utf-32"), ""),
    "cp1252": (make_table(header="time,torque,speed,temp [°C]", end=",20").encode("cp1252"), ""),
    "japanese": (make_table(header="time,torque,speed,温度", end=",20").encode("cp932"), 'encoding = "cp932"'),
    "preamble": (PREAMBLE + make_table(), ""),
    "long preamble": ("a line of text, with a comma\n" * 1500 + make_table(), ""),
    "skipped": ("time,torque,speed\n1,2,3\nall new from here\n" + make_table(), "skip_lines = 3"),
    "units row": (make_table(header="time,torque,speed\ns,Nm,rad/s"), ""),
    "units in brackets": (make_table(header="time,torque,speed\n[s],[Nm],[rad/s]"), ""),
    "units above": (make_table(header="s,Nm,rad/s\ntime,torque,speed"), ""),
    "unknown units row": (make_table(header="time,torque,speed\nsec.,Nm,foo"), ""),
    "units and remarks": (make_table(header="time,torque,speed\ns,Nm,rad/s\nfrom start,clutch,motor"), ""),
    "types above the units": (make_table("\t", header="time\ttorque\tspeed\nf8\tf8\tu16\ns\tNm\trad/s"), ""),
    "types below the units": (make_table(header="time,torque,speed\ns,Nm,rad/s\nREAL,LREAL,BYTE"), ""),
    "types without units": (make_table(header="time,torque,speed\n[double],[double],[int16]"), ""),
    "types first": (make_table(header="float64,float64,byte\ntime,torque,speed"), ""),
    "units in names": (make_table(header="time [s],torque [Nm],speed (rad/s)"), ""),
    "units after a mark": (make_table(";", header="time / s;torque / Nm;speed in rad/s"), ""),
    "comment as header": ("# made by numpy\n" + make_table(header="# time,torque,speed"), ""),
    "comments": (make_table().replace("0.1000,", "# pause\n% or\n// so\n0.1000,", 1), ""),
    "blank lines": (make_table().replace("\n0.1000,", "\n\n  \n0.1000,", 1), ""),
    "empty rows": (make_table() + ",,\n,,\n", ""),
    "trailing separators": (make_table(end=",", header="time,torque,speed,"), ""),
    "trailing in rows only": (make_table(end=","), ""),
    "trailing in names only": (make_table(header="time,torque,speed,,"), ""),
    "excel's empty cells": (make_table(end=",,,", header="time,torque,speed,,,"), ""),
    "empty name": (make_table(header="time,torque,speed,", end=",7"), ""),
    "quoted names": (make_table(header='"time","torque","speed"'), ""),
    "name on two lines": (make_table(header='time,torque,speed,"temp\nof oil, hot"', end=",20"), ""),
    "other delimiter in names": (make_table("\t", header="time, torque, speed"), ""),
    "text columns": (make_table(header="time,torque,speed,phase,valid", end=",shift 1,true"), ""),
    "windows": (make_table().replace("\n", "\r\n"), ""),
    "mac": (make_table().replace("\n", "\r"), ""),
    "windows, twice": (make_table().replace("\n", "\r\r\n"), ""),
    "no last line end": (make_table()[:-1], ""),
    "dos end": (make_table() + "\x1a", ""),
    "fortran": (make_table(write=lambda value: f"{value:.10E}".replace("E", "D")), ""),
    "exponents": (make_table(write="{:+.10e}".format), ""),
    "typesetter's minus": (make_table(write=lambda value: f"{value:.4f}".replace("-", "\u2212")), ""),
    "iso": (make_table(times=ISO), ""),
    "iso, blank": (make_table(times=[cell.replace("T", " ") for cell in ISO]), ""
    ),
    "iso, blank, tabs": (make_table("\t", times=[cell.replace("T", " ") for cell in ISO]), ""),
    "date and time apart": (
        make_table(" ", header="date time torque speed", times=[cell.replace("T", " ") for cell in ISO]), ""),
    "iso, zone": (make_table(times=[cell + "+01:00" for cell in ISO]), ""),
    "iso, decimal comma": (make_table(";", write=write_with_comma, times=[cell.replace(".", ",") for cell in ISO]), ""),
    "iso, zone by name": (make_table(times=[f"{cell.replace('T', ' ')} CEST" for cell in ISO]), ""),
    "iso, compact": (make_table(times=[cell.replace("-", "").replace(":", "") for cell in ISO]), ""),
    "iso, day of the year": (make_table(times=[f"2025-061T{cell[11:]}" for cell in ISO]), ""),
    "days, as IRIG": (make_table(times=[f"061:{cell[11:]}" for cell in ISO]), ""),
    "apostrophe before the year": (make_table(times=[f"'25-03-02 {cell[11:]}" for cell in ISO]), ""),
    "as the C library": (make_table(times=[f"Sun Mar  2 {cell[11:]} 2025" for cell in ISO]), ""),
    "french month": (make_table(times=[f"2 févr. 2025 {cell[11:]}" for cell in ISO]), ""),
    "spanish month": (make_table(times=[f"02-ene-2025 {cell[11:]}" for cell in ISO]), ""),
    "characters for year, month and day": (make_table(times=[f"2025年03月02日 {cell[11:]}" for cell in ISO]), ""),
    "day.month.year": (make_table(";", times=[f"02.03.2025 {cell[11:]}" for cell in ISO]), ""),
    "day first for certain": (make_table(times=[f"22/03/2025 {cell[11:]}" for cell in ISO]), ""),
    "month first for certain": (make_table(times=[f"03/22/2025 {cell[11:]} AM" for cell in ISO]), ""),
    "name of the month": (make_table(times=[f"02-Mar-2025 {cell[11:]}" for cell in ISO]), ""),
    "american": (make_table("\t", times=[f"Mar 2, 2025 {cell[11:]} am" for cell in ISO]), ""),
    "set": (make_table(times=[f"03/02/25 {cell[11:]}" for cell in ISO]), 'time_format = "%d/%m/%y %H:%M:%S.%f"'),
    "set, compact": (
        make_table(times=["20250302" + cell[11:].replace(":", "") for cell in ISO]), 'time_format = "%Y%m%d%H%M%S"'
    ),
    "time of day": (make_table(times=[cell[11:] for cell in ISO]), ""),
    "afternoon": (make_table(times=[f"{cell[11:]} PM" for cell in ISO]), ""),
    "midnight": (
        make_table(times=[f"{'23:59:59' if t < 0.295 else '00:00:00'}.{round(100 * t + 70) % 100:02d}" for t in TIME]), ""
    ),
    "minutes": (make_table(times=[f"11:{12.0 + t:05.2f}" for t in TIME]), ""),
    "epoch": (make_table(times=[f"{1740910260.0 + t:.4f}" for t in TIME]), ""),
    "epoch in ms": (make_table(times=[f"{1740910260000 + round(1e3 * t)}" for t in TIME]), ""),
    "thousands, set": (make_table(";", write=lambda value: f"{value:,.4f}"), 'thousands = ","'),
}  # fmt: skip
