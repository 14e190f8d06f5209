"""The wet-clutch rig for the discrepancy workflow: the plant simulator's own kernel, parameters and effects.

Equation        `plant_sim.rigs.wet_clutch`, from valve voltage and speed demand; blocks driven by measured pressure and slip
Assumptions     a run begins at rest (docs/rig.md), or in operation as in `run_beginning`
Integration     steps of 0.5 ms: compared with 0.025 ms the pressure differs by 0.9 mbar at most, the torque by 3 mNm root
                mean square (tests/clutch_hil/discrepancy/test_wet_clutch_model.py); shorter where an effect is fast
Not modelled    converters' rounding: fits use means over samples
References      docs/rig.md
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from copy import copy
from functools import lru_cache
from math import ceil, pi, sqrt
from typing import Self

import numpy as np
from scipy.ndimage import gaussian_filter1d

from clutch_hil.discrepancy.models.wet_clutch_experiments import WetClutchBench
from clutch_hil.discrepancy.models.wet_clutch_sources import locate
from clutch_hil.discrepancy.models.wet_clutch_starts import check_start, suggest_values
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.model import Candidate, Columns, Evident, Output, RunSource, Values
from clutch_hil.fitting.noise import find_lattice
from clutch_hil.identify.clutch_effects import SENSORS
from clutch_hil.identify.clutch_recalibration import recalibrate_clutch
from clutch_hil.identify.recorded_runs.logged_rows import estimate_timing, find_logged_rows
from clutch_hil.identify.recorded_runs.missing_torque import complete_torques
from clutch_hil.identify.recorded_runs.run_beginning import begin_as_measured, find_initial_state
from clutch_hil.identify.recorded_runs.shaft_angle import complete_angle, integrate_slip, is_integrated
from clutch_hil.identify.recorded_runs.slip_lag import add_slip_lag, advance_slip, delay_slip, describe_slip_lag
from clutch_hil.recordings.checks.knowledge import Limits
from plant_sim.effects.catalogue import load_effects as catalogue
from plant_sim.effects.signals import DRIVE
from plant_sim.effects.table import sum_added_rates
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.wet_clutch_run import ANGLE, CLUTCH_TORQUE, MOTOR_TORQUE, PRESSURE, SLIP, TEMPERATURE, run
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.runs import REQUIRED
from protocols.files.units import BAR

_LIMIT = "motor_torque_limit_nm"  # a column that a run may have
_STEP = 5e-4  # s, see Integration
_FINE = 1e-4  # s, step with springs in the drive, which were dimensioned for it
_RATE = 2.0  # rate of piston and cylinder times step: accurate as well as stable (2.78)
_RIGS = 8  # points that are simulated at the same time, on as many CPUs
SMOOTH = 3e-3  # s, standard deviation of the window that smooths measured pressure and slip before they drive a block
_MOTOR_GAIN = 1.25  # of the motor's limit: largest reading of its channel, for a gain error of a quarter, and noise
_COLDEST = -40.0  # degC of the oil: a climatic chamber
_HEATED = 60.0  # K above the sump: runs heat the oil by 10 K; 55 degC, the coldest of the battery, are 131 degF
_LATE_TEMPERATURE = 60.0  # s: bound of temperature_sensor_lag.time
_CONVERTED = (  # column, group of its sensor, parameter of coarse_quantisation
    ("cylinder_pressure_bar", "pressure", "pressure_bits_lost"),
    ("clutch_torque_nm", "clutch_torque", "torque_bits_lost"),
)
_LOST = 1.0  # bits that a converter must have lost to be called coarse
# s, shortest lag of filtered channels: in 12 s of the profile `lock` the steps of the integration look like a lag of 0.04 ms
_SHORTEST_LAG = 0.2e-3
_TOLD = 0.02  # bits, or steps: accuracy of both from the recorded values
_CHANNELS = ("pressure", "temperature", "motor_torque", "clutch_torque")  # in the order of `run`'s scales
_SHOWN: Mapping[str, tuple[int, Callable[[np.ndarray], np.ndarray]]] = {
    "cylinder_pressure_bar": (PRESSURE, lambda pascal: pascal / BAR),
    "slip_speed_rad_s": (SLIP, lambda speed: speed),
    "oil_temperature_degc": (TEMPERATURE, lambda celsius: celsius),
    "clutch_torque_nm": (CLUTCH_TORQUE, lambda torque: torque),
    "motor_torque_nm": (MOTOR_TORQUE, lambda torque: torque),
}


class WetClutch:
    """The rig of docs/rig.md with the simulator's plug-ins as candidates. `parameters` may be another rig's (`--model`)."""

    name = "wet_clutch"
    run_columns = REQUIRED
    inputs: tuple[str, ...] = ("valve_voltage_v", "motor_speed_demand_rad_s")
    # Resolutions: rounding of docs/rig.md, 9, slip of the encoder over 1 ms. Accuracies, all below the nominal noise of means
    # over 4 ms: pressure and temperature, rounding that no noise averages out; others, three to four times the root mean square
    # difference to a solver with steps of 2 us (engagements, triangles, reversals, multisine)
    outputs: tuple[Output, ...] = (
        Output("cylinder_pressure_bar", "bar", "hydraulics", 0.0014, accuracy=0.0015),
        Output("clutch_torque_nm", "Nm", "friction", 0.0004, accuracy=0.02),
        Output("motor_torque_nm", "Nm", "drive", 0.007, accuracy=0.02),
        Output("slip_speed_rad_s", "rad/s", "drive", 0.0157, accuracy=0.004),
        Output("oil_temperature_degc", "degC", "friction", 0.028, beginning=0.1, accuracy=0.03),
    )
    # Half the stated uncertainty: the battery's rigs deviate by 0.15 of it (standard deviation). With a larger share, more of
    # valve_gain, friction_level, return_spring_change, clearance_change ... counts as calibration.
    calibration = 0.5
    no_hooks: frozenset[int] = frozenset()  # hooks of the simulator at which this model calls no effects
    may_lack: tuple[str, ...] = ("clutch_torque_nm", "motor_torque_nm", "oil_temperature_degc")
    identification = "clutch-hil identify RUN... --out FOLDER"
    # 12 s of six profiles of a sound rig were logged. At 500 Hz six of six lacked nothing, at 200 Hz five, at 100 Hz four, at
    # 50 Hz two, and none got a wrong name; at 20 Hz two of three did
    doubtful_timing, most_timing = 1e-3, 1e-2
    # Eq. 6.9 does not cover plates at rest: they may stick, or the friction follows there with the same lag
    readings: Mapping[str, Values] = {
        "plates at rest carry the applied torque immediately": {"standstill.lag": 0.0},
        "friction of plates at rest builds up by eq. 6.9": {"standstill.lag": 1.0},
    }
    blocks: Mapping[str, tuple[str, ...]] = {
        "hydraulics": ("cylinder_pressure_bar",),
        "friction": ("clutch_torque_nm", "oil_temperature_degc"),
        "drive": ("motor_torque_nm", "slip_speed_rad_s"),
    }

    def __init__(self, parameters: ParameterSet | None = None, step: float = _STEP) -> None:
        """Set up the model; nominal parameters if None. step: longest step of the integration [s]."""
        whole = parameters or wet_clutch.load_nominal()
        self._step = step
        plug_ins = catalogue()
        self._whole = whole
        read = wet_clutch.load_nominal()  # a recording was scaled by the data sheets, whatever the real sensors are
        self._scales = tuple(1.0 / read[f"sensors.{name}_sensitivity"].si for name in _CHANNELS)
        # of the plug-ins' parameters, only sensor offsets with a stated uncertainty, as in a calibration of `identify`
        self.parameters = ParameterSet(
            {
                n: p
                for n, p in whole.items()
                if n.partition(".")[0] not in plug_ins or (n in SENSORS and p.uncertainty > 0.0)
            }
        )
        self.candidates = self._offer_candidates()
        # all runs of a point are simulated in sequence; to build its rig takes a quarter of the time of a simulation
        self._rig = lru_cache(_RIGS)(self._make_rig)

    def _offer_candidates(self) -> tuple[Candidate, ...]:
        """Return the effects of the catalogue that are off, and that this model can simulate."""
        plug_ins = catalogue()
        on = {name for name in plug_ins if any(self._whole[n].value != off for n, off in plug_ins[name].switches)}
        offered = [e for n, e in plug_ins.items() if e.candidate and n not in on and set(e.laws) - self.no_hooks]
        for each in offered:
            check_start(each, [output.column for output in self.outputs])
        return tuple(Candidate.of(each) for each in offered)

    @staticmethod
    def list_nominal_parameters() -> ParameterSet:
        """Return the parameters of docs/rig.md with every effect off."""
        return wet_clutch.load_nominal()

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        """See `Model`."""
        _check_filter(effects)
        return self._simulate(run, parameters, effects, ())

    def simulate_block(self, block: str, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        """See `Blockwise`: hydraulics from the voltage, friction from pressure and slip, drive from speed demand and torque."""
        _check_filter(effects)
        predicted = self._simulate(run, parameters, effects, () if block == "hydraulics" else ("pressure", "slip"))
        return {column: predicted[column] for column in self.blocks[block]}

    def estimate_timing(self, run: Columns) -> float:
        """See `Timed`: the timing uncertainty of a logger's rows."""
        return estimate_timing(run)

    def locate(
        self, number: int, run: Columns, shown: Columns, residuals: Columns, floors: Values, parameters: Values,
        effects: Values,
    ) -> list[RunSource]:  # fmt: skip
        """See `Locating`."""

        def compute_friction(behind: Columns) -> Columns:
            return self.simulate_block("friction", behind, parameters, effects)

        return locate(compute_friction, number, run, shown, residuals, floors, self.parameters, parameters)

    def list_limits(self) -> dict[str, Limits]:
        """See `Ranged`: the larger of converter ends and limits of the rig; for the oil, its possible temperatures."""
        one = {name: p.value for name, p in self._whole.items()}
        ends = {name: one["sensors.input_range"] / one[f"sensors.{name}_sensitivity"] for name in _CHANNELS}
        motor = _MOTOR_GAIN * one["motor.torque_limit"]
        torque = max(motor, ends["clutch_torque"])  # a larger rig has other sensors
        return {
            "valve_voltage_v": Limits(0.0, one["sensors.dac_range"]),
            "cylinder_pressure_bar": Limits(-ends["pressure"], max(ends["pressure"], one["valve.supply_pressure"])),
            "clutch_torque_nm": Limits(-torque, torque),
            "motor_torque_nm": Limits(-motor, motor),
            "slip_speed_rad_s": Limits(
                rest=f"the plates are locked and the motor is at its limit, which {_LIMIT} must state"
            ),
            "oil_temperature_degc": Limits(_COLDEST, one["oil.sump_temperature"] + _HEATED, delay=_LATE_TEMPERATURE),
        }

    def from_others(self, run: Columns) -> dict[str, tuple[str, np.ndarray]]:
        """See `Redundant`: the shaft's angle is the integral of the slip, because the other shaft stands still."""
        return {"shaft_angle_rad": ("slip_speed_rad_s", integrate_slip(run, run["shaft_angle_rad"][0]))}

    def without(self, missing: Collection[str]) -> Self:
        """See `Reducible`. One of both torques must be there: the other one is estimated where a run begins."""
        model = copy(self)
        model.outputs = tuple(output for output in self.outputs if output.column not in missing)
        return model

    def complete_run(self, run: Columns) -> Columns:
        """See `Completing`: the shaft's angle of a rig without an encoder; a missing torque, by the balance of the motor; the
        lag of the slip."""
        return complete_torques(add_slip_lag(complete_angle(run)), self._whole["motor.inertia"].si)

    def describe_completed(self, run: Columns) -> dict[str, str]:
        """See `Completing`."""
        texts = {"slip_speed_rad_s": describe_slip_lag(run)}
        if is_integrated(run):
            texts["shaft_angle_rad"] = "is computed from slip_speed_rad_s, not an independent measurement"
        return {column: text for column, text in texts.items() if text}

    def make_bench(self) -> WetClutchBench:
        """See `experiment_design.Experimenting`."""
        return WetClutchBench(self._whole)

    def recalibrate(self, evidence: Evidence, near: Values) -> dict[str, float]:
        """See `Identifiable`."""
        return recalibrate_clutch(self, evidence, near)

    def suggest_starts(self, candidate: Candidate, run: Columns, residuals: Columns) -> list[dict[str, float]]:
        """See `Hinting`."""
        start = catalogue()[candidate.name].start
        return suggest_values(start, candidate, run, residuals, self.parameters)

    def find_evident_effects(self, runs: Sequence[Columns]) -> dict[str, Evident]:
        """See `Witnessing`: a converter that has lost bits takes few values."""
        name, full = "coarse_quantisation", 2.0 * self._whole["sensors.input_range"].value
        if name not in {c.name for c in self.candidates}:
            return {}
        intervals: dict[str, tuple[float, float, float]] = {}
        rounding, reasons = {}, []
        outputs = {output.column for output in self.outputs}
        for column, group, parameter in (one for one in _CONVERTED if one[0] in outputs):
            volt = self._whole[f"sensors.{group}_sensitivity"].value  # in the unit of the column
            seen = np.array([find_lattice(run[column] * volt) for run in runs])
            levels = 2.0 ** self._whole[f"sensors.{group}_bits"].value
            lost = np.log2(np.maximum(seen[:, 0], 1e-12) * levels / full)
            if lost.min() < _LOST:
                continue
            spread = max(float(np.ptp(lost)), _TOLD)
            intervals[f"{name}.{parameter}"] = float(np.median(lost)), *np.median(lost) + np.array([-spread, spread])
            offset = float(np.median(np.mod(np.round(seen[:, 1], 3), 1.0)))
            intervals[f"{name}.offset"] = offset, offset - _TOLD, offset + _TOLD
            step = float(np.median(seen[:, 0])) / volt
            rounding[column] = step / np.sqrt(12.0)
            reasons.append(f"{column} has only values {step:.3g} apart")
        return {name: Evident(intervals, rounding, ", ".join(reasons))} if reasons else {}

    def _simulate(
        self, columns: Columns, parameters: Values, effects: Values, driven: Sequence[str]
    ) -> dict[str, np.ndarray]:
        rig, rate = self._rig(tuple({**parameters, **effects}.items()))
        period = float(columns["time_s"][1] - columns["time_s"][0])
        limit = _read_limit(columns, float(rig.record["motor_torque_limit"][0]))
        start = find_initial_state(rig, columns, period, float(limit[0]))
        inputs = [columns[name] for name in self.inputs]
        if driven:
            width = SMOOTH / period
            pressure = np.maximum(gaussian_filter1d(columns["cylinder_pressure_bar"], width), 0.0) * BAR
            inputs += [pressure, gaussian_filter1d(advance_slip(columns), width)]
        else:
            inputs += inputs  # not used
        logged, step = find_logged_rows(columns, period), period
        commanded = limit
        if logged:
            step = logged.period
            *inputs, commanded = (logged.refine(values) for values in (*inputs, limit))
        voltage, speed, pressure, slip = (np.ascontiguousarray(values) for values in inputs)
        shown = np.empty((len(voltage), 6))
        run(
            start.y, start.effects, voltage, speed, commanded, rig.record, rig.table.kernel, step,
            count_substeps(rig, rate, step, self._step), bool(driven), pressure, slip, self._scales, shown,
        )  # fmt: skip
        shown[1:, SLIP] = np.diff(shown[:, ANGLE]) / step  # as from an encoder: with the effects on its angle
        if logged:
            slip = logged.take_slip(shown[:, SLIP], 0.5 * step)  # a mean over a step
            shown = logged.take(shown).copy()
            shown[:, SLIP] = slip
        else:
            shown[:, SLIP] = delay_slip(shown[:, SLIP], columns)
        predicted = {column: convert(shown[:, i]) for column, (i, convert) in _SHOWN.items()}
        return begin_as_measured(predicted, columns, period, limit)

    def _make_rig(self, values: tuple[tuple[str, float], ...]) -> tuple[wet_clutch.Rig, float]:
        """Return the rig of a point, and its fastest rate [1/s]."""
        whole = self._whole.with_values(dict(values))
        own = wet_clutch.list_values(whole)
        return wet_clutch.Rig(whole), wet_clutch.fastest_rate(own, sum_added_rates(whole, own))


def _check_filter(effects: Values) -> None:
    """Raise InputError if the channels are filtered so little that the steps of the integration hide it.

    A slow signal is late by inserted sqrt(2)/w, w = 2 pi corner (plant_sim/effects/sensors/anti_alias_filter.py).
    """
    share, corner = (effects.get(f"anti_alias_filter.{name}", 0.0) for name in ("inserted", "corner"))
    if share > 0.0 and share < _SHORTEST_LAG * pi * sqrt(2.0) * corner:
        raise InputError(f"anti_alias_filter with {share:.3g} of a filter of {corner:.3g} Hz is too little to be seen")


def _read_limit(columns: Columns, most: float) -> np.ndarray:
    """Return the motor's torque limit (n,) [Nm]: as commanded, if in the run, else as for a locked clutch; at most `most`."""
    commanded = columns.get(_LIMIT)
    if commanded is None:
        return np.full(len(columns["time_s"]), most)
    return np.fmin(commanded, most)


def count_substeps(rig: wet_clutch.Rig, rate: float, period: float, step: float) -> int:
    """Return the number of integration steps per sample: see Integration."""
    on = (catalogue()[name] for name in rig.table.names)
    if any(DRIVE in effect.laws and effect.states for effect in on):
        step = min(step, _FINE)
    return ceil(max(period / step, period * rate / _RATE) - 1e-9)
