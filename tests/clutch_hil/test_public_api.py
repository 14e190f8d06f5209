"""The bench from Python: runs in memory are those of the command."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import clutch_hil as ch
from clutch_hil.command import make_application
from tests.processes import PATIENCE

SHORT = {"profile": "engagement", "seconds": 1.5}  # s: long enough to engage


def test_a_run_of_no_rig_is_read_as_it_is(tmp_path: Path) -> None:
    """As an imported one; the rig whose columns are missing names them."""
    time = np.arange(3) / 100.0
    ch.write_run(ch.Run({"time_s": time, "temperature_degc": 20.0 + time}, {}), tmp_path / "oven.parquet")
    assert list(ch.read_run(tmp_path / "oven.parquet")) == ["time_s", "temperature_degc"]
    ch.write_run(ch.Run({"time_s": time}, {"rig": "wet_clutch"}), tmp_path / "clutch.parquet")
    with pytest.raises(ch.InputError, match="lacks the column valve_voltage_v"):
        ch.read_run(tmp_path / "clutch.parquet")


def test_every_public_name_is_there() -> None:
    assert all(getattr(ch, name) is not None for name in ch.__all__)
    assert dir(ch) == sorted(ch.__all__)
    assert len(dir(ch)) <= 25
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = ch.simulat


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import sys, clutch_hil; print([n for n in ('scipy.stats', 'matplotlib', 'pyarrow', 'rerun') if n in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )


def test_a_run_in_memory_is_that_of_the_command(tmp_path: Path) -> None:
    run = ch.simulate(**SHORT, seed=3, plant={"friction_level.level": 0.9}, effects=["internal_leakage"])
    leak = run.metadata["plant_parameters"]["internal_leakage.conductance"]
    (tmp_path / "rig.toml").write_text(f"[friction_level]\nlevel = 0.9\n[internal_leakage]\nconductance = {leak}\n")
    done = CliRunner().invoke(
        make_application(),
        ["simulate", "--profile", "engagement", "--seconds", "1.5", "--seed", "3", "--out", str(tmp_path / "runs"),
         "--plant-parameters", str(tmp_path / "rig.toml")],
    )  # fmt: skip
    assert done.exit_code in (0, 1), done.output
    (file,) = (tmp_path / "runs").glob("*.parquet")
    written = ch.read_run(file)
    assert list(written.columns) == list(run.columns)
    for name, column in run.columns.items():
        np.testing.assert_array_equal(written[name], column, err_msg=name)
    assert (written.units, written.meanings) == (run.units, run.meanings)
    assert written.metadata["plant_parameters"] == run.metadata["plant_parameters"]
    assert written.metadata["effects"] == run.metadata["effects"] == ["friction_level", "internal_leakage"]


def test_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    ch.simulate(**SHORT)
    assert list(tmp_path.iterdir()) == []


def test_a_run_is_written_and_read_again(tmp_path: Path) -> None:
    run = ch.simulate(**SHORT)
    ch.write_run(run, tmp_path / "run.parquet")
    again = ch.read_run(tmp_path / "run.parquet")
    np.testing.assert_array_equal(again["clutch_torque_nm"], run["clutch_torque_nm"])
    assert ch.measure_run(again).keys() == ch.measure_run(run).keys()


def test_parameters_of_the_controller_are_changed() -> None:
    runs = [ch.simulate(**SHORT, controller={"torque.integral_gain": gain}) for gain in (0.05, 0.4)]
    assert [run.metadata["controller_parameters"]["torque.integral_gain"] for run in runs] == [0.05, 0.4]
    assert not np.array_equal(runs[0]["valve_voltage_v"], runs[1]["valve_voltage_v"])


def test_a_scenario_is_simulated_with_its_own_settings() -> None:
    run = ch.simulate("creep", seconds=1.0)
    assert run.metadata["scenario"] == "creep"
    assert len(run["time_s"]) == run.metadata["sample_rate_hz"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"profile": "engagment"}, "profile 'engagment' does not exist"),
        ({"scenario": "no_such"}, "scenario 'no_such' is unknown"),
        ({"plant": {"clutch.colour": 1.0}}, "clutch.colour"),
        ({"plant": {"friction_level.level": 99.0}}, "friction_level.level"),
        ({"plant": {"friction_level.level": float("nan")}}, "friction_level.level"),
        ({"controller": {"torque.no_such": 1.0}}, "torque.no_such"),
        ({"effects": ["warp_drive"]}, "effect 'warp_drive' is unknown"),
        ({"effects": {"internal_leakage": {"size": 1.0}}}, "effect internal_leakage has no parameter 'size'"),
        ({"effects": ""}, "effect '' is unknown"),
        ({"rate": 0}, "rate"),
        ({"rate": -200}, "rate -200 Hz is not possible; allowed are 50 to 10000 Hz"),
        ({"rate": 0.5}, "rate is 0.5; a whole number is needed"),
        ({"seed": -1}, "seed is -1; allowed are 0 and more, whole numbers"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"law": "both of them"}, "control law 'both of them' is unknown"),
        ({"temperature": float("nan")}, "oil temperature nan degC"),
        ({"seconds": -1.0}, "-1"),
        ({"scenario": "shift", "effects": ["friction_level"]}, "friction_level.level"),  # of which clutch?
    ],
)
def test_what_cannot_be_simulated_is_said_in_one_sentence(arguments: dict, sentence: str) -> None:
    with pytest.raises(ch.InputError) as error:
        ch.simulate(**arguments)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_a_result_of_the_thesis_is_checked_without_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = ch.reproduce("fig 2.13")
    assert result.entry.name == "figure-2.13"
    assert result.holds
    assert result.picture is None
    assert str(result).endswith(result.verdict)
    assert result.sheet.figure.axes
    assert list(tmp_path.iterdir()) == []


def test_every_friction_model_is_played_by_one_function() -> None:
    curve = ch.friction.Stribeck(static_force=10.0)  # N, at every speed
    springs = {"stiffness": [2e5, 1e5], "weights": [0.5, 0.5]}  # N/m
    models = [
        ch.friction.Coulomb(curve),
        ch.friction.Dahl(coulomb_force=10.0, stiffness=1e6),
        ch.friction.LuGre(curve, stiffness=1e6),
        ch.friction.ElastoPlastic(curve, stiffness=1e6),
        ch.friction.Leuven(curve, stiffness=[2e5, 1e5], limits=[5.0, 5.0]),
        ch.friction.MaxwellSlip(stiffness=[2e5, 1e5], limits=[5.0, 5.0]),
        ch.friction.GMS(curve, **springs),
        ch.friction.XGMS(ch.friction.Amontons(0.1), **springs, attraction=100.0),
    ]
    position = np.linspace(0.0, 1e-2, 2001)  # m: far beyond the springs' 50 um
    for model in models:
        trace = ch.friction.simulate(model, position, dt=1e-3, load=100.0)
        assert trace.force.shape == position.shape
        assert trace.force[-1] == pytest.approx(10.0, rel=1e-3), model
        np.testing.assert_array_equal(trace.force, model.trace(position, 1e-3, 100.0).force)


@pytest.mark.parametrize("place", ["protocols/__init__.py", "plant_sim.py"])
def test_a_module_beside_a_script_that_hides_a_package_of_the_bench_is_named(tmp_path: Path, place: str) -> None:
    script, hiding = tmp_path / "script.py", tmp_path / place
    script.write_text("import clutch_hil\n", encoding="utf-8")
    hiding.parent.mkdir(exist_ok=True)
    hiding.touch()
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=PATIENCE, check=False)
    name = Path(place).parts[0].removesuffix(".py")
    assert f"ImportError: clutch_hil needs the package {name} next to it in " in done.stderr
    assert f"Python finds {hiding.resolve()}: rename that" in done.stderr
