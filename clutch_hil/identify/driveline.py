"""Driveline: motor, vehicle and road of the power-shift rig, identified behind the measured torques of its clutches.

Equation        J_m dw_in/dt = M_m - M_a - M_b;  J_v dw_out/dt = i_a M_a + i_b M_b - T_road           docs/power_shift.md
                start: least squares of J_v dw_out/dt + sign(w_out) R = i_a M_a + i_b M_b over 0.2 s; motor as of one clutch
                fit: `joint_fit.fit_jointly` of both slips and the motor's torque
                plates that stick pass steps of the speed demand between two samples (driveline_run.py). How much of a step
                  is fitted too: all of it by plates that hold at once, 0.7 by the benchmark's rigs, whose friction builds up.
                  With none the motor's proportional gain came out 0.05 % low, outside its interval on half of the rigs
                half width: sqrt(h^2 + (1.96 s)^2), s: standard deviation by which the parameters move where noise of the size
                  of the sensors' is added to the torques, of 16 drawn
Assumptions     the gears are known: i_a and i_b are counted teeth. Offsets of the torque sensors are known from the clutches
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
from clutch_hil.identify.logged_rows import LoggedRows, estimate_timing, find_logged_rows
from clutch_hil.identify.motor_limit import LIMIT
from clutch_hil.identify.run_beginning import AT_DEMAND, count_settling_rows, find_speed_integral, fit_line
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
    "driveline.ratio_a": "the gears are counted teeth",
    "driveline.ratio_b": "the gears are counted teeth",
    "driveline.wheel_radius": "torques and speeds of shafts tell no radius; rolling resistance and drag are relative to it",
}
_SLIPS = ("slip_speed_a_rad_s", "slip_speed_b_rad_s")
# Of the motor's largest torque, 1 Nm of the shipped one, as where plates touch: plates that stick carry it
_CARRIED = 0.025
_STICKING = 0.05  # rad/s in the mean over 20 ms: three steps of the encoder's speed in a sample
_PASSED = "sticking.passed"  # share of a step of the motor's torque that plates that stick pass
_HALF = 0.5  # of it: the middle of what is possible, and its deviation
_COARSE, _FINE = 5e-4, 1.25e-4  # s, steps of integration: as of a clutch
# 1/s of it, 500 Nm/s: seven deviations of the noise at 1 kHz; plates that stop or break away reach thousands
_JUMP = 12.5
_UNSEEN = 0.2  # s after it: two time constants of the motor's regulator, k_p/k_i
_DRAWS, _SEED = 16, 31  # of the noise of the torques
_WINDOW = 10  # means over 20 ms, over which the vehicle's speed is differentiated for a start
_MOVING = 0.2  # rad/s: the vehicle moves, whatever the encoders' noise
_LEAST_CHANGE = 0.5  # rad/s of the output shaft
_LEAST_TIME = 0.5  # s in each direction
_LEAST_DRAG = 0.1  # Nm at the highest speed, with the declared area


class DrivelineModel:
    """Motor, vehicle and road. Its inputs are the clutches' torques; what they do to the shafts is the output."""

    name = "power_shift"
    inputs: tuple[str, ...] = ("input_speed_demand_rad_s", *TORQUES)
    outputs: tuple[Output, ...] = (  # resolutions as of the wet clutch
        Output("slip_speed_a_rad_s", "rad/s", "drive", 0.0157),
        Output("slip_speed_b_rad_s", "rad/s", "drive", 0.0157),
        Output("motor_torque_nm", "Nm", "drive", 0.007),
    )
    candidates: tuple[Candidate, ...] = ()
    doubtful_timing = most_timing = np.inf  # the runs were judged with their clutches

    def __init__(self, whole: ParameterSet, step: float) -> None:
        """whole: all parameters of the rig. step: of the integration [s], at most."""
        self._whole, self._step = whole, step
        self.parameters = ParameterSet(
            {n: p for n, p in whole.items() if n.partition(".")[0] in ("motor", "driveline")}
        )

    def find_unseen(self, columns: Columns) -> dict[str, np.ndarray]:
        """See `Partial`: rows (n,) after a torque that jumped between samples; its course there is not recorded."""
        period = float(columns["time_s"][1] - columns["time_s"][0])
        jumped = np.zeros(len(columns["time_s"]), bool)
        for name in TORQUES:
            jumped[1:] |= np.abs(np.diff(columns[name])) > _JUMP * self._whole[LIMIT].si * period
        after = np.convolve(jumped, np.ones(round(_UNSEEN / period) + 1))[: len(jumped)] > 0.5
        if _begins_in_operation(columns, self._whole):
            after[: count_settling_rows(columns, period)] = True
        return dict.fromkeys((output.column for output in self.outputs), after)

    def estimate_timing(self, run: Columns) -> float:
        """See `Timed`: what a logger's rows leave open."""
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
        """Share (n,) of a step of the motor's torque that each clutch passes: where its plates stick alone, `part` of that of
        the vehicle's inertia."""
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
    """Parameters that were `fitted`, all `values` by name, `half` widths (p,) of 95 % intervals, correlation (p, p); what the
    runs do not excite, a sentence each; columns simulated by run."""

    fitted: Sequence[str]
    values: Mapping[str, float]
    half: np.ndarray
    correlation: np.ndarray
    silent: Mapping[str, str]
    simulated: Mapping[str, Columns]
    left_out: int


def _list_slips(run: Columns) -> list[Columns]:
    """Time, slip and angle of each clutch, under the names of a wet-clutch run, as far as the run has them."""
    own = {"slip_speed_rad_s": "slip_speed_{}_rad_s", "shaft_angle_rad": "slip_angle_{}_rad"}
    return [
        {"time_s": run["time_s"]} | {n: run[own[n].format(clutch)] for n in own if own[n].format(clutch) in run}
        for clutch in CLUTCHES
    ]


def _find_logged_rows(run: Columns, period: float) -> LoggedRows | None:
    """The rows of a run that a logger took, by the clutch that tells; None where they are every cycle."""
    return next(filter(None, (find_logged_rows(one, period) for one in _list_slips(run))), None)


def _begins_in_operation(run: Columns, p: ParameterSet) -> bool:
    """Whether a run begins with a motor that carries torque, or has another speed than is demanded."""
    period = float(run["time_s"][1] - run["time_s"][0])
    speed, torque = (
        fit_line(values, period)[0] for values in (compute_shaft_speeds(run, p)[0], run["motor_torque_nm"])
    )
    return bool(abs(speed - run["input_speed_demand_rad_s"][0]) > AT_DEMAND or abs(torque) > _CARRIED * p[LIMIT].si)


def _find_beginning(run: Columns, p: ParameterSet, drive: np.ndarray) -> tuple[float, float, float]:
    """Speeds of input and output shaft [rad/s], and integral of the motor's controller [rad], in which a run begins: 0 at
    rest, else such that the motor's torque is the measured one. drive: (1,) of MOTOR_RECORD."""
    speeds = compute_shaft_speeds(run, p)
    if not _begins_in_operation(run, p):
        return float(speeds[0][0]), float(speeds[1][0]), 0.0
    period = float(run["time_s"][1] - run["time_s"][0])
    into, out, torque = (fit_line(values, period)[0] for values in (*speeds, run["motor_torque_nm"]))
    m, error = drive[0], float(run["input_speed_demand_rad_s"][0]) - into
    return into, out, find_speed_integral(torque, error, m["limit"], m["proportional"], m["integral"])


def compute_shaft_speeds(run: Columns, p: ParameterSet) -> tuple[np.ndarray, np.ndarray]:
    """Speeds of input and output shaft [rad/s], (n,) each, from both slips."""
    ratio_a, ratio_b = (p[f"driveline.ratio_{clutch}"].value for clutch in CLUTCHES)
    out = (run["slip_speed_a_rad_s"] - run["slip_speed_b_rad_s"]) / (ratio_b - ratio_a)
    return run["slip_speed_a_rad_s"] + ratio_a * out, out


def identify_driveline(
    runs: Mapping[str, Columns], whole: ParameterSet, given: Values, bounds: Mapping[str, tuple[float, float]],
    progress: Callable[[float], None],
) -> Driveline:  # fmt: skip
    """Identify the driveline from `runs`, whose torques have no offset. whole: the rig's parameters, as `given`."""
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
    """Values to begin from, and of parameters that the runs do not excite a sentence."""
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
        block = max(1, round(MEAN / float(columns["time_s"][1] - columns["time_s"][0])))
        count = len(out) // block
        own = (out, *(columns[name] for name in TORQUES))
        speed, *torque = (values[: count * block].reshape(count, block).mean(axis=1) for values in own)
        force = np.convolve(ratios[0] * torque[0] + ratios[1] * torque[1], np.ones(_WINDOW) / _WINDOW, "valid")
        rate = (speed[_WINDOW - 1 :] - speed[: len(force)]) / ((_WINDOW - 1) * MEAN)
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
    """Of parameters that the runs do not excite, a sentence."""
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
            f"inertia and drive need an input speed that changes; these runs reach {rate:.2g} rad/s^2, needed is 30"
        )),
        ("driveline.vehicle_inertia", "driveline.rolling_resistance"): (change >= _LEAST_CHANGE, (
            f"the vehicle needs to be driven; the output shaft changes by {change:.2g} rad/s, needed is {_LEAST_CHANGE:g}"
        )),
        ("driveline.grade",): (min(ways) >= _LEAST_TIME, (
            f"the grade is told from rolling resistance by driving both ways; these runs drive {ways[0]:.2g} s forward and"
            f" {ways[1]:.2g} s backward, needed is {_LEAST_TIME:g} s"
        )),
        ("driveline.drag_area",): (drag >= _LEAST_DRAG, (
            f"the drag of the air needs speed; at the highest one it is about {drag:.2g} Nm, needed is {_LEAST_DRAG:g} Nm"
        )),
    }  # fmt: skip
    return {name: text for names, (met, text) in needs.items() if not met for name in names}


def _with_input_noise(
    joint: JointFit, model: Model, runs: Sequence[Columns], floors: Values, free: Sequence[FreeParameter]
) -> tuple[np.ndarray, np.ndarray]:
    """Half widths (p,) and correlation (p, p) with what the noise of the measured torques adds."""
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
