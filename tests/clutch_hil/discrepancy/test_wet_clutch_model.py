"""The wet clutch as the discrepancy workflow simulates it: coarse steps are fine enough, and a run is read as it began."""

import numpy as np
import pytest

from clutch_hil.discrepancy.models import wet_clutch as module
from clutch_hil.discrepancy.models.wet_clutch import WetClutch

PRESSURE_ERROR = 1e-3  # bar, largest, against steps of 0.025 ms: measured 0.93 mbar
TORQUE_ERROR = 3e-3  # Nm, root mean square: measured 2.9 mNm
REVERSING_ERROR = 6e-3  # Nm, the same where the slip reverses under load: measured 3.7 mNm
N = 8000


def run() -> dict[str, np.ndarray]:
    """Fill, slip, release, twice; outputs as measured at rest."""
    time = 1e-3 * np.arange(N)
    columns = dict.fromkeys(
        ("cylinder_pressure_bar", "shaft_angle_rad", "clutch_torque_nm", "motor_torque_nm"), 0.0 * time
    )
    pressed = np.where(time % 4.0 < 2.5, (3.0 + 0.8 * np.sin(2.0 * np.pi * (0.3 + time / 10.0) * time)) / 2.5, 0.4)
    return columns | {
        "time_s": time, "valve_voltage_v": pressed, "motor_speed_demand_rad_s": 20.0 + 15.0 * np.sin(0.5 * time),
        "slip_speed_rad_s": 0.0 * time, "oil_temperature_degc": 0.0 * time + 70.0,
    }  # fmt: skip


def simulate_run(model: WetClutch, columns: dict[str, np.ndarray], **changed: float) -> dict[str, np.ndarray]:
    nominal = {name: parameter.value for name, parameter in model.parameters.items()}
    return model.simulate(columns, nominal | changed, {})


def test_coarse_steps_are_fine_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    model, columns = WetClutch(), run()
    coarse = simulate_run(model, columns)
    monkeypatch.setattr(module, "_STEP", 2.5e-5)
    fine = simulate_run(model, columns)
    assert np.max(np.abs(coarse["cylinder_pressure_bar"] - fine["cylinder_pressure_bar"])) < PRESSURE_ERROR
    assert np.sqrt(np.mean((coarse["clutch_torque_nm"] - fine["clutch_torque_nm"]) ** 2)) < TORQUE_ERROR
    assert np.ptp(fine["clutch_torque_nm"]) > 10.0


def test_a_sensor_that_is_not_what_its_data_sheet_says_shows_something_else() -> None:
    model, columns = WetClutch(), run()
    plain, sensitive = (
        simulate_run(model, columns),
        simulate_run(model, columns, **{"sensors.clutch_torque_sensitivity": 0.202}),
    )
    np.testing.assert_allclose(sensitive["clutch_torque_nm"], 1.01 * plain["clutch_torque_nm"], rtol=1e-9)
    np.testing.assert_array_equal(sensitive["motor_torque_nm"], plain["motor_torque_nm"])


def test_a_run_that_begins_under_pressure_begins_there() -> None:
    model, columns = WetClutch(), run()
    columns["cylinder_pressure_bar"] = columns["cylinder_pressure_bar"] + 3.0
    assert simulate_run(model, columns)["cylinder_pressure_bar"][0] == pytest.approx(3.0)


@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_a_converter_that_has_lost_bits_shows_in_the_values(offset: float) -> None:
    random, columns = np.random.default_rng(4), run()
    step, native = 20.0 / 2**8, 20.0 / 2**12  # bar: 4 of 12 bits lost, at 1 V/bar
    pressure = 3.0 + np.sin(columns["time_s"]) + 0.02 * random.standard_normal(N)
    fine = columns | {"cylinder_pressure_bar": native * np.round(pressure / native)}
    coarse = columns | {"cylinder_pressure_bar": step * (np.round(pressure / step - offset) + offset)}
    model = WetClutch()
    assert model.find_evident_effects([fine, fine]) == {}
    assert model.find_evident_effects([fine, coarse]) == {}, (
        "what one run does not have is no property of the converter"
    )
    result = model.find_evident_effects([coarse, coarse])["coarse_quantisation"]
    assert result.intervals["coarse_quantisation.pressure_bits_lost"][0] == pytest.approx(4.0, abs=1e-3)
    assert result.intervals["coarse_quantisation.offset"][0] == pytest.approx(offset, abs=1e-3)
    assert "coarse_quantisation.torque_bits_lost" not in result.intervals
    assert result.rounding == pytest.approx({"cylinder_pressure_bar": step / np.sqrt(12.0)})


def test_a_converter_with_uneven_levels_has_lost_bits_too() -> None:
    """Every second level is a fifth of a step high: differential non-linearity."""
    random, columns = np.random.default_rng(4), run()
    step = 20.0 / 2**8
    code = np.round((3.0 + np.sin(columns["time_s"]) + 0.02 * random.standard_normal(N)) / step)
    uneven = columns | {"cylinder_pressure_bar": step * (code + 0.2 * (code % 2))}
    result = WetClutch().find_evident_effects([uneven, uneven])["coarse_quantisation"]
    assert result.intervals["coarse_quantisation.pressure_bits_lost"][0] == pytest.approx(4.0, abs=0.03)


def test_plates_that_reverse_under_load_do_not_chatter(monkeypatch: pytest.MonkeyPatch) -> None:
    model, columns = WetClutch(), run()
    reversing = columns | {"motor_speed_demand_rad_s": 5.0 * np.sin(2.0 * np.pi * columns["time_s"])}
    coarse = simulate_run(model, reversing)["clutch_torque_nm"]
    monkeypatch.setattr(module, "_STEP", 2.5e-5)
    error = coarse - simulate_run(model, reversing)["clutch_torque_nm"]
    assert np.sqrt(np.mean(error**2)) < REVERSING_ERROR


def test_plates_that_never_touch_say_nothing_of_the_pressure_sensor() -> None:
    model, columns = WetClutch(), run()
    columns["valve_voltage_v"] = 0.2 + 0.0 * columns["time_s"]
    shown = simulate_run(model, columns)
    assert not np.any(shown["clutch_torque_nm"])
    nominal = {name: parameter.value for name, parameter in model.parameters.items()}
    floors = {output.column: output.resolution for output in model.outputs}
    residuals = {c: floors[c] * np.random.default_rng(3).standard_normal(N) for c in floors}
    measured = columns | {c: shown[c] + residuals[c] for c in floors}
    with np.errstate(all="raise", under="ignore"):
        sources = model.locate(0, measured, shown, residuals, floors, nominal, {})
    (pressure,) = [s for s in sources if (s.block, s.column) == ("sensors", "cylinder_pressure_bar")]
    assert not np.any(pressure.power)
    assert all(np.isfinite(s.power).all() and np.isfinite(s.tested).all() for s in sources)
