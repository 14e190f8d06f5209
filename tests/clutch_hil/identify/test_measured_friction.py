"""Friction of measured rigs: the published values, and errors on runs that were not fitted. Skipped without the data.

The numbers are those of docs/identify_friction.md. By hand (docs/measured_data.md): EMPS 2.94 N, micro-tribometer
0.115 N, O-ring 2.20 N, held out.
"""

from pathlib import Path

import pytest

from clutch_hil.identify.friction.identification import identify_friction
from clutch_hil.identify.friction.result import IdentifiedFriction
from clutch_hil.recordings.import_map import load_map
from clutch_hil.thesis.measured_data import MissingDataError, find_measured_file
from tests import needs

RIG = ("viscous", "mass", "offset", "delay")


def find_path(name: str) -> Path:
    try:
        return find_measured_file(name)
    except MissingDataError:
        needs.skip("data")


def identify_emps(law: str, terms: tuple[str, ...] | None) -> IdentifiedFriction:
    run, pulses = (find_path(f"emps/{name}.mat") for name in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    return identify_friction(run, law, holdout=[pulses], map_name="emps", terms=terms, starts=2)


class TestEmps:
    def test_has_the_published_inertia_friction_and_offset(self) -> None:
        """Janot, Gautier and Brunot 2019: 95.1 kg, 203.5 Ns/m, 20.4 N, -3.2 N."""
        result = identify_emps("stribeck", RIG)
        assert result["mass"] == pytest.approx(95.1, rel=0.01)
        assert result["viscous"] == pytest.approx(203.5, rel=0.02)
        assert result["static_force"] == pytest.approx(20.4, rel=0.02)
        assert result["offset"] == pytest.approx(-3.2, abs=0.05)
        assert result["delay"] == pytest.approx(-0.32e-3, abs=0.02e-3)
        for name, value in (("mass", 95.1), ("viscous", 203.5), ("static_force", 20.4), ("offset", -3.2)):
            low, high = result.interval(name)
            assert low <= value <= high, name
        assert result.errors["held_out_runs"] <= 3.45

    def test_friction_that_depends_on_the_direction_predicts_the_pulses(self) -> None:
        result = identify_emps("stribeck", (*RIG, "viscous_asymmetry"))
        assert result.errors["held_out_runs"] <= 3.05
        assert result["viscous"] * (1.0 + result["viscous_asymmetry"]) == pytest.approx(168.0, rel=0.02)
        assert result["viscous"] * (1.0 - result["viscous_asymmetry"]) == pytest.approx(241.0, rel=0.02)

    def test_held_out_stretches_choose_the_direction_and_not_the_offset(self) -> None:
        result = identify_emps("stribeck", None)
        assert set(result.structure.terms) == {"mass", "viscous", "viscous_asymmetry", "delay"}
        assert result.errors["held_out_runs"] <= 3.05
        assert "a Stribeck curve needs speeds over two decades" in " ".join(result.warnings)

    def test_a_law_with_pre_sliding_predicts_better_than_the_fit_by_hand(self) -> None:
        result = identify_emps("lugre", ("viscous", "mass", "delay", "viscous_asymmetry"))
        assert result.errors["held_out_runs"] <= 2.94


@pytest.mark.parametrize(("law", "elements"), [("maxwell-slip", 4), ("gms", 4), ("xgms", 4)])
def test_cycles_of_the_microtribometer_are_predicted(law: str, elements: int) -> None:
    """0.115 N by hand; cycles 26 to 50."""
    data, of = find_path("microtribometer/test_data_2.txt"), load_map("microtribometer")
    run, later = (of.cut(begin, begin + 100.0).read(data) for begin in (8.8, 108.8))
    result = identify_friction(run, law, holdout=[later], elements=elements, terms=("offset",), starts=1)
    assert result.errors["held_out_runs"] <= 0.112


def test_friction_of_the_o_ring_is_predicted_at_higher_pressures() -> None:
    """2.20 N by hand; fitted at 1 and 3 bar, held out at 5 and 7."""
    runs = [find_path(f"pneumatic_seal_friction/O-ring_{bar}bar.csv") for bar in (1, 3, 5, 7)]
    result = identify_friction(
        runs[:2], "xgms", holdout=runs[2:], map_name="pneumatic_seal", elements=2,
        terms=("load_gain", "preload", "mass", "viscous", "delay"), starts=1,
    )  # fmt: skip
    assert result.errors["held_out_runs"] <= 2.20
    assert result.units == ("m", "N", "Pa")
    assert result["load_gain"] == pytest.approx(4.98e-4, rel=0.01)  # m^2: a bore of 25.2 mm
