"""Sweep: a scenario simulated again and again, with other seeds and along one parameter of the plant."""

import csv
from collections.abc import Callable, Sequence

import numpy as np

from clutch_hil.bench.limits import judged
from clutch_hil.bench.recording import run_path, writable
from clutch_hil.bench.result import Result
from clutch_hil.bench.simulate import Simulation
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.run import whole_file


def sweep(simulation: Simulation, vary: str | None, seeds: int, progress: Callable[[int, int], None]) -> Result:
    """Simulate for every value of `vary` (`NAME=LOW:HIGH:COUNT`, a plant parameter) and `seeds` seeds; write a CSV.

    Good when 90 % of the demand was reached in every run, or, of a scenario with limits, when all of them hold in every run.
    """
    scenario, settings = simulation.scenario, simulation.scenario.settings
    writable(settings.out)
    name, values = parsed_range(vary, scenario.plant) if vary else ("seed", [float("nan")])
    rows, good = [], []
    for i, value in enumerate(values):
        changed = scenario.plant.with_values({name: value}) if vary else scenario.plant
        for k in range(seeds):
            played = simulation.play(changed, settings.seed + k)
            followed = played.following()
            rows.append((value, settings.seed + k, *followed))
            held = [judgement.holds for judgement in judged(scenario.limits, played.columns())]
            good.append(all(held) if held else not np.isnan(followed.regime_error))
            progress(i * seeds + k + 1, len(values) * seeds)
    path = run_path(settings.out, f"{scenario.name}-sweep", ".csv")
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([(name if vary else "-", "seed", "regime_error_nm", "rise_time_s"), *rows])
    lines = [f"read:  {simulation}, {len(rows)} runs in one process", f"wrote: {path}"]
    table = np.array(rows)
    for value in values:
        of_value = table[np.isnan(table[:, 0]) if np.isnan(value) else table[:, 0] == value]
        error, rise = of_value[:, 2], of_value[:, 3]
        label = f"{name} = {value:<10.5g}" if vary else "all seeds"
        lines.append(f"{label}  regime error {_spread(error)} Nm, rise time {_spread(rise)} s")
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
