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

    The file has the rig's `figures` of every run. Good when the first of them is a number in every run, or, of a scenario with
    limits, when all of them hold in every run.
    """
    scenario, settings = simulation.scenario, simulation.scenario.settings
    writable(settings.out)
    figures = {figure: scenario.rig.measure(figure) for figure in scenario.rig.figures}
    name, values = parsed_range(vary, scenario.plant) if vary else ("seed", [float("nan")])
    rows, good = [], []
    for i, value in enumerate(values):
        changed = scenario.plant.with_values({name: value}) if vary else scenario.plant
        for k in range(seeds):
            columns = simulation.play(changed, settings.seed + k).columns()
            measured = [figure.of(columns) for figure in figures.values()]
            rows.append((value, settings.seed + k, *measured))
            held = [judgement.holds for judgement in judged(scenario.limits, columns)]
            good.append(all(held) if held else not np.isnan(measured[0]))
            progress(i * seeds + k + 1, len(values) * seeds)
    path = run_path(settings.out, f"{scenario.name}-sweep", ".csv")
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([(name if vary else "-", "seed", *figures), *rows])
    lines = [f"read:  {simulation}, {len(rows)} runs in one process", f"wrote: {path}"]
    table = np.array(rows)
    for value in values:
        of_value = table[np.isnan(table[:, 0]) if np.isnan(value) else table[:, 0] == value]
        label = f"{name} = {value:<10.5g}" if vary else "all seeds"
        spreads = (
            _spread(figure, measure.unit, of_value[:, k]) for k, (figure, measure) in enumerate(figures.items(), 2)
        )
        lines.append(f"{label}  {', '.join(spreads)}")
    missed = f"{good.count(False)} {'broke a limit' if scenario.limits else scenario.rig.missed}"
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


def _spread(name: str, unit: str, values: np.ndarray) -> str:
    """Mean and standard deviation of a measure, for people."""
    known = values[~np.isnan(values)]
    spread = f"{known.mean():.3f} +- {known.std():.3f}" if len(known) else "never"
    said = name.removesuffix(f"_{unit.lower()}").replace("_", " ")
    return f"{said} {spread}{'' if unit == '1' else f' {unit}'}"
