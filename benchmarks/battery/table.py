"""Table: docs/battery.md with the results beside the goals, and its pictures, from answers of one split."""

import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import date
from importlib.metadata import version
from itertools import pairwise
from math import isnan
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.battery.cases import FAMILIES, NOISES, list_cases
from benchmarks.battery.score import (
    Answer,
    Measure,
    are_aliases,
    compute_wilson_interval,
    find_family,
    find_first_name,
    is_strong,
    list_hidden_names,
    list_reported_names,
    score_answers,
    score_by_noise,
    score_by_severity,
    score_names,
)
from benchmarks.battery.truth_laws import CATALOGUE_LAWS, UNKNOWN_LAWS
from clutch_hil.bench.progress import format_table
from clutch_hil.discrepancy.result import NONE_OF_THESE, NOTHING
from plant_sim.effects.catalogue import load_effects
from plant_sim.effects.effect import Effect
from protocols.errors import join_names
from protocols.files.output_file import whole_file

PICTURES_FOLDER = "battery"  # beside the page

_MOST_WORST = 40  # wrong answers listed on the page, at most; chosen: a list that can be read
_TOP_NAME = "top-1 name"  # measure of score.py
_COMPARED_MEASURES = (
    _TOP_NAME,
    "a name where nothing is hidden",
    "unknown effect: none_of_these",
    "unknown effect: a name",
)
_BINS = np.linspace(0.0, 1.0, 11)  # edges of the bins of confidence; chosen by judgement
_PACKAGES = ("clutch-hil", "numpy", "scipy", "numba")  # packages whose versions are on the page
ROOT = Path(__file__).parents[2]


def format_value(measure: Measure, value: float) -> str:
    """Format a value in the unit of the measure."""
    if isnan(value):
        return "-"
    if measure.unit == "%":
        return f"{100.0 * value:.1f} %"
    return f"{value:.2f}" if measure.unit == "" else f"{value:.0f} {measure.unit}"


def format_goal(measure: Measure) -> str:
    """Describe the goal of a measure; empty without a goal."""
    if measure.goal is None:
        return ""
    if measure.upper is not None:
        return f"{format_value(measure, measure.goal)} to {format_value(measure, measure.upper)}"
    return ("at most " if measure.below else "") + format_value(measure, measure.goal)


def format_row(measure: Measure) -> tuple[str, ...]:
    """Format the cells of a measure: name, value, count, 95 % interval, goal, whether the goal is reached."""
    low, high = measure.interval
    count = str(measure.count) if measure.good is None else f"{measure.good}/{measure.count}"
    interval = "" if isnan(low) else f"{100.0 * low:.1f} to {100.0 * high:.1f} %"
    reached = {True: "yes", False: "no", None: ""}[measure.reached]
    return measure.name, format_value(measure, measure.value), count, interval, format_goal(measure), reached


_HEADER = ("measure", "value", "of", "95 % interval", "goal", "reached")


def format_measures(measures: Sequence[Measure]) -> str:
    """Format measures as a table for a terminal."""
    return format_table([_HEADER, *(format_row(one) for one in measures)])


def write_page(
    answers: Sequence[Answer],
    split: str,
    folder: Path,
    engine: str,
    rivals: Mapping[str, Sequence[Answer]] | None = None,
) -> list[Path]:
    """Write battery.md and its pictures to `folder`; return their paths.

    rivals: answers of other methods to the same cases, by method. Comments on the numbers come from `folder`/battery/notes.md,
    where there is one. Raises InputError.
    """
    pictures = folder / PICTURES_FOLDER
    done = [answer for answer in answers if "error" not in answer]
    paths = [folder / "battery.md", pictures / "confusion.png", pictures / "calibration.png"]
    notes = pictures / "notes.md"
    notes_text = notes.read_text(encoding="utf-8") if notes.exists() else ""
    page = compose_page(answers, split, engine, rivals or {}, notes_text)  # before a picture makes the commit dirty
    for draw, path in ((draw_confusion, paths[1]), (draw_calibration, paths[2])):
        with whole_file(path) as part:
            draw(done, part)
    with whole_file(paths[0]) as part:
        part.write_text(page, encoding="utf-8")
    return paths


def compose_page(
    answers: Sequence[Answer], split: str, engine: str, rivals: Mapping[str, Sequence[Answer]], notes: str = ""
) -> str:
    """Compose the text of battery.md."""
    done = [answer for answer in answers if "error" not in answer]
    parts = [
        "# The battery", "",
        "How often the discrepancy workflow finds the effect that is hidden in a case. The truth of the cases has laws of its",
        "own, most of them unlike the catalogue's, and another solver. `benchmarks/battery/score.py` defines each measure, and",
        "`benchmarks/battery/cases.py` the cases. Words are in the [glossary](glossary.md#the-battery). Written by",
        "`python -m benchmarks.battery --split " + split + " --docs docs`.", "",
        *_list_candidates_without_law(load_effects().values()), *_describe_run(answers, split, engine), "",
        *_format_table(_HEADER, [format_row(measure) for measure in score_answers(answers)]), "",
        *notes.splitlines(), "",
        "## By noise and severity", "", *_tabulate_noise(answers), "",
        *_format_table(("single effects", "top-1", "of", "95 % interval"),
                       [format_row(measure)[:4] for measure in score_by_severity(answers).values()]), "",
        *_compare_rivals(done, rivals),
        "## Which effect is taken for which", "",
        "![confusion matrix](battery/confusion.png)", "",
        *_format_table(("hidden", "named first", "times"), _count_confusions(done)), "",
        "## Whether confidence is the share that is right", "", "![calibration](battery/calibration.png)", "",
        f"## Worst cases (at most {_MOST_WORST})", "",
        *_format_table(("case", "verdict", "named", "confidence", "share explained"), _list_worst(done)), "",
    ]  # fmt: skip
    return "\n".join(parts)


def _list_candidates_without_law(known: Iterable[Effect]) -> list[str]:
    """Compose a paragraph on the candidates that no case can hide; no lines if there are none."""
    laws = {law.name for law in CATALOGUE_LAWS}
    lacking = join_names(effect.name for effect in known if effect.candidate and effect.name not in laws)
    return (
        [f"No case hides these candidates, since the truth has no law for them: {lacking}.", ""]
        if lacking != "-"
        else []
    )


def _describe_run(answers: Sequence[Answer], split: str, engine: str) -> list[str]:
    packages = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    commit = "unknown"  # without git, or outside a repository
    with suppress(FileNotFoundError):
        command = ["git", "describe", "--always", "--dirty"]
        described = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        commit = described.stdout.strip() or commit
    whole = list_cases(split)
    lines = [
        f"Written on {date.today().isoformat()} at commit {commit} from the answers of {engine}, with {packages},",
        f"Python {platform.python_version()}.", "",
    ]  # fmt: skip
    if earlier := sum(answer.get("engine") != engine for answer in answers):
        lines += [f"**{earlier} of these {len(answers)} answers are of an earlier version of the engine.**", ""]
    counts = [
        (name, str(sum(find_family(t) == name for t in answers)), str(sum(c.family == name for c in whole)))
        for name in FAMILIES
    ]
    if len(answers) < len(whole):
        counts_text = "; ".join(f"{ran} of {there} {name}" for name, ran, there in counts)
        lines += [f"**Not the whole split {split}: {len(answers)} of {len(whole)} cases were run** ({counts_text})."]
    else:
        lines += [f"The whole split {split}: {len(answers)} cases."]
    return [*lines, "", *_format_table(("family", "run", "in the split"), counts)]


def _format_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *rows)]


def _tabulate_noise(answers: Sequence[Answer]) -> list[str]:
    columns = score_by_noise(answers)
    names = [one.name for one in score_answers(answers)]
    rows = []
    for i, name in enumerate(names):
        measures = [columns[noise][i] for noise in NOISES]
        cells = [f"{format_row(one)[1]} ({format_row(one)[2]})" if one.count else "-" for one in measures]
        rows.append((name, *cells, format_goal(measures[0])))
    return _format_table(("measure", *(f"noise {100.0 * noise:g} %" for noise in NOISES), "goal"), rows)


def _compare_rivals(done: Sequence[Answer], rivals: Mapping[str, Sequence[Answer]]) -> list[str]:
    """Compare each other method with the workflow on the cases that both answered; lines of the page."""
    workflow_answers = {answer["case"]: answer for answer in done}
    rows = []
    for method, answers in rivals.items():
        both = [answer for answer in answers if answer["case"] in workflow_answers]
        rival = {m.name: m for m in score_names(both)}
        workflow = {m.name: m for m in score_names([workflow_answers[answer["case"]] for answer in both])}
        cells = [
            f"{format_row(rival[m])[1]}, {format_row(workflow[m])[1]} (of {rival[m].count})" for m in _COMPARED_MEASURES
        ]
        above = 100.0 * (workflow[_TOP_NAME].value - rival[_TOP_NAME].value)
        leads = [
            answer["leads"] == list_hidden_names(answer)[0]
            for answer in both
            if find_family(answer) == "single" and is_strong(answer)
        ]
        rows.append((method, *cells, f"{above:+.1f}", f"{100.0 * float(np.mean(leads)):.1f} %" if leads else "-"))
    header = (
        "method, then the workflow",
        *_COMPARED_MEASURES,
        "points above in top-1 (goal 20)",
        "its top-1 without limits",
    )
    return ["## Other methods on the same cases", "", *_format_table(header, rows), ""] if rows else []


def _count_confusions(done: Sequence[Answer]) -> list[tuple[str, ...]]:
    counts: dict[tuple[str, str], int] = {}
    for answer in done:
        if (
            find_family(answer) == "single"
            and is_strong(answer)
            and find_first_name(answer) != list_hidden_names(answer)[0]
        ):
            key = list_hidden_names(answer)[0], find_first_name(answer)
            counts[key] = counts.get(key, 0) + 1
    return [(*key, str(count)) for key, count in sorted(counts.items(), key=lambda one: -one[1])]


def _is_right(answer: Answer) -> bool:
    """Return whether the verdict is right. The confidence of an answer is the probability of this.

    Right is: all hidden effects and no other; for a single effect also a set that contains it; `nothing_missing` where
    nothing is hidden; `none_of_these` where the effect is unknown.
    """
    names = list_hidden_names(answer)
    if not names:
        return bool(answer["verdict"] == NOTHING)
    if find_family(answer) == "unknown":
        return bool(answer["verdict"] == NONE_OF_THESE)
    return set(names) == set(answer["effects"]) or (len(names) == 1 and names[0] in list_reported_names(answer))


def _list_worst(done: Sequence[Answer]) -> list[tuple[str, ...]]:
    wrong = [t for t in done if not _is_right(t)]

    def rank_badness(answer: Answer) -> tuple[bool, bool, float]:
        far = not (
            list_hidden_names(answer)
            and any(are_aliases(find_first_name(answer), n) for n in list_hidden_names(answer))
        )
        return (bool(list_reported_names(answer)), far, answer["confidence"])

    wrong.sort(key=rank_badness, reverse=True)
    return [
        (
            t["case"],
            t["verdict"],
            ", ".join(list_reported_names(t)) or "-",
            f"{t['confidence']:.2f}",
            f"{t['weighed']['closed']:.3f}",
        )
        for t in wrong[:_MOST_WORST]
    ]


def draw_confusion(done: Sequence[Answer], path: Path) -> None:
    """Draw the confusion matrix into `path`: hidden effect (row) against the first name of the answer (column), in % of a row.

    Counted are single effects with a gap of at least 2. Unknown effects and null cases have one row each.
    """
    known = [law.name for law in CATALOGUE_LAWS]
    rows = [*known, "(unknown)", "(nothing)"]
    lawless = sorted(
        {find_first_name(answer) for answer in done} - {*known, NONE_OF_THESE, NOTHING}
    )  # no case hides these
    columns = [*known, *lawless, NONE_OF_THESE, NOTHING]
    strangers = {law.name for law in UNKNOWN_LAWS}
    counts = np.zeros((len(rows), len(columns)))
    for answer in done:
        names = list_hidden_names(answer)
        if find_family(answer) == "null":
            hidden_as = "(nothing)"
        elif len(names) == 1 and find_family(answer) in ("single", "unknown") and is_strong(answer):
            hidden_as = "(unknown)" if names[0] in strangers else names[0]
        else:
            continue
        counts[rows.index(hidden_as), columns.index(find_first_name(answer))] += 1
    total = counts.sum(axis=1, keepdims=True)
    share = np.divide(counts, total, out=np.zeros_like(counts), where=total > 0)
    with mpl.rc_context({"font.size": 7}):
        figure = Figure(figsize=(12.5, 12.0), layout="constrained")
        axes = figure.add_subplot()
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
        for i, j in zip(*np.nonzero(counts), strict=True):
            colour = "white" if share[i, j] > 0.6 else "black"
            axes.text(j, i, f"{100 * share[i, j]:.0f}", ha="center", va="center", fontsize=6, color=colour)
        axes.set_xticks(range(len(columns)), columns, rotation=90)
        axes.set_yticks(range(len(rows)), [f"{r}  ({int(n)})" for r, n in zip(rows, total[:, 0], strict=True)])
        axes.set_xticks(np.arange(len(columns)) - 0.5, minor=True)
        axes.set_yticks(np.arange(len(rows)) - 0.5, minor=True)
        axes.grid(which="minor", color="0.9", linewidth=0.5)
        axes.tick_params(which="minor", length=0)
        axes.axhline(len(known) - 0.5, color="0.3", linewidth=0.8)
        axes.axvline(len(known) - 0.5, color="0.3", linewidth=0.8)
        axes.set_xlabel("named first")
        axes.set_ylabel("hidden (number of cases)")
        axes.set_title("Share of the cases of a row in %")
        figure.savefig(path, dpi=130, format="png")


def draw_calibration(done: Sequence[Answer], path: Path) -> None:
    """Draw the calibration into `path`: confidence against the share of right verdicts, in ten bins, with 95 % intervals."""
    confidence = np.array([answer["confidence"] for answer in done])
    right = np.array([_is_right(answer) for answer in done], bool)
    figure = Figure(figsize=(5.5, 5.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1, label="confidence = share that is right")
    for low, high in pairwise(_BINS.tolist()):
        inside = (confidence >= low) & ((confidence < high) | (high == 1.0))
        if inside.any():
            good, count = int(right[inside].sum()), int(inside.sum())
            x, (below, above) = float(confidence[inside].mean()), compute_wilson_interval(good, count)
            axes.plot([x, x], [below, above], color="C0", linewidth=1)
            axes.plot(x, good / count, "o", color="C0", markersize=4)
            axes.annotate(str(count), (x, good / count), xytext=(4, 4), textcoords="offset points", fontsize=7)
    axes.set(
        xlim=(0, 1), ylim=(0, 1.02), xlabel="confidence of the verdict", ylabel="share that is right", aspect="equal"
    )
    axes.legend(loc="upper left", frameon=False)
    figure.savefig(path, dpi=130, format="png")
