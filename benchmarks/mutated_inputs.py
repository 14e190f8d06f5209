"""Mutated inputs: reads damaged copies of all inputs of the bench, for a given time.

Recordings, runs and logs of each format; parameters, limits, scenarios, profiles and maps; telemetry messages; frames.

    python -m benchmarks.mutated_inputs --minutes 60                     # of a small file of each kind, made here
    python -m benchmarks.mutated_inputs RECORDING... --count 500     # of your files, 500 copies of each

Each copy must be read, or refused in one sentence, within 20 s of CPU time and with at most 1 GiB of memory. The first one that
is not is kept in the folder --out, and so is the present copy if a library ends the process. The number of copies that could be
opened is counted.
"""

import time
from collections import Counter
from pathlib import Path

import typer

from benchmarks.mutations import Reach, play_copies
from benchmarks.sound_inputs import make_inputs
from benchmarks.sound_recordings import describe_file, make_files
from clutch_hil.bench.progress import format_table, progress_bar
from clutch_hil.command import report, run_command
from protocols.errors import InputError

_ROUND = 20  # copies of a file before the next file: one takes milliseconds to a second
_OUT = Path("mutated")


def mutate_inputs(
    recordings: list[Path] | None = typer.Argument(
        None, help="sound recordings; a small file of each kind if not given"
    ),
    minutes: float = typer.Option(1.0, help="how long, where --count is not given"),
    count: int | None = typer.Option(None, help="copies of each file", min=1),
    seed: int = typer.Option(1, help="seed of the damage", min=0),
    only: str = typer.Option("", help="kinds whose name contains this"),
    out: Path = typer.Option(_OUT, help="folder for the copy at hand"),
) -> None:
    """Read damaged copies of inputs: each is read or refused in one sentence, in bounded time and memory."""
    if not 0.0 < minutes < float("inf"):
        raise InputError(f"--minutes is {minutes:g}; allowed is more than 0")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"folder {out} cannot be made: {error.strerror}") from None
    sounds = [describe_file(path) for path in recordings] if recordings else [*make_files(out), *make_inputs(out)]
    sounds = [sound for sound in sounds if only.lower() in sound.name.lower()]
    if not sounds:
        raise InputError(f"--only is {only!r}, which no kind contains")
    try:
        contents = {sound.name: sound.file.read_bytes() for sound in sounds}
    except OSError as error:
        raise InputError(f"recording {error.filename} cannot be read: {error.strerror}") from None
    end, done = time.monotonic() + 60.0 * minutes, 0
    reached = {sound.name: Counter[Reach]() for sound in sounds}
    target = count or _ROUND
    with progress_bar("mutated inputs", False) as progress:
        while done == 0 or (count is None and time.monotonic() < end):
            for sound in sounds:
                copy = out / f"damaged{sound.file.suffix}"
                reached[sound.name].update(
                    play_copies(copy, contents[sound.name], target, seed + done, sound.play, sound.damage)
                )
                progress(min(60.0 * minutes, 60.0 * minutes - (end - time.monotonic())), int(60 * minutes))
            done += target
    rows = [("file", "copies", "behind opening", "of these read whole")]
    for name, counts in reached.items():
        rows.append((name, str(done), str(done - counts[Reach.REFUSED]), str(counts[Reach.READ])))
    document = {
        "copies": done,
        "reached": {name: {reach.name.lower(): counts[reach] for reach in Reach} for name, counts in reached.items()},
    }
    text = f"{format_table(rows)}\nwrote:   {out}"
    report(document, text, f"{done * len(sounds)} copies, none broke a rule", True, False)


if __name__ == "__main__":
    run_command(mutate_inputs)
