"""Identification design: the shortest next experiment for a clutch that is identified in part, by its Fisher information.

Equation        F = F_runs + sum over pieces of J'J,  J: sensitivities of the outputs to the parameters, in block noise
                  F_runs: inverse of the covariance that the calibration states, times w^2
                  w = c sqrt(k/(k - p)): how much wider intervals are than white noise gives, after k seconds for p parameters
                  (joint_fit.py); c as in the runs. Covariance after the experiment: w^2 F^-1
                goal ratio q = half width / goal, from F^-1 (goals.py). Greedy: the piece that lowers sum log max(q/0.8, 1)
                  most per second is added, until every q <= 0.8
Assumptions     linear about the identified values; white noise; inputs as a controller with the calibration makes them
                a piece tells as much wherever it stands in the experiment: each begins and ends with an open clutch
Not modelled    what the pieces tell of parameters that the user holds
References      Atkinson and Donev 1992, Optimum Experimental Designs, ch. 9 to 12; Pintelon and Schoukens 2012, ch. 5
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from clutch_hil.bench.rig import find_rig
from clutch_hil.discrepancy.identification_set import CourseExperiment
from clutch_hil.discrepancy.models.wet_clutch_experiments import WetClutchBench
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import linearise
from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Values
from clutch_hil.identify.clutch_parameters import FITTED
from clutch_hil.identify.course_pieces import PIECES, compose
from clutch_hil.identify.courses import TORQUE_SHARE, Span, profile_text
from clutch_hil.identify.goals import GOALS, Goal, Standing, stand_at
from clutch_hil.identify.identification import TIMING, Identification, free_parameters

MARGIN = 0.8  # of a goal that a design must predict: intervals come out up to a fifth wider than white noise predicts
_MOST_PIECES = 8  # half a minute: what is linear about the present values is not trusted further; then identify again
_UNKNOWN = 1.0  # standard deviation over value of a parameter that no run has shown
_LEAST_GAIN = 1e-3  # of the sum of log q: a piece that gains less is none
_REFERENCE_SLIP = 20.94  # rad/s: 200 rpm, where the torque limits the pressure


@dataclass(frozen=True)
class Design:
    """The pieces of the next experiment, its `seconds`, its profile, and how goals stand now and would stand after it."""

    pieces: Sequence[str]
    seconds: float
    profile: str
    before: Sequence[Standing]
    after: Sequence[Standing]

    @property
    def reaches(self) -> bool:
        """Whether every goal is reached after it, as far as predicted."""
        return all(one.is_reached for one in self.after)


def design_experiment(
    found: Identification, goals: Sequence[Goal] = GOALS, progress: Callable[[float], None] = lambda share: None
) -> Design:
    """The shortest next experiment for what is identified so far, with the calibration in the controller."""
    calibration = found.calibration
    model = find_rig(calibration.rig).model()
    bench = WetClutchBench(controller={name: value for name, (value, _) in calibration.controller.items()})
    known = [p.name for p in calibration.parameters]
    by_user = {name for name, why in calibration.held.items() if "runs" not in why}
    names = [*known, *(name for name in FITTED if name not in known and name not in by_user)]
    values = {n: p.value for n, p in model.parameters.items()} | {p.name: p.value for p in calibration.parameters}
    gathered = _information_of_runs(found, names, values)
    span = _span(values, model.parameters["motor.torque_limit"].value)
    floors = _floors(found)
    wider = _widening(found, names, values, floors)
    told: dict[str, tuple[np.ndarray, float]] = {}
    for k, piece in enumerate(PIECES):
        if (one := _information_of_piece(piece, span, found, names, values, floors, bench)) is not None:
            told[piece] = one
        progress((k + 1) / len(PIECES))
    gathered = gathered * wider.after(0.0) ** 2  # of white noise, as that of the pieces
    before, spent = _stand(gathered, names, values, goals, wider.after(0.0)), 0.0
    now, chosen = _lack(before), list[str]()
    while len(chosen) < _MOST_PIECES and now > 0.0:
        lacks = {
            piece: _lack(_stand(gathered + information, names, values, goals, wider.after(spent + seconds)))
            for piece, (information, seconds) in told.items()
        }
        best = max(told, key=lambda piece: (now - lacks[piece]) / told[piece][1], default="")
        if not best or now - lacks[best] < _LEAST_GAIN:
            break
        chosen.append(best)
        gathered, spent, now = gathered + told[best][0], spent + told[best][1], lacks[best]
    after = _stand(gathered, names, values, goals, wider.after(spent))
    course = compose(chosen, span)
    seconds = float(course.rows[-1][0])
    text = profile_text(course, f"Next experiment of clutch-hil identify --design: {', '.join(chosen) or 'nothing'}")
    return Design(chosen, seconds, text, before, after)


def _span(values: Values, torque_limit: float) -> Span:
    """Pressures that the identified clutch may be given."""
    slope = values["clutch.coulomb_slope"]
    slope += values["clutch.viscous_slope"] * _REFERENCE_SLIP ** values["clutch.viscous_exponent"]
    return Span.of_line(slope, values["piston.contact_pressure"], TORQUE_SHARE * torque_limit)


def _floors(found: Identification) -> dict[str, float]:
    """Noise of each output: the root mean square residual over the misfit."""
    floors = {}
    for column, misfit in found.misfit.items():
        left = np.concatenate([run[column] - found.simulated[name][column] for name, run in found.measured.items()])
        floors[column] = float(np.sqrt(np.mean(left**2))) / misfit
    return floors


def _information_of_runs(found: Identification, names: Sequence[str], values: Values) -> np.ndarray:
    """F_runs (p, p); of a parameter that the runs do not show next to nothing."""
    calibration = found.calibration
    count = len(calibration.parameters)
    deviation = np.array([p.half for p in calibration.parameters]) / NORMAL_95
    unknown = [0.0] * count + [1.0 / (_UNKNOWN * max(abs(values[name]), 1e-9)) ** 2 for name in names[count:]]
    information = np.diag(unknown)
    # in units of the deviations, as parameters differ by ten powers of ten
    correlation = np.asarray(calibration.correlation) + 1e-9 * np.eye(count)
    information[:count, :count] += np.linalg.inv(correlation) / np.outer(deviation, deviation)
    return information


@dataclass(frozen=True)
class _Widening:
    """How much wider intervals are than white noise gives: `excess` sqrt(k/(k - p)), after k `seconds` for p `parameters`."""

    excess: float
    seconds: float
    parameters: int

    def after(self, more: float) -> float:
        """After `more` seconds [s]."""
        k = max(self.seconds + more, self.parameters + 1.0)
        return self.excess * float(np.sqrt(k / (k - self.parameters)))


def _widening(found: Identification, names: Sequence[str], values: Values, floors: Values) -> _Widening:
    """That of the runs: the median over the parameters that the goals need."""
    model, calibration = find_rig(found.calibration.rig).model(), found.calibration
    known, runs = len(calibration.parameters), list(found.measured.values())
    at = linearise(
        Evidence(model, runs, floors, timing=TIMING), (dict(values), {}), free_parameters(model, names[:known])
    )
    size = np.sqrt(np.diag(at.gram)) + 1e-12
    white = np.sqrt(np.diag(np.linalg.inv(at.gram / np.outer(size, size) + 1e-9 * np.eye(known)))) / size
    stated = np.array([p.half for p in calibration.parameters]) / NORMAL_95 / [f.scale for f in at.free]
    needed = {name for goal in GOALS for name in goal.needs}
    wider = float(np.median([r for name, r in zip(names, stated / white, strict=False) if name in needed] or [1.0]))
    seconds = sum(float(run["time_s"][-1] - run["time_s"][0]) for run in runs)
    few = _Widening(1.0, seconds, known).after(0.0)
    return _Widening(max(wider / few, 1.0), seconds, known)


def _information_of_piece(
    piece: str,
    span: Span,
    found: Identification,
    names: Sequence[str],
    values: Values,
    floors: Values,
    bench: WetClutchBench,
) -> tuple[np.ndarray, float] | None:
    """J'J (p, p) of a piece, and its length [s]; None where the bench may not play it."""
    model = find_rig(found.calibration.rig).model()
    alone, rest = compose([piece], span), compose([], span)
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{piece}.csv"
        path.write_text(profile_text(alone, piece), encoding="utf-8")
        first = next(iter(found.measured.values()))
        celsius = float(np.mean(first["oil_temperature_degc"]))
        inputs = bench.plan_inputs(CourseExperiment(str(path), celsius), dict(values), {})
    if inputs is None:
        return None
    run = {**inputs, **model.simulate(inputs, values, {})}
    free = free_parameters(model, names)
    at = linearise(Evidence(model, [run], floors, timing=TIMING), (dict(values), {}), free)
    sensitivity = at.jacobian / np.array([f.scale for f in at.free])
    return sensitivity.T @ sensitivity, float(alone.rows[-1][0] - rest.rows[-1][0])


def _stand(
    information: np.ndarray, names: Sequence[str], values: Values, goals: Sequence[Goal], wider: float
) -> list[Standing]:
    """How goals stand with F (p, p) of white noise, and intervals that are so much wider."""
    size = np.sqrt(np.diag(information))
    spread = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
    return stand_at(values, names, (NORMAL_95 * wider) ** 2 * spread, goals)


def _lack(standings: Sequence[Standing]) -> float:
    """Sum of log max(q/0.8, 1): 0 where every goal is predicted with its margin."""
    return float(sum(np.log(max(one.worst / (MARGIN * one.goal.limit), 1.0)) for one in standings))
