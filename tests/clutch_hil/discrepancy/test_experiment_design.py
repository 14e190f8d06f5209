"""The separating experiment: it is the one in which alternatives still differ once each is re-fitted to the other."""

from collections.abc import Sequence

import numpy as np
import pytest

from clutch_hil.bench.in_process import play
from clutch_hil.discrepancy.experiment_design import LEAST_SEPARATION, Experiment, propose
from clutch_hil.discrepancy.experiments.blind import measure_standard
from clutch_hil.discrepancy.experiments.follow_up import read_proposal
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.models.wet_clutch_experiments import HELD_OUT, LIBRARY, STANDARD, WetClutchBench, find
from clutch_hil.fitting.model import Candidate, Columns, Output, Values
from plant_sim.effects.effect import Strength
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.wet_clutch_regulated import Regulator, regulate_profile
from protocols.errors import InputError
from protocols.files.parameters import Parameter, ParameterSet
from protocols.node import load_node
from tests.processes import play_here

# floors, root mean square of an output: 0.15 was measured for return_spring_change, at least 0.33 for the others
LEAST_GAP = 0.1
VOLTAGE = 2e-3  # V: 1.0 mV measured, where a converter's step of the pressure passes a threshold a sample later
SHORT = 3.0  # s of a profile: fill, rise, hold
QUIET = {f"sensors.{name}_noise": 0.0 for name in ("pressure", "temperature", "torque")}


class Line:
    """y = slope u + square u^2 + cube u^3, the slope uncertain: what u separates square and cube?"""

    name = "line"
    inputs = ("u",)
    outputs = (Output("y", "m", "line", 0.01),)
    parameters = ParameterSet({"line.slope": Parameter("line.slope", 1.0, "1", 0.5, (-9.0, 9.0), "a test")})
    candidates = tuple(
        Candidate(name, "line", name, name, (Strength("size", "1", 0.0, 0.1, (-9.0, 9.0), "a test"),))
        for name in ("square", "cube", "slanted")
    )

    def __init__(self, spans: dict[str, tuple[float, float]], safe: Sequence[str] = ()) -> None:
        self.experiments = tuple(Experiment(name, 70.0) for name in spans)
        self._spans, self._safe = spans, safe or tuple(spans)

    def make_bench(self) -> "Line":
        return self

    def plan_inputs(self, experiment: Experiment, parameters: Values, effects: Values) -> Columns | None:
        u = np.linspace(*self._spans[experiment.profile], 400)
        return {"time_s": np.arange(400) / 1e3, "u": u} if experiment.profile in self._safe else None

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> Columns:
        u = run["u"]
        slope = parameters["line.slope"] + effects.get("slanted.size", 0.0)
        return {"y": slope * u + effects.get("square.size", 0.0) * u**2 + effects.get("cube.size", 0.0) * u**3}


WIDE, POSITIVE = {"drift": (-1.0, 1.0)}, {"crawl": (0.0, 1.0)}
BOTH = POSITIVE | WIDE


def propose_experiment(model: Line, *options: Values) -> dict:
    return propose(model, {"line.slope": 1.0}, options, {"y": 0.01})


@pytest.mark.parametrize("spans", [BOTH, dict(reversed(BOTH.items()))])
def test_the_experiment_is_the_one_that_a_re_fit_explains_least(spans: dict) -> None:
    """Over 0..1 a square and a line look much like a cube; over -1..1 one is even and the other odd."""
    proposed = propose_experiment(Line(spans), {"square.size": 0.5}, {"cube.size": 0.4})
    assert proposed["profile"] == "drift"
    assert proposed["command"] == "clutch-hil up --profile drift --temperature 70 --rate 1000"
    assert proposed["standard_deviations"] ** 2 > LEAST_SEPARATION


def test_the_difference_that_is_told_is_what_is_left_after_the_re_fit() -> None:
    """Least squares of u and u^2 to 0.4 u^3 on -1..1 leave 0.4 (u^3 - 0.6 u): 0.4 sqrt(4/175) root mean square."""
    proposed = propose_experiment(Line(WIDE), {"square.size": 0.5}, {"cube.size": 0.4})
    assert proposed["predicted_difference"]["y"] == pytest.approx(0.4 * np.sqrt(4 / 175) / 0.01, rel=0.03)


def test_a_bench_with_the_old_name_of_its_method_is_refused_with_the_new_one() -> None:
    class Old:
        experiments = ()

        def planned(self, *arguments: object) -> None: ...

    model = Line(BOTH)
    model.make_bench = Old  # type: ignore[assignment, method-assign]
    with pytest.raises(InputError, match=r"rig line: its method planned\(\) is called plan_inputs\(\) now"):
        propose_experiment(model, {"square.size": 0.5}, {"cube.size": 0.4})


def test_an_experiment_that_is_not_safe_is_not_proposed() -> None:
    assert (
        propose_experiment(Line(BOTH, safe=["crawl"]), {"square.size": 3.0}, {"cube.size": 3.0})["profile"] == "crawl"
    )


def test_equivalent_alternatives_are_said_to_be_so() -> None:
    proposed = propose_experiment(Line(BOTH), {"square.size": 0.3}, {"square.size": 0.3, "slanted.size": 0.2})
    assert proposed["profile"] is None
    assert proposed["why"].startswith(
        "none of 2 experiments separates square and slanted+square: re-fitted to each other they"
    )


@pytest.mark.parametrize("experiment", LIBRARY, ids=lambda e: e.name)
def test_every_experiment_of_the_library_is_safe_on_the_rig_as_it_is(experiment: Experiment) -> None:
    assert WetClutchBench().plan_inputs(experiment, {}, {}) is not None
    assert find(experiment.name) == experiment


@pytest.mark.parametrize("name", ["crawl-9999", "crawl-3"])
def test_an_oil_temperature_out_of_range_is_refused_before_anything_is_played(name: str) -> None:
    with pytest.raises(InputError, match=r"^oil temperature \d+ degC is outside 35\.\.150 degC$"):
        find(name)


@pytest.mark.parametrize(
    ("contact", "shift"), [(2.35, 0.0), (2.43, 0.0), (2.27, 0.0), (2.46, 0.1), (2.6, 0.25), (1.8, -0.55), (4.02, 1.65)]
)
def test_an_experiment_is_as_far_above_contact_as_on_the_shipped_clutch(contact: float, shift: float) -> None:
    own, fitted = find("crawl"), find("crawl").fit_to_contact(contact)
    assert fitted.shift == pytest.approx(shift, abs=1e-9)
    assert fitted.name == own.name
    if shift > 0.3:
        sentence = (
            r"^experiment crawl-70 would be played \+1\.65 bar from its own pressures.*5\.45 bar is .* 0\.\.4\.5 bar"
        )
        with pytest.raises(InputError, match=sentence):
            fitted.load()
        return
    before, after = own.load(), fitted.load()
    assert (after.time, after.speed, after.torque) == (before.time, before.speed, before.torque)
    moved = [b + shift if b > 0.0 else 0.0 for b in before.pressure]
    assert list(after.pressure) == pytest.approx(moved, abs=1e-9)
    with fitted.open_profile() as name:
        assert load_profile(name).pressure == after.pressure
        assert (name == own.profile) is (shift == 0.0)
    assert ("from these" in fitted.title) is (shift != 0.0)


def test_a_bench_plans_the_experiments_for_its_own_clutch() -> None:
    nominal = wet_clutch.load_nominal()
    assert WetClutchBench().experiments == LIBRARY
    stiff = nominal.with_values({"piston.contact_pressure": 2.6, "piston.preload_pressure": 1.9})
    bench = WetClutchBench(stiff)
    assert {e.shift for e in bench.experiments} == {0.25}
    (crawl,) = (e for e in bench.experiments if e.profile == "crawl")
    inputs = bench.plan_inputs(crawl, {}, {})
    assert inputs is not None
    volts, at_rest = inputs["valve_voltage_v"], WetClutchBench().plan_inputs(find("crawl"), {}, {})
    assert at_rest is not None
    assert np.median(volts) - np.median(at_rest["valve_voltage_v"]) == pytest.approx(
        0.25 / 2.5, abs=0.01
    )  # V, 2.5 bar/V
    high = WetClutchBench(nominal.with_values({"piston.contact_pressure": 6.0, "piston.preload_pressure": 4.0}))
    assert [high.plan_inputs(e, {}, {}) for e in high.experiments] == [None] * len(LIBRARY)


def test_a_proposal_keeps_its_shift() -> None:
    fitted = find("crawl").fit_to_contact(2.6)
    settings = {"temperature": fitted.temperature, "rate": fitted.rate, "shift": fitted.shift}
    assert read_proposal("x", {"profile": "crawl", "settings": settings}) == fitted
    del settings["shift"]
    assert read_proposal("x", {"profile": "crawl", "settings": settings}) == find("crawl")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("identify", "crawl"), "experiment identify is a whole set and is played alone"),
        (("crawl", "identify"), "experiment identify is a whole set and is played alone"),
        (("identifi",), "experiment 'identifi' is unknown; did you mean identify?"),
        (("crawl", "--list"), "--list and crawl were both given; only one of them is allowed"),
        (("--standard", "--list"), "--list and --standard were both given; only one of them is allowed"),
    ],
)
def test_experiments_that_cannot_be_played_together_are_refused(words: tuple[str, ...], sentence: str) -> None:
    done = play_here("experiment", *words)
    assert done.returncode == 2
    assert sentence in done.stderr


def test_an_unknown_experiment_is_told_what_comes_closest() -> None:
    assert find("crawl-55") == Experiment("crawl", 55.0)
    with pytest.raises(InputError, match=r"experiment 'craw' is unknown.*crawl"):
        find("craw")


@pytest.mark.parametrize("name", ["hold_and_release", "reversals", "pressure_steps"])
def test_the_regulated_rig_gets_the_voltage_that_the_controller_gives(name: str) -> None:
    parameters = wet_clutch.load_nominal().with_values(QUIET | {"sensors.pressure_sensitivity": 1.03})  # reads 3 % high
    profile = load_profile(name, SHORT)
    played = play(PlantNode(1000, parameters, profile, temperature=70.0), load_node("controller")(rate=1000))
    inputs = regulate_profile(wet_clutch.Rig(parameters), profile, Regulator.from_controller(), 70.0, 1000, 10)
    assert np.abs(inputs.voltage - played["valve_voltage_v"]).max() < VOLTAGE
    assert np.abs(inputs.speed - played["motor_speed_demand_rad_s"]).max() < 1e-3
    assert played["valve_voltage_v"].max() > 1.0


def test_the_standard_experiments_show_every_candidate() -> None:
    shown = measure_standard()
    gaps = {c.name: shown.compute_gaps(c.list_typical_values()) for c in WetClutch().candidates}
    assert not {name: gap for name, gap in gaps.items() if not max(gap.values()) > LEAST_GAP}
    assert not set(STANDARD) & set(HELD_OUT)
