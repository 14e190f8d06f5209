"""Starts of a friction law: the size of records, also of those in which little of what they show is in many rows."""

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.identify.friction.slide_record import SlideRecord
from clutch_hil.identify.friction.starts import measure_scale

PERIOD, ROWS, STROKE = 1e-3, 24_000, 4_000  # s, and rows
SPEED = 0.05  # m/s
LEVEL, MASS, OFFSET, NOISE = 10.0, 2.0, 3.0, 0.05  # N, kg, N, N
NEAR = 0.05  # relative


def record(reversal: int, load: np.ndarray | None = None) -> ch.Run:
    """Record strokes at one speed, whose reversals take so many rows."""
    way = np.where(np.arange(ROWS + reversal) // STROKE % 2 == 0, SPEED, -SPEED)
    speed = np.convolve(way, np.ones(reversal) / reversal, "valid")[:ROWS]
    friction = LEVEL * np.sign(speed) + NOISE * np.random.default_rng(1).standard_normal(ROWS)
    columns = {
        "time_s": PERIOD * np.arange(ROWS), "position_m": PERIOD * np.cumsum(speed),
        "force_n": friction + MASS * np.gradient(speed, PERIOD) + OFFSET, **({} if load is None else {"load_n": load}),
    }  # fmt: skip
    return ch.Run(columns, {})


@pytest.mark.parametrize("reversal", [10, 40])  # rows: 0.25 and 1 % of them
def test_the_mass_is_found_however_short_the_reversals_are(reversal: int) -> None:
    found = ch.identify_friction(record(reversal), "stribeck", starts=1)
    assert found["mass"] == pytest.approx(MASS, rel=NEAR)
    assert np.isfinite(found.interval("mass")).all()


@pytest.mark.parametrize("load", [None, np.zeros(ROWS), np.full(ROWS, 100.0)], ids=["none", "zero", "constant"])
def test_a_load_that_does_not_vary_takes_nothing_of_the_offset(load: np.ndarray | None) -> None:
    run = record(40, load)
    values = np.ones(ROWS) if load is None else load
    slide = SlideRecord(
        "", "", PERIOD, run["position_m"], run["force_n"], values, ("m", "N", "" if load is None else "N")
    )
    scale = measure_scale([slide])
    assert scale.offset == pytest.approx(OFFSET, rel=NEAR)
    assert scale.load_gain == 0.0


def test_a_load_of_zero_is_no_load() -> None:
    """As of a channel that was not connected; a law without a load does not need it."""
    found = ch.identify_friction(record(40, np.zeros(ROWS)), "gms", terms=["offset"], elements=1, starts=1)
    assert found["offset"] == pytest.approx(OFFSET, rel=NEAR)
