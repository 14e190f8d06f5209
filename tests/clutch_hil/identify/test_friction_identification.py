"""Friction that is known is identified again: parameters within intervals, terms by held-out stretches, files, warnings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.identify.friction.identification import identify_friction
from clutch_hil.identify.friction.result import IdentifiedFriction, read_friction
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.directed import Directed
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.asymmetric import ShapedElements
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.shaped import ShapedMaxwellSlip
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError
from protocols.files.run import Run
from tests.clutch_hil.identify.slides import PERIOD, SPAN, make_motion, make_red_noise, make_white_noise, play

POSITION = make_motion()
N = POSITION.size
NOISE = 0.02  # N, of about 10
LIMITS, POINTS = np.array([4.0, 3.0]), np.array([2e-5, 1e-4])  # N, m
CURVE = Stribeck(7.0, 0.7, 4e-3, 80.0)
STEPPED = np.array([20.0, 60.0, 10.0, 120.0, 35.0])[np.arange(N) * 15 // N % 5]  # N, load


def make_truth(name: str, seed: int = 3) -> tuple[Run, tuple[str, ...], dict[str, float]]:
    """A run, the terms of its law, and the values that are to be found."""
    elements = {"limit_1": 4.0, "limit_2": 3.0, "break_point_1": 2e-5, "break_point_2": 1e-4}
    stribeck = {"beta": 0.7, "stribeck_velocity": 4e-3, "viscous": 80.0}
    terms = ("viscous", "stribeck")
    noise = make_white_noise(N, NOISE, seed)
    if name == "stribeck":
        return (
            play(Coulomb(CURVE), noise=noise, mass=3.0),
            (*terms, "mass"),
            {"static_force": 7.0, **stribeck, "mass": 3.0},
        )
    if name == "maxwell-slip":
        return (
            play(MaxwellSlip(LIMITS / POINTS, LIMITS), noise=noise, offset=0.5),
            ("offset",),
            {**elements, "offset": 0.5},
        )
    if name == "gms":
        model = GMS(CURVE, LIMITS / POINTS, LIMITS / 7.0, 7.0 * 50.0)
        return (
            play(model, noise=noise, mass=3.0),
            (*terms, "lag", "mass"),
            {**elements, **stribeck, "attraction": 50.0, "mass": 3.0},
        )
    if name == "lugre":
        return play(LuGre(CURVE, 2e5), noise=noise), terms, {"static_force": 7.0, "stiffness": 2e5, **stribeck}
    law = LoadLaw(0.3, 2.0, 50.0)
    level = float(law(STEPPED.mean()))
    limits = LIMITS * level / LIMITS.sum()
    model = XGMS(law, limits / POINTS, limits / level, 0.7, 4e-3, 80.0 / level, attraction=50.0)
    values = {"limit_1": limits[0], "limit_2": limits[1], "break_point_1": 2e-5, "break_point_2": 1e-4}
    values |= stribeck | {"attraction": 50.0, "fall": 0.5, "load_scale": 50.0}
    return play(model, load=STEPPED, noise=noise), (*terms, "lag", "fall"), values


@pytest.mark.parametrize("name", ["stribeck", "maxwell-slip", "gms", "xgms", "lugre"])
def test_a_law_that_is_known_is_found_again(name: str) -> None:
    run, terms, values = make_truth(name)
    result = identify_friction(run, name, terms=terms, elements=2 if "limit_1" in values else None, starts=2)
    inside = [result.interval(one)[0] <= value <= result.interval(one)[1] for one, value in values.items()]
    assert {one.name for one in result.parameters} == set(values)
    for one, value in values.items():
        assert result[one] == pytest.approx(value, rel=0.05), one
    assert sum(inside) >= len(inside) - 1, [one for one, is_in in zip(values, inside, strict=True) if not is_in]
    if name != "stribeck":  # whose sign is a sample early or late at a reversal
        assert result.errors["held_out"] == pytest.approx(NOISE, rel=0.15)
    assert result.starts[1] == 2


def test_held_out_stretches_choose_the_terms_and_the_elements() -> None:
    """The rig has 2 elements, mass, viscous friction and an offset; no delay, no damping, no asymmetry."""
    model, position = GMS(Stribeck(7.0, viscous=80.0), LIMITS / POINTS, LIMITS / 7.0), make_motion(10.0)  # s: enough
    run = play(model, position, noise=make_white_noise(position.size, NOISE, 1), mass=3.0, offset=0.5)
    result = identify_friction(run, "gms", starts=1)
    assert result.structure.elements == 2
    assert set(result.structure.terms) == {"mass", "viscous", "offset"}
    assert result["mass"] == pytest.approx(3.0, rel=0.01)
    assert result["offset"] == pytest.approx(0.5, rel=0.05)
    assert sum(step.chosen for step in result.steps) == 1
    assert len(result.steps) > 4


def test_friction_that_differs_with_the_direction_is_told_from_an_offset() -> None:
    up, down = (GMS(Stribeck(7.0, viscous=80.0 * share), LIMITS / POINTS, LIMITS / 7.0) for share in (1.2, 0.8))
    result = identify_friction(play(Directed(up, down), noise=make_white_noise(N, NOISE, 2)), "gms", starts=1)
    assert "viscous_asymmetry" in result.structure.terms
    assert "offset" not in result.structure.terms
    assert result["viscous_asymmetry"] == pytest.approx(0.2, abs=0.01)


def test_the_shape_of_an_asymmetric_loop_is_found() -> None:
    shape = np.array([0.15, -0.1])
    reach = float(np.abs(POSITION).max())
    model = ShapedMaxwellSlip(ShapedElements(MaxwellSlip(LIMITS / POINTS, LIMITS), shape, reach))
    run = play(model, noise=make_white_noise(N, NOISE, 4))
    result = identify_friction(run, "maxwell-slip", elements=2, terms=("shape",), starts=1)
    assert [result["shape_1"], result["shape_2"]] == pytest.approx(shape, abs=0.01)
    plain = identify_friction(run, "maxwell-slip", elements=2, terms=(), starts=1)
    assert plain.errors["held_out"] > 5.0 * result.errors["held_out"]


def test_intervals_hold_where_the_noise_lasts_over_many_samples() -> None:
    """Noise that is correlated over 100 samples: intervals that take it as white hold half of the values or less."""
    position, model = make_motion(12.0), MaxwellSlip(LIMITS / POINTS, LIMITS)
    inside, narrow, total = 0, 0, 0
    for seed in range(20):
        noise = make_red_noise(position.size, 0.1, 0.99, seed)
        result = identify_friction(
            play(model, position, noise=noise), "maxwell-slip", elements=2, terms=("offset",), starts=1
        )
        for name, value in (("limit_1", 4.0), ("limit_2", 3.0), ("break_point_2", 1e-4), ("offset", 0.0)):
            low, high = result.interval(name)
            inside += low <= value <= high
            total += 1
            white_half = 0.5 * (high - low) * 0.1  # 100 correlated samples in place of one
            narrow += abs(result[name] - value) <= white_half
    assert inside >= 0.85 * total
    assert narrow <= 0.6 * total


def test_a_run_that_is_fitted_judges_nothing() -> None:
    run, terms, _ = make_truth("stribeck")
    piece = Run({name: values[2000:6000] for name, values in run.columns.items()}, run.metadata)
    with pytest.raises(InputError, match=r"^run 1, held out: time_s, rows 0 to 3999, are rows 2000 to 5999 of run 1: "):
        identify_friction(run, "stribeck", terms=terms, starts=1, holdout=[piece])


class TestFile:
    def identify_again(self) -> IdentifiedFriction:
        run, terms, _ = make_truth("xgms")
        held_out, _, _ = make_truth("xgms", seed=4)
        return identify_friction(run, "xgms", terms=terms, elements=2, starts=1, rig="bench 3", holdout=[held_out])

    def test_loads_back_to_the_last_digit(self, tmp_path: Path) -> None:
        result = self.identify_again()
        again = read_friction(result.write(tmp_path / "friction.toml"))
        assert again.values == result.values
        assert again.verdict == result.verdict
        assert np.array_equal(again.correlation, result.correlation, equal_nan=True)
        assert again.runs == result.runs
        assert [run.used for run in again.runs] == ["fitted", "held out"]
        assert again.rig == "bench 3"
        force, kept = (one.model.trace(POSITION, PERIOD, STEPPED).force for one in (result, again))
        assert np.array_equal(force, kept)

    def test_what_was_changed_by_hand_and_is_wrong_is_told(self, tmp_path: Path) -> None:
        path = self.identify_again().write(tmp_path / "friction.toml")
        text = path.read_text(encoding="utf-8")
        for before, after, message in (
            ('kind = "friction"', 'kind = "clutch"', "is of the kind 'clutch'"),
            ('law = "xgms"', 'law = "xgmz"', "law 'xgmz' is unknown; did you mean xgms"),
            ("beta = {", "betta = {", "has the parameters"),
            ("elements = 2", "elements = 3", "has the parameters"),
            ("beta = { value = ", "beta = { value = -", "beta is -0"),
        ):
            path.write_text(text.replace(before, after, 1), encoding="utf-8")
            with pytest.raises(InputError, match=message):
                read_friction(path)


class TestWarnings:
    MODEL = GMS(Stribeck(7.0, viscous=80.0), LIMITS / POINTS, LIMITS / 7.0)

    def list_warnings(self, run: Run, law: str = "gms", terms: tuple[str, ...] | None = ()) -> str:
        """What is told of a run. It comes of the run and of a fit without terms; these are searched for if `terms` is None."""
        elements = 1 if law != "stribeck" else None
        return "\n".join(identify_friction(run, law, starts=1, elements=elements, terms=terms).warnings)

    def test_one_way_says_nothing_of_pre_sliding(self) -> None:
        time = PERIOD * np.arange(N)
        rising = 5e-3 * time + 2e-3 * (1.0 - np.cos(0.5 * time))  # m, never turns
        run = play(self.MODEL, rising, noise=make_white_noise(N, NOISE, 5))
        assert "no reversal" in self.list_warnings(run, terms=None), "as well where terms are chosen"

    def test_one_speed_says_nothing_of_stribeck(self) -> None:
        saw = SPAN * (2.0 * np.abs(2.0 * ((np.arange(N) * PERIOD * 0.5) % 1.0) - 1.0) - 1.0)
        sentence = self.list_warnings(play(Coulomb(CURVE), saw, noise=make_white_noise(N, NOISE, 5)), "stribeck")
        assert "a Stribeck curve needs speeds over two decades" in sentence

    def test_a_constant_load_says_nothing_of_its_influence(self) -> None:
        model = XGMS(LoadLaw(0.3, 2.0, 50.0), LIMITS / POINTS, LIMITS / 7.0)
        run = play(model, load=np.full(N, 40.0), noise=make_white_noise(N, NOISE, 5))
        assert "taken as proportional" in self.list_warnings(run, "xgms")

    def test_a_load_that_the_law_does_not_know_is_told(self) -> None:
        run, _, _ = make_truth("xgms")
        assert "but gms has no load: use xgms" in self.list_warnings(run)

    def test_samples_too_far_apart_do_not_resolve_pre_sliding(self) -> None:
        stiff = GMS(Stribeck(7.0, viscous=80.0), [1e8], [1.0])
        assert "pre-sliding is not resolved" in self.list_warnings(play(stiff, noise=make_white_noise(N, NOISE, 5)))

    def test_a_force_at_the_end_of_its_sensor_is_told(self) -> None:
        run = play(self.MODEL, noise=make_white_noise(N, NOISE, 5))
        force = run["friction_force_n"]
        cut = replace(run, columns={**run.columns, "friction_force_n": np.minimum(force, 0.8 * force.max())})
        assert "saturated" not in self.list_warnings(run, "stribeck")
        assert "it is saturated; widen its range" in self.list_warnings(cut, "stribeck")


@pytest.mark.parametrize(
    ("law", "change", "message"),
    [
        ("gsm", {}, "law 'gsm' is unknown; did you mean gms"),
        ("xgms", {}, "law xgms needs the load"),
        ("stribeck", {"elements": 2}, "law stribeck has no elements"),
        ("gms", {"elements": 0}, "number of elements is 0; allowed are 1 and more"),
        ("gms", {"terms": ("lag",)}, "'lag' needs 'stribeck'"),
        ("gms", {"terms": ("fall",)}, "law gms has no term 'fall'"),
        ("gms", {"terms": ("inertia",)}, "term 'inertia' is unknown"),
        ("gms", {"starts": 0}, "number of starts is 0"),
        ("gms", {"low_pass": -1.0}, "low-pass is -1 Hz"),
        ("gms", {"low_pass": 400.0}, "allowed is below 250"),
    ],
)
def test_wrong_requests_are_told_in_a_sentence(law: str, change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        identify_friction(play(TestWarnings.MODEL), law, **change)  # type: ignore[arg-type]


def test_a_reversed_sign_and_a_constant_speed_are_told() -> None:
    run = play(TestWarnings.MODEL)
    reversed_sign = Run({**run.columns, "friction_force_n": -run["friction_force_n"]}, {})
    with pytest.raises(InputError, match="friction would drive it; reverse its sign"):
        identify_friction(reversed_sign, "gms")
    with pytest.raises(InputError, match=r"the speed is constant at 0\.005 m/s"):
        identify_friction(
            play(Coulomb(CURVE), 5e-3 * PERIOD * np.arange(N), noise=make_white_noise(N, NOISE, 6)), "stribeck"
        )


def make_heavy_saw() -> Run:
    """A heavy mass whose speed always changes fast: inertia hides the friction throughout."""
    time = 1e-3 * np.arange(8000)
    speed = np.interp(time % 2.0, [0.0, 1.6, 2.0], [-0.5, 0.5, -0.5])
    force = 50.0 * np.gradient(speed, 1e-3) + 2.0 * np.sign(speed) + make_white_noise(time.size, 0.01, 1)
    return Run({"time_s": time, "speed_m_s": speed, "force_n": force}, {})


def test_inertia_that_hides_the_friction_throughout_is_a_warning() -> None:
    result = identify_friction(make_heavy_saw(), "gms", elements=1, terms=("mass",), starts=1)
    assert any("these runs have none: beta, V_S" in text for text in result.warnings)
    assert result.mass == pytest.approx(50.0, rel=0.01)


@pytest.mark.parametrize(
    ("law", "columns", "terms", "words"),
    [
        ("xgms", {"load_n": np.zeros(N)}, None, "law xgms needs the load, and it is 0 N throughout"),
        ("gms", {"load_n": np.zeros(N)}, ("load_gain",), "'load_gain' is given, but the load is 0 throughout"),
        (
            "gms",
            {"position_m": np.where(np.arange(N) < N // 2, 0.0, 1e-3)},
            ("mass",),
            "rests in nearly all rows, and jumps",
        ),
    ],
)
def test_columns_that_say_nothing_are_one_sentence(
    law: str, columns: dict[str, np.ndarray], terms: tuple[str, ...] | None, words: str
) -> None:
    run = make_truth("gms")[0]
    with pytest.raises(InputError, match=words):
        identify_friction(replace(run, columns={**run.columns, **columns}), law, terms=terms, elements=1, starts=1)
