"""The wet clutch as the discrepancy workflow simulates it: coarse steps are fine enough, and a run is read as it began."""

import numpy as np
import pytest

from plant_sim.discrepancy.models import wet_clutch as module
from plant_sim.discrepancy.models.wet_clutch import WetClutch

PRESSURE_ERROR = 1e-3  # bar, largest, against steps of 0.025 ms: measured 0.6 mbar
TORQUE_ERROR = 3e-3  # Nm, root mean square: measured 1.9 mNm
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


def simulated(model: WetClutch, columns: dict[str, np.ndarray], **changed: float) -> dict[str, np.ndarray]:
    nominal = {name: parameter.value for name, parameter in model.parameters.items()}
    return model.simulate(columns, nominal | changed, {})


def test_coarse_steps_are_fine_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    model, columns = WetClutch(), run()
    coarse = simulated(model, columns)
    monkeypatch.setattr(module, "_STEP", 2.5e-5)
    fine = simulated(model, columns)
    assert np.max(np.abs(coarse["cylinder_pressure_bar"] - fine["cylinder_pressure_bar"])) < PRESSURE_ERROR
    assert np.sqrt(np.mean((coarse["clutch_torque_nm"] - fine["clutch_torque_nm"]) ** 2)) < TORQUE_ERROR
    assert np.ptp(fine["clutch_torque_nm"]) > 10.0


def test_a_sensor_that_is_not_what_its_data_sheet_says_shows_something_else() -> None:
    model, columns = WetClutch(), run()
    plain, sensitive = (
        simulated(model, columns),
        simulated(model, columns, **{"sensors.clutch_torque_sensitivity": 0.202}),
    )
    np.testing.assert_allclose(sensitive["clutch_torque_nm"], 1.01 * plain["clutch_torque_nm"], rtol=1e-9)
    np.testing.assert_array_equal(sensitive["motor_torque_nm"], plain["motor_torque_nm"])


def test_a_run_that_begins_under_pressure_begins_there() -> None:
    model, columns = WetClutch(), run()
    columns["cylinder_pressure_bar"] = columns["cylinder_pressure_bar"] + 3.0
    assert simulated(model, columns)["cylinder_pressure_bar"][0] == pytest.approx(3.0)
