"""Study: simulate a scenario for many independent samples of parameters; the result table has a row for each run."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa

from clutch_hil.bench.arguments import take_function, take_iterable, take_list, take_mapping
from clutch_hil.bench.in_memory import compose_scenario, measure_run, simulate
from clutch_hil.bench.scenario import Scenario, check_seed, choose_scenario
from clutch_hil.bench.simulate import Simulation
from clutch_hil.bench.sweeps.executors import compute
from clutch_hil.bench.sweeps.sampling import MOST_SAMPLES, check_count
from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError

_CONTROLLER = "controller."


@dataclass(frozen=True)
class Case:
    """One run: the arguments of `simulate`, and the names of the measures that it returns."""

    arguments: Mapping[str, Any]
    measures: tuple[str, ...]


def sweep(
    samples: Sequence[Mapping[str, float]],
    scenario: str | Path | None = None,
    *,
    seeds: Iterable[int] | None = None,
    measures: Sequence[str] | None = None,
    workers: int | None = None,
    address: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> pa.Table:
    """Simulate `scenario`, or a profile, for every sample and every seed; return a table with one row per run, in that order.

    A sample has values of plant parameters by dotted name, and controller parameters with `controller.` before the name.
    `clutch_hil.grid`, `random` and `latin_hypercube` make samples. `settings` are those of `simulate`. Columns of the table are
    the names in the samples, `seed` and `measures`. `seeds` is the scenario's seed if None. All measures of
    `clutch_hil.measure_run` are allowed; None takes the summary measures of the rig, and the fault. The fields of the table's
    schema have their unit as metadata.

    `workers` processes compute the runs, one per CPU if None, or the Dask cluster at `address`. The table is bit-identical
    wherever the runs are computed. `progress(done, of)` is called after every run. In a script, call this below
    `if __name__ == "__main__":`, because worker processes load the script.

    Raises InputError for a run that is not possible, before any run is computed.
    """
    if "seed" in settings:
        raise InputError(f"seed = {settings['seed']!r} is not an argument of a sweep; use seeds, such as seeds=(1, 2)")
    if progress is not None:
        take_function("progress", progress)
    rows = [take_mapping("a sample", sample) for sample in take_list("samples", samples)]
    if seeds is None:
        seeds = [choose_scenario(None if scenario is None else str(scenario), {}).settings.seed]
    numbers = list(map(check_seed, islice(take_iterable("seeds", seeds), MOST_SAMPLES + 1)))
    if not rows or not numbers:
        raise InputError(f"a sweep was given no {'seeds' if rows else 'samples'}; one or more are needed")
    check_count(len(rows) * len(numbers), "runs")
    names = list(rows[0])
    if odd := next((row for row in rows if row.keys() != rows[0].keys()), None):
        raise InputError(
            f"a sample has {', '.join(odd) or 'no values'}, the first has {', '.join(names)}; all samples need the"
            " same parameters"
        )
    if measures is None:
        measures = (*choose_scenario(None if scenario is None else str(scenario), {}).rig.figures, "fault")
    measures = take_list("measures", measures)
    cases = list(prepare_cases(rows, numbers, scenario, tuple(measures), settings))
    results: list[dict[str, Any]] = [{} for _ in cases]
    for done, (index, result) in enumerate(compute(measure_case, cases, workers, address), 1):
        results[index] = result
        if progress:
            progress(done, len(cases))
    repeated = [(row, seed) for row in rows for seed in numbers]
    columns: dict[str, list[Any]] = {name: [row[name] for row, _ in repeated] for name in names}
    columns |= {"seed": [seed for _, seed in repeated]}
    columns |= {name: [result[name] for result in results] for name in measures}
    units = _list_units(names, measures, compose_scenario(scenario, {"profile": settings.get("profile")}))
    table = pa.table(columns)
    fields = [field.with_metadata({"unit": units.get(field.name, "1")}) for field in table.schema]
    return table.cast(pa.schema(fields))


def _list_units(names: Sequence[str], measures: Sequence[str], scenario: Scenario) -> dict[str, str]:
    """Return the units of parameters in a sample, and of measures, by name."""
    controller = scenario.settings.make_controller(scenario.rig.plant.controllers[CONTROLLERS[0]]).parameters
    units = {name: scenario.rig.measure(name).unit or "1" for name in measures}
    for name in names:
        short = name.removeprefix(_CONTROLLER)
        units[name] = (controller[short] if name.startswith(_CONTROLLER) else scenario.plant[name]).unit
    return units


def measure_case(case: Case) -> dict[str, float | str]:
    """Simulate a case in a worker and compute its measures."""
    values = measure_run(simulate(**case.arguments))
    return {name: values[name] for name in case.measures}


def prepare_cases(
    samples: Sequence[Mapping[str, float]],
    seeds: Sequence[int],
    scenario: str | Path | None,
    measures: tuple[str, ...],
    settings: Mapping[str, Any],
) -> Iterator[Case]:
    """Yield the cases of a sweep; the arguments are those of `sweep`. Raises InputError for a case that is not possible."""
    own = {key: dict(settings.get(key) or {}) for key in ("plant", "controller")}
    others = {key: value for key, value in settings.items() if key not in own}
    run = {key: value for key, value in others.items() if key != "effects"}
    effects = others.get("effects", ())
    others["effects"] = effects if isinstance(effects, (str, Mapping)) else tuple(effects)  # it is read for every case
    for number, sample in enumerate(samples):
        ours = {name.removeprefix(_CONTROLLER): v for name, v in sample.items() if name.startswith(_CONTROLLER)}
        plant = own["plant"] | {name: v for name, v in sample.items() if not name.startswith(_CONTROLLER)}
        controller = own["controller"] | ours
        chosen = compose_scenario(scenario, run, plant, controller, others["effects"])
        if number == 0:
            Simulation(chosen)  # checks rig, profile and rate, which all cases share
            for name in measures:
                chosen.rig.measure(name)
        elif ours:
            chosen.make_controllers(chosen.load_profile())
        for seed in seeds:
            yield Case(
                {**others, "scenario": scenario, "seed": seed, "plant": plant, "controller": controller}, measures
            )
