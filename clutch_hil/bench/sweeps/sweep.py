"""Sweep of `clutch-hil simulate`: a scenario with several seeds, and with several values of one plant parameter."""

import csv
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from clutch_hil.bench.label import Label
from clutch_hil.bench.recording import make_writable, reserve_run_path
from clutch_hil.bench.result import Result
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.sweeps.sampling import MOST_SAMPLES, check_count
from clutch_hil.bench.sweeps.study import sweep
from protocols.errors import InputError
from protocols.files.output_file import whole_file
from protocols.files.parameters import ParameterSet
from protocols.files.units import space_unit

_FOLLOWING = ("regime_error_nm", "rise_time_s")


def sweep_to_csv(
    scenario: Scenario,
    settings: Mapping[str, Any],
    vary: str | None,
    seeds: int,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
    address: str | None = None,
) -> Result:
    """Simulate for every value of `vary` (`NAME=LOW:HIGH:COUNT`, a plant parameter) and `seeds` seeds; write a CSV.

    The file has the rig's `figures` of every run. `scenario` was made with `settings`, fields of RunSettings. `workers`,
    `address` and `progress` are those of `clutch_hil.sweep`. With limits, the result is good if all limits hold in every run;
    without limits, if the first figure is not NaN in any run. Raises InputError.
    """
    make_writable(scenario.settings.out)
    figures = scenario.rig.figures
    name, values = parse_range(vary, scenario.plant) if vary else ("-", [float("nan")])
    check_count(seeds * len(values), "runs")
    table = sweep(
        [{name: value} for value in values] if vary else [{}],
        scenario.path,
        seeds=range(scenario.settings.seed, scenario.settings.seed + seeds),
        measures=tuple(dict.fromkeys((*figures, *(limit.measure for limit in scenario.limits)))),
        workers=workers,
        address=address,
        progress=progress,
        **{key: value for key, value in settings.items() if key not in ("seed", "out")},
    )
    runs = table.to_pylist()
    rows = [(run.get(name, float("nan")), run["seed"], *(run[figure] for figure in figures)) for run in runs]
    path = reserve_run_path(scenario.settings.out, f"{scenario.name}-sweep", ".csv")
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([(name, "seed", *figures), *rows])
    lines = [f"read:  {Label.of(scenario).read(scenario.duration)}, {len(rows)} runs", f"wrote: {path}"]
    for value, of_value in zip(values, np.array(rows).reshape(len(values), seeds, -1), strict=True):
        label = f"{name} = {value:<10.5g}" if vary else "all seeds"
        spreads = (
            _format_spread(figure, scenario.rig.measure(figure).unit, of_value[:, k])
            for k, figure in enumerate(figures, 2)
        )
        lines.append(f"{label}  {', '.join(spreads)}")
    good = [
        all(limit.judge_value(run[limit.measure]).holds for limit in scenario.limits)
        if scenario.limits
        else not np.isnan(run[figures[0]])
        for run in runs
    ]
    missed = f"{good.count(False)} {'broke a limit' if scenario.limits else scenario.rig.missed}"
    verdict = f"{len(rows)} runs, {missed}"
    document = {"sweep": str(path), "runs": [list(map(float, row)) for row in rows], "verdict": verdict}
    return Result(document, "\n".join(lines), verdict, all(good))


def parse_range(text: str, parameters: ParameterSet) -> tuple[str, Sequence[float]]:
    """Parse `NAME=LOW:HIGH:COUNT` into a parameter name and its values. Raises InputError."""
    name, _, span = text.partition("=")
    try:
        low, high, number = span.split(":")
        ends, count = (float(low), float(high)), int(number)
    except ValueError:
        raise InputError(f"range {text!r} is not of the form NAME=LOW:HIGH:COUNT") from None
    if not all(map(isfinite, ends)):
        raise InputError(f"range {text!r} is not possible; LOW and HIGH must be numbers")
    if not 1 <= count <= MOST_SAMPLES:
        raise InputError(f"range {text!r} is not possible; COUNT must be 1 to {MOST_SAMPLES}")
    values = np.linspace(*ends, count).tolist()
    for value in values:
        parameters.with_values({name: value})
    return name, values


def _format_spread(name: str, unit: str, values: np.ndarray) -> str:
    """Return mean and standard deviation of a measure as text; without deviation for a single run."""
    known = values[~np.isnan(values)]
    deviation = f" +- {known.std():.3f}" if len(known) > 1 else ""
    spread = f"{known.mean():.3f}{deviation}" if len(known) else "never"
    words = name.removesuffix(f"_{unit.lower()}").replace("_", " ")
    return f"{words} {spread}{space_unit(unit)}"
