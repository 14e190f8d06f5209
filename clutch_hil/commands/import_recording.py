"""`clutch-hil import`: list a foreign recording, map it, and write it as run files."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON, OVERWRITE
from protocols.errors import InputError, format_count

if TYPE_CHECKING:
    from clutch_hil.recordings.import_map import ImportMap


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(name="import")(import_run)


def import_run(
    recordings: list[Path] = typer.Argument(
        ...,
        metavar="RECORDING...",
        help="MDF 3 or 4, MATLAB .mat, CSV or other text, Excel .xlsx, TDMS, HDF5, Parquet, Feather, or a bus log; known by its"
        " content; also compressed",
    ),
    map_name: str | None = typer.Option(
        None, "--map", help="TOML file that assigns the columns, or emps, microtribometer, pneumatic_seal"
    ),
    show_list: bool = typer.Option(
        False, "--list", help="list the names, units, sample rates and time spans in the file"
    ),
    draft: bool = typer.Option(
        False, "--draft", help="write a map of all columns, for you to edit, to --out or NAME.toml"
    ),
    from_s: float | None = typer.Option(None, "--from", help="first time to keep, in s; that of the map if not given"),
    to_s: float | None = typer.Option(None, "--to", help="last time to keep, in s; that of the map if not given"),
    out: Path | None = typer.Option(
        None,
        help="run file to write: .parquet, .mf4 or .csv; NAME-1, NAME-2, ... where gaps cut the recording into runs. A folder"
        " where more recordings than one are given: each is written there as a .parquet of its name",
    ),
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Map names and units of a recording onto those of a run and write the run; what was done to it is told, and kept in the
    file's metadata. --list and --draft show what is in it first."""
    if show_list and draft:
        raise InputError("--list and --draft were both given; only one of them is allowed")
    recording = recordings[0]
    if (show_list or draft) and len(recordings) > 1:
        name = "--list" if show_list else "--draft"
        raise InputError(f"{name} was given with {len(recordings)} recordings; it allows only one")
    if show_list:
        _list(recording, map_name, json_output)
    elif draft:
        _draft(recording, map_name, out, overwrite, json_output)
    else:
        if map_name is None:
            command = shlex.join(["clutch-hil", "import", "--draft", str(recording)])
            own = "; --map bench reads a log of the bench's own frames" if _is_bus_log(recording) else ""
            raise InputError(f"--map is missing; `{command}` writes a draft of one{own}")
        if out is None:
            raise InputError("--out is missing; it is the run file to write: .parquet, .mf4 or .csv")
        _import(recordings, map_name, from_s, to_s, out, overwrite, json_output)


def _is_bus_log(recording: Path) -> bool:
    from clutch_hil.recordings.format import recognise
    from clutch_hil.recordings.formats.bus_log import BusLogFormat

    with suppress(InputError):
        return isinstance(recognise(recording), BusLogFormat)
    return False


def _import(
    recordings: Sequence[Path],
    map_name: str,
    from_s: float | None,
    to_s: float | None,
    out: Path,
    overwrite: bool,
    json_output: bool,
) -> None:
    from clutch_hil.recordings.import_map import load_map
    from protocols.files.runs import check_suffix

    if len(recordings) == 1 and not out.is_dir():
        check_suffix(out)
        done = _import_recording(recordings[0], load_map(map_name).cut(from_s, to_s), out, overwrite, recordings)
        report(done.document, str(done), done.verdict, True, json_output)
    else:
        the_map, targets = load_map(map_name).cut(from_s, to_s), _choose_files(recordings, out)
        with _made_folder(out):
            _import_several(targets, the_map, overwrite, json_output)


def _choose_files(recordings: Sequence[Path], folder: Path) -> dict[Path, Path]:
    """Return the file in `folder` to which each recording is written. Raises InputError."""
    if folder.suffix and not folder.is_dir():
        raise InputError(f"--out is {folder}, and {len(recordings)} recordings are given; allowed is a folder")
    if folder.exists() and not folder.is_dir():
        raise InputError(
            f"--out is {folder}, which is a file; allowed is a folder, as {len(recordings)} recordings are given"
        )
    targets: dict[Path, Path] = {}
    for recording in recordings:
        if recording in targets:
            raise InputError(f"{recording} was given twice; give it once")
        target = folder / f"{recording.stem}.parquet"
        for other, taken in targets.items():
            if target == taken:
                raise InputError(f"{other} and {recording} would both be written to {target}; import them one by one")
        targets[recording] = target
    return targets


@contextmanager
def _made_folder(folder: Path) -> Iterator[None]:
    """Create a folder, and remove it again if nothing was written to it. Raises InputError."""
    from protocols.files.output_file import make_folder

    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    make_folder(folder)
    try:
        yield
    finally:
        with suppress(OSError):  # not empty
            for one in missing:
                one.rmdir()


def _import_several(targets: Mapping[Path, Path], the_map: "ImportMap", overwrite: bool, json_output: bool) -> None:
    """Import recordings in turn. A refused one is reported, gives exit code 2, and does not stop the others."""
    from clutch_hil.bench.progress import progress_bar

    imported, refused = [], {}
    with progress_bar("importing", json_output) as show:
        for number, (recording, target) in enumerate(targets.items()):
            show(number, len(targets))
            try:
                imported.append(_import_recording(recording, the_map, target, overwrite, list(targets)))
            except InputError as error:
                refused[str(recording)] = str(error)
    lines = [*map(str, imported), *(f"refused {name}: {error}" for name, error in refused.items())]
    verdict = f"{len(imported)} of {format_count(len(targets), 'recording')} imported"
    documents = [one.document for one in imported]
    report({"imported": documents, "refused": refused}, "\n".join(lines), verdict, True, json_output)
    if refused:
        raise typer.Exit(2)


@dataclass(frozen=True)
class _Imported:
    """An imported recording: its document, the processing steps in `lines`, and the verdict."""

    document: Mapping[str, Any]
    lines: Sequence[str]
    verdict: str

    def __str__(self) -> str:
        """Return the processing steps, one per line."""
        return "\n".join(self.lines)


def _import_recording(
    recording: Path, the_map: "ImportMap", out: Path, overwrite: bool, recordings: Sequence[Path]
) -> _Imported:
    """Import a recording; none of `recordings` is overwritten. Raises InputError."""
    from clutch_hil.recordings.checks.every_check import check_columns_alone
    from protocols.files.output_file import check_new_file, whole_files
    from protocols.files.runs import write_run

    check_new_file(out, overwrite, recordings)
    runs = the_map.read_runs(recording)
    files = [out] if len(runs) == 1 else [out.with_stem(f"{out.stem}-{k}") for k in range(1, len(runs) + 1)]
    for file in files:
        check_new_file(file, overwrite, recordings)
    checks = []
    with whole_files(out.parent) as parts:  # all runs of a recording or none
        for run, file in zip(runs, files, strict=True):
            own = check_columns_alone(str(file), run.columns, run.units)
            run.metadata["import"]["checks"] = [finding.as_json() for finding in own]
            write_run(run, parts / file.name)
            checks += own
    rows = [len(run["time_s"]) for run in runs]
    rate = (rows[0] - 1) / (runs[0]["time_s"][-1] - runs[0]["time_s"][0])
    done = runs[0].metadata["import"]["done"]
    document = {
        "read": str(recording), "wrote": [str(file) for file in files], "rows": rows, "columns": list(runs[0].columns),
        "done": done, "checks": [finding.as_json() for finding in checks],
    }  # fmt: skip
    written = ", ".join(str(file) for file in files)
    lines = [f"read:    {recording}", *done, *map(str, checks), f"wrote:   {written}: {', '.join(runs[0].columns)}"]
    verdict = f"{sum(rows)} rows at {rate:.6g} Hz" + (f" in {len(runs)} runs" if len(runs) > 1 else "")
    return _Imported(document, lines, verdict)


def _list(recording: Path, map_name: str | None, json_output: bool) -> None:
    from clutch_hil.bench.progress import format_table
    from clutch_hil.recordings.contents import list_contents, make_document
    from clutch_hil.recordings.format import open_recording, recognise
    from clutch_hil.recordings.import_map import load_map

    contents = open_recording(recording, load_map(map_name).options if map_name else None)
    kind = recognise(recording).name
    document = {"read": str(recording), "format": kind, **make_document(contents)}
    numbers = [f"{name} = {value:.6g}" for name, value in contents.numbers.items()]
    table = format_table(list_contents(contents))
    lines = [f"read:    {recording}: {kind}", *contents.notes, *numbers, table, "wrote:   nothing"]
    report(document, "\n".join(lines), format_count(len(contents.channels), "channel"), True, json_output)


def _draft(recording: Path, map_name: str | None, out: Path | None, overwrite: bool, json_output: bool) -> None:
    from clutch_hil.recordings.contents import draft_map
    from clutch_hil.recordings.format import open_recording
    from clutch_hil.recordings.import_map import load_map
    from protocols.files.output_file import check_new_file, whole_file

    if out is not None and out.suffix.lower() != ".toml":
        raise InputError(f"--out is {out}; a map is written as .toml")
    options = load_map(map_name).options if map_name else {}
    contents = open_recording(recording, options)
    text = draft_map(recording, contents, list(options.items()))
    target = out or Path(f"{recording.stem}.toml")
    check_new_file(target, overwrite, [recording, *([Path(map_name)] if map_name else [])])
    with whole_file(target) as part:
        part.write_text(text, encoding="utf-8")
    document = {"read": str(recording), "wrote": str(target), "notes": contents.notes}
    words = ["clutch-hil", "import", recording, "--map", target, "--out", "run.parquet"]
    next_step = f"next:    edit {target}, then {shlex.join(map(str, words))}"
    lines = [f"read:    {recording}", *contents.notes, f"wrote:   {target}", next_step]
    report(document, "\n".join(lines), f"map with {text.count(' = {')} columns", True, json_output)
