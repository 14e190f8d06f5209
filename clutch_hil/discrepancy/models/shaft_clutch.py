"""A clutch of the power-shift rig as a separate model: from valve voltage and slip to pressure, torque and oil temperature.

Equation        `plant_sim.rigs.shaft_clutch_run`. The measured slip contains the effect of the shafts
Assumptions     as in `wet_clutch`; the error of the measured slip is so small that it changes no torque (docs/identify.md)
Not modelled    sticking plates. So rows with a slip near 0 in contact give no information on the torque, see `find_unseen`
"""

import numpy as np

from clutch_hil.discrepancy.models.wet_clutch import WetClutch, count_substeps
from clutch_hil.fitting.model import Candidate, Columns, Output, Values
from clutch_hil.identify.clutch_effects import SPEED
from clutch_hil.identify.logged_rows import find_logged_rows
from clutch_hil.identify.run_beginning import begin_as_measured, find_initial_state
from plant_sim.rigs.shaft_clutch_run import PRESSURE, TEMPERATURE, TORQUE, run
from protocols.files.units import BAR

_LEAST_SLIP = 0.5  # rad/s: plates with less slip may stick, as in the steps of identification
# s after such a slip: 14 times the lag of friction (docs/rig.md); with a lag a third longer, 3e-5 of the state is left
_UNSEEN = 0.2
_BEFORE = 5e-3  # s before it: the smoothing of the slip also uses later samples


class ShaftClutch(WetClutch):
    """One clutch of a rig with other drives on its shafts. Parameters and effects are those of the wet clutch."""

    inputs = ("valve_voltage_v", "slip_speed_rad_s")
    outputs: tuple[Output, ...] = tuple(o for o in WetClutch.outputs if o.block != "drive")

    def _offer_candidates(self) -> tuple[Candidate, ...]:
        return ()  # it is only identified; no effect is searched for

    def find_unseen(self, columns: Columns) -> dict[str, np.ndarray]:
        """See `Partial`: rows (n,) in which the plates may stick."""
        period = float(columns["time_s"][1] - columns["time_s"][0])
        slow = np.flatnonzero(np.abs(columns["slip_speed_rad_s"]) < _LEAST_SLIP)
        edges = np.zeros(len(columns["time_s"]) + 1)
        np.add.at(edges, np.maximum(slow - round(_BEFORE / period), 0), 1.0)
        np.add.at(edges, np.minimum(slow + round(_UNSEEN / period) + 1, len(edges) - 1), -1.0)
        return {"clutch_torque_nm": np.cumsum(edges[:-1]) > 0.5}

    def _simulate(
        self, columns: Columns, parameters: Values, effects: Values, driven: object = ()
    ) -> dict[str, np.ndarray]:
        values = {**parameters, **effects}
        rig, rate = self._rig(tuple(values.items()))
        period = float(columns["time_s"][1] - columns["time_s"][0])
        voltage, slip = (np.ascontiguousarray(columns[name]) for name in self.inputs)
        slip = slip - values.get(SPEED, 0.0)  # the zero error of its sensor is not slip of the plates
        logged, step = find_logged_rows(columns, period), period
        if logged:
            voltage, slip, step = logged.refine(voltage), logged.refine(slip), logged.period
        shown = np.empty((len(voltage), 3))
        start = find_initial_state(rig, columns, period, 0.0)
        pressure, temperature, _, torque = self._scales
        run(
            start.y, start.effects, voltage, slip, rig.record, rig.table.attachments, step,
            count_substeps(rig, rate, step, self._step), (pressure, temperature, torque), shown,
        )  # fmt: skip
        if logged:
            shown = logged.take(shown)
        predicted = {
            "cylinder_pressure_bar": shown[:, PRESSURE] / BAR,
            "clutch_torque_nm": shown[:, TORQUE],
            "oil_temperature_degc": shown[:, TEMPERATURE],
        }
        return begin_as_measured(predicted, columns, period, np.full(len(shown), np.inf))
