"""Rivals by one command: python -m benchmarks.battery.rivals --method sindy|classifier|gaussian_process|all.

Their rankings are below OUT/ENGINE/rivals/METHOD, their limits are set on the development split, and their answers to the split
asked for are kept beside the battery's own, with --keep, from where its page reads them.
"""

from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.battery.rivals import METHODS, classifier
from benchmarks.battery.rivals.ranking import rank
from benchmarks.battery.rivals.verdict import answered, tuned
from benchmarks.battery.run import Cache, chosen, keep, run
from benchmarks.battery.score import Told, family, hidden, naming
from benchmarks.battery.table import text
from benchmarks.battery.validity import engine
from clutch_hil.bench.progress import progress_bar
from clutch_hil.discrepancy.result import NONE_OF_THESE, NOTHING
from protocols.errors import InputError, closest

FAMILIES = ("single", "null", "unknown")
_PACKAGES = {"sindy": "pysindy", "classifier": "sklearn"}


def _class(told: Told) -> str:
    if family(told) == "unknown":
        return NONE_OF_THESE
    return hidden(told)[0] if hidden(told) else NOTHING


def classified(training: Sequence[Told], asked: Sequence[Told]) -> tuple[list[Told], list[Told]]:
    """Both with rankings, the training cases by classifiers that were not shown them."""
    x, classes = np.array([t["features"] for t in training]), [_class(t) for t in training]
    own = [t | {"ranking": r} for t, r in zip(training, classifier.left_out(x, classes), strict=True)]
    if not asked:
        return own, []
    answers = classifier.Classifier(x, classes).ranked(np.array([t["features"] for t in asked]))
    return own, [t | {"ranking": r} for t, r in zip(asked, answers, strict=True)]


def main(
    method: Annotated[str, typer.Option(help="sindy, gaussian_process, classifier, all")] = "all",
    split: Annotated[str, typer.Option(help="development or evaluation")] = "evaluation",
    only: Annotated[list[str] | None, typer.Option(help="pattern of case names, in both splits")] = None,
    quick: Annotated[bool, typer.Option(help="severity 2, noise 2 %, one seed")] = False,
    jobs: Annotated[int, typer.Option(min=1)] = 2,
    out: Annotated[Path, typer.Option(help="folder of the rankings")] = Path("runs/battery"),
    keeping: Annotated[bool, typer.Option("--keep", help="keep the answers, for the repository")] = False,
) -> None:
    """Run other methods on single effects, null cases and unknown effects."""
    try:
        if method not in (*METHODS, "all"):
            raise InputError(f"method {method!r} is unknown; {closest(method, (*METHODS, 'all'))}")
        names = {
            s: [c.name for c in chosen(s, FAMILIES, quick, only or [])] for s in dict.fromkeys(("development", split))
        }
        if empty := [s for s, ones in names.items() if not ones]:
            raise InputError(f"no case of the split {empty[0]} is like {', '.join(only or [])}; both splits need some")
        methods = METHODS if method == "all" else (method,)
        if lacking := [name for one, name in _PACKAGES.items() if one in methods and find_spec(name) is None]:
            raise InputError(f"package {lacking[0]} is not installed; pip install -e '.[battery]' brings it")
    except InputError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(2) from None
    folder = out / engine()
    for one in methods:
        found: dict[str, list[Told]] = {}
        for s, wanted in names.items():
            with progress_bar(f"{one}, {s}", False) as progress:
                found[s] = []
                for told in run(
                    wanted, Cache(folder / "rivals" / one), jobs, partial(rank, one, folder / "rivals" / "prepared")
                ):
                    found[s].append(told)
                    progress(len(found[s]), len(wanted))
            found[s].sort(key=lambda told: str(told["case"]))  # they come as they are done; a classifier sees an order
        if one == "classifier":
            asked = [] if split == "development" else found[split]
            found["development"], answers = classified(found["development"], asked)
            found[split] = answers or found["development"]
        limits = tuned(found["development"])
        answers = [answered(told, limits) for told in found[split]]
        typer.echo(f"{one}: {limits}\n{text(naming(answers))}")
        if keeping:
            typer.echo(f"wrote:   {keep(answers, folder.name, f'{one}-{split}')}")
    typer.echo("verdict: done")


if __name__ == "__main__":
    typer.run(main)
