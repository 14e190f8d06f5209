"""Identification of a clutch with its measured slip as input, for rigs whose motor torque or speed demand was not recorded.

Equation        clutch: from valve voltage and slip to pressure, torque and oil temperature (`Rig.clutch_model`)
                motor: int (M_m - M) dt = J d omega + o dt over blocks of time                       docs/rig.md, 8
                  o = o_m - o_M, zeros of both sensors
                half width of J includes the error of a torque that is sampled while the speed controller changes it. For a
                  demand that moves in samples of T at a steady acceleration a, the torque between samples is wrong by up to
                  k_p T a/2, and J by k_p T/2: 4 % with the gains of docs/rig.md (rig 1 of benchmarks/identification.py:
                  3.9 %)
                gains of the motor's speed controller: in the declared ratio to the inertia, so that it is equally fast
Assumptions     clutch torque and motor torque are measured separately; errors of clutch and motor are independent
Not modelled    the motor's speed controller: it cannot be identified without its demand
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.linalg import block_diag
from scipy.ndimage import uniform_filter1d

from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Columns
from clutch_hil.fitting.run_checks import list_findings
from clutch_hil.identify.calibration import Calibration, Identified
from clutch_hil.identify.clutch_effects import (
    DELAY,
    DRAG,
    MOTOR,
    PRESSURE,
    SPEED,
    TORQUE,
    choose_absent,
    declare_effects,
)
from clutch_hil.identify.clutch_parameters import FITTED
from clutch_hil.identify.controller_values import derive_controller_values
from clutch_hil.identify.recorded_runs.logged_rows import RECORDED_SLIP
from clutch_hil.identify.recorded_runs.motor_limit import LIMIT, find_motor_limit
from clutch_hil.identify.recorded_runs.run_evidence import Evidenced
from clutch_hil.identify.recorded_runs.shaft_angle import differentiate_angle
from clutch_hil.identify.recorded_runs.torque_balance import find_other_torque
from clutch_hil.identify.thesis_quantities import Propagation
from protocols.errors import name_run
from protocols.files.parameters import ParameterSet
from protocols.node import load_node

FITTED_BEHIND_SLIP = tuple(name for name in FITTED if not name.startswith("motor."))
EFFECTS_BEHIND_SLIP = (PRESSURE, TORQUE, DELAY, DRAG, SPEED)  # effects that can be identified without the motor
MOTOR_COLUMNS = ("motor_speed_demand_rad_s", "motor_torque_nm")  # columns that may be missing
_INERTIA, _GAINS = "motor.inertia", ("motor.proportional_gain", "motor.integral_gain")
_DEMAND, _TORQUE = MOTOR_COLUMNS
_SLIP, _CLUTCH_TORQUE = "slip_speed_rad_s", "clutch_torque_nm"
_BLOCK = 0.05  # s, length of a block: a step of the motor's speed takes about 0.1 s
_MEAN = 0.02  # s, averaging time of the slip at both ends of a block: a noise of 0.1 rad/s is then 0.6 rad/s^2 at 1 kHz
_LEAST_BLOCKS = 20
_LOOP, _FASTER = 1e-3, 1.5  # s, sample of a speed controller; largest ratio of its speed to the declared one
_KNOWN = 0.2  # largest relative half width of the inertia: with a wider one it is not identified


def drive_by_slip(run: Columns) -> Columns:
    """Return a clutch run whose motor has the slip, differentiated from the angle, as demand, and the clutch torque as
    torque."""
    slip = differentiate_angle(run["time_s"], run["shaft_angle_rad"])
    return {
        **run, _SLIP: slip, _DEMAND: slip, _TORQUE: run[_CLUTCH_TORQUE], RECORDED_SLIP: run[_SLIP],
    }  # fmt: skip


def put_behind_slip(runs: Evidenced) -> Evidenced:
    """Return the runs changed by `drive_by_slip`, with a finding where motor and clutch torque disagree."""
    findings = find_other_torque(runs.measured) if _has_both_torques(runs) else []
    driven = {name: drive_by_slip(run) for name, run in runs.measured.items()}
    return replace(runs, measured=driven, findings=[*runs.findings, *findings])


def _has_both_torques(runs: Evidenced) -> bool:
    """Return whether motor and clutch torque were measured separately in all runs."""
    return all(_TORQUE in run for run in runs.measured.values()) and not runs.find_formula(_CLUTCH_TORQUE, _TORQUE)


def fit_motor(nominal: ParameterSet, runs: Mapping[str, Columns]) -> ParameterSet:
    """Return a clutch's parameters with a motor limit that covers the torques of the runs."""
    return nominal.with_values({LIMIT: find_motor_limit(runs, nominal[LIMIT].value, nominal[LIMIT].bounds[1])[0]})


def describe_missing_motor(runs: Evidenced) -> str:
    """Return a sentence if a run lacks the motor torque or the speed demand, or the demand is computed from the slip; else
    ""."""
    lacking = [
        f"{name_run(name)} lacks {column}"
        for name, run in runs.measured.items()
        for column in MOTOR_COLUMNS
        if column not in run
    ]
    if name := runs.find_formula(_DEMAND, _SLIP):
        lacking.append(f"{_DEMAND} of {name_run(name)} is computed from the slip")
    if not lacking:
        return ""
    return f"{lacking[0]}: the clutch is identified from its measured slip, and the motor's speed controller is not identified"


@dataclass(frozen=True)
class MotorBalance:
    """Inertia [kg m^2] and difference of the sensor zeros o_m - o_M [Nm], with half widths of their 95 % intervals."""

    inertia: float
    inertia_half: float
    zero: float
    zero_half: float


def balance_motor(runs: Sequence[Columns]) -> MotorBalance | None:
    """Return the motor balance over all `runs`; None where they do not determine the inertia."""
    blocks = [_take_blocks(run) for run in runs]
    rate, torque = (np.concatenate([pair[k] for pair in blocks]) for k in (0, 1))
    if len(rate) < _LEAST_BLOCKS:
        return None
    terms = np.column_stack([rate, np.ones(len(rate))])
    normal = terms.T @ terms
    if np.linalg.matrix_rank(normal) < 2:
        return None
    best, *_ = np.linalg.lstsq(terms, torque, rcond=None)
    left = torque - terms @ best
    inverse = np.linalg.inv(normal)
    # White 1980: the residuals are larger where the speed changes
    half = NORMAL_95 * np.sqrt(np.diag(inverse @ (terms.T * left**2) @ terms @ inverse))
    if not half[0] < _KNOWN * best[0]:
        return None
    return MotorBalance(float(best[0]), float(half[0]), float(best[1]), float(half[1]))


def _take_blocks(run: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Return acceleration [rad/s^2] and motor torque minus clutch torque [Nm], block means (n,), both with the same
    smoothing."""
    period = float(run["time_s"][1] - run["time_s"][0])
    mean, block = max(1, round(_MEAN / period)), max(1, round(_BLOCK / period))
    impulse = cumulative_trapezoid(run[_TORQUE] - run[_CLUTCH_TORQUE], dx=period, initial=0.0)
    inside = slice(mean, -mean, block)
    slip, impulse = (np.diff(uniform_filter1d(values, mean)[inside]) for values in (run[_SLIP], impulse))
    return slip / (block * period), impulse / (block * period)


def add_motor(
    calibration: Calibration, known: Propagation, runs: Evidenced, declared: ParameterSet, held: Container[str]
) -> tuple[Calibration, Propagation]:
    """Return calibration and propagation of a clutch behind its slip, with the motor parameters that `runs` determine added.

    declared: parameters of the rig. held: names of the parameters that the user gave.
    """
    values, fixed, warnings = dict(known.values), dict(calibration.fixed), list[str]()
    notes = list(calibration.notes)
    if LIMIT not in held:
        torques = {name: {_TORQUE: run.get(_TORQUE, run[_CLUTCH_TORQUE])} for name, run in runs.measured.items()}
        values[LIMIT], larger = find_motor_limit(torques, declared[LIMIT].value, declared[LIMIT].bounds[1])
        notes += list_findings(larger)
        if larger:
            fixed[LIMIT] = values[LIMIT], f"taken as {values[LIMIT]:.4g} Nm, by the largest torque of the runs"
    balance = balance_motor(list(runs.measured.values())) if _has_both_torques(runs) else None
    identified: list[Identified] = []
    absent = list(calibration.absent)
    if balance and _INERTIA not in held:
        rate = declared[_GAINS[0]].value / declared[_INERTIA].value  # 1/s, of the declared speed controller
        sampled = 0.5 * _FASTER * _LOOP * rate * balance.inertia
        identified.append(
            _identify(declared, _INERTIA, balance.inertia, float(np.hypot(balance.inertia_half, sampled)))
        )
    elif _INERTIA not in held:
        warnings.append(
            f"{_INERTIA} stays as declared, because these runs do not show it; set it with --hold {_INERTIA}=VALUE"
        )
    if balance and MOTOR not in held:
        half = float(np.hypot(balance.zero_half, known.find_half(TORQUE)))
        zero = _identify(ParameterSet(declare_effects()), MOTOR, balance.zero + values[TORQUE], half)
        is_absent = choose_absent([MOTOR], np.array([zero.value]), np.array([half]), np.eye(1))
        (absent if is_absent else identified).append(zero)
    values |= {one.name: one.value for one in identified}
    times = values[_INERTIA] / declared[_INERTIA].value
    for name in _GAINS:
        if name not in held:
            values[name] = times * declared[name].value
            fixed[name] = values[name], "as declared to the inertia: no speed demand was recorded"
    both = replace(
        calibration,
        parameters=[*calibration.parameters, *identified],
        correlation=block_diag(calibration.correlation, np.eye(len(identified))),
        controller=derive_controller_values(
            values, {name: p.value for name, p in declared.items()}, load_node("controller")().parameters
        ),
        fixed=fixed,
        absent=absent,
        warnings=[*warnings, *calibration.warnings],
        notes=notes,
    )
    spread = np.diag([(one.half / NORMAL_95) ** 2 for one in identified])
    names = [*known.names, *(one.name for one in identified)]
    return both, Propagation(values, names, block_diag(known.covariance, spread))


def _identify(declared: ParameterSet, name: str, value: float, half: float) -> Identified:
    """Return an identified parameter with its value clipped to its bounds."""
    one = declared[name]
    return Identified(name, float(np.clip(value, *one.bounds)), half, one.unit, one.value)
