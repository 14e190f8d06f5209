"""Identify first: a rig that is only calibrated otherwise lacks no effect, and is told so, with what moved how far.

Thirty rigs are `python -m benchmarks.calibration_first`.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.battery.truth_rig import BAR, draw_rig
from benchmarks.calibration_first import COURSES, KINDS, play_closed_loop
from benchmarks.identification import Hidden, draw, play
from clutch_hil.discrepancy.decision import CLOSED_EXCESS
from clutch_hil.discrepancy.identify_first import is_as_stated, note_limits, note_rest
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.outcome import Discrepancy, find_discrepancy
from clutch_hil.discrepancy.recalibration import Moved, Recalibration
from clutch_hil.discrepancy.result import Estimate
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.model import Candidate, Columns, Output, Values
from clutch_hil.fitting.noise import estimate_floors
from clutch_hil.fitting.recalibration import FLOOR
from clutch_hil.identify.clutch_effects import PRESSURE, SENSORS
from clutch_hil.identify.clutch_recalibration import recalibrate_clutch
from plant_sim.effects.effect import Strength
from plant_sim.rigs import wet_clutch
from protocols.files.parameters import Parameter, ParameterSet

SOURCE = "a test's"
NOISE = 0.05  # V
EXAMPLE = {"coulomb_slope": 17.0, "viscous_exponent": 0.4, "stribeck_speed": 6.0, "attraction": 40.0}  # of issue 31
CONTACT = 2.65  # bar
OFFSET = 0.04  # bar, of a pressure sensor: eight deviations of its noise


def make_example() -> np.ndarray:
    """The clutch of docs/identify_method.md; the zeros of its torque lines lie at the contact pressure as the thesis's do."""
    rig, nominal = draw_rig(), draw_rig()
    for name, value in EXAMPLE.items():
        rig[f"clutch_{name}"] = value / (BAR if name == "coulomb_slope" else 1.0)
    rig["piston_contact_pressure"] = CONTACT * BAR
    for line in ("coulomb", "viscous"):
        zero = nominal[f"clutch_{line}_intercept"] / nominal[f"clutch_{line}_slope"]
        rig[f"clutch_{line}_intercept"] = rig[f"clutch_{line}_slope"] * zero * CONTACT * BAR
        rig[f"clutch_{line}_intercept"] /= nominal["piston_contact_pressure"]
    rig["clutch_beta_onset"] += rig["piston_contact_pressure"] - nominal["piston_contact_pressure"]
    springs = rig["piston_contact_pressure"] - rig["piston_preload_pressure"]
    rig["piston_spring_stiffness"] = rig["piston_area"] * springs / rig["piston_clearance"]
    return rig


@pytest.fixture(scope="module")
def example() -> Discrepancy:
    return find_discrepancy(play(make_example(), 1, names=COURSES))


def test_the_clutch_of_the_issue_is_to_be_identified_first(example: Discrepancy) -> None:
    assert (example.result.verdict, example.result.effects, example.result.alternatives) == ("identify_first", [], [])
    assert str(example).startswith("identify first: ")
    assert "clutch-hil identify RUN... --out FOLDER" in str(example)
    recalibration = example.result.recalibration
    assert recalibration is not None
    moved = {one.name: one for one in recalibration.moved}
    for name, value in EXAMPLE.items():
        assert moved[f"clutch.{name}"].value == pytest.approx(value, rel=0.02)
    assert moved["clutch.coulomb_slope"].sigmas == pytest.approx((17.0 - 10.8) / 0.3, rel=0.02)
    assert moved["piston.contact_pressure"].value == pytest.approx(CONTACT, abs=0.03)  # its stated uncertainty


def test_its_report_says_what_moved_and_names_no_parameter_of_an_effect(example: Discrepancy, tmp_path) -> None:
    files = {path.name: path for path in example.write(tmp_path)}
    page = files["report.html"].read_text(encoding="utf-8")
    assert "Identify the rig first" in page
    assert "clutch.coulomb_slope" in page
    assert "[friction_level]" not in files["model.toml"].read_text(encoding="utf-8")


def test_its_notes_say_which_uncertainty_to_state(example: Discrepancy) -> None:
    (note,) = [
        note for note in example.result.notes if note.startswith("uncertainties that would allow the calibration")
    ]
    assert "(0.5 of each is used)" in note
    assert "clutch.coulomb_slope 12 Nm/bar; " in note  # 6.2 Nm/bar over 0.5
    assert "clutch.stribeck_speed 11 rad/s" in note


@pytest.mark.parametrize(
    ("seed", "kind", "profile"),
    [
        (7, "all by 30 %", "table-6.6"),
        (16, "all by 30 %", "table-6.6"),
        (24, "all by 30 %", "engagement"),
        (2, "five by 30 %", "engagement"),  # no ramp, and a contact pressure 0.45 bar off
    ],
)
def test_one_closed_loop_of_such_a_rig_is_enough(seed: int, kind: str, profile: str) -> None:
    """It excites V_S, C and the motor's inertia too little for an interval, and they move it by far more than its noise."""
    outcome = find_discrepancy([play_closed_loop(seed, kind, profile)])
    assert (outcome.result.verdict, outcome.result.effects) == ("identify_first", [])


def state_offset(value: float, uncertainty: float) -> WetClutch:
    """A model whose pressure sensor may be off by an offset of this value and uncertainty [bar]."""
    nominal = wet_clutch.load_nominal()
    stated = replace(nominal[PRESSURE], value=value, uncertainty=uncertainty)
    return WetClutch(ParameterSet({**nominal, PRESSURE: stated}))


def test_offsets_are_part_of_a_baseline_only_where_their_uncertainty_is_stated() -> None:
    plain = set(WetClutch().parameters)
    assert not plain & set(SENSORS)
    assert set(state_offset(0.0, 0.02).parameters) - plain == {PRESSURE}
    assert set(state_offset(0.03, 0.0).parameters) == plain


def test_a_recalibration_fits_an_offset_whose_uncertainty_is_stated() -> None:
    rig = draw(4, *KINDS["all by 10 %"])
    runs = [run.columns for run in play(rig, 4, Hidden(pressure=OFFSET), names=("fills",))]
    floors = estimate_floors(runs, WetClutch.outputs)
    left = {}
    for uncertainty in (0.0, 0.02):
        model = state_offset(0.0, uncertainty)
        evidence = Evidence(model, runs, floors)
        values = recalibrate_clutch(model, evidence, {n: p.value for n, p in model.parameters.items()})
        left[uncertainty] = evidence.compute_excess(evidence.compute_residuals([(values, {})])[0])
    assert values[PRESSURE] == pytest.approx(OFFSET, abs=0.003)
    assert left[0.02] < FLOOR < left[0.0]


class Filter:
    """y = gain u + curve u^2, delayed by nothing; a cubic or a louder output may be missing."""

    name = "filter"
    inputs = ("input_v",)
    outputs = (Output("output_v", "V", "filter"),)
    parameters = ParameterSet(
        {"gain.value": Parameter("gain.value", 2.0, "1", 0.02, (0.0, 10.0), SOURCE),
         "curve.value": Parameter("curve.value", 0.5, "1/V", 0.01, (-5.0, 5.0), SOURCE)}
    )  # fmt: skip
    candidates = (
        Candidate("cubic", "filter", "Cubic", "y + c u^3", (Strength("share", "1", 0.0, 0.2, (0.0, 5.0), SOURCE),)),
        Candidate("louder", "filter", "Louder", "(1 + l) y", (Strength("share", "1", 0.0, 0.2, (-0.9, 5.0), SOURCE),)),
    )

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        u = run["input_v"]
        y = parameters["gain.value"] * u + parameters["curve.value"] * u**2 + effects.get("cubic.share", 0.0) * u**3
        return {"output_v": (1.0 + effects.get("louder.share", 0.0)) * y}


def record(parameters: Values, effects: Values) -> dict[str, Columns]:
    runs: dict[str, Columns] = {}
    for seed in (1, 2, 3):
        time = 1e-3 * np.arange(4000)
        u = np.sin((3.0 + seed) * time) + 0.6 * np.sin(7.1 * seed * time)
        run = {"time_s": time, "input_v": u}
        y = Filter().simulate(run, parameters, effects)["output_v"]
        runs[f"run-{seed}"] = run | {"output_v": y + NOISE * np.random.default_rng(seed).standard_normal(len(time))}
    return runs


def test_a_model_without_an_identification_says_what_to_state() -> None:
    result = investigate(Filter(), record({"gain.value": 2.6, "curve.value": 0.1}, {}))
    assert (result.verdict, result.effects) == ("identify_first", [])
    assert result.recalibration is not None
    assert result.recalibration.command is None
    assert [one.name for one in result.recalibration.moved] == ["curve.value", "gain.value"]
    assert result.recalibration.moved[1].value == pytest.approx(2.6, abs=0.01)
    assert "state these values" in result.recalibration.advice
    assert any("(1 of each is used): curve.value 0.4 1/V; gain.value 0.6; state them" in note for note in result.notes)


def test_one_effect_that_explains_as_well_stays_named_and_a_note_has_the_calibration() -> None:
    """Parsimony: gain and curve that are both wrong by a fifth are the same data as one louder output."""
    result = investigate(Filter(), record({"gain.value": 2.4, "curve.value": 0.6}, {}))
    assert (result.verdict, result.effects) == ("named", ["louder"])
    assert result.recalibration is not None
    assert result.recalibration.equals
    (note,) = [one for one in result.notes if "cannot tell which is right" in one]
    assert "gain.value 2 -> 2.4" in note
    assert "curve.value 0.5 -> 0." in note


def test_an_effect_that_no_calibration_imitates_stays_named() -> None:
    result = investigate(Filter(), record({"gain.value": 2.0, "curve.value": 0.5}, {"cubic.share": 0.3}))
    assert (result.verdict, result.effects) == ("named", ["cubic"])
    assert result.recalibration is None or not result.recalibration.equals
    assert not any("cannot tell which is right" in note for note in result.notes)


def test_where_nothing_disagrees_nothing_is_looked_for() -> None:
    result = investigate(Filter(), record({"gain.value": 2.0, "curve.value": 0.5}, {}))
    assert (result.verdict, result.recalibration, result.notes) == ("nothing_missing", None, [])
    assert result.as_json()["recalibration"] is None


MOVED = Moved("gain.value", 2.0, 2.6, "1", 0.02)
FOUND = Recalibration((MOVED,), before=10.0, after=1.0, effects=3.0, margin=0.1, command=None)


def test_a_calibration_that_explains_much_but_not_all_is_noted() -> None:
    assert not FOUND.explains
    (note,) = note_rest(FOUND, True)
    assert "explains 90.0% of the disagreement by itself" in note
    assert "gain.value 2 -> 2.6 (30.0 stated uncertainties)" in note
    assert note_rest(replace(FOUND, effects=1.5), False) == []


@pytest.mark.parametrize("after", [0.0, 0.09, 2.0, 3.0])
def test_a_calibration_that_explains_as_much_as_what_is_named_is_noted(after: float) -> None:
    as_much = replace(FOUND, after=after, effects=3.0 if after > 0.1 else 0.01)
    assert as_much.equals
    assert not as_much.explains
    (note,) = note_rest(as_much, True)
    assert "explains as much as what is named: gain.value 2 -> 2.6" in note
    assert note_rest(as_much, False) == []
    assert not replace(as_much, after=3.1).equals


def test_a_calibration_that_leaves_a_tenth_of_what_effects_leave_comes_first() -> None:
    assert replace(FOUND, effects=10.1).explains
    assert not replace(FOUND, effects=9.9).explains
    (note,) = note_rest(replace(FOUND, effects=10.1), True)
    assert (
        note
        == "even after re-calibration the model leaves 1 times the power of the noise floor: an effect may also be missing;"
        + (" identify, then search again")
    )
    assert note_rest(replace(FOUND, after=0.05), True) == []


def test_effects_must_leave_more_by_a_margin() -> None:
    assert replace(FOUND, after=0.05).explains
    assert not replace(FOUND, after=0.05, effects=0.14).explains


def test_beside_several_effects_a_likely_calibration_comes_first() -> None:
    as_well = replace(FOUND, after=CLOSED_EXCESS, effects=0.0, margin=CLOSED_EXCESS)
    assert not as_well.explains
    assert replace(as_well, likely=True).explains
    assert not replace(as_well, likely=True, after=1.01 * CLOSED_EXCESS).explains


def test_where_the_baseline_leaves_nothing_a_calibration_explains_all() -> None:
    assert replace(FOUND, before=0.0, after=0.0, effects=0.0, likely=True).closed == 1.0
    assert FOUND.closed == pytest.approx(0.9)


@pytest.mark.parametrize(("sigmas", "as_stated"), [(0.0, True), (1.0, True), (1.5, False), (30.0, False)])
def test_a_calibration_is_as_stated_unless_it_is_rare(sigmas: float, as_stated: bool) -> None:
    moved = [Moved(f"p{k}.value", 2.0, 2.0 + 0.1 * sigmas * (-1) ** k, "1", 0.1) for k in range(30)]
    assert is_as_stated(moved) == as_stated
    assert is_as_stated([*moved[:-1], Moved("gain.value", 2.0, 3.0, "1", 0.1)]) is False  # one by ten uncertainties


def test_a_parameter_without_a_stated_uncertainty_that_moved_far_is_not_as_stated() -> None:
    assert is_as_stated([Moved("gain.value", 2.0, 2.2, "1", 0.0)])
    assert not is_as_stated([Moved("gain.value", 2.0, 2.6, "1", 0.0)])


def test_only_a_parameter_at_its_limit_is_noted() -> None:
    at = Estimate("gain.value", 2.02, "1", (2.02, 2.02), 2.0, 0.02)
    assert note_limits(Filter(), [replace(at, value=2.015)], None) == []
    (note,) = note_limits(Filter(), [at], None)
    assert note.endswith(
        "2.02 where 2 +- 0.02 is stated and a share of 1 of it is allowed; state a larger uncertainty, or identify it"
    )
