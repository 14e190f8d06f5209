"""Results of the side-by-side benchmark of friction models, except the times, which depend on the machine."""

import pytest

from benchmarks import friction as bench


@pytest.fixture(scope="module")
def contestants() -> dict[str, bench.OwnModel]:
    """Our models by name."""
    return {contestant.name.partition(",")[0]: contestant for contestant in bench.make_own_models()}


def test_models_with_one_smooth_spring_drift_under_a_bias_and_those_of_maxwell_slip_do_not(contestants):
    """LuGre and Dahl creep many break-away displacements in 4 s; Maxwell-slip, GMS and XGMS stay within a thousandth."""
    break_away = bench.STATIC_FORCE / bench.STIFFNESS
    for name in ("Dahl", "LuGre"):
        assert bench.measure_drift(contestants[name]) > 10.0 * break_away
    for name in ("Maxwell-slip", "GMS", "XGMS"):
        assert bench.measure_drift(contestants[name]) < 1e-3 * break_away


def test_inner_loops_close_with_memory_and_not_without(contestants):
    """To rounding with the memory of reversals; Dahl and LuGre miss by a quarter of the friction."""
    for name in ("Maxwell-slip", "GMS", "XGMS"):
        assert bench.measure_closure(contestants[name]) < 1e-15
    for name in ("Dahl", "LuGre"):
        assert bench.measure_closure(contestants[name]) == pytest.approx(0.25, abs=0.02)


def test_a_missing_package_is_listed_with_the_command_that_installs_it(monkeypatch):
    """Its row has no numbers, and no target is judged against it."""
    monkeypatch.setattr(bench, "WINDOW_COUNT", 1)
    monkeypatch.setattr(bench.Oracle, "is_installed", classmethod(lambda cls: False))
    rows, targets, _ = bench.measure_friction_models()
    assert ("MuJoCo LuGre", "not installed: pip install mujoco", "", "", "") in rows
    assert len(rows) == 1 + len(bench.make_own_models()) + 3
    assert not [target for target in targets if "OpenSees" in target.name]
