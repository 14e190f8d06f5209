"""Effects of the hydraulics: against an independent integration of their laws, and closed forms."""

from math import exp
from types import SimpleNamespace

import numpy as np
import pytest

from plant_sim.effects.catalogue import find_effect
from plant_sim.effects.signals import RIG
from tests.plant_sim.effects.fluid import A_CYL, BAR, C_H, KELVIN, Fluid, G, make_rig, run

PRESSURE, POSITION = 6e-5, 6e-9  # bar, m, to the independent integration: kink of the touch; measured 0.03 mbar, 2.7 nm
LANDING = 5e-4  # bar, from steps of a 16th; measured 0.064 mbar, 4.8 mbar without the air's share of the capacity
STEADY = 1e-7  # relative, 1.5 s after a step; measured 1.4e-8: the piston creeps on its damping
VOLUME = 1e-3  # of the air's volume: trapezoids over 0.1 ms; measured 7e-5
FLUID = 1e-3  # relative: Vogel's constants are rounded; measured 1e-4

MOVES = [(1.36, 300), (0.8, 200), (1.4, 250)]  # fill and touch, part way back, again
HELD = [(1.36, 1500)]

AIR, ATMOSPHERE = 2e-6, 1.01325  # m^3, bar
LEAK = 1e-5  # m^3/(s bar)
SPUN = 1e-3 * 20.0**2  # bar, at 20 rad/s
THICK = exp(765.0 * (1 / 143.0 - 1 / 173.0))  # viscosity at 40 degC over that at 70 degC, Vogel


@pytest.mark.parametrize(
    ("changed", "celsius", "law"),
    [
        ({}, 70.0, Fluid()),
        (
            {"entrapped_air__volume": AIR},
            70.0,
            Fluid(capacity=lambda p: C_H + AIR * ATMOSPHERE / (ATMOSPHERE + p) ** 2),
        ),
        ({"internal_leakage__conductance": LEAK}, 70.0, Fluid(flow=lambda p_v, p: G * (p_v - p) - LEAK * p)),
        (
            {"internal_leakage__conductance": 2.0 * LEAK, "oil__sump_temperature": 40.0},
            40.0,
            Fluid(flow=lambda p_v, p: G * (p_v - p) - 2.0 * LEAK / THICK * p),
        ),
        ({"centrifugal_pressure__coefficient": 1e-3}, 70.0, Fluid(thrust=lambda p: p + SPUN)),
        (
            {"oil_viscosity__share": 1.0, "oil__sump_temperature": 40.0},
            40.0,
            Fluid(flow=lambda p_v, p: G / THICK * (p_v - p)),
        ),
        ({"drain_restriction__ratio": 0.3}, 70.0, Fluid(flow=lambda p_v, p: G * (p_v - p) * (1 if p_v > p else 0.3))),
    ],
    ids=["baseline", "air", "leakage", "leakage of cold oil", "centrifugal", "viscosity", "drain"],
)
def test_rig_agrees_with_an_independent_integration(changed: dict[str, float], celsius: float, law: Fluid) -> None:
    result, expected = run(make_rig(**changed), MOVES, celsius=celsius), law.run(MOVES)
    assert result["pressure"] / BAR == pytest.approx(expected[:, 2], abs=PRESSURE)
    assert result["position"] == pytest.approx(expected[:, 3], abs=POSITION)
    if changed:
        assert np.abs(expected - Fluid().run(MOVES))[:, 2].max() > 0.05, "or nothing is compared"


# --- air -------------------------------------------------------------------------------------------------------------


def measure_drawn_oil(**changed: float) -> tuple[float, float, float]:
    """Oil [m^3] that a fill to 3.4 bar has drawn in 0.6 s, by the line's law; pressure [bar] and position [m] then."""
    records = run(make_rig(**changed), [(1.36, 600)])
    flow = G * (records["valve_pressure"] - records["pressure"]) / BAR
    return 1e-3 * np.sum(flow), records["pressure"][-1] / BAR, records["position"][-1]


def test_air_draws_the_oil_that_compresses_it() -> None:
    (plain, p, x), (airy, p_airy, x_airy) = measure_drawn_oil(), measure_drawn_oil(entrapped_air__volume=AIR)
    assert (p_airy, x_airy) == pytest.approx((p, x), rel=1e-6)
    assert plain == pytest.approx(C_H * p + A_CYL * x, rel=VOLUME)
    assert airy - plain == pytest.approx(AIR * p / (ATMOSPHERE + p), rel=VOLUME)  # Boyle


def test_air_makes_the_plates_touch_later() -> None:
    touch = [
        np.argmax(run(make_rig(entrapped_air__volume=v), HELD)["normal_force"] > 0) for v in (0.0, 1e-6, 5e-6, 5e-5)
    ]
    assert touch == sorted(touch)
    assert touch[0] < touch[2] < touch[3]


def test_piston_meets_its_rest_without_losing_oil_that_shares_the_cylinder_with_air() -> None:
    airy, worst = make_rig(entrapped_air__volume=5e-6), 0.0
    for last in (2.9, 3.2, 3.5, 3.8):  # bar: moves the landing through the phases of a step
        pieces = [(1.36, 250), (last / 25.0, 5), (0.0, 150)]
        coarse, fine = (run(airy, pieces, substeps=n)["pressure"] / BAR for n in (10, 160))
        worst = max(worst, np.abs(coarse - fine).max())
    assert worst < LANDING


# --- leakage ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("leak", [2e-6, 1e-5, 1e-4])
def test_leakage_divides_the_pressure_with_the_line(leak: float) -> None:
    end = run(make_rig(internal_leakage__conductance=leak), HELD)[-1]
    assert end["pressure"] == pytest.approx(end["valve_pressure"] * G / (G + leak), rel=STEADY)
    assert end["valve_pressure"] == pytest.approx(3.4 * BAR, rel=STEADY)


@pytest.mark.parametrize(("share", "factor"), [(0.0, 1.0), (0.5, THICK**-0.5), (1.0, 1.0 / THICK)])
def test_cold_oil_leaks_less_the_more_laminar_the_gap_is(share: float, factor: float) -> None:
    leak = {"internal_leakage__conductance": 1e-5, "internal_leakage__share": share}
    end = run(make_rig(**leak, oil__sump_temperature=40.0), HELD, celsius=40.0)[-1]
    assert end["pressure"] == pytest.approx(end["valve_pressure"] * G / (G + 1e-5 * factor), rel=STEADY)


# --- rotation --------------------------------------------------------------------------------------------------------


def test_centrifugal_pressure_presses_the_plates_and_not_the_sensor() -> None:
    spun, plain = (run(make_rig(centrifugal_pressure__coefficient=k), HELD)[-1] for k in (2e-4, 0.0))
    assert spun["pressure"] == pytest.approx(plain["pressure"], rel=STEADY)
    more = spun["normal_force"] - plain["normal_force"]
    assert more == pytest.approx(A_CYL * BAR * 2e-4 * spun["slip_speed"] ** 2, rel=0.02)  # less what the springs take
    assert more < A_CYL * BAR * 2e-4 * spun["slip_speed"] ** 2


def test_centrifugal_pressure_is_even_in_speed_and_nothing_at_standstill() -> None:
    forward, backward = (run(make_rig(centrifugal_pressure__coefficient=2e-4), MOVES, speed) for speed in (20.0, -20.0))
    assert (forward["position"] == backward["position"]).all()
    still, plain = (run(make_rig(centrifugal_pressure__coefficient=k), MOVES, 0.0) for k in (2e-4, 0.0))
    assert still.tobytes() == plain.tobytes()


# --- viscosity -------------------------------------------------------------------------------------------------------


def compute_conductance(celsius: float) -> float:
    """Of the line, relative to 70 degC, by the law of oil_viscosity."""
    one = find_effect("oil_viscosity")
    c = SimpleNamespace(hydraulics_conductance=1.0, oil_reference=70.0 + KELVIN)
    p = SimpleNamespace(share=1.0)
    one.laws[RIG](SimpleNamespace(temperature=celsius + KELVIN), c, p, SimpleNamespace(), 1e-3)
    return c.hydraulics_conductance


def test_the_fluid_has_its_data_sheets_viscosities() -> None:
    assert compute_conductance(100.0) / compute_conductance(40.0) == pytest.approx(35.0 / 7.2, rel=FLUID)
    assert compute_conductance(70.0) == 1.0


def test_viscosity_changes_nothing_at_the_reference_temperature() -> None:
    viscous, plain = (run(make_rig(oil_viscosity__share=s), MOVES, speed=0.0) for s in (1.0, 0.0))
    assert viscous.tobytes() == plain.tobytes()


def test_cold_oil_fills_late() -> None:
    cold = {"oil__sump_temperature": 40.0}
    late, prompt = (
        np.argmax(run(make_rig(oil_viscosity__share=s, **cold), HELD, celsius=40.0)["normal_force"] > 0)
        for s in (1.0, 0.0)
    )
    assert late > 1.5 * prompt


# --- drain -----------------------------------------------------------------------------------------------------------


def test_drain_empties_with_its_own_time_constant_and_fills_as_ever() -> None:
    pieces = [(1.36, 300), (0.0, 1500)]
    slow, plain = (run(make_rig(drain_restriction__ratio=r), pieces) for r in (0.05, 1.0))
    full = np.argmax(plain["pressure"] > plain["valve_pressure"])  # the valve overshoots a little
    assert full > 150
    assert slow[:full].tobytes() == plain[:full].tobytes()
    resting = (slow["position"] == 0.0) & (slow["valve_pressure"] < 1.0) & (slow["pressure"] > 1e3)
    resting[:300] = False
    time, pressure = slow["time"][resting], slow["pressure"][resting]
    assert len(time) > 100
    assert np.polyfit(time, np.log(pressure), 1)[0] == pytest.approx(-0.05 * G / C_H, rel=1e-3)
