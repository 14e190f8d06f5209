"""Fits: bounded least squares with priors, every effect beside the baseline, and when two are told apart."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from clutch_hil.discrepancy.candidates import CandidateSearch
from clutch_hil.discrepancy.decision import (
    CLOSED_BY_FURTHER,
    CLOSED_BY_LARGE,
    LARGE_SHARE,
    RUNNER_UP_SHARE,
    Explanation,
)
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import (
    CHI2_QUANTILE,
    FreeParameter,
    LinearModel,
    free_baseline,
    free_effect,
    linearise,
    refit,
)
from clutch_hil.fitting.model import Candidate, Columns, Evident, Output, Values
from clutch_hil.fitting.noise import estimate_floors, estimate_noise, pool_noise
from plant_sim.effects.effect import Shape, Strength
from protocols.errors import InputError
from protocols.files.parameters import Parameter, ParameterSet

NOISE = 0.05  # V
POWER = 0.15  # mean square of 1000 residuals: three standard deviations, sqrt(2/1000) each
TRUE_GAIN = 2.03  # declared 2.0 +- 0.1
PARAMETERS = ParameterSet(
    {"gain.value": Parameter("gain.value", 2.0, "1", 0.1, (0.0, 10.0), "a test's"),
     "lag.time": Parameter("lag.time", 0.05, "s", 0.0, (0.001, 1.0), "a test's")}
)  # fmt: skip
SOURCE = "a test's"


class Amplifier:
    """y = gain u, perhaps with an offset, a cubic, a saturation."""

    name = "amplifier"
    inputs = ("input_v",)
    outputs = (Output("output_v", "V", "amplifier"),)
    parameters = PARAMETERS
    candidates = (
        Candidate("offset", "amplifier", "Offset", "y + o", (Strength("volts", "V", 0.0, 0.3, (-2.0, 2.0), SOURCE),)),
        Candidate("cubic", "amplifier", "Cubic", "y + c u^3", (Strength("share", "1", 0.0, 0.2, (0.0, 5.0), SOURCE),)),
        Candidate(
            "saturation", "amplifier", "Saturation", "limit tanh(y/limit)",
            (Strength("inverse", "1", 0.0, 0.2, (0.0, 2.0), SOURCE),),
        ),
        Candidate(
            "ripple", "amplifier", "Ripple", "y + a sin(w t)",
            (Strength("amplitude", "V", 0.0, 0.2, (0.0, 2.0), SOURCE), Shape("rate", "rad/s", 3.0, (0.5, 50.0), SOURCE)),
        ),
    )  # fmt: skip

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        u = run["input_v"]
        y = parameters["gain.value"] * u + effects.get("cubic.share", 0.0) * u**3 + effects.get("offset.volts", 0.0)
        y = y + effects.get("ripple.amplitude", 0.0) * np.sin(effects.get("ripple.rate", 3.0) * run["time_s"])
        if inverse := effects.get("saturation.inverse", 0.0):
            y = np.tanh(inverse * y) / inverse
        return {"output_v": y}


def record_run(seed: int, effects: Values, n: int = 4000, noise: float = NOISE) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    time = 1e-3 * np.arange(n)
    run = {"time_s": time, "input_v": np.sin(2.0 * time + seed) + 0.3 * np.sin(7.3 * time)}
    y = Amplifier().simulate(run, {"gain.value": TRUE_GAIN}, effects)["output_v"]
    return run | {"output_v": y + noise * random.standard_normal(n)}


def make_runs(effects: Values) -> dict[str, Columns]:
    return {f"run-{seed}": record_run(seed, effects) for seed in range(1, 4)}


def make_linear_model(effects: Values, point: Values | None = None) -> tuple[Evidence, LinearModel]:
    model, measured = Amplifier(), list(make_runs(effects).values())
    evidence = Evidence(model, measured, estimate_floors(measured, model.outputs))
    nominal = {n: p.value for n, p in model.parameters.items()} | dict(point or {})
    return evidence, linearise(evidence, (nominal, {}), free_baseline(model.parameters, 1.0))


def test_the_floor_of_white_noise_is_its_standard_deviation_whatever_the_signal() -> None:
    for effects in ({}, {"cubic.share": 0.5}):
        assert estimate_noise(record_run(1, effects)["output_v"]) == pytest.approx(NOISE, rel=0.03)


def test_the_floor_of_a_rounded_signal_is_not_below_its_rounding() -> None:
    time = np.arange(2000) * 1e-3
    assert estimate_noise(0.1 * np.round(10.0 * np.sin(time))) == pytest.approx(0.1 / np.sqrt(12.0))


def test_residuals_of_the_true_model_have_unit_variance() -> None:
    evidence, _ = make_linear_model({})
    (residual,) = evidence.compute_residuals([({"gain.value": TRUE_GAIN, "lag.time": 0.05}, {})])
    assert np.mean(residual**2) == pytest.approx(1.0, abs=0.08)
    assert evidence.compute_excess(residual) < 0.08


def test_runs_of_different_rates_each_have_the_noise_of_their_means() -> None:
    """A mean over 4 ms has four samples at 1 kHz, and one at 250 Hz."""
    runs = list(make_runs({}).values())
    slow = {name: values[::4] for name, values in record_run(4, {}, n=16000).items()}
    for mixed in ([*runs, slow], [slow, slow, slow, runs[0]]):
        evidence = Evidence(Amplifier(), mixed, estimate_floors(mixed, Amplifier.outputs))
        (residual,) = evidence.compute_residuals([({"gain.value": TRUE_GAIN, "lag.time": 0.05}, {})])
        assert [np.mean(residual[piece] ** 2) for piece in evidence.pieces] == pytest.approx([1.0] * 4, abs=POWER)


def test_a_noisier_run_has_its_own_noise_and_a_quieter_one_that_of_the_others() -> None:
    runs = list(make_runs({}).values())
    for noise, power in ((3.0 * NOISE, 1.0), (0.2 * NOISE, 0.04)):
        mixed = [*runs, record_run(4, {}, noise=noise)]
        floors = estimate_floors(mixed, Amplifier.outputs)
        evidence = Evidence(Amplifier(), mixed, floors)
        (residual,) = evidence.compute_residuals([({"gain.value": TRUE_GAIN, "lag.time": 0.05}, {})])
        powers = [np.mean(residual[piece] ** 2) for piece in evidence.pieces]
        assert powers[:3] == pytest.approx([1.0] * 3, abs=POWER)
        assert powers[3] == pytest.approx(power, rel=POWER), "of what it would have with the noise of the others"
        pooled = np.sqrt(np.mean([NOISE**2] * 3 + [max(noise, NOISE) ** 2]))
        assert pool_noise([run["output_v"] for run in mixed], floors["output_v"]) == pytest.approx(pooled, rel=0.05)


def test_a_vibration_in_one_run_is_not_all_taken_for_its_noise() -> None:
    """At 120 Hz third differences take a part of it for noise; means over 4 ms still show it."""
    runs = list(make_runs({}).values())
    vibrating = dict(record_run(4, {}))
    vibrating["output_v"] = vibrating["output_v"] + 8.0 * NOISE * np.sin(2.0 * np.pi * 120.0 * vibrating["time_s"])
    mixed = [*runs, vibrating]
    floors = estimate_floors(mixed, Amplifier.outputs)
    assert estimate_noise(vibrating["output_v"]) > 1.1 * floors["output_v"]
    evidence = Evidence(Amplifier(), mixed, floors)
    (residual,) = evidence.compute_residuals([({"gain.value": TRUE_GAIN, "lag.time": 0.05}, {})])
    assert np.mean(residual[evidence.pieces[3]] ** 2) > 2.0


def test_what_is_sampled_slowly_tells_by_itself() -> None:
    """Within 0.4 s residuals tell as much as one: a hundred blocks of 4 ms, forty samples of 10 ms, one of a second."""
    run = record_run(1, {})
    for period, redundancy in ((1e-3, 100.0), (1e-2, 40.0), (1.0, 1.0)):
        slower = run | {"time_s": run["time_s"] * period / 1e-3}
        assert Evidence(Amplifier(), [slower], {"output_v": NOISE}).redundancy == pytest.approx(redundancy)


def test_a_calibration_error_is_fitted_and_leaves_no_excess() -> None:
    evidence, at = make_linear_model({})
    outcome = refit(evidence, at)
    assert outcome.point[0]["gain.value"] == pytest.approx(TRUE_GAIN, abs=0.003)
    assert evidence.compute_excess(outcome.residual) < 0.08 < evidence.compute_excess(at.residual)


def test_a_parameter_without_uncertainty_stays() -> None:
    evidence, at = make_linear_model({})
    assert [f.name for f in at.free] == ["gain.value"]
    assert refit(evidence, at).point[0]["lag.time"] == 0.05


def test_a_refit_stays_within_the_stated_uncertainty() -> None:
    evidence, at = make_linear_model({"saturation.inverse": 0.4})  # which asks for a much lower gain
    outcome = refit(evidence, at)
    assert outcome.point[0]["gain.value"] == pytest.approx(1.9)  # 2.0 - 0.1


@pytest.mark.parametrize("redundancy", [1.0, 100.0])
def test_a_bounded_minimum_is_the_least_in_the_box(redundancy: float) -> None:
    random = np.random.default_rng(4)
    jacobian, residual = random.standard_normal((300, 3)), random.standard_normal(300)
    residual -= jacobian @ np.array([2.0, -0.2, 0.4])
    free = tuple(FreeParameter(name, 0.1, 1.0, -1.0, 1.0, 0.0) for name in "abc")
    at = LinearModel(({"a": 0.0, "b": 0.0, "c": 0.0}, {}), free, residual, jacobian, redundancy)
    left = at.eliminate(residual)
    assert left.move[0] == pytest.approx(1.0)
    assert list(left.inner) == [1, 2]
    for trial in random.uniform(-1.0, 1.0, (2000, 3)):
        cost = np.sum((residual + jacobian @ trial) ** 2) + redundancy * trial @ trial
        assert cost >= left.cost - 1e-9


@pytest.mark.parametrize("size", [1.0, 2.5])
def test_parameters_may_each_be_off_but_not_all_at_once(size: float) -> None:
    count, limit = 30, chi2.ppf(CHI2_QUANTILE, 30)
    random = np.random.default_rng(5)
    jacobian = 100.0 * random.standard_normal((300, count))
    wanted = size * np.sign(random.standard_normal(count))
    names = [f"p{i}" for i in range(count)]
    free = tuple(FreeParameter(name, 0.1, 1.0, -3.0, 3.0, 0.0) for name in names)
    at = LinearModel((dict.fromkeys(names, 0.0), {}), free, -jacobian @ wanted, jacobian, 1.0)
    left = at.eliminate(at.residual)
    if count * size**2 <= limit:  # 30: likely
        assert left.move == pytest.approx(wanted, rel=1e-3)
        assert left.weight == 1.0
    else:  # 187: each within 3, but not all
        assert 0.85 * limit < left.move @ left.move <= limit
        assert np.corrcoef(left.move, wanted)[0, 1] > 0.95
    assert left.cost == pytest.approx(np.sum((at.residual + jacobian @ left.move) ** 2) + left.move @ left.move)


def test_one_parameter_may_be_off_as_far_as_it_may() -> None:
    jacobian = 100.0 * np.ones((300, 1))
    free = (FreeParameter("p", 0.1, 1.0, -3.0, 3.0, 0.0),)
    at = LinearModel(({"p": 0.0}, {}), free, -3.0 * jacobian[:, 0], jacobian, 1.0)
    assert at.eliminate(at.residual).move == pytest.approx([3.0], rel=1e-3)


def test_each_hidden_effect_is_the_best_of_the_screened() -> None:
    model = Amplifier()
    for name, hidden in (
        ("offset", {"offset.volts": 0.4}),
        ("cubic", {"cubic.share": 0.3}),
        ("saturation", {"saturation.inverse": 0.3}),
    ):
        evidence, at = make_linear_model(hidden)
        search = CandidateSearch(evidence, at)
        best, *_ = search.improve(search.screen(model.candidates, {}), 2)
        assert best.name == name
        assert best.values[next(iter(hidden))] == pytest.approx(next(iter(hidden.values())), rel=0.05)


class Stiff(Amplifier):
    """An amplifier whose disturbance grows less than its strength does: where it is off it seems to need little."""

    candidates = (
        Candidate("hum", "amplifier", "Hum", "y + root(s) sin 60 t", (Strength("size", "V^2", 0.0, 0.01, (0.0, 4.0), SOURCE),)),
    )  # fmt: skip

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        y = super().simulate(run, parameters, effects)["output_v"]
        return {"output_v": y + np.sqrt(effects.get("hum.size", 0.0)) * np.sin(60.0 * run["time_s"])}


def test_a_step_is_made_longer_while_that_pays() -> None:
    model, hidden = Stiff(), 0.64  # predicted from 0.01: root(0.64 0.01) = 0.08
    run = record_run(1, {})
    run = run | {"output_v": run["output_v"] + np.sqrt(hidden) * np.sin(60.0 * run["time_s"])}
    evidence = Evidence(model, [run], estimate_floors([run], model.outputs))
    nominal = {n: p.value for n, p in model.parameters.items()}
    search = CandidateSearch(evidence, linearise(evidence, (nominal, {}), free_baseline(model.parameters, 1.0)))
    (fit,) = search.screen(model.candidates, {})
    assert fit.values["hum.size"] == pytest.approx(hidden, rel=0.01)  # measured 8e-4


def test_a_further_effect_mends_most_or_much_of_what_is_left() -> None:
    """Half of it and no small part of the excess, or such a part while no other does nearly as well."""
    explanation = Explanation(base=9000.0, best=1000.0, size=1000, count=1, excess=8.0, rest=0.2)
    assert explanation.justifies_further(1.01 * CLOSED_BY_FURTHER * 0.2, 0.0)
    assert not explanation.justifies_further(0.99 * CLOSED_BY_FURTHER * 0.2, 0.0)  # less than the part of 8
    small = replace(explanation, excess=0.5)
    much = 1.01 * LARGE_SHARE * 0.5  # a tenth of what is left
    assert small.justifies_further(1.01 * CLOSED_BY_LARGE * 0.2, 0.2)
    assert not small.justifies_further(0.99 * CLOSED_BY_LARGE * 0.2, 0.2)
    assert small.justifies_further(much, 0.99 * RUNNER_UP_SHARE * much)
    assert not small.justifies_further(much, 1.01 * RUNNER_UP_SHARE * much)
    assert not small.justifies_further(0.99 * LARGE_SHARE * 0.5, 0.0)


def test_the_step_of_a_ripples_rate_is_shortened_until_it_is_small_after_many_turns() -> None:
    hidden = {"ripple.amplitude": 0.5, "ripple.rate": 30.0}
    model, measured = Amplifier(), [record_run(1, hidden, n=20_000)]
    evidence = Evidence(model, measured, estimate_floors(measured, model.outputs))
    point = {n: p.value for n, p in model.parameters.items()}, hidden
    amplitude, rate = linearise(evidence, point, free_effect(model.candidates[3], hidden)).free
    assert amplitude.step == pytest.approx(0.05 * 0.5)
    assert rate.step < 0.1 < 0.05 * 30.0  # 0.1 rad/s are 2 rad after 20 s


def test_a_hidden_effect_is_named_and_the_gap_closes_on_a_run_that_was_not_fitted() -> None:
    hidden = {"cubic.share": 0.3}
    result = investigate(Amplifier(), make_runs(hidden), {"other": record_run(9, hidden)})
    assert (result.verdict, result.effects) == ("named", ["cubic"])
    gap = result.gap["output_v"]
    assert gap.before > 2.0 * NOISE
    assert gap.after == pytest.approx(NOISE, rel=0.05)
    (estimate,) = result.parameters
    assert estimate.ci95[0] <= 0.3 <= estimate.ci95[1]


def test_nothing_is_named_where_nothing_is_hidden() -> None:
    result = investigate(Amplifier(), make_runs({}))
    assert (result.verdict, result.effects, result.parameters, result.where) == ("nothing_missing", [], [], [])
    assert result.gap["output_v"].after == result.gap["output_v"].before


def test_two_hidden_effects_are_both_named() -> None:
    result = investigate(Amplifier(), make_runs({"cubic.share": 0.3, "offset.volts": 0.3}))
    assert result.verdict == "named"
    assert sorted(result.effects) == ["cubic", "offset"]


def test_an_effect_that_no_candidate_explains_is_not_named() -> None:
    measured = {
        name: run | {"output_v": run["output_v"] + 0.4 * np.sign(np.sin(61.0 * run["time_s"]))}
        for name, run in make_runs({}).items()
    }
    result = investigate(Amplifier(), measured, names=["offset", "cubic", "saturation"])
    assert (result.verdict, result.effects) == ("none_of_these", [])


class Witnessed(Amplifier):
    """An amplifier whose recordings show a ripple by themselves; zero and offset are one thing by two names."""

    candidates = (
        *Amplifier.candidates,
        Candidate("zero", "amplifier", "Zero", "y + o", (Strength("volts", "V", 0.0, 0.3, (-2.0, 2.0), SOURCE),)),
    )  # fmt: skip

    def find_evident_effects(self, runs: Sequence[Columns]) -> dict[str, Evident]:
        return {"ripple": Evident({"ripple.amplitude": (0.0, 0.0, 0.0)}, {}, "so it was made")}

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        y = super().simulate(run, parameters, effects)["output_v"]
        return {"output_v": y + effects.get("zero.volts", 0.0)}


def test_beside_what_is_evident_a_disagreement_is_named_and_nothing_slight() -> None:
    small = {"offset.volts": 0.008}  # less than a tenth of the floor's power in means over 4 ms
    assert investigate(Amplifier(), make_runs(small)).verdict == "one_of", "where nothing is evident it is told"
    alone = investigate(Witnessed(), make_runs(small))
    assert (alone.verdict, alone.effects, alone.alternatives) == ("named", ["ripple"], [])
    assert investigate(Witnessed(), make_runs({"cubic.share": 0.3})).effects == ["ripple", "cubic"]
    either = investigate(Witnessed(), make_runs({"offset.volts": 0.3}))
    assert (either.verdict, either.effects) == ("one_of", ["ripple"])
    assert set(either.alternatives[0]) == {"offset", "zero"}


def test_only_candidates_of_the_rig_can_be_asked_for() -> None:
    with pytest.raises(InputError, match=r"effect 'cubik' is not a candidate of the rig amplifier; .*cubic"):
        investigate(Amplifier(), make_runs({}), names=["cubik"])


def test_what_no_candidate_explains_is_described_in_the_models_own_inputs() -> None:
    """Also where it is a simple function of one of them."""
    measured = {
        name: run | {"output_v": run["output_v"] + 0.5 * run["input_v"] ** 2} for name, run in make_runs({}).items()
    }
    result = investigate(Amplifier(), measured, names=["ripple"])
    assert result.verdict == "none_of_these"
    assert result.surrogate is not None
    assert "input_v" in result.surrogate["variables"]
    assert "quadratic in input_v" in result.surrogate["sentence"]


def test_what_makes_an_output_worse_is_contradicted_whatever_it_mends() -> None:
    """Each output counts above its floor: what is below makes up for nothing."""
    model, n = WetClutch(), 8000
    rows = {output.column: np.random.default_rng(1).standard_normal(n) for output in model.outputs}
    evidence = Evidence(model, [{"time_s": 1e-3 * np.arange(n)} | rows], dict.fromkeys(rows, 1.0))
    before, after = np.ones(evidence.size), np.full(evidence.size, 0.5)
    torque, pressure = evidence.find_part(0, "clutch_torque_nm"), evidence.find_part(0, "cylinder_pressure_bar")
    before[torque], after[pressure] = 3.0, 2.0  # mends 8 floors^2 of torque, spoils pressure by 3
    assert evidence.compute_contradiction(after, before) == pytest.approx(3.0 / 5)
    assert evidence.compute_contradiction(before, before) == 0.0


def test_no_output_outweighs_the_others() -> None:
    """Of one that is off by 100 floors a tenth may be the law's: sigma^2 = 1 + 10^2. What is at its floor weighs as before."""
    model, n = WetClutch(), 8000
    rows = {output.column: np.random.default_rng(1).standard_normal(n) for output in model.outputs}
    evidence = Evidence(model, [{"time_s": 1e-3 * np.arange(n)} | rows], dict.fromkeys(rows, 1.0))
    slip, torque = evidence.find_part(0, "slip_speed_rad_s"), evidence.find_part(0, "clutch_torque_nm")
    before = np.ones(evidence.size)
    before[slip] = np.sqrt(1.0 + 100.0**2)
    with_tolerance = evidence.with_tolerance(before)
    share = with_tolerance.weights / evidence.weights
    assert share[slip] == pytest.approx(1.0 / np.sqrt(1.0 + 10.0**2))
    assert share[torque] == pytest.approx(1.0)
    assert with_tolerance.compute_excess(share * 1.0) == pytest.approx(
        0.0, abs=1e-12
    )  # noise alone, in its new measure
    assert with_tolerance.compute_excess_by_run(share * before) == pytest.approx([100.0**2 / (1.0 + 10.0**2) / 5])


class Fragile(Amplifier):
    """An amplifier that cannot be simulated with two effects at once."""

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
        if effects.get("offset.volts", 0.0) and effects.get("cubic.share", 0.0):
            raise InputError("an offset and a cubic at once cannot be simulated")
        return super().simulate(run, parameters, effects)


def test_a_pair_that_cannot_be_simulated_is_not_taken() -> None:
    """And breaks nothing."""
    result = investigate(Fragile(), make_runs({"offset.volts": 0.4, "cubic.share": 0.2}))
    assert set(result.effects) != {"offset", "cubic"}
