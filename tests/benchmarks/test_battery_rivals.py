"""The battery's rivals do what their methods promise, on made-up residuals."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.battery.rivals import gaussian_process
from benchmarks.battery.rivals.__main__ import main
from benchmarks.battery.rivals.features import compute_features
from benchmarks.battery.rivals.residuals import INPUTS, OUTPUTS, PERIOD, ResidualData
from benchmarks.battery.rivals.verdict_limits import answer_by_limits, tune_limits
from clutch_hil.command import make_command
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING
from protocols.errors import InputError
from tests import needs

TORQUE, PRESSURE = OUTPUTS.index("clutch_torque_nm"), OUTPUTS.index("cylinder_pressure_bar")
SAMPLES = 3000


def make_data(add) -> ResidualData:
    """Two runs with residuals of unit noise and what `add` makes of the predicted outputs."""
    t, random = PERIOD * np.arange(SAMPLES), np.random.default_rng(1)
    one = [
        3.2 + 0.8 * np.sin(2.1 * t),
        15 + 5 * np.sin(1.3 * t),
        15 + 5 * np.sin(1.3 * t),
        10 + 8 * np.sin(0.9 * t),
        70 + t,
    ]
    predicted = np.array([one, [values[::-1] for values in one]])
    inputs = np.array([[one[PRESSURE] / 2.5, one[3], np.cumsum(one[3]) * PERIOD]] * 2)
    assert (len(OUTPUTS), len(INPUTS)) == (5, 3)
    return ResidualData(random.standard_normal(predicted.shape) + add(predicted), predicted, inputs, 1.0)


def scale_residual(predicted: np.ndarray) -> np.ndarray:
    residuals = np.zeros_like(predicted)
    residuals[:, TORQUE] = 0.1 * predicted[:, TORQUE]
    return residuals


def test_sparse_regression_finds_a_term():
    needs.skip_without("pysindy")
    from benchmarks.battery.rivals import sindy

    ranking = sindy.rank_effects(make_data(scale_residual))
    assert ranking[0][0] == "torque_sensor_gain"
    assert ranking[0][1] > 0.2


def test_marginal_likelihood_and_its_gradient_are_those_of_scikit_learn():
    needs.skip_without("sklearn")
    from sklearn import gaussian_process as process
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    random = np.random.default_rng(1)
    x, y = random.standard_normal((40, 3)), random.standard_normal(40)
    kernel = ConstantKernel(1.0) * RBF(np.ones(3)) + WhiteKernel(1.0)
    regressor = process.GaussianProcessRegressor(kernel, optimizer=None, alpha=0.0).fit(x, y)
    apart = (x.T[:, :, None] - x.T[:, None, :]) ** 2
    for logs in random.uniform(-1.0, 1.0, (5, 5)):
        value, gradient = regressor.log_marginal_likelihood(logs, eval_gradient=True)
        ours, by = gaussian_process.compute_loss(logs, apart, y)
        assert ours == pytest.approx(-value, rel=1e-10)  # the same formula: rounding alone
        assert by == pytest.approx(-gradient, rel=1e-8)


def test_gaussian_process_looks_like_the_effect_that_made_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(gaussian_process, "_SUBSET_SIZE", 120)
    case = make_data(scale_residual)
    other = np.zeros_like(case.predicted)
    other[:, PRESSURE] = 1.0
    ranking = gaussian_process.rank_effects(
        case, {"pressure_sensor_offset": other, "torque_sensor_gain": scale_residual(case.predicted)}
    )
    assert ranking[0][0] == "torque_sensor_gain"
    assert ranking[0][1] > 0.8
    assert ranking[1][1] < 0.3


def test_classifier_tells_classes_it_was_not_shown(monkeypatch: pytest.MonkeyPatch):
    needs.skip_without("sklearn")
    from sklearn import ensemble

    from benchmarks.battery.rivals import classifier

    monkeypatch.setattr(classifier, "_make_forests", lambda: [ensemble.RandomForestClassifier(20, random_state=1)])
    x = np.random.default_rng(1).standard_normal((30, 4))
    classes = ["a" if row[0] > 0 else "b" for row in x]
    x[:, 0] += np.where(x[:, 0] > 0, 3.0, -3.0)
    answers = classifier.cross_validate(x, classes)
    assert sum(answer[0][0] == c for answer, c in zip(answers, classes, strict=True)) >= 28


def test_features_are_finite_and_tell_cases_apart():
    plain, off = (
        compute_features(make_data(lambda predicted: 0.0 * predicted)),
        compute_features(make_data(scale_residual)),
    )
    assert plain.shape == off.shape
    assert np.isfinite(off).all()
    assert np.abs(off - plain).max() > 0.1


def test_limits_are_learned_from_null_and_unknown_cases():
    def answer(case: str, effects: list[str], excess: float, name: str, score: float) -> dict:
        truth = {"effects": [{"name": n} for n in effects]}
        return {"case": case, "truth": truth, "excess": excess, "ranking": [(name, score)]}

    answers = [
        answer("null/1", [], 0.01, "a", 0.9),
        answer("null/2", [], 0.02, "a", 0.9),
        answer("unknown/1", ["x"], 1.0, "a", 0.3),
        answer("single/1", ["a"], 1.0, "a", 0.9),
        answer("single/2", ["b"], 0.9, "b", 0.8),
    ]
    limits = tune_limits(answers)
    assert [answer_by_limits(a, limits)["verdict"] for a in answers] == [NOTHING, NOTHING, NONE_OF_THESE, NAMED, NAMED]
    assert answer_by_limits(answers[3], limits)["effects"] == ["a"]
    assert answer_by_limits(answers[2], limits)["leads"] == "a"  # though it is not named


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--method", "svm"], "method 'svm' is unknown"),
        (["--split", "test"], "split 'test' is unknown"),
        (["--only", "*/s1"], "no case of the split evaluation is like */s1"),
    ],
)
def test_wrong_input_is_told_in_a_sentence(arguments: list[str], message: str, tmp_path: Path):
    refused = CliRunner().invoke(make_command(main), [*arguments, "--out", str(tmp_path)]).exception
    assert isinstance(refused, InputError)
    assert message in str(refused)
    assert list(tmp_path.iterdir()) == []
