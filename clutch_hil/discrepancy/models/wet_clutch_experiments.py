"""Experiments of the wet-clutch rig: profiles that its bench can play, their predicted inputs, and whether they are safe.

The standard set excites every candidate within two minutes of rig time (checked by test_experiment_design.py). From the
library, the experiment is chosen that separates what the standard set cannot.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from clutch_hil.bench.effect_sheets.excitation import QUANTITIES
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.fitting.model import Columns, Values
from plant_sim.node.plant_node import convert_initial_temperature
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.wet_clutch_regulated import Regulator, regulate_profile
from protocols.errors import InputError, suggest_closest
from protocols.files.parameters import ParameterSet
from protocols.files.units import ZERO_CELSIUS
from protocols.node import load_node

STANDARD: Mapping[str, Experiment] = {
    e.name: e
    for e in (
        Experiment("loads_and_slips", 70.0),
        Experiment("pressure_steps", 80.0),
        Experiment("seal_hysteresis_triangle", 65.0),
        Experiment("reversals", 70.0),
        Experiment("broadband", 60.0),
    )
}
HELD_OUT: Mapping[str, Experiment] = {
    e.name: e for e in (Experiment("hold_and_release", 75.0), Experiment("slip_sine", 68.0))
}
_FURTHER = (
    Experiment("stribeck_staircase", 70.0),
    Experiment("stribeck_staircase", 45.0),
    Experiment("stribeck_staircase", 100.0),
    Experiment("loads_and_slips", 45.0),
    Experiment("loads_and_slips", 100.0),
    Experiment("multisine", 70.0),
    Experiment("crawl", 70.0),
    Experiment("long_hold", 70.0),
    Experiment("long_hold", 45.0),
    Experiment("open_sweep", 70.0),
    Experiment("open_sweep", 45.0),
    Experiment("drift", 70.0),
)
LIBRARY: tuple[Experiment, ...] = (*STANDARD.values(), *HELD_OUT.values(), *_FURTHER)


def find(name: str, sets: Sequence[str] = ()) -> Experiment:
    """Return an experiment by its name, or the first one of a profile. Raises InputError, which also lists names of `sets`."""
    for experiment in LIBRARY:
        if name in (experiment.name, experiment.profile):
            return experiment
    profile, _, temperature = name.rpartition("-")
    known = {e.profile for e in LIBRARY}
    if profile in known and temperature.isdecimal():
        convert_initial_temperature(float(temperature))  # refused before any experiment is played
        return Experiment(profile, float(temperature))
    raise InputError(f"experiment {name!r} is unknown; {suggest_closest(name, [*sorted(known), *sets])}")


FLOORS: Mapping[str, float] = {
    column: resolution for column, (_, _, resolution) in QUANTITIES.items()
}  # noise and rounding
_MARGIN = 0.95  # share of each of the guard's limits and of the motor's torque that a prediction may reach


class WetClutchBench:
    """The bench of a rig with `parameters`, nominal ones if None; see `experiment_design.Bench`.

    controller: changed parameters of its controller, by dotted name.
    """

    def __init__(self, parameters: ParameterSet | None = None, controller: Values | None = None) -> None:
        self._whole = parameters or wet_clutch.load_nominal()
        contact = self._whole["piston.contact_pressure"].value
        self.experiments = tuple(experiment.fit_to_contact(contact) for experiment in LIBRARY)
        self._regulator = Regulator.from_controller(controller)
        guard = load_node("controller")().parameters
        self._pressure, self._slip = (_MARGIN * guard[f"guard.{name}"].si for name in ("pressure", "slip_speed"))
        self._kelvin = _MARGIN * guard["guard.temperature"].value + ZERO_CELSIUS

    def plan_inputs(self, experiment: Experiment, parameters: Values, effects: Values) -> Columns | None:
        """See `Bench`."""
        whole = self._whole.with_values({**parameters, **effects})
        try:
            profile = experiment.load()
        except InputError:  # a clutch with such a high contact pressure that the bench cannot supply its pressures
            return None
        rate = experiment.rate
        substeps = int(np.ceil(1.0 / (rate * wet_clutch.STEP_LIMIT) - 1e-9))
        inputs = regulate_profile(
            wet_clutch.Rig(whole), profile, self._regulator, experiment.temperature, rate, substeps
        )
        safe = (
            inputs.pressure <= self._pressure
            and inputs.temperature <= self._kelvin
            and inputs.slip <= self._slip
            and inputs.torque <= _MARGIN * whole["motor.torque_limit"].si
        )
        n = len(inputs.voltage)
        return {
            "time_s": np.arange(n) / rate,
            "valve_voltage_v": inputs.voltage,
            "motor_speed_demand_rad_s": inputs.speed,
            "cylinder_pressure_bar": np.zeros(n),  # at rest
            "oil_temperature_degc": np.full(n, experiment.temperature),
            "shaft_angle_rad": np.zeros(n),
        } if safe else None  # fmt: skip
