"""Results as the workflow gives them, made by hand from the wet-clutch rig with and without piston seal friction.

Errors, claims and floors are computed from the traces; rivals, confidence and experiment are invented.
"""

from dataclasses import replace

import numpy as np

from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.recalibration import Moved, Recalibration
from clutch_hil.discrepancy.report.wording import compute_excess
from clutch_hil.discrepancy.result import (
    IDENTIFY_FIRST,
    NAMED,
    NONE_OF_THESE,
    NOTHING,
    ONE_OF,
    Claim,
    Estimate,
    Gap,
    Result,
    Rival,
    Trace,
)
from clutch_hil.fitting.model import find_equation
from plant_sim.effects import catalogue

EFFECT = "piston_seal_friction"
FITTED = {f"{EFFECT}.force": 58.0, f"{EFFECT}.pressure_slope": 6.4, f"{EFFECT}.travel": 5.0e-6}
RATE = 1000  # Hz
UNITS = {
    "cylinder_pressure_bar": "bar",
    "clutch_torque_nm": "Nm",
    "motor_torque_nm": "Nm",
    "slip_speed_rad_s": "rad/s",
    "oil_temperature_degc": "degC",
}
FLOORS = {
    "cylinder_pressure_bar": 0.0052,
    "clutch_torque_nm": 0.05,
    "motor_torque_nm": 0.051,
    "slip_speed_rad_s": 0.016,
    "oil_temperature_degc": 0.104,
}
_BLOCKS = dict(zip(UNITS, ("hydraulics", "friction", "drive", "drive", "friction"), strict=True))
OIL = 70.0  # degC, at the start


def make_result(verdict: str, runs: int = 3, seconds: float = 8.0, outputs: int = 3) -> Result:
    """A result with that verdict and so many `outputs`; the last run (of five or more, the last two) was held out."""
    columns = list(UNITS)[:outputs]
    traces = [_keep_outputs(_make_trace(k, runs, seconds, verdict), columns) for k in range(runs)]
    seen = {c for t in traces for c in columns if _compute_rms(t, c, "before") > 1.15 * FLOORS[c]}
    gaps = {column: _compute_gap(traces, column, "all") for column in columns}
    by_regime = {c: {r: _compute_gap(traces, c, r) for r in make_regimes(traces[0].columns)} for c in columns}
    where = [
        Claim(_BLOCKS[c], c, r, compute_excess(g) * g.floor, UNITS[c], compute_excess(g), 0.002)
        for c in columns
        if c in seen
        for r, g in {"all": gaps[c], **by_regime[c]}.items()
        if g.before > 1.2 * g.floor
    ]
    base = Result(
        rig="wet_clutch", verdict=verdict, effects=[], alternatives=[], confidence=0.97, where=where, parameters=[],
        baseline=_BASELINE, gap=gaps, gap_by_regime=by_regime, rivals=[], surrogate=None, experiment=None,
        floors={c: FLOORS[c] for c in columns}, units={c: UNITS[c] for c in columns}, equations={},
        hashes={t.name: f"{k:064x}" for k, t in enumerate(traces)},
        seconds=31.04, held_out="given", notes=["run-2 begins with the clutch filled."], traces=traces,
    )  # fmt: skip
    return _MAKERS[verdict](base)


def make_regimes(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Samples of some regimes of the wet clutch."""
    pressure = columns["cylinder_pressure_bar"]
    rising = np.gradient(np.convolve(pressure, np.ones(41) / 41, "same")) >= 0.0
    closed = pressure > 2.35
    return {
        "direction=apply": closed & rising,
        "direction=release": closed & ~rising,
        "phase=open": ~closed,
        "phase=slip": closed,
    }


def _make_named(base: Result) -> Result:
    rivals = [Rival(EFFECT, 0.987, 41230.0, FITTED, "", 1), *_make_rejected_rivals(0.99)]
    return replace(
        base, effects=[EFFECT], alternatives=[["valve_hysteresis"]], parameters=_PARAMETERS,
        equations={EFFECT: _find_equation(EFFECT)}, rivals=rivals,
    )  # fmt: skip


def _make_nothing(base: Result) -> Result:
    return replace(base, confidence=0.9998, rivals=_make_rejected_rivals(0.04))


def _make_one_of(base: Result) -> Result:
    other = "valve_hysteresis"
    rivals = [
        Rival(EFFECT, 0.93, 10230.0, FITTED, "cannot be told from valve hysteresis by these runs", 1),
        Rival(other, 0.91, 10110.0, {f"{other}.width": 0.071}, "cannot be told from piston seal friction", 1),
        *_make_rejected_rivals(0.8)[1:],
    ]
    experiment = {
        "title": "Hold the pressure and let the slip run through a sine.",
        "why": "Valve hysteresis moves the pressure; a seal moves only the force behind it.",
        "separates": [EFFECT, other],
        "expected_distance": 8.3,
        "probability_to_decide": 0.96,
        "course": {
            "time_s": [0.0, 0.3, 0.5, 2.5, 4.5, 6.5],
            "pressure_bar": [0.0, 2.5, 3.4, 4.2, 2.6, 3.4],
            "speed_rad_s": [20.0, 20.0, 20.0, 20.0, 10.0, 10.0],
        },
    }
    return replace(
        base, alternatives=[[EFFECT, other]], experiment=experiment, rivals=rivals,
        parameters=[*_PARAMETERS, Estimate(f"{other}.width", 0.071, "bar", (0.066, 0.076), 0.0)],
        equations={name: _find_equation(name) for name in (EFFECT, other)},
    )  # fmt: skip


def _make_none(base: Result) -> Result:
    surrogate = {
        "block": "friction",
        "variables": ["cylinder_pressure_bar", "direction of cylinder_pressure_bar"],
        "shape": "a loop: higher while the pressure falls, wider at higher pressure",
        "terms": [
            {"term": "sign(dp/dt)", "coefficient": -0.41, "unit": "Nm"},
            {"term": "p sign(dp/dt)", "coefficient": -0.062, "unit": "Nm/bar"},
        ],
        "closed": 0.71,
    }
    return replace(base, confidence=0.93, surrogate=surrogate, rivals=_make_rejected_rivals(0.38))


def _make_identify_first(base: Result) -> Result:
    moved = (
        Moved("clutch.coulomb_slope", 10.8, 17.02, "Nm/bar", 0.3),
        Moved("clutch.viscous_exponent", 1.0 / 3.0, 0.401, "1", 0.0),
    )
    result = Recalibration(moved, 40.0, 0.02, 1.2, 0.03, "clutch-hil identify RUN... --out FOLDER")
    return replace(base, confidence=0.9, recalibration=result, rivals=_make_rejected_rivals(0.72))


_MAKERS = {
    NAMED: _make_named,
    NOTHING: _make_nothing,
    ONE_OF: _make_one_of,
    NONE_OF_THESE: _make_none,
    IDENTIFY_FIRST: _make_identify_first,
}
_PARAMETERS = [
    Estimate(f"{EFFECT}.force", 58.02, "N", (54.31, 61.73), 0.0),
    Estimate(f"{EFFECT}.pressure_slope", 6.41, "N/bar", (5.88, 6.94), 0.0),
    Estimate(f"{EFFECT}.travel", 5.02e-6, "m", (4.4e-6, 5.64e-6), 5e-6),
]
_BASELINE = [
    Estimate("valve.gain", 2.507, "bar/V", (2.505, 2.509), 2.5, 0.05),
    Estimate("hydraulics.conductance", 1.93e-4, "m^3/(s bar)", (1.85e-4, 2.01e-4), 2.0e-4, 2.0e-5),
    Estimate("piston.contact_pressure", 2.361, "bar", (2.357, 2.365), 2.35, 0.03),
    Estimate("clutch.coulomb_slope", 11.46, "Nm/bar", (11.41, 11.51), 10.8, 0.3),
    Estimate("oil.sump_temperature", 69.2, "degC", (68.1, 70.3), 70.0, 2.0),
]


def _make_rejected_rivals(most: float) -> list[Rival]:
    """Candidates that are not the one, the first of which closes `most` of the gap."""
    names = (
        "valve_hysteresis", "friction_lag", "torque_sensor_gain", "friction_level", "load_dependent_friction",
        "direction_asymmetry", "coulomb_temperature", "clearance_change", "entrapped_air", "valve_delay",
        "shaft_angle_ripple", "drag_torque", "squeeze_film", "pressure_sensor_gain",
    )  # fmt: skip
    result = []
    for k, name in enumerate(names):
        closed = most * 0.72**k - 0.01 if k < 12 else -0.8 / (15 - k)
        reason = (
            f"closes {100 * closed:.0f} % only, and what is left follows the pressure's direction"
            if closed > 0.02
            else "explains nothing more than chance does (p = 0.4)"
        )
        effect = catalogue.find_effect(name)
        units = {f"{name}.{p.name}": p.unit for p in effect.parameters}
        result.append(Rival(name, closed, 41000.0 * closed, effect.list_typical_values(), reason, 1, units))
    return result


def _find_equation(name: str) -> str:
    return find_equation(catalogue.find_effect(name))


def _make_trace(number: int, runs: int, seconds: float, verdict: str) -> Trace:
    n = round(seconds * RATE)
    time = np.arange(n) / RATE
    sweep = np.sin(2.0 * np.pi * (0.25 + 0.1 * number + 0.05 * time) * time)
    inputs = {
        "time_s": time,
        "valve_voltage_v": np.where((time % 8.0) < 7.0, (3.2 + 0.7 * sweep) / 2.5, 0.4),
        "motor_speed_demand_rad_s": 20.0 + 12.0 * np.sin((0.5 + 0.2 * number) * time),
    }
    beginning = {
        "cylinder_pressure_bar": np.zeros(n),
        "oil_temperature_degc": np.full(n, OIL),
        "shaft_angle_rad": np.zeros(n),
    }
    model = WetClutch()
    parameters = {name: p.value for name, p in model.parameters.items()}
    before = dict(model.simulate(inputs | beginning, parameters, {}))
    true = before if verdict == NOTHING else dict(model.simulate(inputs | beginning, parameters, FITTED))
    random = np.random.default_rng(number)
    measured = {column: true[column] + FLOORS[column] * random.standard_normal(n) for column in UNITS}
    columns = inputs | {"shaft_angle_rad": np.cumsum(true["slip_speed_rad_s"]) / RATE} | measured
    held = number >= runs - (2 if runs > 4 else 1)
    after = before if verdict in (NONE_OF_THESE, IDENTIFY_FIRST) else true
    return Trace(f"run-{number}.parquet", held, columns, measured, before, after)


def _keep_outputs(trace: Trace, columns: list[str]) -> Trace:
    """A copy with some outputs only."""
    measured, before, after = ({c: v[c] for c in columns} for v in (trace.measured, trace.before, trace.after))
    return replace(trace, measured=measured, before=before, after=after)


def _compute_rms(trace: Trace, column: str, when: str, inside: np.ndarray | slice = slice(None)) -> float:
    error = (trace.measured[column] - getattr(trace, when)[column])[inside]
    return float(np.sqrt(np.mean(error**2)))


def _compute_gap(traces: list[Trace], column: str, regime: str) -> Gap:
    held = [trace for trace in traces if trace.held_out]
    result = []
    for when in ("before", "after"):
        squares = []
        for trace in held:
            inside = slice(None) if regime == "all" else make_regimes(trace.columns)[regime]
            squares.append(_compute_rms(trace, column, when, inside) ** 2)
        result.append(float(np.sqrt(np.mean(squares))))
    return Gap(*result, FLOORS[column])
