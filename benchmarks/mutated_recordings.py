"""Mutated recordings: damaged copies of sound files, for as long as you like.

    python -m benchmarks.mutated_recordings --minutes 60                 # of a small file of each format, made here
    python -m benchmarks.mutated_recordings RECORDING... --count 500     # of files of yours, so many copies of each

Each copy must be read, or refused in one sentence, within 20 s and with at most 1 GiB of memory. The first that is not stays in
the folder --out, and so does the copy at hand if a library ends the process.
"""

import time
from collections import Counter
from pathlib import Path

import numpy as np
import typer

from benchmarks.mutations import check_damaged
from clutch_hil.bench.progress import progress_bar
from clutch_hil.command import report, run_command
from clutch_hil.recordings.format import recognise
from protocols.errors import InputError

_ROUND = 20  # copies of a file before the next file has its turn: one takes milliseconds to a second
_ROWS = 200  # of the files that are made here
_OUT = Path("mutated")


def make_files(folder: Path) -> list[Path]:
    """Write a small sound file of each format into `folder`; return their paths."""
    import asammdf
    import h5py
    import nptdms
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.feather
    import pyarrow.parquet
    import scipy.io

    t = 0.01 * np.arange(_ROWS)
    columns = {"time": t, "torque": np.sin(t), "speed": 100.0 + t}
    table = pa.table(columns)
    names = (
        "sound.csv",
        "sound.parquet",
        "sound.feather",
        "sound.mat",
        "sound.mf4",
        "sound.h5",
        "sound.tdms",
        "sound.log",
    )
    csv, parquet, feather, mat, mf4, hdf5, tdms, log = (folder / name for name in names)
    pyarrow.csv.write_csv(table, csv)
    pyarrow.parquet.write_table(table, parquet)
    pyarrow.feather.write_feather(table, feather)
    scipy.io.savemat(
        mat, {**columns, "rec": {"X": t, "Y": {"Name": "torque", "Data": columns["torque"]}}}, do_compression=True
    )
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(columns[name], t, name=name) for name in ("torque", "speed")])
        mdf.save(mf4, compression=2)
    with h5py.File(hdf5, "w") as file:
        for name, values in columns.items():
            file.create_dataset(name, data=values, compression="gzip")
    with nptdms.TdmsWriter(tdms) as writer:
        writer.write_segment([nptdms.ChannelObject("rig", name, values) for name, values in columns.items()])
    log.write_text("".join(f"({1e9 + 0.01 * k:.6f}) can0 123#{k:016X}\n" for k in range(_ROWS)), encoding="utf-8")
    return [csv, parquet, feather, mat, mf4, hdf5, tdms, log]


def mutate_recordings(
    recordings: list[Path] | None = typer.Argument(None, help="sound files; small ones of each format if not given"),
    minutes: float = typer.Option(1.0, help="how long, where --count is not given"),
    count: int | None = typer.Option(None, help="copies of each file", min=1),
    seed: int = typer.Option(1, help="seed of the damage", min=0),
    out: Path = typer.Option(_OUT, help="folder for the copy at hand"),
) -> None:
    """Read damaged copies of recordings: each is read or refused in one sentence, in bounded time and memory."""
    if not 0.0 < minutes < float("inf"):
        raise InputError(f"--minutes is {minutes:g}; allowed is more than 0")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"folder {out} cannot be made: {error.strerror}") from None
    files = recordings or make_files(out)
    try:
        contents = {file: file.read_bytes() for file in files}
    except OSError as error:
        raise InputError(f"recording {error.filename} cannot be read: {error.strerror}") from None
    end, done, read = time.monotonic() + 60.0 * minutes, 0, Counter[Path]()
    target = count or _ROUND
    with progress_bar("mutated recordings", False) as progress:
        while done == 0 or (count is None and time.monotonic() < end):
            for file, content in contents.items():
                read[file] += check_damaged(
                    out / f"damaged{file.suffix}", content, target, seed + done, whole=recognise(file).order < 2
                )[0]
                progress(min(60.0 * minutes, 60.0 * minutes - (end - time.monotonic())), int(60 * minutes))
            done += target
    lines = [f"{file}: {done} copies, {read[file]} read, {done - read[file]} refused" for file in files]
    text = "\n".join([*lines, f"wrote:   {out}"])
    document = {"copies": done, "read": {str(file): read[file] for file in files}}
    report(document, text, f"{done * len(files)} copies, none broke a rule", True, False)


if __name__ == "__main__":
    run_command(mutate_recordings)
