"""Effects of piston, springs and plates: against an independent integration of their laws, and closed forms."""

import numpy as np
import pytest

from protocols.errors import InputError
from tests.plant_sim.effects.fluid import (
    A_CYL,
    BAR,
    C_P,
    F_0,
    K_S,
    K_STACK,
    P_CONTACT,
    X_C,
    Fluid,
    compute_stack_force,
    make_rig,
    run,
)

PRESSURE, POSITION = 6e-5, 6e-9  # bar, m: as in test_hydraulics.py
TOUCH = 1e-3  # bar: a ramp of 0.4 bar/s sampled at 1 kHz; measured 0.3 mbar
STIFF = 1e-3  # bar: the seal's force is held over a step; measured 0.25 mbar, 50 mbar once unstable
FORCE = 1e-9  # relative: sums of a kilonewton

MOVES = [(1.36, 300), (0.8, 200), (1.4, 250)]
RAMP = [(float(v) / 2.5, 5) for v in np.arange(1.8, 3.4, 0.002)]  # 0.4 bar/s: quasi-steady
BACK = [*RAMP, *RAMP[::-1]]

WAVE = 1e-4  # m


def compute_cushion(x: float) -> float:
    """Mean of linear stacks over gaps spread evenly over +-WAVE, summed."""
    gaps = x - X_C - WAVE * (2 * np.arange(2000) + 1 - 2000) / 2000
    return float(K_STACK * np.maximum(gaps, 0.0).mean())


@pytest.mark.parametrize(
    ("changed", "law"),
    [
        ({"clearance_change__change": 0.2}, Fluid(stack=lambda x: compute_stack_force(x, 1.2e-3))),
        ({"clearance_change__change": -0.2}, Fluid(stack=lambda x: compute_stack_force(x, 0.8e-3))),
        ({"return_spring_change__ratio": 0.8}, Fluid(spring=lambda x: 0.8 * (F_0 + K_S * x))),
        ({"plate_waviness__height": 1e3 * WAVE}, Fluid(stack=compute_cushion)),
    ],
    ids=["worn", "swollen", "weak springs", "wavy"],
)
def test_rig_agrees_with_an_independent_integration(changed: dict[str, float], law: Fluid) -> None:
    result, expected = run(make_rig(**changed), MOVES), law.run(MOVES)
    assert result["pressure"] / BAR == pytest.approx(expected[:, 2], abs=PRESSURE)
    assert result["position"] == pytest.approx(expected[:, 3], abs=POSITION)
    assert np.abs(expected - Fluid().run(MOVES))[:, 2].max() > 0.05, "or nothing is compared"


def find_touch(**changed: float) -> tuple[float, float]:
    """Pressure [bar], less what damping takes, and piston position [m] at which the plates touch on a slow ramp."""
    records = run(make_rig(**changed), RAMP)
    first = np.argmax(records["normal_force"] > 0.0)
    speed = (records["position"][first - 1] - records["position"][first - 2]) / 1e-3
    return (records["pressure"][first - 1] - C_P * speed / A_CYL) / BAR, records["position"][first - 1]


# --- clearance, springs ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("change", [-0.3, 0.0, 0.3])  # mm
def test_clearance_moves_the_touch_and_stretches_the_springs(change: float) -> None:
    pressure, position = find_touch(clearance_change__change=change)
    assert position == pytest.approx(X_C + 1e-3 * change, abs=2e-6)
    assert pressure == pytest.approx(P_CONTACT + 1e-3 * change * K_S / (A_CYL * BAR), abs=TOUCH)


@pytest.mark.parametrize("ratio", [0.9, 1.0, 1.1])
def test_springs_scale_the_pressure_of_the_touch_and_leave_its_place(ratio: float) -> None:
    pressure, position = find_touch(return_spring_change__ratio=ratio)
    assert position == pytest.approx(X_C, abs=2e-6)
    assert pressure == pytest.approx(ratio * P_CONTACT, abs=TOUCH)


# --- waviness --------------------------------------------------------------------------------------------------------


def test_wavy_plates_press_by_position_alone_as_their_mean_gap_does() -> None:
    records = run(
        make_rig(plate_waviness__height=1e3 * WAVE, hydraulics__conductance=1e-3), [(1.36, 300), (4.0, 200), (0.0, 90)]
    )
    gap, force = records["position"] - X_C, records["normal_force"]
    law = np.where(np.abs(gap) < WAVE, K_STACK * (gap + WAVE) ** 2 / (4 * WAVE), K_STACK * np.maximum(gap, 0.0))
    assert force == pytest.approx(law, rel=FORCE)
    assert gap.max() > WAVE, "flat again"
    assert ((gap > -WAVE) & (gap < WAVE)).sum() > 100


def test_wavy_plates_touch_earlier() -> None:
    pressure, position = find_touch(plate_waviness__height=1e3 * WAVE)
    assert position == pytest.approx(X_C - WAVE, abs=2e-6)
    assert pressure == pytest.approx(P_CONTACT - WAVE * K_S / (A_CYL * BAR), abs=TOUCH)


# --- seal ------------------------------------------------------------------------------------------------------------


def test_seal_slides_at_a_limit_that_grows_with_pressure() -> None:
    records = run(make_rig(piston_seal_friction__force=30.0, piston_seal_friction__pressure_slope=20.0), BACK)
    limit = 30.0 + 20.0 * records["pressure"] / BAR
    step = np.diff(records["position"], prepend=0.0)
    sliding = (records["position"] > 1e-5) & (np.abs(records["position"] - X_C) > 1e-4) & (np.abs(step) > 1e-8)
    forward, backward = sliding & (step > 0), sliding & (step < 0)
    forward[1:] &= forward[:-1]
    assert forward.sum() > 500
    assert backward.sum() > 500
    assert records["seal_force"][forward] == pytest.approx(limit[forward], rel=FORCE)
    late = backward & (records["time"] > records["time"][backward][0] + 0.2)
    assert records["seal_force"][late] == pytest.approx(-limit[late], rel=FORCE)
    assert (np.abs(records["seal_force"]) <= limit * (1 + FORCE)).all()


def test_seal_dissipates_over_a_closed_stroke_and_springs_do_not() -> None:
    records = run(
        make_rig(piston_seal_friction__force=30.0, piston_seal_friction__pressure_slope=20.0), [*BACK, (0.0, 300)]
    )
    step = np.diff(records["position"], prepend=0.0)
    loss = np.sum(records["seal_force"] * step)
    assert records["position"][-1] == 0.0
    stroke = records["position"].max()
    assert loss > 2 * stroke * (30.0 + 20.0 * 1.7) * 0.95  # at least the friction at the lowest sliding pressure
    assert loss < 2 * stroke * (30.0 + 20.0 * 2.5)


@pytest.mark.parametrize(("force", "slope"), [(1000.0, 0.0), (0.0, 40.0)])
def test_seal_is_refused_before_its_stiffness_makes_the_rig_unstable(force: float, slope: float) -> None:
    """The shortest travel that is allowed gives what steps of an eighth give."""
    seal = {"piston_seal_friction__force": force, "piston_seal_friction__pressure_slope": slope}
    with pytest.raises(InputError, match="too fast to integrate"):
        make_rig(piston_seal_friction__travel=2.5e-6, **seal)
    stiff = make_rig(piston_seal_friction__travel=3e-6, **seal)
    pieces = [(1.36, 200), (10.0, 60), (0.0, 200)]
    coarse, fine = (run(stiff, pieces, substeps=n)["pressure"] / BAR for n in (10, 80))
    assert coarse == pytest.approx(fine, abs=STIFF)
