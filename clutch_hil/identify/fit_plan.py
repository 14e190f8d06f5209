"""FitPlan: which parameters of a clutch are fitted, and the values of the others, from the user's wishes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from clutch_hil.bench.arguments import take_flag, take_mapping, take_name, take_number, take_range
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.model import Model, Values
from clutch_hil.identify.clutch_effects import EFFECTS, declare_effects
from clutch_hil.identify.clutch_parameters import FITTED, HELD, Ties
from clutch_hil.identify.free_parameters import free_parameter
from protocols.errors import InputError, join_names, suggest_closest
from protocols.files.parameters import ParameterSet


@dataclass(frozen=True)
class Subject:
    """A clutch to be identified.

    rig: name for the calibration. nominal: declared parameters. make: creates the model from parameters. fitted, effects: names
    of the parameters and effects that are fitted if the runs excite them. shows_response: whether the frequency response of the
    pressure loop can be measured in its runs.
    """

    rig: str
    nominal: ParameterSet
    make: Callable[..., Any]
    fitted: Sequence[str] = FITTED
    effects: Sequence[str] = tuple(EFFECTS)
    shows_response: bool = True

    def without_output(self, column: str) -> "Subject":
        """Return the subject with a model that does not predict `column`, so that the fit does not compare it."""

        def make(*arguments: Any, **named: Any) -> Model:
            model = self.make(*arguments, **named)
            model.outputs = tuple(output for output in model.outputs if output.column != column)
            return model

        return replace(self, make=make)


@dataclass(frozen=True)
class Wishes:
    """The user's options for parameters by name: see `identify_clutch`."""

    hold: Mapping[str, float | None] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    ties: Mapping[str, str] = field(default_factory=dict)
    force: bool = False


def take_wishes(hold: Any, bounds: Any, ties: Any, force: Any) -> Wishes:
    """Return the options that a Python caller passes. Raises InputError for other types."""
    return Wishes(
        {n: None if v is None else take_number(f"hold of {n}", v) for n, v in take_mapping("hold", hold).items()},
        {n: take_range(f"bounds of {n}", v) for n, v in take_mapping("bounds", bounds).items()},
        {n: take_name(f"ties of {n}", v) for n, v in take_mapping("ties", ties).items()},
        take_flag("force", force),
    )


@dataclass(frozen=True)
class FitPlan:
    """Plan of a fit.

    known: parameters and effects as declared. held: names of held ones, with the reason. given: their values. ratios: tied
    parameter -> (other parameter, ratio to it). free: parameters to be fitted.
    """

    known: ParameterSet
    held: Mapping[str, str]
    given: Mapping[str, float]
    ratios: Ties
    free: Sequence[FreeParameter]

    def give(self, name: str, value: float, why: str) -> "FitPlan":
        """Return this plan with one more parameter held at `value`. why: the reason."""
        return replace(self, held={**self.held, name: why}, given={**self.given, name: value})

    def select_given(self, among: ParameterSet) -> dict[str, float]:
        """Return the given values of the parameters in `among`."""
        return {name: value for name, value in self.given.items() if name in among}

    @property
    def declared(self) -> Values:
        return {name: p.value for name, p in self.known.items()}


def plan_fit(subject: Subject, model: Model, wishes: Wishes) -> FitPlan:
    """Return the plan for the fit of a clutch with this model.

    Raises InputError for a value out of bounds, a tie to a parameter that is 0, and bounds of a parameter that is not fitted.
    """
    known = ParameterSet({**model.parameters, **declare_effects()})
    declared = {name: p.value for name, p in known.items()}
    hold, bounds = wishes.hold, wishes.bounds
    held = {n: why for n, why in HELD.items() if n not in bounds} | dict.fromkeys(hold, "held by the user")
    given = {name: declared[name] if (value := hold.get(name)) is None else value for name in held}
    known.with_values(given)  # raises InputError for a held value out of bounds
    ratios = {name: (other, _resolve_ratio(name, other, declared)) for name, other in wishes.ties.items()}
    could_be = [name for name in (*subject.fitted, *subject.effects) if name not in ratios and name not in hold]
    if unfitted := [name for name in bounds if name not in could_be]:
        raise InputError(
            f"bounds of {unfitted[0]} have no effect, because it is not fitted; fitted are {join_names(could_be)}"
        )
    names = [name for name in subject.fitted if name not in held and name not in ratios]
    names += [name for name in subject.effects if name not in held]
    return FitPlan(known, held, given, ratios, [free_parameter(known, name, bounds.get(name)) for name in names])


def check_names(known: ParameterSet, names: Sequence[str]) -> None:
    """Raise InputError for a name that is not in `known`."""
    for name in names:
        if name not in known:
            raise InputError(f"parameter {name!r} is unknown; {suggest_closest(name, list(known))}")


def check_ties(wishes: Wishes) -> None:
    """Raise InputError for a tie to a parameter that is itself tied, and for a parameter that is both held and tied."""
    for name, other in wishes.ties.items():
        if other in wishes.ties:
            raise InputError(
                f"{name} is tied to {other}, which is tied to {wishes.ties[other]}; allowed is a parameter that is not tied"
            )
        if name in wishes.hold:
            raise InputError(f"{name} is both held and tied to {other}; only one of them is allowed")


def _resolve_ratio(name: str, other: str, declared: Values) -> float:
    if declared[other] == 0.0:
        raise InputError(f"{name} is tied to {other}, which is 0; allowed is another parameter that is not 0")
    return declared[name] / declared[other]
