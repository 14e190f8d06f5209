"""A third rig is one folder: that of docs/add_a_rig.md is found, simulated, judged and recorded, with no edit elsewhere."""

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from clutch_hil.bench.rig import GROUP, find_rig, list_rigs
from clutch_hil.bench.scenario import choose_scenario, load_scenario
from clutch_hil.bench.simulate import Simulation
from clutch_hil.command import make_application
from clutch_hil.discrepancy.models.named import find_model
from protocols.errors import InputError
from protocols.files.runs import read_run
from tests.processes import play_here

FOLDER = Path(__file__).parents[3] / "docs" / "examples" / "small_clutch"
SCENARIO = str(FOLDER / "gentle.toml")
POWER = 50.0  # W: 5 Nm at 10 rad/s


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The rig's package as pip would install it: its module, and its entry points from its own pyproject.toml."""
    site = tmp_path_factory.mktemp("site")
    project = tomllib.loads((FOLDER / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    metadata = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    points = project["entry-points"][GROUP]
    lines = [f"[{GROUP}]", *(f"{name} = {place}" for name, place in points.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    (site / "small_clutch.py").symlink_to(FOLDER / "small_clutch.py")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", str(site))
    yield
    find_rig.cache_clear()


def test_it_is_listed_with_the_others() -> None:
    assert list_rigs() == ("power_shift", "small_clutch", "wet_clutch")
    with pytest.raises(InputError, match="rig is 'lorry'; allowed are power_shift, small_clutch, wet_clutch"):
        find_rig("lorry")


def test_its_run_has_its_name_its_parameters_and_its_measures(tmp_path: Path) -> None:
    result = Simulation(load_scenario(SCENARIO, {"out": tmp_path})).run(lambda done, total: None)
    assert result.good, result.text
    (power, _) = result.judgements
    assert power.limit.measure == "peak_power_w"
    assert power.value == pytest.approx(POWER, rel=0.05)  # 49.4 measured
    run = read_run(result.document["run"])
    assert run.metadata["rig"] == "small_clutch"
    assert run.metadata["plant_parameters"]["clutch.coulomb_slope"] == 5.4
    end = run["torque_demand_nm"] > 4.9
    assert np.abs(run["truth_clutch_torque_nm"] - run["torque_demand_nm"])[end].mean() < 0.5  # Nm
    assert Path(result.document["picture"]).exists()


def test_a_limit_that_does_not_hold_breaks() -> None:
    scenario = load_scenario(SCENARIO)
    columns = Simulation(scenario).play(scenario.plant.with_values({"friction_level.level": 2.0}), 1).make_columns()
    judgement = scenario.limits[0].judge(columns)
    assert not judgement.holds, str(judgement)


def test_it_is_swept_by_its_own_figures(tmp_path: Path) -> None:
    words = ["simulate", SCENARIO, "--seeds", "2", "--seconds", "0.7", "--out", str(tmp_path), "--json"]
    done = CliRunner().invoke(make_application(), words)
    assert done.exit_code == 0, done.output
    (path,) = tmp_path.glob("*.csv")
    assert path.read_text().splitlines()[0] == "-,seed,regime_error_nm,peak_power_w"


def test_its_processes_in_lock_step_are_one_process_to_the_bit(local_bus: str, tmp_path: Path) -> None:
    words = ("up", SCENARIO, "--bus", local_bus, "--lockstep", "--no-telemetry", "--out", str(tmp_path), "--json")
    done = play_here(*words)
    assert done.returncode == 0, done.stderr
    run = read_run(json.loads(done.stdout)["run"])
    assert run.metadata["rig"] == "small_clutch"
    scenario = load_scenario(SCENARIO)
    for name, values in Simulation(scenario).play(scenario.plant, 1).make_columns().items():
        assert np.array_equal(run[name], values), name


def test_what_it_lacks_is_told() -> None:
    with pytest.raises(InputError, match="rig small_clutch has no discrepancy model"):
        find_model("small_clutch")
    with pytest.raises(InputError, match=r"scenario .*gentle\.toml is of the rig small_clutch, and --rig wet_clutch"):
        choose_scenario(SCENARIO, {}, "wet_clutch")


def test_a_rig_that_cannot_be_loaded_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    metadata = tmp_path / "broken-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: broken\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{GROUP}]\nbroken = no_such_module:RIG\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(
        InputError,
        match="rig broken cannot be loaded from no_such_module:RIG of the package broken: ModuleNotFoundError: No ",
    ):
        find_rig("broken")
