"""Identification design: find the shortest next experiment for a partly identified clutch, from its Fisher information.

Equation        F = sum over runs and pieces of J'J,  J: sensitivities of the outputs to the parameters, in block noise
                half width of a goal's quantity f:  1.96 w sqrt(f' F^-1 f'),  w = sqrt(k/(k - p)) after k seconds, for p
                  parameters (joint_fit.py);  q: half width divided by the half width that the goal allows
                next experiment: the pieces that give every q <= 0.85 in the least time. Greedy: the piece that reduces
                  sum log max(q/0.85, 1) most per second is added until the sum is 0. Then pieces are removed again, the
                  longest first, while the sum stays 0
                after a single run, where V_S and others are only guesses: SURVEY. An experiment planned with guesses may be
                  far too long, or contain too little information for starting values
                after a designed experiment: every q is multiplied by the ratio of that goal's interval to its prediction
                  where the ratio exceeds 1, because the residuals of one second may be correlated
                when all goals are reached: 3 s of the pieces that reduce sum log q most per second, to confirm the result
Assumptions     linear about the identified values; inputs as the bench's controller makes them
                sensitivities are the short central differences of the joint fit. Long one-sided differences are biased by
                curvature: M_C, C_v, V_S and gamma would seem to be separated three times as well as they are
                the information of a piece does not depend on its position in an experiment. The whole experiment is simulated
                again, and pieces are added until this simulation also predicts that the goals are reached
References      Atkinson and Donev 1992, Optimum Experimental Designs, ch. 9 to 12 (exchange algorithms, A-optimality);
                Pintelon and Schoukens 2012, ch. 5
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from clutch_hil.bench.rig import find_rig
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.models.wet_clutch_experiments import WetClutchBench
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.intervals import NORMAL_95, split_clusters
from clutch_hil.fitting.model import Columns, Model, Values
from clutch_hil.fitting.noise import estimate_floors
from clutch_hil.identify.clutch_parameters import FITTED, NEEDS, Need
from clutch_hil.identify.courses.clutch_courses import Span, write_course
from clutch_hil.identify.courses.course_pieces import LIBRARY, compose
from clutch_hil.identify.free_parameters import TIMING, UNKNOWN, free_parameter
from clutch_hil.identify.goals import GOALS, Goal, Standing, stand
from clutch_hil.identify.identification import NOT_EXCITED, Identification
from clutch_hil.identify.joint_fit import linearise_centrally, shorten_step
from clutch_hil.identify.stepwise import take_samples
from protocols.errors import InputError

MARGIN = 0.85  # share of a goal's half width that a design must predict: intervals come out a little wider
# The experiment after a single run: slips, pressures and their rates over the whole range, to obtain starting values
SURVEY = (
    "sweep at 0.35 bar", "sweep at 0.9 bar", "sweep at 1.85 bar", "slip sine at 1.05 bar", "triangle at 10 rad/s", "hold",
    "hold",
)  # fmt: skip
CONFIRMATION = 3.0  # s, length of a confirming experiment: three more clusters of residuals, and a fill
_MOST_SECONDS = 60.0  # s, limit of an experiment: longer than any course of the fixed set, so it would save nothing
_MOST_ROUNDS = 8  # of adding pieces, where the whole experiment does not reach the goals that its pieces should reach
_STEP = 1e-3  # in a parameter's finite-difference scale: step of the derivatives of the goals
_END = 500  # samples at the end of a run whose mean is the oil temperature: its noise is 0.1 K
# No goal asks for the temperature law, which needs 8 K. Its uncertainty is part of the intervals of the others
_NOT_ASKED = "oil.viscous_gain"
# Least reference of a percentage goal, as a share of a map's largest value: early estimates may be 0 at some pressure
_LEAST_SIZE = 0.01


@dataclass(frozen=True)
class Design:
    """The next experiment: its `pieces`, `seconds`, the text of its profile, and the initial oil temperature [degC].

    predicted: largest half width expected after the experiment, by goal, in the goal's unit. confirms: whether all goals are
    reached already and the experiment only confirms them.
    """

    pieces: Sequence[str]
    seconds: float
    profile: str
    celsius: float
    predicted: Mapping[str, float]
    confirms: bool

    def __str__(self) -> str:
        counts = Counter(self.pieces)
        pieces = ", ".join(f"{count} x {name}" if count > 1 else name for name, count in counts.items())
        return f"{self.seconds:.1f} s{' to confirm it' if self.confirms else ''}: {pieces}"


class _Designer:
    """Information in the runs of an identification, and the information that further pieces would add."""

    def __init__(
        self, identification: Identification, span: Span, controller: Values, rate: int, goals: Sequence[Goal]
    ) -> None:
        self._model: Model = find_rig(identification.calibration.rig).model()
        self._runs = list(identification.measured.values())
        self._values, self.span, self._rate, self._goals = identification.propagation.values, span, rate, goals
        plant = find_rig(identification.calibration.rig).plant.load_parameters()
        self._bench = WetClutchBench(plant, controller)
        identified = [p.name for p in identification.calibration.parameters]
        held = {name for name, why in identification.calibration.held.items() if why != NOT_EXCITED}
        names = [*identified, *(name for name in FITTED if name not in identified and name not in held)]
        self._free = [shorten_step(free_parameter(plant, name, None)) for name in names]
        self._floors = estimate_floors(self._runs, self._model.outputs)
        self.celsius = float(np.mean(self._runs[-1]["oil_temperature_degc"][-_END:]))
        self._slopes = self._differentiate()
        # the prior of a parameter that no run shows is as wide as in the fit
        sizes = np.array([max((1.0 if f.name in identified else UNKNOWN) * abs(self._values[f.name]), f.scale) / f.scale
                          for f in self._free])  # fmt: skip
        evidence, jacobian = self._linearise(self._runs)
        self.information = jacobian.T @ jacobian + np.diag(1.0 / sizes**2)
        self._clusters = len(split_clusters(evidence))
        self._wider = np.ones(sum(self._sizes))

    def widen(self, standings: Sequence[Standing]) -> None:
        """Multiply predicted intervals by actual over predicted width of the last identification, where this exceeds 1."""
        allowed = np.array([standing.goal.limit for standing in standings])
        predicted = np.array([part.max() for part in self._split(self.compute_ratios(self.information, 0.0))])
        wider = np.array([standing.worst for standing in standings]) / allowed / predicted
        self._wider = np.repeat(np.where((wider > 1.0) & np.isfinite(wider), wider, 1.0), self._sizes)

    def _linearise(self, runs: Sequence[Columns]) -> tuple[Evidence, np.ndarray]:
        """Return runs as evidence, and the sensitivities (size, p) of their residuals."""
        evidence = Evidence(self._model, runs, self._floors, timing=TIMING)
        return evidence, linearise_centrally(evidence, self._make_point(), self._free).jacobian

    def _make_point(self) -> Point:
        """Return the identified parameters and effects."""
        ours = self._model.parameters
        return {n: v for n, v in self._values.items() if n in ours}, {
            n: v for n, v in self._values.items() if n not in ours
        }

    def _differentiate(self) -> np.ndarray:
        """Return derivatives (m, p) of all goal quantities, divided by the allowed half width, per finite-difference scale."""
        rows = []
        for goal in self._goals:
            value = goal.of(self._values)
            size = np.abs(value)
            size = np.maximum(size, (_LEAST_SIZE * size.max()) or 1.0)
            allowed = goal.limit / 100.0 * size if goal.unit == "%" else np.full_like(value, goal.limit)
            columns = []
            for f in self._free:
                above, below = (
                    goal.of({**self._values, f.name: self._values[f.name] + sign * _STEP * f.scale})
                    for sign in (1.0, -1.0)
                )
                columns.append((above - below) / (2.0 * _STEP) / allowed)
            rows.append(np.column_stack(columns))
        self._sizes = [len(one) for one in rows]
        return np.concatenate(rows)

    def compute_ratios(self, information: np.ndarray, seconds: float) -> np.ndarray:
        """Return q (m,) of every quantity for information F (p, p) after `seconds` more."""
        clusters = self._clusters + int(seconds)
        wider = np.sqrt(clusters / max(clusters - len(self._free), 1))
        size = np.sqrt(np.diag(information))
        slopes = self._slopes / size
        solved = np.linalg.solve(information / np.outer(size, size), slopes.T)
        half = NORMAL_95 * wider * np.sqrt(np.maximum(np.einsum("mp,pm->m", slopes, solved), 1e-18))
        return np.asarray(self._wider * half)

    def _split(self, values: np.ndarray) -> list[np.ndarray]:
        """Split values (m,) of the quantities by goal."""
        return np.split(values, np.cumsum(self._sizes)[:-1])

    def compute_lack(self, information: np.ndarray, seconds: float, margin: float) -> float:
        """Return the mean of log max(q/margin, 1) of each goal, summed over the goals."""
        parts = self._split(np.log(np.maximum(self.compute_ratios(information, seconds) / margin, 1.0)))
        return float(sum(np.mean(part) for part in parts))

    def compute_spread(self, information: np.ndarray, seconds: float) -> float:
        """Return the mean of log q of each goal, summed over the goals."""
        parts = self._split(np.log(self.compute_ratios(information, seconds)))
        return float(sum(np.mean(part) for part in parts))

    def finish(self, pieces: Sequence[str], confirms: bool = False) -> Design:
        """Return the experiment with these pieces. Raises InputError where it is not within the limits of the bench."""
        run, text, _ = self.plan(pieces)
        seconds = float(run["time_s"][-1])
        predicted = self.predict(self.information + self.compute_information(run), seconds)
        return Design(list(pieces), seconds, text, self.celsius, predicted, confirms)

    def predict(self, information: np.ndarray, seconds: float) -> dict[str, float]:
        """Return the largest half width of each goal, in its unit."""
        parts = self._split(self.compute_ratios(information, seconds))
        return {g.name: float(part.max()) * g.limit for g, part in zip(self._goals, parts, strict=True)}

    def plan(self, pieces: Sequence[str]) -> tuple[Columns, str, list[tuple[float, float]]]:
        """Return the predicted run of a course of these pieces, its profile, and the times of each piece. Raises InputError."""
        course, times = compose(pieces, self.span)
        text = write_course(
            course, f"Next experiment of clutch-hil experiment identify --design, {len(pieces)} pieces."
        )
        with TemporaryDirectory() as folder:
            path = Path(folder) / "next.csv"
            path.write_text(text, encoding="utf-8")
            inputs = self._bench.plan_inputs(Experiment(str(path), self.celsius, self._rate), dict(self._values), {})
        if inputs is None:
            raise InputError(
                f"an experiment up to {self.span.contact + self.span.reach:.3g} bar would reach the limits of the guard or of"
                " the motor"
            )
        return {**inputs, **self._model.simulate(inputs, *self._make_point())}, text, times

    def compute_information(self, run: Columns) -> np.ndarray:
        """Return J'J (p, p) of a run."""
        _, jacobian = self._linearise([run])
        return jacobian.T @ jacobian

    def compute_information_by_piece(self) -> dict[str, tuple[np.ndarray, float]]:
        """Return J'J (p, p) of each piece of the library, and its length [s]."""
        run, _, times = self.plan(list(LIBRARY))
        evidence, jacobian = self._linearise([run])
        by_piece = {}
        for name, (begin, end) in zip(LIBRARY, times, strict=True):
            first, last = (round(time / evidence.lengths[0]) for time in (begin, end))
            rows = np.concatenate(
                [
                    jacobian[part.start + first : part.start + last]
                    for part in (evidence.find_part(0, c) for c in evidence.columns)
                ]
            )
            by_piece[name] = rows.T @ rows, end - begin
        return by_piece

    def list_unmet(self, run: Columns) -> list[Need]:
        """Return the needs of an identification that the recorded runs and this run do not meet."""
        samples = take_samples([*self._runs, run])
        return [n for n in NEEDS if _NOT_ASKED not in n.parameters and n.warn(samples, self._values)]

    def choose_best(self, need: Need, pieces: Sequence[str]) -> str:
        """Return the piece that improves the value of `need` most when added to `pieces`."""
        before = need.value(take_samples([*self._runs, self.plan(pieces)[0]]), self._values)
        gains = {}
        for name in LIBRARY:
            run = self.plan([*pieces, name])[0]
            gains[name] = need.value(take_samples([*self._runs, run]), self._values) - before
        return max(gains, key=lambda name: gains[name])


def design_experiment(
    identification: Identification, span: Span, controller: Values, rate: int = 1000, goals: Sequence[Goal] = GOALS
) -> Design:
    """Return the shortest next experiment after `identification`, in the pressures of `span`, at `rate` [Hz].

    controller: parameters that differ from the shipped ones, by dotted name. Raises InputError where no experiment is within
    the limits of the bench.
    """
    known = _Designer(identification, span, controller, rate, goals)
    if len(identification.measured) == 1:
        return known.finish(SURVEY)
    by_piece = known.compute_information_by_piece()
    standings = stand(identification.calibration, goals)
    if all(standing.is_reached for standing in standings):
        return known.finish(_choose_confirming_pieces(known, by_piece), confirms=True)
    if len(identification.measured) > 2:  # after the survey alone there are only as many clusters as parameters
        known.widen(standings)
    margin, pieces = MARGIN, list[str]()
    for _ in range(_MOST_ROUNDS):
        pieces = _choose(known, by_piece, pieces, margin)
        run, *_ = known.plan(pieces)
        if needed := known.list_unmet(run):
            pieces = [*pieces, known.choose_best(needed[0], pieces)]
            run, *_ = known.plan(pieces)
        lacks = (
            known.compute_lack(known.information + known.compute_information(run), float(run["time_s"][-1]), MARGIN)
            > 0.0
        )
        if not (lacks or known.list_unmet(run)):
            break
        margin *= 0.95 if lacks else 1.0
    return known.finish(pieces or _choose_confirming_pieces(known, by_piece))


def _choose(
    known: _Designer, by_piece: Mapping[str, tuple[np.ndarray, float]], begun: Sequence[str], margin: float
) -> list[str]:
    """Return pieces that reach all goals with this margin, in the order of the library; they include `begun`."""
    overhead = compose([], known.span)[0].seconds
    chosen = list(begun)

    def state(pieces: Sequence[str]) -> tuple[np.ndarray, float]:
        return known.information + sum(by_piece[p][0] for p in pieces), overhead + sum(by_piece[p][1] for p in pieces)

    information, seconds = state(chosen)
    while (now := known.compute_lack(information, seconds, margin)) > 0.0 and seconds < _MOST_SECONDS:
        gains = {
            name: (now - known.compute_lack(information + more, seconds + length, margin)) / length
            for name, (more, length) in by_piece.items()
        }
        chosen.append(max(gains, key=lambda name: gains[name]))
        information, seconds = state(chosen)
    for name in sorted(chosen, key=lambda one: -by_piece[one][1]):
        rest = list(chosen)
        rest.remove(name)
        if name not in begun and known.compute_lack(*state(rest), margin) == 0.0:
            chosen = rest
    return [name for name in LIBRARY for _ in range(chosen.count(name))]


def _choose_confirming_pieces(known: _Designer, by_piece: Mapping[str, tuple[np.ndarray, float]]) -> list[str]:
    """Return the pieces that reduce the intervals of all goals together most per second."""
    information, seconds, chosen = known.information, 0.0, list[str]()
    while seconds < CONFIRMATION:
        gains = {
            name: (known.compute_spread(information, seconds) - known.compute_spread(information + more, seconds))
            / length
            for name, (more, length) in by_piece.items()
        }
        chosen.append(max(gains, key=lambda name: gains[name]))
        information, seconds = information + by_piece[chosen[-1]][0], seconds + by_piece[chosen[-1]][1]
    return [name for name in LIBRARY for _ in range(chosen.count(name))]
