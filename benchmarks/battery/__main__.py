"""The battery by one command: python -m benchmarks.battery."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from benchmarks.battery.cases import FAMILIES
from benchmarks.battery.rivals import METHODS
from benchmarks.battery.run import Cache, chosen, keep, kept, line, run
from benchmarks.battery.validity import CHECKED, differences, engine
from clutch_hil.bench.progress import progress_bar
from protocols.errors import InputError


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
    """Run cases, or what is not done of them, and say how good the engine was."""
    from benchmarks.battery.score import scores
    from benchmarks.battery.table import text, write

    try:
        if check:
            raise typer.Exit(0 if _check(jobs, dask) else 1)
        names = [case.name for case in chosen(split, families.split(","), quick, only or [])]
    except InputError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from None
    if not names:
        typer.echo(f"error: no case of the split {split} is like that", err=True)
        raise typer.Exit(2)
    folder = out / engine()
    cache = Cache(folder / "cases", kept(folder.name))
    if done:
        names = [name for name in names if cache.read(name)]
    answers = []
    try:
        with progress_bar(f"battery, {split}", False) as progress:
            progress(0, len(names))
            for told in run(names, cache, jobs, address=dask):
                answers.append(told)
                progress(len(answers), len(names))
                if log:
                    with log.open("a", encoding="utf-8") as file:
                        file.write(line(told) + "\n")
    except InputError as error:
        typer.echo(f"error: {error}; the same command goes on from there", err=True)
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        typer.echo(f"stopped after {len(answers)} of {len(names)} cases; the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    typer.echo(f"read:    {len(names)} cases of the split {split}")
    typer.echo(f"wrote:   {cache.folder}")
    if keeping:
        typer.echo(f"wrote:   {keep(answers, folder.name)}")
    found = scores(answers)
    typer.echo(text(found))
    if docs:
        rivals = {name: list(said.values()) for name in METHODS if (said := kept(folder.name, f"{name}-{split}"))}
        for path in write(answers, split, docs, folder.name, rivals):
            typer.echo(f"wrote:   {path}")
    failed = [one.name for one in found if one.reached is False]
    typer.echo(
        f"verdict: {len(failed)} goals not reached: {', '.join(failed)}" if failed else "verdict: every goal is reached"
    )
    raise typer.Exit(1 if failed else 0)


def _check(jobs: int | None, address: str | None) -> bool:
    """Whether today's engine says of a handful of cases what was kept."""
    before, changed = kept(engine()), 0
    with TemporaryDirectory() as folder:
        for told in run(CHECKED, Cache(Path(folder)), jobs, address=address):
            found = differences(before[told["case"]], told)
            typer.echo("\n  ".join([f"{told['case']}: {'the same' if not found else 'it differs'}", *found]))
            changed += bool(found)
    typer.echo(f"read:    {len(CHECKED)} cases, and what was kept of {engine()}\nwrote:   nothing")
    if changed:
        typer.echo(f"verdict: {changed} of {len(CHECKED)} differ; raise the version of what was changed on purpose")
    else:
        typer.echo(f"verdict: all {len(CHECKED)} are as they were")
    return not changed


if __name__ == "__main__":
    typer.run(main)
