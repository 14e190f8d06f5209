"""A bench of another size: a clutch of six times the torque on frames of 300 Nm, as two processes on a bus."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.run_file import read_run
from clutch_hil.identify.controller_values import derive_controller_values
from plant_sim.rigs import wet_clutch
from protocols.can.size import DATABASE, read_guard_values, write_sized_text
from rt_controller.loop.parameter_sets import OWN_LIMITS, load_controller_parameters

SIZE = 6.0
SCALED = (
    "clutch.coulomb_slope", "clutch.coulomb_intercept", "clutch.viscous_slope", "clutch.viscous_intercept", "motor.inertia",
    "motor.proportional_gain", "motor.integral_gain", "motor.torque_limit", "oil.heat_capacity", "oil.heat_transfer",
)  # fmt: skip
PROFILE = """time_s,torque_demand_nm,motor_speed_demand_rad_s
0,0,10.5
0.3,0,10.5
0.55,60,10.5
1.5,60,10.5
1.8,120,20
3,120,20
3.2,0,10.5
3.6,0,10.5
"""


def write_parameters(path: Path, values: dict[str, float]) -> Path:
    groups: dict[str, list[str]] = {}
    for name, value in values.items():
        group, _, own = name.partition(".")
        groups.setdefault(group, []).append(f"{own} = {value!r}")
    path.write_text("\n".join(f"[{group}]\n" + "\n".join(lines) for group, lines in groups.items()))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With own.dbc, limits.toml, plant.toml, controller.toml and demands.csv."""
    folder = tmp_path_factory.mktemp("larger")
    (folder / "own.dbc").write_text(write_sized_text(50.0 * SIZE, 40.0), encoding="utf-8")
    values = {**read_guard_values(folder / "own.dbc"), "motor_torque": SIZE * 40.0}
    (folder / "limits.toml").write_text("[guard]\n" + "\n".join(f"{name} = {v!r}" for name, v in values.items()))
    nominal = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    plant = {name: SIZE * nominal[name] for name in SCALED}
    write_parameters(folder / "plant.toml", plant)
    controller = derive_controller_values({**nominal, **plant}, nominal, load_controller_parameters())
    write_parameters(folder / "controller.toml", {name: value for name, (value, _) in controller.items()})
    (folder / "demands.csv").write_text(PROFILE)
    return folder


def play(folder: Path, *words: str, **changed: str) -> subprocess.CompletedProcess:
    environment = {**os.environ, DATABASE: "own.dbc", OWN_LIMITS: str(folder / "limits.toml"), **changed}
    command = [sys.executable, "-m", "clutch_hil", *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_a_clutch_of_six_times_the_torque_follows_its_demand(folder: Path, local_bus: str) -> None:
    files = ("--plant-parameters", "plant.toml", "--controller-parameters", "controller.toml")
    words = ("up", "--bus", local_bus, "--lockstep", "--no-telemetry", "--profile", "demands.csv", *files, "--json")
    done = play(folder, *words)
    assert done.returncode == 0, done.stderr
    run = read_run(folder / json.loads(done.stdout)["run"])
    settled = (run["torque_demand_nm"] > 59.9) & (run["time_s"] % 1.5 > 0.7)
    assert run["truth_clutch_torque_nm"].max() > 118.0
    assert np.abs(run["truth_clutch_torque_nm"] - run["torque_demand_nm"])[settled].mean() < 0.02 * 60.0
    assert not run["controller_fault"].any()
    step = np.unique(np.round(np.diff(np.unique(run["clutch_torque_nm"])), 9)).min()
    assert step == pytest.approx(
        2.0 * 50.0 * SIZE / 65536, rel=1e-3
    )  # Nm a count: of a converter of 16 bits and 300 Nm


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({OWN_LIMITS: ""}, "MOTOR_COMMAND.TORQUE_LIMIT has the factor 0.006 and offset 0; the guard's are 0.001 and 0"),
        ({DATABASE: ""}, "set-point 60 Nm is outside 0..30 Nm"),
        ({DATABASE: "none.dbc"}, "none.dbc does not exist"),
        (
            {DATABASE: "demands.csv"},
            "demands.csv is malformed: its text has none of the formats dbc, arxml, kcd, sym, cdd",
        ),
    ],
)
def test_what_does_not_belong_together_is_one_sentence(
    folder: Path, local_bus: str, changed: dict[str, str], sentence: str
) -> None:
    done = play(folder, "up", "--bus", local_bus, "--lockstep", "--no-telemetry", "--profile", "demands.csv", **changed)
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert sentence in line


def test_the_command_writes_such_a_database(folder: Path) -> None:
    written = folder / "written.dbc"
    done = play(
        folder, "frames", "--torque", "300", "--speed", "40", "--write", str(written), **{DATABASE: "", OWN_LIMITS: ""}
    )
    assert done.returncode == 0, done.stderr
    assert written.read_bytes() == (folder / "own.dbc").read_bytes()
    assert "[guard]\nmotor_range = 393.216\npressure_range = 10\ndata_key = " in done.stdout
    spaced = folder / "my rig.dbc"
    told = play(folder, "frames", "--torque", "300", "--write", str(spaced), **{DATABASE: "", OWN_LIMITS: ""})
    assert f"export {DATABASE}='{spaced}' {OWN_LIMITS}=FILE, in every terminal" in told.stdout  # as a shell takes it
    larger = ("--torque", "400", "--write", str(written), "--overwrite")
    again = play(folder, "frames", *larger, **{DATABASE: str(written), OWN_LIMITS: "not_there_yet.toml"})
    assert again.returncode == 0, again.stderr
    assert "motor_range = 524.288" in again.stdout
    for words, sentence in (
        (("--torque", "300"), "--torque needs --write, and cannot be combined with --dbc or --clutches"),
        (
            ("--pressure", "9", "--write", "small.dbc"),
            "a bench of 9 bar is not possible; allowed pressures are 10 to 60 bar",
        ),
        (
            ("--torque", "30", "--write", "small.dbc"),
            "a bench of 30 Nm is not possible; allowed torques are 50 to 3500 Nm",
        ),
        (("--torque", "300", "--write", str(written)), "written.dbc exists already"),
    ):
        refused = play(folder, "frames", *words, **{DATABASE: "", OWN_LIMITS: ""})
        assert refused.returncode == 2
        assert sentence in refused.stderr
    assert not (folder / "small.dbc").exists()
