"""Driveline: motor, vehicle and road of the power-shift rig, identified with the measured clutch torques as inputs.

Equation        J_m dw_in/dt = M_m - M_a - M_b;  J_v dw_out/dt = i_a M_a + i_b M_b - T_road           docs/power_shift.md
                start: least squares of J_v dw_out/dt + sign(w_out) R = i_a M_a + i_b M_b over 0.2 s; motor as for one clutch
                fit: `joint_fit.fit_jointly` of both slips and the motor torque
                sticking plates transmit the torque of a step of the speed demand between two samples (driveline_run.py). The
                  transmitted share of a step is fitted too: 1 for plates that hold at once, 0.7 on the rigs of the benchmark,
                  whose friction builds up. With a share of 0 the motor's proportional gain came out 0.05 % low, outside its
                  interval on half of the rigs
                half width: sqrt(h^2 + (1.96 s)^2), s: standard deviation of the parameters when noise of the size of the
                  sensor noise is added to the torques, from 16 draws
Assumptions     the gear ratios i_a and i_b are known from the numbers of teeth. Offsets of the torque sensors are known from
                the fits of the clutches
Not modelled    what `plant_sim.rigs.driveline_run` leaves out
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Candidate, Columns, Model, Output, Values, simulate_seen
from clutch_hil.fitting.noise import estimate_floors, estimate_noise
from clutch_hil.identify.free_parameters import TIMING, free_parameter
from clutch_hil.identify.joint_fit import JointFit, fit_jointly
from clutch_hil.identify.recorded_runs.logged_rows import LoggedRows, estimate_timing, find_logged_rows
from clutch_hil.identify.recorded_runs.motor_limit import LIMIT
from clutch_hil.identify.recorded_runs.run_beginning import (
    AT_DEMAND,
    count_settling_rows,
    find_speed_integral,
    fit_line,
)
from clutch_hil.identify.stepwise import MEAN, estimate_motor, take_samples
from plant_sim.rigs.driveline_run import MOTOR_RECORD, MOTOR_TORQUE, SLIP_A, SLIP_B
from plant_sim.rigs.driveline_run import run as run_driveline
from plant_sim.rigs.power_shift import GRAVITY, make_driveline_record
from protocols.can.two_clutches import CLUTCHES
from protocols.files.parameters import ParameterSet

TORQUES = ("clutch_torque_a_nm", "clutch_torque_b_nm")
FITTED = (
    "motor.inertia", "motor.proportional_gain", "motor.integral_gain", "driveline.vehicle_inertia",
    "driveline.rolling_resistance", "driveline.grade", "driveline.drag_area",
)  # fmt: skip
HELD = {
    "driveline.ratio_a": "the gear ratios are known from the numbers of teeth",
    "driveline.ratio_b": "the gear ratios are known from the numbers of teeth",
    "driveline.wheel_radius": "torques and speeds of shafts do not show a radius; rolling resistance and drag are"
    " relative to it",
}
_SLIPS = ("slip_speed_a_rad_s", "slip_speed_b_rad_s")
# Share of the motor's largest torque, 1 Nm on the shipped rig, as for plates that touch: sticking plates carry more
_CARRIED = 0.025
_STICKING = 0.05  # rad/s, mean over 20 ms: plates with less slip stick; three steps of the encoder's speed in a sample
_PASSED = "sticking.passed"  # share of a step of the motor torque that sticking plates transmit
_HALF = 0.5  # start value and prior deviation of it: the middle of its range 0 to 1
_COARSE, _FINE = 5e-4, 1.25e-4  # s, integration steps: as for a clutch
# Largest rate of a clutch torque, in motor limits per second: 500 Nm/s on the shipped rig, seven deviations of the noise at 1
# kHz. Plates that stop or break away reach thousands of Nm/s
_JUMP = 12.5
_UNSEEN = 0.2  # s after such a jump that are not compared: two time constants of the motor's regulator, k_p/k_i
_DRAWS, _SEED = 16, 31  # number of noise draws, seed of the random numbers
_WINDOW = 10  # means over 20 ms: window for the differentiation of the vehicle speed in the start values
_MOVING = 0.2  # rad/s: above it the vehicle moves; larger than the noise of the encoders
_LEAST_CHANGE = 0.5  # rad/s, least change of the output shaft's speed
_LEAST_TIME = 0.5  # s, least driving time in each direction
_LEAST_DRAG = 0.1  # Nm, least air drag at the highest speed, for the declared drag area


class DrivelineModel:
    """Model of motor, vehicle and road. Inputs: speed demand and clutch torques; outputs: both slips and the motor torque."""

    name = "power_shift"
    inputs: tuple[str, ...] = ("input_speed_demand_rad_s", *TORQUES)
    outputs: tuple[Output, ...] = (  # resolutions as of the wet clutch
        Output("slip_speed_a_rad_s", "rad/s", "drive", 0.0157),
        Output("slip_speed_b_rad_s", "rad/s", "drive", 0.0157),
        Output("motor_torque_nm", "Nm", "drive", 0.007),
    )
    candidates: tuple[Candidate, ...] = ()
    doubtful_timing = most_timing = np.inf  # timing is checked in the fits of the clutches

    def __init__(self, whole: ParameterSet, step: float) -> None:
        """whole: all parameters of the rig. step: largest integration step [s]."""
        self._whole, self._step = whole, step
        self.parameters = ParameterSet(
            {n: p for n, p in whole.items() if n.partition(".")[0] in ("motor", "driveline")}
        )

    def find_unseen(self, columns: Columns) -> dict[str, np.ndarray]:
        """Return by output the rows (n,) that are not compared. See `Partial`.

        These are rows after a jump of a clutch torque, whose course between samples is not recorded, and those at the beginning
        of a run in operation, until the state has settled.
        """
        period = float(columns["time_s"][1] - columns["time_s"][0])
        jumped = np.zeros(len(columns["time_s"]), bool)
        for name in TORQUES:
            jumped[1:] |= np.abs(np.diff(columns[name])) > _JUMP * self._whole[LIMIT].si * period
        after = np.convolve(jumped, np.ones(round(_UNSEEN / period) + 1))[: len(jumped)] > 0.5
        if _begins_in_operation(columns, self._whole):
            after[: count_settling_rows(columns, period)] = True
        return dict.fromkeys((output.column for output in self.outputs), after)

    def estimate_timing(self, run: Columns) -> float:
        """Return the time uncertainty of events between the rows of a logger [s]. See `Timed`."""
        return max(estimate_timing(one) for one in _list_slips(run))

    def simulate(self, columns: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        """See `Model`."""
        whole = self.parameters.with_values({n: parameters[n] for n in self.parameters})
        p = whole.list_si("motor")
        drive = np.array(
            [(p["inertia"], p["proportional_gain"], p["integral_gain"], p["torque_limit"])], dtype=MOTOR_RECORD
        )
        line = make_driveline_record(whole)
        period = float(columns["time_s"][1] - columns["time_s"][0])
        begin = _find_beginning(columns, whole, drive)
        logged, step = _find_logged_rows(columns, period), period
        given = [*(columns[name] for name in self.inputs), *self._find_passed(columns, whole, effects[_PASSED])]
        if logged:
            given, step = [logged.refine(values) for values in given], logged.period
        demand, a, b, passed_a, passed_b = (np.ascontiguousarray(values) for values in given)
        shown = np.empty((len(demand), 3))
        run_driveline(
            a, b, passed_a, passed_b, demand, *begin, drive, line, step, max(1, round(step / self._step)), shown,
        )  # fmt: skip
        if logged:
            slips = [logged.take_slip(shown[:, k], 0.5 * step) for k in (SLIP_A, SLIP_B)]  # means over a step
            shown = logged.take(shown).copy()
            shown[:, SLIP_A], shown[:, SLIP_B] = slips
        names = dict(zip((SLIP_A, SLIP_B, MOTOR_TORQUE), self.outputs, strict=True))
        return {output.column: shown[:, k] for k, output in names.items()}

    def _find_passed(self, columns: Columns, whole: ParameterSet, part: float) -> list[np.ndarray]:
        """Return for each clutch the share (n,) of a motor torque step that it transmits while only its plates stick.

        The share is `part` times the vehicle's share of the inertia, J_v/(J_v + i^2 J_m).
        """
        period = float(columns["time_s"][1] - columns["time_s"][0])
        window = np.ones(max(1, round(MEAN / period)))
        sticking = [
            (np.abs(np.convolve(columns[slip], window / len(window), "same")) < _STICKING)
            & (np.abs(np.convolve(columns[torque], window / len(window), "same")) > _CARRIED * whole[LIMIT].si)
            for slip, torque in zip(_SLIPS, TORQUES, strict=True)
        ]
        vehicle, motor = whole["driveline.vehicle_inertia"].si, whole["motor.inertia"].si
        shares = [vehicle / (vehicle + whole[f"driveline.ratio_{clutch}"].si ** 2 * motor) for clutch in CLUTCHES]
        alone = sticking[0] ^ sticking[1]
        return [part * share * (one & alone) for share, one in zip(shares, sticking, strict=True)]


@dataclass(frozen=True)
class Driveline:
    """Result of the identification of the driveline.

    fitted: names of the fitted parameters. values: all parameters by name. half (p,): half widths of the 95 % intervals.
    correlation: (p, p). silent: a sentence for each parameter that the runs do not excite. simulated: columns by run. left_out:
    number of outliers.
    """

    fitted: Sequence[str]
    values: Mapping[str, float]
    half: np.ndarray
    correlation: np.ndarray
    silent: Mapping[str, str]
    simulated: Mapping[str, Columns]
    left_out: int


def _list_slips(run: Columns) -> list[Columns]:
    """Return time, slip and angle of each clutch with the column names of a wet-clutch run, as far as the run has them."""
    own = {"slip_speed_rad_s": "slip_speed_{}_rad_s", "shaft_angle_rad": "slip_angle_{}_rad"}
    return [
        {"time_s": run["time_s"]} | {n: run[own[n].format(clutch)] for n in own if own[n].format(clutch) in run}
        for clutch in CLUTCHES
    ]


def _find_logged_rows(run: Columns, period: float) -> LoggedRows | None:
    """Return the logger rows of a run, from the first clutch that shows them; None where every cycle was recorded."""
    return next(filter(None, (find_logged_rows(one, period) for one in _list_slips(run))), None)


def _begins_in_operation(run: Columns, p: ParameterSet) -> bool:
    """Return whether the motor carries torque at the beginning of a run, or its speed differs from the demand."""
    period = float(run["time_s"][1] - run["time_s"][0])
    speed, torque = (
        fit_line(values, period)[0] for values in (compute_shaft_speeds(run, p)[0], run["motor_torque_nm"])
    )
    return bool(abs(speed - run["input_speed_demand_rad_s"][0]) > AT_DEMAND or abs(torque) > _CARRIED * p[LIMIT].si)


def _find_beginning(run: Columns, p: ParameterSet, drive: np.ndarray) -> tuple[float, float, float]:
    """Return the initial speeds of input and output shaft [rad/s] and the initial integral of the motor's controller [rad].

    At rest the integral is 0; otherwise it is chosen so that the motor torque is the measured one. drive: (1,) of MOTOR_RECORD.
    """
    speeds = compute_shaft_speeds(run, p)
    if not _begins_in_operation(run, p):
        return float(speeds[0][0]), float(speeds[1][0]), 0.0
    period = float(run["time_s"][1] - run["time_s"][0])
    into, out, torque = (fit_line(values, period)[0] for values in (*speeds, run["motor_torque_nm"]))
    m, error = drive[0], float(run["input_speed_demand_rad_s"][0]) - into
    return into, out, find_speed_integral(torque, error, m["limit"], m["proportional"], m["integral"])


def compute_shaft_speeds(run: Columns, p: ParameterSet) -> tuple[np.ndarray, np.ndarray]:
    """Compute the speeds of input and output shaft [rad/s], (n,) each, from both slips."""
    ratio_a, ratio_b = (p[f"driveline.ratio_{clutch}"].value for clutch in CLUTCHES)
    out = (run["slip_speed_a_rad_s"] - run["slip_speed_b_rad_s"]) / (ratio_b - ratio_a)
    return run["slip_speed_a_rad_s"] + ratio_a * out, out


def identify_driveline(
    runs: Mapping[str, Columns], whole: ParameterSet, given: Values, bounds: Mapping[str, tuple[float, float]],
    progress: Callable[[float], None],
) -> Driveline:  # fmt: skip
    """Identify the driveline from `runs` whose torques are free of offsets.

    whole: parameters of the rig, with held values inserted. given: held values by name. bounds: (low, high) by name.
    """
    columns = list(runs.values())
    coarse, fine = (DrivelineModel(whole, step) for step in (_COARSE, _FINE))
    start, silent = _estimate_start(columns, coarse)
    start |= {n: v for n, v in given.items() if n in start}
    free = [
        free_parameter(whole, name, bounds.get(name)) for name in FITTED if name not in silent and name not in given
    ]
    if not free:
        return Driveline([], start, np.zeros(0), np.zeros((0, 0)), silent, {}, 0)
    start |= {f.name: float(np.clip(start[f.name], f.low, f.high)) for f in free}
    floors = estimate_floors(columns, coarse.outputs)
    free.append(FreeParameter(_PASSED, 0.1, _HALF, 0.0, 1.0, centre=_HALF))
    evidences = [Evidence(model, columns, floors, timing=TIMING) for model in (coarse, fine)]
    joint = fit_jointly(evidences[0], evidences[1], (start, {_PASSED: _HALF}), free, progress)
    half, correlation = (part[..., :-1] for part in _with_input_noise(joint, fine, columns, floors, free))
    values, passed = joint.at.point
    simulated = {name: simulate_seen(coarse, run, values, passed) for name, run in runs.items()}
    return Driveline(
        [f.name for f in free[:-1]], dict(values), half, correlation[:-1], silent, simulated, joint.left_out
    )


def _estimate_start(runs: Sequence[Columns], model: DrivelineModel) -> tuple[dict[str, float], dict[str, str]]:
    """Return start values by name, and a sentence for each parameter that the runs do not excite."""
    p = model.parameters
    values = {name: q.value for name, q in p.items()}
    speeds = [compute_shaft_speeds(run, p) for run in runs]
    shafts = [
        {
            **columns, "slip_speed_rad_s": into, "clutch_torque_nm": np.add(*(columns[name] for name in TORQUES)),
            "motor_speed_demand_rad_s": columns["input_speed_demand_rad_s"],
            **dict.fromkeys(("valve_voltage_v", "cylinder_pressure_bar", "oil_temperature_degc"), np.zeros_like(into)),
        }
        for columns, (into, _) in zip(runs, speeds, strict=True)
    ]  # fmt: skip
    samples = take_samples(shafts)
    values |= estimate_motor(samples, p["motor.torque_limit"].value)
    rows, aims = [], []
    ratios = [p[f"driveline.ratio_{clutch}"].value for clutch in CLUTCHES]
    for columns, (_, out) in zip(runs, speeds, strict=True):
        period = float(columns["time_s"][1] - columns["time_s"][0])
        block = max(1, round(MEAN / period))
        count = len(out) // block
        own = (out, *(columns[name] for name in TORQUES))
        speed, *torque = (values[: count * block].reshape(count, block).mean(axis=1) for values in own)
        force = np.convolve(ratios[0] * torque[0] + ratios[1] * torque[1], np.ones(_WINDOW) / _WINDOW, "valid")
        rate = (speed[_WINDOW - 1 :] - speed[: len(force)]) / ((_WINDOW - 1) * block * period)
        middle = speed[_WINDOW // 2 : _WINDOW // 2 + len(force)]
        moving = np.abs(middle) > _MOVING
        rows.append(np.column_stack([rate, np.sign(middle)])[moving])
        aims.append(force[moving])
    terms, aim = np.concatenate(rows), np.concatenate(aims)
    if len(aim) > _WINDOW:
        (inertia, rolling), *_ = np.linalg.lstsq(terms, aim, rcond=None)
        if inertia > 0.0:
            values["driveline.vehicle_inertia"] = float(inertia)
            weight = inertia * GRAVITY / p["driveline.wheel_radius"].value
            values["driveline.rolling_resistance"] = max(float(rolling / weight), 0.0)
    return values, _list_silent([out for _, out in speeds], runs, samples.slip_rate, p)


def _list_silent(
    speeds: Sequence[np.ndarray], runs: Sequence[Columns], rates: np.ndarray, p: ParameterSet
) -> dict[str, str]:
    """Return a sentence for each parameter that the runs do not excite."""
    periods = [float(run["time_s"][1] - run["time_s"][0]) for run in runs]
    ways = [
        sum(period * np.count_nonzero(sign * out > _MOVING) for out, period in zip(speeds, periods, strict=True))
        for sign in (1.0, -1.0)
    ]
    change = max(float(np.ptp(out)) for out in speeds)
    fastest = max(float(np.max(np.abs(out))) for out in speeds)
    drag = float(make_driveline_record(p)["drag"][0]) * fastest**2
    rate = float(np.quantile(np.abs(rates), 0.99))
    needs = {
        ("motor.inertia", "motor.proportional_gain", "motor.integral_gain"): (rate >= 30.0, (
            f"inertia and drive need an input speed that changes; these runs reach {rate:.2g} rad/s^2, 30 rad/s^2 is needed"
        )),
        ("driveline.vehicle_inertia", "driveline.rolling_resistance"): (change >= _LEAST_CHANGE, (
            f"the vehicle must be driven; the output speed changes by {change:.2g} rad/s, {_LEAST_CHANGE:g} rad/s is needed"
        )),
        ("driveline.grade",): (min(ways) >= _LEAST_TIME, (
            "the grade is separated from rolling resistance by driving in both directions; these runs drive"
            f" {ways[0]:.2g} s forward and {ways[1]:.2g} s backward, {_LEAST_TIME:g} s of each is needed"
        )),
        ("driveline.drag_area",): (drag >= _LEAST_DRAG, (
            f"the air drag needs a high speed; at the highest speed of these runs it is about {drag:.2g} Nm, needed"
            f" is {_LEAST_DRAG:g} Nm"
        )),
    }  # fmt: skip
    return {name: text for names, (met, text) in needs.items() if not met for name in names}


def _with_input_noise(
    joint: JointFit, model: Model, runs: Sequence[Columns], floors: Values, free: Sequence[FreeParameter]
) -> tuple[np.ndarray, np.ndarray]:
    """Return half widths (p,) and correlation (p, p), with the contribution of the noise of the measured torques added."""
    random = np.random.default_rng(_SEED)
    noise = {name: float(np.median([estimate_noise(run[name]) for run in runs])) for name in TORQUES}
    before, moves = joint.at.find_best(joint.at.residual)[0], []
    for _ in range(_DRAWS):
        noisy = [
            {**run, **{n: run[n] + noise[n] * random.standard_normal(len(run[n])) for n in TORQUES}} for run in runs
        ]
        evidence = Evidence(model, noisy, floors, timing=TIMING)
        evidence.weights = joint.evidence.weights
        moves.append(joint.at.find_best(evidence.compute_residuals([joint.at.point])[0])[0] - before)
    scale = np.array([f.scale for f in free])
    added = (np.array(moves).T @ np.array(moves) / _DRAWS) * np.outer(scale, scale) * NORMAL_95**2
    whole = joint.correlation * np.outer(joint.half, joint.half) + added
    half = np.sqrt(np.diag(whole))
    return half, whole / np.outer(half, half)
