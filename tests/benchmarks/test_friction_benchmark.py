"""What the side-by-side benchmark of friction models says, but for the times, which are the machine's."""

import pytest

from benchmarks import friction as bench


@pytest.fixture(scope="module")
def contestants() -> dict[str, bench.Ours]:
    """Our models by name."""
    return {contestant.name.partition(",")[0]: contestant for contestant in bench.ours()}


def test_models_with_one_smooth_spring_drift_under_a_bias_and_those_of_maxwell_slip_do_not(contestants):
    """LuGre and Dahl creep many break-away displacements in 4 s; Maxwell-slip, GMS and XGMS stay within a thousandth."""
    break_away = bench.STATIC / bench.STIFFNESS
    for name in ("Dahl", "LuGre"):
        assert bench.drift(contestants[name]) > 10.0 * break_away
    for name in ("Maxwell-slip", "GMS", "XGMS"):
        assert bench.drift(contestants[name]) < 1e-3 * break_away


def test_inner_loops_close_with_memory_and_not_without(contestants):
    """To rounding with the memory of reversals; Dahl and LuGre miss by a quarter of the friction."""
    for name in ("Maxwell-slip", "GMS", "XGMS"):
        assert bench.closure(contestants[name]) < 1e-15
    for name in ("Dahl", "LuGre"):
        assert bench.closure(contestants[name]) == pytest.approx(0.25, abs=0.02)


def test_a_missing_package_is_listed_with_the_command_that_installs_it(monkeypatch):
    """Its row has no numbers, and no target is judged against it."""
    monkeypatch.setattr(bench, "ROUNDS", 1)
    monkeypatch.setattr(bench.Oracle, "installed", classmethod(lambda cls: False))
    rows, targets, _ = bench.friction_benchmark()
    assert ("MuJoCo LuGre", "not installed: pip install mujoco", "", "", "") in rows
    assert len(rows) == 1 + len(bench.ours()) + 3
    assert not [target for target in targets if "OpenSees" in target.name]
