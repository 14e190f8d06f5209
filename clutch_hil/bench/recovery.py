"""Recovery: restore run files from the journals of recorders that were killed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from clutch_hil.bench.sealed import SealedWriter, make_truth_path
from protocols.errors import InputError
from protocols.files.journal import JournalReader, LivingWriterError, find_run, list_journals
from protocols.files.output_file import check_new_file
from protocols.files.runs import RunWriter, read_last_row, remove_dead_parts
from protocols.realtime.shared_folder import remove_dead_folders

_REASON = "its recorder was killed; recovered from the journal"
_TRUTH = make_truth_path(Path("x.parquet")).name.removeprefix("x")  # suffix of a truth file


@dataclass(frozen=True)
class Recovered:
    """Result of the recovery of a `journal`: the run `file`, its number of `samples` and `seconds`; None if it had no run."""

    journal: Path
    file: Path | None
    samples: int = 0
    seconds: float = 0.0
    was_complete: bool = False  # the recorder was killed between completing the file and removing the journal

    def __str__(self) -> str:
        if self.file is None:
            return f"{self.journal} had {self.samples} samples, no run; it was removed"
        if self.was_complete:
            return f"{self.file} was complete; its journal was removed"
        return f"recovered {self.file}: {self.samples} samples, {self.seconds:.3f} s of a run whose recorder was killed"


def recover_folder(folder: Path, tell: Callable[[str], None]) -> list[Recovered]:
    """Recover every journal in a folder whose writer is dead; call `tell` with a sentence for each, also for a failed recovery.

    Other remains of killed processes are removed: unfinished run files in the folder, and shared memory.
    """
    done = []
    for journal in list_journals(folder):
        try:
            done.append(recover(journal))
        except LivingWriterError:
            continue
        except InputError as error:
            tell(str(error))
        else:
            tell(str(done[-1]))
    remove_remains(folder)
    return done


def remove_remains(folder: Path) -> None:
    """Remove unfinished run files in a folder whose writers are dead, and the shared memory of dead processes."""
    remove_dead_parts(folder)
    remove_dead_folders()


def recover(journal: Path) -> Recovered:
    """Write the run whose rows are in a journal, and remove the journal. Raises InputError; the journal is then kept.

    The run has the metadata known at its start, and `incomplete`. Both files of a blind run are written.
    """
    recorded = find_run(journal)
    sealed = recorded.name.endswith(_TRUTH)
    run = recorded.with_name(recorded.name.removesuffix(_TRUTH) + ".parquet") if sealed else recorded
    with JournalReader(journal) as rows:
        if run.exists() and (result := _compare(rows, run, recorded)):
            journal.unlink()
            return result
    with JournalReader(journal) as rows:
        # a run of this name may be another run, which was to be replaced
        free = run.with_stem(f"{run.stem}-recovered") if run.exists() else run
        check_new_file(free)
        result = _write(rows, free, make_truth_path(free) if sealed else None)
        remove_dead_parts(run.parent)  # not that of another writer, which keeps it locked
        if sealed and not run.exists():
            recorded.unlink(missing_ok=True)
        journal.unlink()
    return result


def _compare(rows: JournalReader, run: Path, recorded: Path) -> Recovered | None:
    """Return the run at `run` as complete if the file of its whole rows, `recorded`, has the rows of the journal; else None."""
    samples, last = 0, np.empty(0)
    for piece in rows:
        samples, last = samples + len(piece), piece[-1]
    try:
        names, count, last_row = read_last_row(recorded)
    except InputError:
        return None
    same = names == [column.name for column in rows.columns] and count == samples
    if not (same and np.array_equal(last, last_row, equal_nan=True)):
        return None
    return Recovered(rows.path, run, samples, was_complete=True)


def _write(rows: JournalReader, run: Path, truth: Path | None) -> Recovered:
    samples, times = 0, [np.nan, np.nan]
    names = [column.name for column in rows.columns]
    if not names:  # its writer ended before it wrote any row
        return Recovered(rows.path, None)
    if "time_s" not in names:
        raise InputError(f"journal {rows.path} is not that of a run: it lacks the column time_s")
    at = names.index("time_s")
    with SealedWriter(run, rows.columns, truth) if truth else RunWriter(run, rows.columns) as writer:
        for piece in rows:
            times = [times[0] if samples else piece[0, at], piece[-1, at]]
            samples += len(piece)
            writer.append(piece)
        if samples < 2:
            return Recovered(rows.path, None, samples)
        writer.finish(rows.metadata | {"incomplete": _REASON})
    return Recovered(rows.path, run, samples, float(times[1] - times[0]))
