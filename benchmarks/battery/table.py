"""Table: docs/battery.md with the results beside the goals, and its pictures, from answers of one split."""

import os
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

from benchmarks.battery.cases import FAMILIES, NOISES, cases
from benchmarks.battery.score import (
    Measure,
    Told,
    aliased,
    by_noise,
    by_severity,
    family,
    first,
    hidden,
    naming,
    reported,
    scores,
    strong,
    wilson,
)
from benchmarks.battery.truth_laws import CATALOGUE, UNKNOWN
from clutch_hil.bench.progress import table_text
from clutch_hil.discrepancy.result import NONE_OF_THESE, NOTHING
from plant_sim.effects.catalogue import effects
from plant_sim.effects.effect import Effect
from protocols.errors import listing

_WORST = 40  # cases listed
_TOP = "top-1 name"
_COMPARED = (_TOP, "a name where nothing is hidden", "unknown effect: none_of_these", "unknown effect: a name")
_BINS = np.linspace(0.0, 1.0, 11)  # of confidence
_PACKAGES = ("clutch-hil", "numpy", "scipy", "numba")
ROOT = Path(__file__).parents[2]


def number(measure: Measure, value: float) -> str:
    """A value as the measure shows it."""
    if isnan(value):
        return "-"
    if measure.unit == "%":
        return f"{100.0 * value:.1f} %"
    return f"{value:.2f}" if measure.unit == "" else f"{value:.0f} {measure.unit}"


def goal(measure: Measure) -> str:
    """A goal in words."""
    if measure.goal is None:
        return ""
    if measure.upper is not None:
        return f"{number(measure, measure.goal)} to {number(measure, measure.upper)}"
    return ("at most " if measure.below else "") + number(measure, measure.goal)


def row(measure: Measure) -> tuple[str, ...]:
    """Name, value, of how many, interval, goal, whether reached."""
    low, high = measure.interval
    count = str(measure.count) if measure.good is None else f"{measure.good}/{measure.count}"
    interval = "" if isnan(low) else f"{100.0 * low:.1f} to {100.0 * high:.1f} %"
    reached = {True: "yes", False: "no", None: ""}[measure.reached]
    return measure.name, number(measure, measure.value), count, interval, goal(measure), reached


_HEADER = ("measure", "reached", "of", "95 %", "goal", "holds")


def text(found: Sequence[Measure]) -> str:
    """The measures as a table for a terminal."""
    return table_text([_HEADER, *(row(one) for one in found)])


def write(
    answers: Sequence[Told], split: str, folder: Path, engine: str, rivals: Mapping[str, Sequence[Told]] | None = None
) -> list[Path]:
    """Write battery.md and its pictures to `folder`. `rivals`: answers of other methods to the same cases. Returns paths.

    What a person has to say of the numbers is taken from battery/notes.md there, if there is any.
    """
    pictures = folder / "battery"
    pictures.mkdir(parents=True, exist_ok=True)
    done = [told for told in answers if "error" not in told]
    paths = [folder / "battery.md", pictures / "confusion.png", pictures / "calibration.png"]
    confusion(done, paths[1])
    calibration(done, paths[2])
    notes = pictures / "notes.md"
    said = notes.read_text(encoding="utf-8") if notes.exists() else ""
    paths[0].write_text(page(answers, split, engine, rivals or {}, said), encoding="utf-8")
    return paths


def page(
    answers: Sequence[Told], split: str, engine: str, rivals: Mapping[str, Sequence[Told]], notes: str = ""
) -> str:
    """The text of battery.md."""
    done = [told for told in answers if "error" not in told]
    parts = [
        "# The battery", "",
        "How often the workflow finds what is hidden, on cases whose truth comes from other laws and another solver than the",
        "catalogue's. What each measure is: `benchmarks/battery/score.py`. Cases: `benchmarks/battery/cases.py`.",
        "Again: `python -m benchmarks.battery --split " + split + " --docs docs`.", "", *_without_law(effects().values()),
        *_ran(answers, split, engine), "", *_table(_HEADER, [row(one) for one in scores(answers)]), "",
        *notes.splitlines(), "",
        "## By noise and severity", "", *_by_noise(answers), "", *_table(("single effects", "top-1", "of", "95 %"),
                                                                     [row(m)[:4] for m in by_severity(answers).values()]), "",
        *_rivals(done, rivals),
        "## Who is taken for whom", "",
        "![confusion matrix](battery/confusion.png)", "", *_table(("hidden", "said", "times"), _mixed_up(done)), "",
        "## Whether confidence is what it says", "", "![calibration](battery/calibration.png)", "",
        f"## Worst cases (at most {_WORST})", "",
        *_table(("case", "verdict", "said", "confidence", "share explained"), _worst(done)), "",
    ]  # fmt: skip
    return "\n".join(parts)


def _without_law(known: Iterable[Effect]) -> list[str]:
    """A paragraph that names the candidates which no case can hide; no line where there is none."""
    laws = {law.name for law in CATALOGUE}
    lacking = listing(effect.name for effect in known if effect.candidate and effect.name not in laws)
    return (
        [f"No case hides these candidates, since the truth has no law for them: {lacking}.", ""]
        if lacking != "-"
        else []
    )


def _ran(answers: Sequence[Told], split: str, engine: str) -> list[str]:
    packages = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    commit = "unknown"  # to who has no git, or no repository
    with suppress(FileNotFoundError):
        command = ["git", "describe", "--always", "--dirty"]
        described = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        commit = described.stdout.strip() or commit
    whole = cases(split)
    lines = [
        f"{date.today().isoformat()}; {packages}, Python {platform.python_version()}; commit {commit}, {engine};",
        f"{_processor()}, {os.cpu_count()} cores.", "",
    ]  # fmt: skip
    counts = [
        (name, str(sum(family(t) == name for t in answers)), str(sum(c.family == name for c in whole)))
        for name in FAMILIES
    ]
    if len(answers) < len(whole):
        ones = "; ".join(f"{ran} of {there} {name}" for name, ran, there in counts)
        lines += [f"**Not the whole split {split}: {len(answers)} of {len(whole)} cases were run** ({ones})."]
    else:
        lines += [f"The whole split {split}: {len(answers)} cases."]
    return [*lines, "", *_table(("family", "run", "in the split"), counts)]


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor()


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(line)} |" for line in (header, ["---"] * len(header), *rows)]


def _by_noise(answers: Sequence[Told]) -> list[str]:
    columns = by_noise(answers)
    names = [one.name for one in scores(answers)]
    rows = []
    for i, name in enumerate(names):
        ones = [columns[noise][i] for noise in NOISES]
        cells = [f"{row(one)[1]} ({row(one)[2]})" if one.count else "-" for one in ones]
        rows.append((name, *cells, goal(ones[0])))
    return _table(("measure", *(f"noise {100.0 * noise:g} %" for noise in NOISES), "goal"), rows)


def _rivals(done: Sequence[Told], rivals: Mapping[str, Sequence[Told]]) -> list[str]:
    """Each method beside the workflow on the cases that both answered."""
    ours = {told["case"]: told for told in done}
    rows = []
    for method, answers in rivals.items():
        both = [told for told in answers if told["case"] in ours]
        theirs = {m.name: m for m in naming(both)}
        mine = {m.name: m for m in naming([ours[told["case"]] for told in both])}
        cells = [f"{row(theirs[m])[1]}, {row(mine[m])[1]} (of {theirs[m].count})" for m in _COMPARED]
        above = 100.0 * (mine[_TOP].value - theirs[_TOP].value)
        leads = [told["leads"] == hidden(told)[0] for told in both if family(told) == "single" and strong(told)]
        rows.append((method, *cells, f"{above:+.1f}", f"{100.0 * float(np.mean(leads)):.1f} %" if leads else "-"))
    header = ("method, then the workflow", *_COMPARED, "points above in top-1 (goal 20)", "its top-1 without limits")
    return ["## Other methods on the same cases", "", *_table(header, rows), ""] if rows else []


def _mixed_up(done: Sequence[Told]) -> list[tuple[str, ...]]:
    counts: dict[tuple[str, str], int] = {}
    for told in done:
        if family(told) == "single" and strong(told) and first(told) != hidden(told)[0]:
            key = hidden(told)[0], first(told)
            counts[key] = counts.get(key, 0) + 1
    return [(*key, str(count)) for key, count in sorted(counts.items(), key=lambda one: -one[1])]


def _right(told: Told) -> bool:
    """Whether the verdict is right, which confidence is about: the effects, or a set with the effect, or none of these."""
    names = hidden(told)
    if not names:
        return bool(told["verdict"] == NOTHING)
    if family(told) == "unknown":
        return bool(told["verdict"] == NONE_OF_THESE)
    return set(names) == set(told["effects"]) or (len(names) == 1 and names[0] in reported(told))


def _worst(done: Sequence[Told]) -> list[tuple[str, ...]]:
    wrong = [t for t in done if not _right(t)]

    def badness(told: Told) -> tuple[bool, bool, float]:
        far = not (hidden(told) and any(aliased(first(told), n) for n in hidden(told)))
        return (bool(reported(told)), far, told["confidence"])

    wrong.sort(key=badness, reverse=True)
    return [
        (
            t["case"],
            t["verdict"],
            ", ".join(reported(t)) or "-",
            f"{t['confidence']:.2f}",
            f"{t['weighed']['closed']:.3f}",
        )
        for t in wrong[:_WORST]
    ]


def confusion(done: Sequence[Told], path: Path) -> None:
    """Picture: what was hidden against what was said first, shares of a row; single effects with a gap of 2 at least,
    unknown ones and null cases as rows of their own."""
    known = [law.name for law in CATALOGUE]
    rows = [*known, "(unknown)", "(nothing)"]
    lawless = sorted({first(told) for told in done} - {*known, NONE_OF_THESE, NOTHING})  # candidates that no case hides
    columns = [*known, *lawless, NONE_OF_THESE, NOTHING]
    strangers = {law.name for law in UNKNOWN}
    counts = np.zeros((len(rows), len(columns)))
    for told in done:
        names = hidden(told)
        if family(told) == "null":
            hidden_as = "(nothing)"
        elif len(names) == 1 and family(told) in ("single", "unknown") and strong(told):
            hidden_as = "(unknown)" if names[0] in strangers else names[0]
        else:
            continue
        counts[rows.index(hidden_as), columns.index(first(told))] += 1
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
        axes.set_xlabel("said first")
        axes.set_ylabel("hidden (number of cases)")
        axes.set_title("Share of the cases of a row in %")
        figure.savefig(path, dpi=130)


def calibration(done: Sequence[Told], path: Path) -> None:
    """Picture: confidence of the verdict against how often it was right, in ten bins, with 95 % intervals."""
    confidence = np.array([told["confidence"] for told in done])
    right = np.array([_right(told) for told in done], bool)
    figure = Figure(figsize=(5.5, 5.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1, label="as it says")
    for low, high in pairwise(_BINS.tolist()):
        inside = (confidence >= low) & ((confidence < high) | (high == 1.0))
        if inside.any():
            good, count = int(right[inside].sum()), int(inside.sum())
            x, (below, above) = float(confidence[inside].mean()), wilson(good, count)
            axes.plot([x, x], [below, above], color="C0", linewidth=1)
            axes.plot(x, good / count, "o", color="C0", markersize=4)
            axes.annotate(str(count), (x, good / count), xytext=(4, 4), textcoords="offset points", fontsize=7)
    axes.set(
        xlim=(0, 1), ylim=(0, 1.02), xlabel="confidence of the verdict", ylabel="share that is right", aspect="equal"
    )
    axes.legend(loc="upper left", frameon=False)
    figure.savefig(path, dpi=130)
