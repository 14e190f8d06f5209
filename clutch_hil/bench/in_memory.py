"""Runs in memory: simulate a scenario or a profile from Python and return its columns as arrays. No file is written."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from clutch_hil.bench.arguments import take_list, take_mapping, take_number, take_path, take_run
from clutch_hil.bench.rig import find_rig_of_run
from clutch_hil.bench.scenario import Scenario, choose_scenario
from clutch_hil.bench.settings import select_settings
from clutch_hil.bench.simulate import Simulation
from plant_sim.node.injection import switch_on
from protocols.errors import InputError
from protocols.files.run import Run

Values = Mapping[str, float]


def simulate(
    scenario: str | Path | None = None,
    *,
    profile: str | Path | None = None,
    seconds: float | None = None,
    rate: int | None = None,
    seed: int | None = None,
    temperature: float | None = None,
    law: str | None = None,
    adaptation: bool | None = None,
    plant_parameters: str | Path | None = None,
    controller_parameters: str | Path | None = None,
    plant: Values | None = None,
    controller: Values | None = None,
    effects: Iterable[str] | Mapping[str, Values] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Simulate plant and controllers of a rig in this process, as `clutch-hil simulate` does.

    `scenario` is the name of a shipped scenario or the path of a TOML file. Without it `profile` is played: a shipped name, the
    path of a CSV file, or `engagement` if it is None. `seconds` [s] repeats or cuts the profile. `rate` is in Hz. `temperature`
    [degC] is the oil temperature at the start. `law` is both, feedforward or feedback. `plant_parameters` and
    `controller_parameters` are TOML files that change parameters, such as a model file of `find_discrepancy`. `plant` and
    `controller` change parameters by dotted name, each in its declared unit. `effects` are switched on, with typical values or
    with values by short name; on a rig with two clutches their names are like `a.friction_level`. An argument that is None
    keeps the value of the scenario. `progress(cycle, cycles)` is called from time to time.

    Return the columns that a run file would have, each of shape (samples,), with units, meanings and metadata.
    Raises InputError.
    """
    settings = select_settings(locals())
    chosen = compose_scenario(scenario, settings, plant, controller, effects)
    played, metadata = Simulation(chosen).play_with_metadata(progress)
    descriptions = played.describe_columns()
    return Run(
        played.make_columns(),
        metadata,
        {column.name: column.unit for column in descriptions},
        {column.name: column.meaning for column in descriptions},
    )


def compose_scenario(
    scenario: str | Path | None,
    settings: Mapping[str, Any],
    plant: Values | None = None,
    controller: Values | None = None,
    effects: Iterable[str] | Mapping[str, Values] = (),
) -> Scenario:
    """Return the scenario that `simulate` plays with these arguments. Raises InputError."""
    given = dict(settings)
    plant, controller = take_mapping("plant", plant), take_mapping("controller", controller)
    for name in ("profile", "plant_parameters", "controller_parameters"):
        if given.get(name) is not None:
            path = take_path(name, given[name])
            given[name] = str(given[name]) if name == "profile" else path
    chosen = choose_scenario(None if scenario is None else str(scenario), given)
    for name, values in take_effects(effects).items():
        clutch, dot, effect = name.rpartition(".")
        on = {f"{clutch}{dot}{parameter}": value for parameter, value in switch_on(effect, values).items()}
        chosen = replace(chosen, plant=chosen.plant.with_values(on))
    if plant:
        chosen = replace(chosen, plant=chosen.plant.with_values(plant))
    if controller:
        changed = replace(chosen.settings, controller={**chosen.settings.controller, **controller})
        chosen = replace(chosen, settings=changed)
    return chosen


def take_effects(effects: Iterable[str] | Mapping[str, Values] | None) -> dict[str, Values]:
    """Return effects by name, with the values given for each. Raises InputError."""
    if isinstance(effects, Mapping):
        return {
            name: {
                short: take_number(f"parameter {name}.{short}", value)
                for short, value in take_mapping(f"effects[{name!r}]", values).items()
            }
            for name, values in effects.items()
        }
    names = take_list("effects", () if effects is None else effects)
    if odd := next((name for name in names if not isinstance(name, str)), None):
        raise InputError(f"effects has {odd!r}; allowed are names of effects")
    return {name: {} for name in names}


def measure_run(run: Run) -> dict[str, float | str]:
    """Compute every measure of a run, by name: a number in its unit, NaN where it cannot be measured, or a word.

    Raises InputError for a run that lacks a column that its rig's measures need.
    """
    run = take_run("run", run)
    rig = find_rig_of_run(run)
    return {name: rig.compute_measure(name, run.columns) for name in rig.measures}
