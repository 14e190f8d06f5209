"""The battery by one command: python -m benchmarks.battery."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, TextIO

import typer

from benchmarks.battery.cases import FAMILIES
from benchmarks.battery.rivals import METHODS
from benchmarks.battery.run import Cache, format_answer, keep_answers, read_kept_answers, run_cases, select_cases
from benchmarks.battery.score import Answer, score_answers
from benchmarks.battery.table import PICTURES_FOLDER, format_measures, write_page
from benchmarks.battery.validity import CHECKED_CASES, format_engine_name, list_differences
from clutch_hil.bench.progress import progress_bar
from clutch_hil.bench.recording import make_writable
from clutch_hil.command import end_with_verdict, run_command
from protocols.errors import InputError, InterruptionError

_CONTINUE = "the same command goes on from there"


def main(
    split: Annotated[str, typer.Option(help="development or evaluation")] = "development",
    families: Annotated[str, typer.Option(help="of cases, with commas")] = ",".join(FAMILIES),
    only: Annotated[list[str] | None, typer.Option(help="pattern of case names; several: in this order")] = None,
    quick: Annotated[bool, typer.Option(help="severity 2, noise 2 %, one seed")] = False,
    jobs: Annotated[int | None, typer.Option(min=1, help="worker processes; one for each CPU if not given")] = None,
    dask: Annotated[
        str | None, typer.Option(help="Dask scheduler whose workers judge, such as tcp://host:8786")
    ] = None,
    out: Annotated[Path, typer.Option(help="folder of the answers")] = Path("runs/battery"),
    log: Annotated[Path | None, typer.Option(help="a line a case is added to it")] = None,
    docs: Annotated[Path | None, typer.Option(help="folder to write battery.md and its pictures to")] = None,
    done: Annotated[bool, typer.Option("--done", help="only what is there: run nothing")] = False,
    keeping: Annotated[
        bool, typer.Option("--keep", help="keep the answers beside the battery, for the repository")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help="play a handful of cases again and compare with what was kept")
    ] = False,
) -> None:
    """Run the cases that have no answer yet, and print the measures of the engine over all of them."""
    if jobs is not None and dask is not None:
        raise InputError(f"--jobs {jobs} and --dask {dask} were given together; a cluster has its own workers")
    if check:
        others = {"--only": only, "--quick": quick, "--log": log, "--docs": docs, "--done": done, "--keep": keeping}
        if unused := [name for name, value in others.items() if value]:
            raise InputError(
                f"--check and {unused[0]} were given together; --check plays cases of its own, writes nothing"
            )
        check_kept_answers(jobs, dask)
        return
    names = [case.name for case in select_cases(split, families.split(","), quick, only or [])]
    if not names:
        asked = f"--families {families}" + "".join(f" --only {pattern}" for pattern in only or []) + " --quick" * quick
        raise InputError(
            f"no case of the split {split} suits {asked}; the names of cases are FAMILY/EFFECTS/SEVERITY/NOISE/SEED"
        )
    folder = out / format_engine_name()
    kept = read_kept_answers(folder.name)
    if not done:  # answers of an earlier engine are on the page until their cases are run again
        kept = {name: answer for name, answer in kept.items() if answer.get("engine") == folder.name}
    cache = Cache(folder / "cases", kept)
    if done:
        names = [name for name in names if cache.read(name)]
        if not names:
            raise InputError(
                f"no answer to such a case is in {cache.folder} or kept beside the battery; --done runs none"
            )
    else:
        make_writable(cache.folder)
    if docs:
        make_writable(docs / PICTURES_FOLDER)
    answers = _answer_cases(names, cache, jobs, dask, split, log)
    typer.echo(f"read:    {len(names)} cases of the split {split}")
    if not done:
        typer.echo(f"wrote:   {cache.folder}")
    if keeping:
        typer.echo(f"wrote:   {keep_answers(answers, folder.name)}")
    measures = score_answers(answers)
    typer.echo(format_measures(measures))
    if docs:
        rivals = {
            name: list(rival_answers.values())
            for name in METHODS
            if (rival_answers := read_kept_answers(folder.name, f"{name}-{split}"))
        }
        for path in write_page(answers, split, docs, folder.name, rivals):
            typer.echo(f"wrote:   {path}")
    failed = [one.name for one in measures if one.reached is False]
    end_with_verdict(
        f"{len(failed)} goals not reached: {', '.join(failed)}" if failed else "every goal is reached", not failed
    )


def _answer_cases(
    names: Sequence[str], cache: Cache, jobs: int | None, address: str | None, split: str, log: Path | None
) -> list[Answer]:
    """Answer all cases with a progress bar, and a line a case in the `log`. Raises InputError and InterruptionError."""
    answers: list[Answer] = []
    try:
        with open_log(log) as lines, progress_bar(f"battery, {split}", False) as progress:
            progress(0, len(names))
            for answer in run_cases(names, cache, jobs, address=address):
                answers.append(answer)
                progress(len(answers), len(names))
                if lines:
                    print(format_answer(answer), file=lines, flush=True)
    except InputError as error:
        raise InputError(f"{error}; {_CONTINUE}" if answers else str(error)) from None
    except KeyboardInterrupt:
        raise InterruptionError(f"{len(answers)} of {len(names)} cases are answered; {_CONTINUE}") from None
    return answers


@contextmanager
def open_log(path: Path | None) -> Iterator[TextIO | None]:
    """Open a file to which lines are added; None without a path. Raises InputError."""
    if path is None:
        yield None
        return
    try:
        file = path.open("a", encoding="utf-8")
    except OSError as error:
        raise InputError(f"log {path} cannot be written: {error.strerror}") from None
    with file:
        yield file


def check_kept_answers(jobs: int | None, address: str | None) -> None:
    """Play CHECKED_CASES again and print how they differ from the kept answers; exit code 1 if one does."""
    before, changed = read_kept_answers(format_engine_name()), 0
    if missing := [name for name in CHECKED_CASES if name not in before]:
        raise InputError(f"no answer to {missing[0]} is kept for {format_engine_name()}; --keep keeps answers")
    with TemporaryDirectory() as folder:
        for answer in run_cases(CHECKED_CASES, Cache(Path(folder)), jobs, address=address):
            differences = list_differences(before[answer["case"]], answer)
            typer.echo(
                "\n  ".join([f"{answer['case']}: {'the same' if not differences else 'it differs'}", *differences])
            )
            changed += bool(differences)
    count = len(CHECKED_CASES)
    typer.echo(f"read:    {count} cases, and what was kept of {format_engine_name()}\nwrote:   nothing")
    if changed:
        end_with_verdict(f"{changed} of {count} differ; raise the version of what was changed on purpose", good=False)
    end_with_verdict(f"all {count} are as they were")


if __name__ == "__main__":
    run_command(main)
