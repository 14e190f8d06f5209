"""Runs of different clutches that are given together."""

from functools import cache

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.in_memory import simulate
from clutch_hil.identify.other_clutch import find_other_clutch
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.run import Run

LINES = ("coulomb", "viscous")


@cache
def play(profile: str, contact: float = 0.0, slope: float = 1.0) -> Run:
    """A run of the clutch whose contact pressure is `contact` [bar] higher, and whose friction is `slope` times the shipped."""
    nominal = wet_clutch.load_nominal()
    moved = ("piston.contact_pressure", "piston.preload_pressure", "clutch.beta_onset")
    plant = {name: nominal[name].value + contact for name in moved}
    for line in LINES:
        rise = slope * nominal[f"clutch.{line}_slope"].value
        plant[f"clutch.{line}_slope"] = rise
        plant[f"clutch.{line}_intercept"] = slope * nominal[f"clutch.{line}_intercept"].value - contact * rise
    return simulate(profile=profile, seconds=12.0, seed=3, rate=500, plant=plant)


def find(**runs: Run) -> list[str]:
    return [str(f) for f in find_other_clutch({name: run.columns for name, run in runs.items()})]


def test_runs_of_one_clutch_are_of_one() -> None:
    profiles = ("engagement", "pressure_steps", "multisine", "creep", "slip_sine")  # of the last two none shows a line
    assert find(**{profile: play(profile) for profile in profiles}) == []


def test_a_higher_contact_pressure_is_told_of_the_run_with_more_torque() -> None:
    (text,) = find(ours=play("pressure_steps"), theirs=play("pressure_steps", contact=0.4))
    assert text.startswith("run ours: clutch_torque_nm, rows 0 to 5999, is 1")
    assert "that of run theirs is 1" in text


def test_more_friction_is_told() -> None:
    (text,) = find(ours=play("pressure_steps"), too=play("multisine"), theirs=play("pressure_steps", slope=1.5))
    assert text.startswith("run theirs: clutch_torque_nm, rows 0 to 5999, is 2")


@pytest.mark.parametrize("contact", [-0.05, 0.05])
def test_a_pressure_sensor_that_was_zeroed_again_is_no_other_clutch(contact: float) -> None:
    assert find(ours=play("pressure_steps"), theirs=play("multisine", contact=contact)) == []


def test_identify_refuses_them_before_it_fits() -> None:
    steps: list[str] = []
    with pytest.raises(InputError, match=r"different clutches.*--force-checks, force=True"):
        ch.identify_clutch(
            [play("pressure_steps"), play("pressure_steps", contact=0.4)],
            progress=lambda what, share: steps.append(what),
        )
    assert steps == []


def test_runs_without_samples_in_contact_say_nothing() -> None:
    still = {name: np.zeros(6000) for name in play("pressure_steps").columns} | {"time_s": np.arange(6000) / 500.0}
    assert find(ours=play("pressure_steps"), still=Run(still, {})) == []
