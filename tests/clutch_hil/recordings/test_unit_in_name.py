"""Units at the end of names without brackets, as `time_ms` and `speed rpm`: a map that says another one is refused."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.unit_in_name import hint_unit
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 60
TIME = 0.01 * np.arange(ROWS)
SPEED = np.round(100.0 + np.sin(TIME), 4)
RPM = np.pi / 30.0  # rad/s


def write(tmp_path: Path, time: str = "time_ms", speed: str = "speed_rpm") -> Path:
    path = tmp_path / "recording.csv"
    rows = (f"{1e3 * t:.0f},{n:.4f}" for t, n in zip(TIME, SPEED, strict=True))
    path.write_text("\n".join([f"{time},{speed}", *rows, ""]), encoding="utf-8")
    return path


def make_map(time: str, speed: str) -> str:
    return f"[columns]\ntime_s = {{ number = 1, {time} }}\nspeed_rad_s = {{ number = 2, {speed} }}\n"


@pytest.mark.parametrize(
    ("time", "speed", "sentence"),
    [
        ('unit = "s"', 'unit = "rpm"', "'time_ms' for time_s is in ms by its name, and in s by the map"),
        ('unit = "ms"', 'unit = "rad/s"', "'speed_rpm' for speed_rad_s is in rpm by its name, and in rad/s by the map"),
    ],
)
def test_a_unit_that_the_name_denies_is_refused(tmp_path: Path, time: str, speed: str, sentence: str) -> None:
    assert sentence in find_refusal(tmp_path, write(tmp_path), make_map(time, speed))


@pytest.mark.parametrize(
    ("time", "speed", "factor"),
    [
        ('unit = "ms"', 'unit = "rpm"', RPM),
        ('unit = "s", scale = 0.001', 'unit = "rad/s", unit_from = "map"', 1.0),
    ],
)
def test_a_map_may_agree_convert_or_know_better(tmp_path: Path, time: str, speed: str, factor: float) -> None:
    run = import_by(tmp_path, write(tmp_path), make_map(time, speed))
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"], factor * SPEED, rtol=1e-12)


@pytest.mark.parametrize(
    ("time", "speed"),
    [
        ("time_ms", "speed_rpm"),
        ("t ms", "speed rpm"),
        ("millis", "RPM"),
        ("TIME_MS", "Engine RPM"),
        ("timeMs", "speedRpm"),
    ],
)
def test_a_draft_takes_the_unit_of_the_name(tmp_path: Path, time: str, speed: str) -> None:
    path = write(tmp_path, time, speed)
    run = import_by(tmp_path, path, draft_map(path, open_recording(path)))
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    speed = next(name for name in run.columns if name != "time_s")
    np.testing.assert_allclose(run[speed], RPM * SPEED, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("p_kPa", "kPa"), ("speed_rad_s", "rad/s"), ("oil °C", "°C"), ("v_km/h", "km/h"), ("t_µs", "µs"),
        ("angle_deg", "deg"), ("M/kNm", "kNm"), ("p:kPa", "kPa"), ("p-mbar", "mbar"), ("torque [kNm] filtered", "kNm"),
        ("p (kPa) 1", "kPa"), ("Time (s) - Plot 0", "s"), ("Amplitude (V) - Plot 0", "V"), ("Time [ms] 2", "ms"),
        ("wheel (L) speed", ""), ("M (Nm)-(raw)", "Nm"), ("signal (raw) 2", ""),
        ("p_kPa_mean", "kPa"), ("v_km_h_raw", "km/h"), ("torque_ft_lb", "ft_lb"),
        ("M_inlb", "in*lbf"), ("Engine RPM", "rpm"),
        ("RPM", "rpm"), ("n_RPM_raw", "rpm"), ("speedRpm", "rpm"), ("torqueNm", "Nm"), ("pressKpa", "kPa"),
        ("TIME_MS", "ms"), ("timeMs", "ms"), ("time_sec", "sec"), ("millis", "ms"), ("kNm", "kNm"),
        ("P_PSI", "psi"), ("p_BAR", "bar"),
        ("torquekNm", ""), ("Beams", ""), ("TIMES", ""),
        ("p_min", ""), ("p_in", ""), ("kPa_to_bar_psi_x", ""), ("M.kNm", ""), ("debar_x", ""),
        ("n_rad", ""), ("items", ""), ("bar", ""), ("crossbar", ""), ("p_NM", ""), ("x_s", ""),
        ("clutch_torque_nm", "Nm"), ("Motor moment NM", "Nm"), ("torque_knm", "kNm"), ("line_pressure_mpa", "MPa"),
        ("valve_voltage_v", "V"), ("valve_current_ma", "mA"), ("oil_temperature_degc", "degC"), ("force_kn", "kN"),
        ("gap_nm", ""), ("mpa", ""), ("v", ""), ("current_a", ""), ("torque_nm_s", ""), ("voltage", ""),
    ],
)  # fmt: skip
def test_only_words_that_are_nothing_else_are_units(name: str, unit: str) -> None:
    assert hint_unit(name)[1] == unit


def test_work_is_no_torque(tmp_path: Path) -> None:
    path = write(tmp_path, "time [ms]", "work [kJ]")
    torque = "[columns]\ntime_s = { number = 1 }\ntorque_nm = { number = 2 }\n"
    assert "'work' for torque_nm is in 'kJ', which cannot be converted into 'Nm'" in find_refusal(
        tmp_path, path, torque
    )
    assert 'work_1 = { from = "work", unit = "1", unit_from = "map" }' in draft_map(path, open_recording(path))


def test_one_time_in_two_units_is_no_second_table(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    rows = (f"{1e3 * t:.0f},{t:.2f},{n:.4f}" for t, n in zip(TIME, SPEED, strict=True))
    path.write_text("\n".join(["time [ms],time [s],speed [rpm]", *rows, ""]))
    run = import_by(tmp_path, path, draft_map(path, open_recording(path)))
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["time_2_s"], TIME, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("step", "first", "asked"), [(10.0, 0.0, True), (1.0, 500.0, True), (0.5, 0.0, False), (1.0, 1.7e9, False)]
)
def test_a_draft_does_not_take_whole_numbers_for_seconds(
    tmp_path: Path, step: float, first: float, asked: bool
) -> None:
    path = tmp_path / "recording.csv"
    path.write_text("\n".join(["time,speed [rpm]", *(f"{first + step * n:.10g},{n}" for n in range(ROWS)), ""]))
    draft = draft_map(path, open_recording(path))
    assert (f'# time_s = {{ from = "time", unit = "ms" }}  # rises by {step:g} a row, and' in draft) is asked
    if asked:
        assert "has no column time_s" in find_refusal(tmp_path, path, draft)
        run = import_by(tmp_path, path, draft.replace("# time_s", "time_s"))
        np.testing.assert_allclose(run["time_s"], 1e-3 * (first + step * np.arange(ROWS)))
    else:
        assert import_by(tmp_path, path, draft)["time_s"][1] == pytest.approx(step)


def test_a_draft_says_how_a_current_takes_the_place_of_the_valves_voltage(tmp_path: Path) -> None:
    path = write(tmp_path, "time_ms", "I valve [mA]")
    draft = draft_map(path, open_recording(path))
    line = next(line for line in draft.splitlines() if line.startswith("# valve_voltage_v = "))
    assert "scale is in V per mA" in line
    run = import_by(
        tmp_path, path, draft + line.removeprefix("# ").replace("scale =", "scale = 0.005").partition("  #")[0]
    )
    np.testing.assert_allclose(run["valve_voltage_v"], 0.005 * SPEED)
