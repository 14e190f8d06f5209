"""Surrogate term: describe a disagreement that no candidate explains by its block, its variables and its shape.

Method          the block with the largest source (sources.py) is taken. Its residual is a sum of terms of the effects
                residual_torque and residual_pressure. Terms are added one by one while they explain more of left-out runs
Equation        R^2 = 1 - (SSE - N)/(SST - N) over left-out runs, each predicted by a fit to the others; N: power of the noise
Assumptions     additive; the pressure term reaches the cylinder through the valve (docs/rig.md, eq. 1)
Not modelled    products of more than two variables, memory beyond 50 ms
References      Efron and Hastie 2016, Computer age statistical inference, ch. 12 (cross-validation)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from scipy.signal import cont2discrete, lfilter, welch

from clutch_hil.discrepancy.sources import (
    FRICTION,
    HYDRAULICS,
    PRESSURE,
    SENSORS,
    TORQUE,
    Source,
    average,
    compute_step,
    count_rows,
    find_sources,
    select_usual,
)
from clutch_hil.fitting.model import Columns, Model, Values
from plant_sim.effects.catalogue import find_effect
from plant_sim.effects.friction import residual_torque as by_friction
from plant_sim.effects.valve import residual_pressure as by_demand
from protocols.errors import join_names
from protocols.files.units import BAR

_LEAST_R2_GAIN = 0.02  # of a further term
_MOST_TERMS = 6  # a description with more terms is not useful
_RIDGE = 1e-6  # of a term's mean square: similar terms then share their coefficient
_SEGMENT = 512  # means, of a spectrum: 2 s at 1 kHz
_LEAST_R2 = 0.3  # with a smaller R^2 the terms describe nothing
_ORDERS = range(1, 61)  # periods per turn that are searched
_TERM_TEXTS = {  # term -> the variables it depends on, and the kind of dependence
    "offset": ((), "a constant offset"), "level": ((), "a constant level"),
    "pressure": (("pressure",), "proportional to pressure"), "pressure2": (("pressure",), "quadratic in pressure"),
    "slip": (("slip",), "proportional to slip speed"), "slip2": (("slip",), "quadratic in slip speed"),
    "pressure_slip": (("pressure", "slip"), "proportional to pressure times slip speed"),
    "temperature": (("temperature",), "proportional to temperature"),
    "pressure_temperature": (("pressure", "temperature"), "proportional to pressure times temperature"),
    "direction": (("direction",), "changing sign with the direction of the pressure"),
    "pressure_direction": (("pressure", "direction"), "changing sign with the direction of the pressure, in proportion to it"),
    "time": (("time",), "growing with time"), "open_slip": (("slip",), "a drag of the open clutch in proportion to slip speed"),
    "cosine": (("angle",), "periodic in the shaft's angle"), "sine": (("angle",), "periodic in the shaft's angle"),
    "lag": (("pressure rate",), "following changes of the demand"),
    "pressure_lag": (("pressure rate",), "following changes of pressure"),
    "slip_lag": (("slip rate",), "following changes of slip speed"),
}  # fmt: skip
_PARTNER = {"cosine": "sine", "sine": "cosine"}
Terms = Mapping[str, np.ndarray]  # (n,) by name


@dataclass(frozen=True)
class Target:
    """The residual to describe: `residual` (n,) and `terms` of each run.

    effect: name of the effect that can carry the terms, "" for none. column: the output. order: periods per turn, None for
    none.
    """

    residual: list[np.ndarray]
    terms: list[Terms]
    effect: str
    column: str
    order: int | None = None


def describe_residual(
    model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values
) -> dict[str, Any]:
    """Describe the residual of `model` at `parameters` with `effects`, as in report.json under "surrogate".

    Keys: block, output, variables, shape, r2 on left-out runs, sentence, and `values`: parameters of the effect that carries
    the terms, {} where no effect can. r2 is not-a-number for a single run, because no run can be left out.
    """
    run_sources = find_sources(model, runs, floors, parameters, effects)
    one = max(run_sources, key=lambda s: float(np.mean(np.concatenate(s.power))) / floors[s.column] ** 2)
    shown = [model.simulate(run, parameters, effects) for run in runs]
    target = _choose_target(model, one, runs, shown, parameters)
    noise = sum(
        floors[target.column] ** 2 / count_rows(run) * len(r) for run, r in zip(runs, target.residual, strict=True)
    )
    names, r2 = _choose_terms(target, noise)
    if not names or not (r2 >= _LEAST_R2 or len(runs) == 1):
        return _make_description(one, [], r2, {}, _describe_unexplained(one, target, r2, runs))
    coefficients = _fit_terms(target, names)
    values = {}
    if target.effect:
        bounds = {p.name: p.bounds for p in find_effect(target.effect).parameters}
        values = {
            f"{target.effect}.{name}": float(np.clip(v, *bounds[name]))
            for name, v in zip(names, coefficients, strict=True)
        }
        if target.order and "cosine" in names:
            values[f"{target.effect}.order"] = float(target.order)
    ranked = [names[i] for i in np.argsort(-_compute_term_sizes(target, names, coefficients))]
    shape = ", ".join(dict.fromkeys(_describe_term(name)[1] for name in ranked))
    if target.order and "cosine" in names:
        shape = shape.replace("the shaft's angle", f"the shaft's angle, {target.order} a turn")
    share = f"this explains {100.0 * r2:.0f} % of the excess over the floor in left-out runs"
    if not np.isfinite(r2):
        share = "there was no second run to check it"
    return _make_description(
        one, ranked, r2, values, f"{_name_place(one)}: the missing part is {shape}; {share}.", shape
    )


def _make_description(
    one: Source, names: Sequence[str], r2: float, values: Mapping[str, float], sentence: str, shape: str = "none found"
) -> dict[str, Any]:
    variables = list(dict.fromkeys(v for name in names for v in _describe_term(name)[0]))
    return {
        "block": one.block, "output": one.column, "variables": variables, "shape": shape,
        "r2": round(float(r2), 4), "sentence": sentence, "values": dict(values),
    }  # fmt: skip


def _describe_term(term: str) -> tuple[tuple[str, ...], str]:
    """Return the variables that a term depends on, and the kind of dependence in words."""
    if term in _TERM_TEXTS:
        return _TERM_TEXTS[term]
    if column := term.removeprefix("direction of ") if term.startswith("direction of ") else "":
        return (column, "direction"), f"changing sign with the direction of {column}"
    column = term.removesuffix("^2")
    return (column,), f"{'proportional to' if column == term else 'quadratic in'} {column}"


def _name_place(one: Source) -> str:
    return f"{one.block.capitalize()}, {one.column}"


def _describe_unexplained(one: Source, target: Target, r2: float, runs: Sequence[Columns]) -> str:
    """Return the sentence for a residual that no term explains: whether it has a dominant frequency."""
    steps = [compute_step(run) for run in runs]
    alike = select_usual(steps, [len(r) for r in target.residual])
    step, left = steps[alike[0]], [target.residual[k] for k in alike]
    segment = min(_SEGMENT, *(len(r) for r in left))
    power = np.mean([welch(r, 1.0 / step, nperseg=segment)[1] for r in left], axis=0)
    hertz = np.arange(len(power)) / (segment * step)
    peak = 2 + int(np.argmax(power[2:])) if len(power) > 3 else 0
    sharp = power[peak] > 10.0 * float(np.median(power[2:])) and peak > 2
    own = f"it oscillates at {hertz[peak]:.1f} Hz" if sharp else "it has no dominant frequency"
    known = f"at most {max(100.0 * r2, 0.0):.0f} %" if np.isfinite(r2) else "little"
    return (
        f"{_name_place(one)}: the missing part is not a simple function of {_list_variables(target)}"
        f" ({known} of the excess explained in left-out runs); {own}."
    )


def _list_variables(target: Target) -> str:
    """Return the variables of the terms, in words."""
    return join_names(list(dict.fromkeys(v for name in target.terms[0] for v in _describe_term(name)[0])))


def _choose_target(
    model: Model, one: Source, runs: Sequence[Columns], shown: Sequence[Columns], parameters: Values
) -> Target:
    clutch = "piston.contact_pressure" in parameters and PRESSURE in shown[0]
    if not clutch:
        return Target(list(one.residual), _make_input_terms(model, runs), "", one.column)
    if one.block == HYDRAULICS:
        residual = [average(run[PRESSURE] - s[PRESSURE], run) for run, s in zip(runs, shown, strict=True)]
        terms = [_make_demand_terms(run, parameters) for run in runs]
        return Target(residual, terms, "residual_pressure", PRESSURE)
    order = _find_order(one, runs)
    terms = [_make_torque_terms(run, s, parameters, order) for run, s in zip(runs, shown, strict=True)]
    residual = list(one.residual)
    if one.block in (FRICTION, SENSORS) and one.column == TORQUE:
        residual = [average(run[TORQUE] - s[TORQUE], run) for run, s in zip(runs, shown, strict=True)]
    effect = "residual_torque" if (one.block, one.column) == (FRICTION, TORQUE) else ""
    return Target(residual, terms, effect, one.column, order)


def _make_torque_terms(run: Columns, shown: Columns, parameters: Values, order: int) -> Terms:
    """Return terms of `residual_torque` by name, as means over 4 ms."""
    period = _compute_period(run)
    bar = shown[PRESSURE]
    slip, angle = run["slip_speed_rad_s"], run["shaft_angle_rad"]
    q = np.clip(
        (bar - by_friction.PRESSURE / BAR) / (by_friction.PRESSURE_SPAN / BAR), -by_friction.MOST, by_friction.MOST
    )
    w = np.minimum(np.abs(slip) / by_friction.SLIP_SPAN, by_friction.MOST)
    t = np.clip((shown["oil_temperature_degc"] - 70.0) / by_friction.KELVIN_SPAN, -by_friction.MOST, by_friction.MOST)
    e = np.clip(
        (bar - _filter_low_pass(bar, by_friction.LAG, period)) / (by_friction.PRESSURE_SPAN / BAR),
        -by_friction.MOST,
        by_friction.MOST,
    )
    v = (slip - _filter_low_pass(slip, by_friction.LAG, period)) / by_friction.SLIP_SPAN
    d = _track_direction(np.ascontiguousarray(bar), by_friction.TURN / BAR)
    contact = (bar >= parameters["piston.contact_pressure"]).astype(float)
    sign = slip / (np.abs(slip) + by_friction.CREEP)
    on = contact * sign
    terms = {
        "offset": np.ones_like(bar), "level": on, "pressure": on * q, "pressure2": on * q**2, "slip": on * w,
        "slip2": on * w**2, "pressure_slip": on * q * w, "temperature": on * t, "pressure_temperature": on * q * t,
        "direction": on * d, "pressure_direction": on * q * d, "time": on * run["time_s"] / by_friction.TIME_SPAN,
        "pressure_lag": on * e, "slip_lag": contact * v, "open_slip": (1.0 - contact) * sign * w,
        "cosine": contact * np.cos(order * angle), "sine": contact * np.sin(order * angle),
    }  # fmt: skip
    return {name: average(values, run) for name, values in terms.items()}


def _make_demand_terms(run: Columns, parameters: Values) -> Terms:
    """Return terms of `residual_pressure` by name, filtered by the valve, as means over 4 ms."""
    period = _compute_period(run)
    u = parameters["valve.gain"] * run["valve_voltage_v"]
    q = np.clip((u - by_demand.PRESSURE / BAR) / (by_demand.PRESSURE_SPAN / BAR), -by_demand.MOST, by_demand.MOST)
    w = np.minimum(np.abs(run["slip_speed_rad_s"]) / by_demand.SLIP_SPAN, by_demand.MOST)
    t = np.clip((run["oil_temperature_degc"] - 70.0) / by_demand.KELVIN_SPAN, -by_demand.MOST, by_demand.MOST)
    e = np.clip(
        (u - _filter_low_pass(u, by_demand.LAG, period)) / (by_demand.PRESSURE_SPAN / BAR),
        -by_demand.FOLLOWED,
        by_demand.FOLLOWED,
    )
    d = _track_direction(u, by_demand.TURN / BAR)
    terms = {
        "level": np.ones_like(u), "pressure": q, "pressure2": q**2, "slip": w, "slip2": w**2, "temperature": t, "direction": d,
        "pressure_direction": q * d, "time": run["time_s"] / by_demand.TIME_SPAN, "lag": e,
    }  # fmt: skip
    speed, damping = parameters["valve.frequency"], parameters["valve.damping"]
    b, a, _ = cont2discrete(([speed**2], [1.0, 2.0 * damping * speed, speed**2]), period, "zoh")
    asked = u > 0.0
    return {name: average(lfilter(np.ravel(b), a, values * asked), run) for name, values in terms.items()}


def _make_input_terms(model: Model, runs: Sequence[Columns]) -> list[Terms]:
    """Return terms of any other model by run: inputs, their squares, signs of their slopes, and time.

    Each is divided by its spread in all runs together, so that one coefficient is the same law in each run.
    """
    longest = max(float(run["time_s"][-1] - run["time_s"][0]) for run in runs)
    terms = [
        {"level": np.ones(len(run["time_s"])), "time": (run["time_s"] - run["time_s"][0]) / longest} for run in runs
    ]
    for name in model.inputs:
        whole = np.concatenate([run[name] for run in runs])
        scaled = [(run[name] - whole.mean()) / max(float(whole.std()), 1e-12) for run in runs]
        rates = [np.gradient(x, _compute_period(run)) for x, run in zip(scaled, runs, strict=True)]
        usual = max(float(np.concatenate(rates).std()), 1e-12)
        for own, x, rate in zip(terms, scaled, rates, strict=True):
            own |= {name: x, f"{name}^2": x**2, f"direction of {name}": np.tanh(rate / usual)}
    return [{name: average(v, run) for name, v in own.items()} for own, run in zip(terms, runs, strict=True)]


def _find_order(one: Source, runs: Sequence[Columns]) -> int:
    """Return the whole number of periods per turn at which the residual has its largest amplitude."""
    angles = [average(run["shaft_angle_rad"], run) for run in runs]
    sizes = [
        abs(sum(np.sum(r * np.exp(-1j * order * a)) for r, a in zip(one.residual, angles, strict=True)))
        for order in _ORDERS
    ]
    return _ORDERS[int(np.argmax(sizes))]


def _choose_terms(target: Target, noise: float) -> tuple[list[str], float]:
    """Return the names of the chosen terms and their R^2 on left-out runs; not-a-number for a single run.

    noise: sum of squares of the noise in all residuals.
    """
    every = list(target.terms[0])
    grams = [_make_normal_equations(terms, r, every) for terms, r in zip(target.terms, target.residual, strict=True)]
    total = sum(float(r @ r) for r in target.residual)
    excess = max(total - noise, 1e-12 * total, 1e-300)
    alone = len(grams) == 1
    chosen: list[str] = []
    best = 0.0
    while len(chosen) < _MOST_TERMS:
        trials: dict[tuple[str, ...], float] = {}
        for name in every:
            if name not in chosen:
                names = [*chosen, name, *([_PARTNER[name]] if name in _PARTNER else [])]
                missed = _compute_error_left_out(grams, [every.index(n) for n in names], alone)
                trials[tuple(names)] = 1.0 - (missed - noise) / excess
        if not trials:
            break
        taken = max(trials, key=lambda n: trials[n])
        if trials[taken] < best + _LEAST_R2_GAIN:
            break
        chosen, best = list(taken), trials[taken]
    return chosen, float("nan") if alone else min(best, 1.0)


def _make_normal_equations(
    terms: Terms, residual: np.ndarray, names: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, float]:
    x = np.column_stack([terms[name] for name in names])
    return x.T @ x, x.T @ residual, float(residual @ residual)


def _compute_error_left_out(
    grams: Sequence[tuple[np.ndarray, np.ndarray, float]], picked: Sequence[int], alone: bool
) -> float:
    """Return the sum of squares left in each run by a fit to the others, or to the run itself for a single run."""
    missed = 0.0
    at = np.ix_(picked, picked)
    for i, (gram, right, square) in enumerate(grams):
        others = grams if alone else [g for j, g in enumerate(grams) if j != i]
        b = _solve_ridge(
            np.sum([g[0][at] for g in others], axis=0), np.sum([g[1][list(picked)] for g in others], axis=0)
        )
        missed += square - 2.0 * float(b @ right[list(picked)]) + float(b @ gram[at] @ b)
    return missed


def _fit_terms(target: Target, names: Sequence[str]) -> np.ndarray:
    normals = [_make_normal_equations(terms, r, names) for terms, r in zip(target.terms, target.residual, strict=True)]
    return _solve_ridge(np.sum([n[0] for n in normals], axis=0), np.sum([n[1] for n in normals], axis=0))


def _solve_ridge(gram: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(gram + np.diag(_RIDGE * np.diag(gram) + 1e-12), right, rcond=1e-12)[0]


def _compute_term_sizes(target: Target, names: Sequence[str], coefficients: np.ndarray) -> np.ndarray:
    """Return the root mean square of each term."""
    spread = [np.std(np.concatenate([terms[name] for terms in target.terms])) for name in names]
    return np.abs(coefficients) * np.array(spread)


@njit(cache=True)
def _track_direction(values, turn):
    """Return the state (n,) of a Maxwell-slip element driven by `values` (n,): +-1 once they have moved by `turn`."""
    filtered = np.empty_like(values)
    now, last = 0.0, 0.0
    for i in range(values.size):
        now = min(max(now + (values[i] - last) / turn, -1.0), 1.0)
        last = values[i]
        filtered[i] = now
    return filtered


def _filter_low_pass(values: np.ndarray, lag: float, period: float) -> np.ndarray:
    decay = np.exp(-period / lag)
    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], values))


def _compute_period(run: Columns) -> float:
    return float(run["time_s"][1] - run["time_s"][0])
