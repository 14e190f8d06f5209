"""Sweep of the command: a scenario simulated again and again, with other seeds and along one parameter of the plant."""

import csv
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from clutch_hil.bench.label import Label
from clutch_hil.bench.recording import run_path, writable
from clutch_hil.bench.result import Result
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.study import sweep
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.run import whole_file

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

    `scenario` was made with `settings`, fields of RunSettings. `workers`, `address` and `progress` as of `clutch_hil.sweep`.
    Good when 90 % of the demand was reached in every run, or, of a scenario with limits, when all of them hold in every run.
    Raises InputError.
    """
    writable(scenario.settings.out)
    name, values = parsed_range(vary, scenario.plant) if vary else ("-", [float("nan")])
    table = sweep(
        [{name: value} for value in values] if vary else [{}],
        scenario.path,
        seeds=range(scenario.settings.seed, scenario.settings.seed + seeds),
        measures=tuple(dict.fromkeys((*_FOLLOWING, *(limit.measure for limit in scenario.limits)))),
        workers=workers,
        address=address,
        progress=progress,
        **{key: value for key, value in settings.items() if key not in ("seed", "out")},
    )
    runs = table.to_pylist()
    rows = [(run.get(name, float("nan")), run["seed"], *(run[measure] for measure in _FOLLOWING)) for run in runs]
    path = run_path(scenario.settings.out, f"{scenario.name}-sweep", ".csv")
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([(name, "seed", *_FOLLOWING), *rows])
    lines = [f"read:  {Label.of(scenario).read(scenario.duration)}, {len(rows)} runs", f"wrote: {path}"]
    for value, of_value in zip(values, np.array(rows).reshape(len(values), seeds, -1), strict=True):
        error, rise = of_value[:, 2], of_value[:, 3]
        label = f"{name} = {value:<10.5g}" if vary else "all seeds"
        lines.append(f"{label}  regime error {_spread(error)} Nm, rise time {_spread(rise)} s")
    good = [
        all(limit.judge_value(run[limit.measure]).holds for limit in scenario.limits)
        if scenario.limits
        else not np.isnan(run["regime_error_nm"])
        for run in runs
    ]
    missed = f"{good.count(False)} {'broke a limit' if scenario.limits else 'never reached 90 % of the demand'}"
    verdict = f"{len(rows)} runs, {missed}"
    document = {"sweep": str(path), "runs": [list(map(float, row)) for row in rows], "verdict": verdict}
    return Result(document, "\n".join(lines), verdict, all(good))


def parsed_range(text: str, parameters: ParameterSet) -> tuple[str, Sequence[float]]:
    """Parameter name and values of `NAME=LOW:HIGH:COUNT`. Raises InputError."""
    name, _, span = text.partition("=")
    try:
        low, high, count = span.split(":")
        values = np.linspace(float(low), float(high), int(count)).tolist()
    except ValueError:
        raise InputError(f"range {text!r} is not of the form NAME=LOW:HIGH:COUNT") from None
    if not values:
        raise InputError(f"range {text!r} has no values; COUNT must be 1 or more")
    for value in values:
        parameters.with_values({name: value})
    return name, values


def _spread(values: np.ndarray) -> str:
    known = values[~np.isnan(values)]
    return f"{known.mean():.3f} +- {known.std():.3f}" if len(known) else "never"
