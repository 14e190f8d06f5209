"""Across the levels: the Generic-Rayleigh model as the measured contact, XGMS identified on it (property 19)."""

import numpy as np
import pytest

from clutch_hil.thesis.control_models import cross_level as entry
from clutch_hil.thesis.control_models.cross_level import LOAD, SPEEDS, compute_nrmse


@pytest.fixture(scope="module")
def here():
    return entry.make_contact(1)


@pytest.fixture(scope="module")
def records(here):
    motions, stairs = entry.make_training()
    return motions, stairs, [record.measure(here) for record in (*motions, *stairs)]


@pytest.fixture(scope="module")
def models(records):
    return entry.identify_models(*records)


@pytest.fixture(scope="module")
def measured():
    """Held-out motions and their friction on another part of the surface, by name."""
    elsewhere = entry.make_contact(2)
    known, others = entry.make_held_out()
    return {motion.name: (motion, motion.measure(elsewhere)) for motion in (*known, *others)}


def compute_errors(models, measured, name):
    motion, force = measured[name]
    return {model: compute_nrmse(motion.predict(models[model]), force) for model in models}


def test_training_covers_pre_sliding_and_all_lubrication_regimes(here, records):
    motions, _, forces = records
    slow, sine = (here.observe(m.position, m.dt, m.load) for m in motions)
    assert slow.dry[0] == 0.0  # all tips in stick
    assert slow.dry.max() > 0.8 * (slow.stick + slow.dry).max()  # gross sliding: tips stick only where they meet a step
    assert slow.wet.max() < 0.05 * slow.dry.max()
    assert sine.wet.max() > 0.9 * (sine.stick + sine.dry + sine.wet).max()
    steady = forces[2] / LOAD
    assert steady[0] == pytest.approx(steady[2], rel=0.02)  # boundary
    assert steady.min() < 0.75 * steady[0]  # mixed
    assert steady[-1] > 1.5 * steady.min()  # hydrodynamic
    assert SPEEDS[-1] / SPEEDS[0] == pytest.approx(1e3)


def test_identified_model_stands_for_the_measured_curves(here, records, models):
    """Static friction, total stiffness and steady friction of XGMS are those of the asperities."""
    motions, _, forces = records
    xgms = models["XGMS"]
    assert float(xgms.friction(LOAD)) == pytest.approx(forces[2][0], rel=0.02)
    first = forces[0][5] / motions[0].position[5]
    assert xgms.stiffness.sum() == pytest.approx(first, rel=0.1)
    np.testing.assert_allclose(xgms.steady_state(SPEEDS, LOAD), forces[2], rtol=0.12)


@pytest.mark.parametrize("name", ["small slow loops", "inner loops", "slow sine", "fast sine", "multisine"])
def test_predicts_motions_it_has_not_seen(models, measured, name):
    result = compute_errors(models, measured, name)
    assert result["XGMS"] < 0.15
    assert result["XGMS"] < result["LuGre"] < result["Coulomb"]


def test_inner_loops_need_non_local_memory(models, measured):
    result = compute_errors(models, measured, "inner loops")
    assert result["XGMS"] < 0.5 * result["LuGre"]


@pytest.mark.parametrize("name", ["inner loops, load 1.5", "multisine, load 1.5", "multisine, load 1 to 2"])
def test_predicts_under_loads_it_has_not_seen(models, measured, name):
    """Even against models that are made to grow with the load."""
    result = compute_errors(models, measured, name)
    assert result["XGMS"] < 0.2
    assert result["XGMS"] < 0.8 * min(result["LuGre"], result["Coulomb"])


def test_only_the_load_divides_gms_and_xgms(models, measured):
    motion, _ = measured["multisine"]
    gms, xgms = models["GMS"], models["XGMS"]
    assert compute_nrmse(motion.predict(gms), motion.predict(xgms)) < 0.05
    loaded, _ = measured["multisine, load 1 to 2"]
    assert compute_nrmse(loaded.predict(gms), loaded.predict(xgms)) > 0.05
    assert (
        compute_nrmse(loaded.predict(gms) * LOAD / loaded.load, loaded.predict(xgms)) > 0.2
    )  # as it is, blind to the load
