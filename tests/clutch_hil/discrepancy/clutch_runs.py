"""Short runs of the wet clutch with something hidden, for tests of the atlas: quick to make, at known baseline parameters."""

from collections.abc import Mapping

import numpy as np

from clutch_hil.discrepancy.models.wet_clutch import WetClutch

PERIOD = 1e-3  # s
SECONDS = 8.0
NOISE = {  # 0.5 % of 3.4 bar, 17 Nm, 10 K; slip: encoder over a sample
    "cylinder_pressure_bar": 0.017, "clutch_torque_nm": 0.085, "motor_torque_nm": 0.085, "slip_speed_rad_s": 0.016,
    "oil_temperature_degc": 0.1,
}  # fmt: skip


def record_runs(
    hidden: Mapping[str, float], seed: int = 1, noise: Mapping[str, float] = NOISE, model: WetClutch | None = None
) -> list[dict[str, np.ndarray]]:
    """Three runs: engagements, pressure triangles, a pressure multisine, all at changing slip, with effects `hidden`."""
    t = np.arange(0.0, SECONDS, PERIOD)
    triangle = 2.0 * np.abs((t / 2.0) % 1.0 - 0.5)
    sines = sum(np.sin(2.0 * np.pi * f * t + f) for f in (0.7, 1.3, 2.9, 5.3))
    model, random = model or WetClutch(), np.random.default_rng(seed)
    baseline = {name: p.value for name, p in model.parameters.items()}
    runs = []
    for bar, speed, celsius in (
        (np.where(t % 2.0 > 0.6, 3.4, 0.0), 12.0 + 6.0 * np.sin(1.7 * t), 70.0),
        (2.7 + 1.3 * triangle, 15.0 + 8.0 * np.sin(0.9 * t), 80.0),
        (3.4 + 0.25 * sines, 18.0 + 5.0 * np.sin(2.3 * t), 75.0),
    ):
        run = {
            "time_s": t, "valve_voltage_v": bar / 2.5, "motor_speed_demand_rad_s": speed,
            "cylinder_pressure_bar": np.zeros_like(t), "oil_temperature_degc": np.full_like(t, celsius),
            "shaft_angle_rad": np.zeros_like(t),
        }  # fmt: skip
        shown = model.simulate(run, baseline, hidden)
        for column, sigma in noise.items():
            run[column] = shown[column] + sigma * random.standard_normal(len(t))
        slip = shown["slip_speed_rad_s"]  # each the mean over the sample that ends with it
        run["shaft_angle_rad"] = PERIOD * (np.cumsum(slip) - slip[0])
        runs.append(run)
    return runs


def list_baseline() -> dict[str, float]:
    """Nominal parameters of the baseline."""
    return {name: p.value for name, p in WetClutch().parameters.items()}
