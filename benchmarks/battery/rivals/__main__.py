"""Other methods by one command: python -m benchmarks.battery.rivals --method sindy|classifier|gaussian_process|all.

Rankings are written below OUT/ENGINE/rivals/METHOD. Limits of a method are set on the development split. With --keep,
answers to the split are kept beside those of the battery, from where its page reads them.
"""

from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.battery.rivals import METHODS, classifier
from benchmarks.battery.rivals.ranking import rank_case
from benchmarks.battery.rivals.verdict_limits import answer_by_limits, tune_limits
from benchmarks.battery.run import Cache, keep_answers, run_cases, select_cases
from benchmarks.battery.score import Answer, find_family, list_hidden_names, score_names
from benchmarks.battery.table import format_measures
from benchmarks.battery.validity import format_engine_name
from clutch_hil.bench.progress import progress_bar
from clutch_hil.bench.recording import make_writable
from clutch_hil.command import end_with_verdict, run_command
from clutch_hil.discrepancy.result import NONE_OF_THESE, NOTHING
from protocols.errors import InputError, suggest_closest

FAMILIES = ("single", "null", "unknown")
_PACKAGES = {"sindy": "pysindy", "classifier": "sklearn"}


def _find_true_class(answer: Answer) -> str:
    if find_family(answer) == "unknown":
        return NONE_OF_THESE
    return list_hidden_names(answer)[0] if list_hidden_names(answer) else NOTHING


def rank_by_classifier(training: Sequence[Answer], asked: Sequence[Answer]) -> tuple[list[Answer], list[Answer]]:
    """Add rankings to both; those of training cases come from classifiers trained without them."""
    x, classes = np.array([t["features"] for t in training]), [_find_true_class(t) for t in training]
    own = [t | {"ranking": r} for t, r in zip(training, classifier.cross_validate(x, classes), strict=True)]
    if not asked:
        return own, []
    answers = classifier.Classifier(x, classes).rank_classes(np.array([t["features"] for t in asked]))
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
    if method not in (*METHODS, "all"):
        raise InputError(f"method {method!r} is unknown; {suggest_closest(method, (*METHODS, 'all'))}")
    names = {
        split_name: [c.name for c in select_cases(split_name, FAMILIES, quick, only or [])]
        for split_name in dict.fromkeys(("development", split))
    }
    if empty := [split_name for split_name, ones in names.items() if not ones]:
        raise InputError(f"no case of the split {empty[0]} is like {', '.join(only or [])}; both splits need some")
    methods = METHODS if method == "all" else (method,)
    if lacking := [name for rival, name in _PACKAGES.items() if rival in methods and find_spec(name) is None]:
        raise InputError(f"package {lacking[0]} is not installed; pip install -e '.[battery]' brings it")
    folder = make_writable(out / format_engine_name())
    for rival in methods:
        answers_by_split: dict[str, list[Answer]] = {}
        for split_name, case_names in names.items():
            with progress_bar(f"{rival}, {split_name}", False) as progress:
                answers_by_split[split_name] = []
                for answer in run_cases(
                    case_names,
                    Cache(folder / "rivals" / rival),
                    jobs,
                    partial(rank_case, rival, folder / "rivals" / "prepared"),
                ):
                    answers_by_split[split_name].append(answer)
                    progress(len(answers_by_split[split_name]), len(case_names))
            # workers finish in any order; a classifier depends on the order
            answers_by_split[split_name].sort(key=lambda answer: str(answer["case"]))
        if rival == "classifier":
            asked = [] if split == "development" else answers_by_split[split]
            answers_by_split["development"], answers = rank_by_classifier(answers_by_split["development"], asked)
            answers_by_split[split] = answers or answers_by_split["development"]
        limits = tune_limits(answers_by_split["development"])
        answers = [answer_by_limits(answer, limits) for answer in answers_by_split[split]]
        typer.echo(f"{rival}: {limits}\n{format_measures(score_names(answers))}")
        if keeping:
            typer.echo(f"wrote:   {keep_answers(answers, folder.name, f'{rival}-{split}')}")
    end_with_verdict("done")


if __name__ == "__main__":
    run_command(main)
