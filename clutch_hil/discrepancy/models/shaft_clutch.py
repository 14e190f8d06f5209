"""A clutch behind its measured slip: from valve voltage and slip to pressure, torque and oil temperature.

For one clutch of the power-shift rig, and for a rig whose motor has an unknown demand.

Equation        `plant_sim.rigs.shaft_clutch_run`. The measured slip contains the effect of the shafts and of the motor
Assumptions     as in `wet_clutch`. The error of the measured slip changes no torque (docs/identify_method.md)
Not modelled    sticking plates. So rows with a slip near 0 in contact give no information on the torque, see `find_unseen`.
                Effects of drive and motor (hook DRIVE)
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.models.wet_clutch import SMOOTH, WetClutch, count_substeps
from clutch_hil.discrepancy.models.wet_clutch_experiments import WetClutchBench
from clutch_hil.fitting.model import Columns, Output, Values
from clutch_hil.identify.behind_slip import drive_by_slip
from clutch_hil.identify.clutch_effects import SPEED
from clutch_hil.identify.recorded_runs.logged_rows import find_logged_rows
from clutch_hil.identify.recorded_runs.run_beginning import begin_as_measured, find_initial_state
from clutch_hil.identify.stepwise import LEAST_SLIP
from plant_sim.effects.signals import DRIVE
from plant_sim.rigs.shaft_clutch_run import PRESSURE, TEMPERATURE, TORQUE, run
from protocols.files.parameters import ParameterSet
from protocols.files.units import BAR

_SLIP, _TORQUE = "slip_speed_rad_s", "clutch_torque_nm"
CYLINDER_SPEED = "cylinder_speed_rad_s"  # a column that a run may have; without it the cylinder turns with the slip
# s after such a slip: 14 times the lag of friction (docs/rig.md); with a lag a third longer, 3e-5 of the state is left
_UNSEEN = 0.2
_BEFORE = 5e-3  # s before it: the smoothing of the slip also uses later samples


class ShaftClutch(WetClutch):
    """One clutch of a rig with other drives on its shafts. Parameters and effects are those of the wet clutch."""

    inputs = ("valve_voltage_v", _SLIP)
    outputs: tuple[Output, ...] = tuple(o for o in WetClutch.outputs if o.block != "drive")
    no_hooks = frozenset({DRIVE})
    may_lack = ("oil_temperature_degc",)
    blocks: Mapping[str, tuple[str, ...]] = {name: WetClutch.blocks[name] for name in ("hydraulics", "friction")}

    def complete_run(self, run: Columns) -> Columns:
        """See `Completing`: speed demand and motor torque as if the motor followed the measured slip at once."""
        whole = super().complete_run(run)
        return drive_by_slip(whole) if {_SLIP, _TORQUE, "shaft_angle_rad"} <= set(whole) else whole

    def make_bench(self) -> "SlipBench":
        """See `experiment_design.Experimenting`."""
        return SlipBench(self._whole)

    def find_unseen(self, columns: Columns) -> dict[str, np.ndarray]:
        """See `Partial`: rows (n,) in which the plates may stick."""
        period = float(columns["time_s"][1] - columns["time_s"][0])
        slow = np.flatnonzero(np.abs(columns[_SLIP]) < LEAST_SLIP)
        edges = np.zeros(len(columns["time_s"]) + 1)
        np.add.at(edges, np.maximum(slow - round(_BEFORE / period), 0), 1.0)
        np.add.at(edges, np.minimum(slow + round(_UNSEEN / period) + 1, len(edges) - 1), -1.0)
        return {_TORQUE: np.cumsum(edges[:-1]) > 0.5}

    def _simulate(
        self, columns: Columns, parameters: Values, effects: Values, driven: Sequence[str]
    ) -> dict[str, np.ndarray]:
        """Simulate a run. The torque is the measured one in rows that the model does not predict."""
        values = {**parameters, **effects}
        rig, rate = self._rig(tuple(values.items()))
        period = float(columns["time_s"][1] - columns["time_s"][0])
        voltage, slip = (np.ascontiguousarray(columns[name]) for name in self.inputs)
        slip = slip - values.get(SPEED, 0.0)  # the zero error of its sensor is not slip of the plates
        cylinder = np.ascontiguousarray(columns[CYLINDER_SPEED]) if CYLINDER_SPEED in columns else slip
        pressure = voltage  # not used
        if driven:
            pressure = np.maximum(gaussian_filter1d(columns["cylinder_pressure_bar"], SMOOTH / period), 0.0) * BAR
        logged, step = find_logged_rows(columns, period), period
        if logged:
            voltage, slip, cylinder, pressure = (logged.refine(one) for one in (voltage, slip, cylinder, pressure))
            step = logged.period
        shown = np.empty((len(voltage), 3))
        start = find_initial_state(rig, columns, period, 0.0)
        by_pressure, by_temperature, _, by_torque = self._scales
        run(
            start.y, start.effects, voltage, slip, cylinder, rig.record, rig.table.attachments, step,
            count_substeps(rig, rate, step, self._step), bool(driven), pressure, (by_pressure, by_temperature, by_torque),
            shown,
        )  # fmt: skip
        if logged:
            shown = logged.take(shown)
        predicted = {
            "cylinder_pressure_bar": shown[:, PRESSURE] / BAR,
            _TORQUE: shown[:, TORQUE],
            "oil_temperature_degc": shown[:, TEMPERATURE],
        }
        if _TORQUE in columns:
            predicted[_TORQUE] = np.where(self.find_unseen(columns)[_TORQUE], columns[_TORQUE], predicted[_TORQUE])
        return begin_as_measured(predicted, columns, period, np.full(len(shown), np.inf))


class SlipBench(WetClutchBench):
    """The bench of the wet-clutch rig, whose planned inputs have the slip that its motor leads to."""

    def __init__(self, parameters: ParameterSet) -> None:
        super().__init__(parameters)
        self._rig = WetClutch(parameters)

    def plan_inputs(self, experiment: Experiment, parameters: Values, effects: Values) -> Columns | None:
        """See `Bench`."""
        inputs = super().plan_inputs(experiment, parameters, effects)
        return inputs and {**inputs, _SLIP: self._rig.simulate(inputs, parameters, effects)[_SLIP]}
