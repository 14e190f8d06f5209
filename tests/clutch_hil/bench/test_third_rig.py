"""A third rig is one folder: that of docs/add_a_rig.md is found, simulated, judged and recorded, with no edit elsewhere."""

import importlib
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from clutch_hil.bench.pictures.figures import draw_run
from clutch_hil.bench.rig import GROUP, find_rig, list_rigs
from clutch_hil.bench.scenario import choose_scenario, load_scenario
from clutch_hil.bench.simulate import Simulation
from clutch_hil.command import make_application
from clutch_hil.discrepancy.models.named import find_model
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import read_run
from tests.packages import lay_out
from tests.processes import play_here

FOLDER = Path(__file__).parents[3] / "docs" / "examples" / "small_clutch"
SCENARIO = str(FOLDER / "gentle.toml")
POWER = 50.0  # W: 5 Nm at 10 rad/s


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The rig's package as pip would install it: its module, and its entry points from its own pyproject.toml."""
    site = tmp_path_factory.mktemp("site")
    lay_out(FOLDER, site)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", str(site), prepend=os.pathsep)
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
    with pytest.raises(InputError, match=r"scenario .*gentle\.toml is for the rig small_clutch, but --rig wet_clutch"):
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


SMALL = (FOLDER / "small_clutch.py").read_text(encoding="utf-8")
BROKEN = {  # what is replaced in the rig's module, by what, and what is told of it
    "raises": ("PLATES = 0.5", "raise RuntimeError('boom')", "cannot be loaded from broken:RIG of .*: RuntimeError: boom"),
    "ends": ("PLATES = 0.5", "raise SystemExit(3)", "broken cannot be loaded from broken:RIG of .*: SystemExit: 3"),
    "number": ("RIG = Rig(", "RIG = 5\nOTHER = Rig(", "rig broken is 5; a Rig"),
    "plant": ("plant=PLANT", "plant=5", "rig broken has the plant 5; a PlantRig"),
    "name": ('name="broken"', 'name="other"', "rig broken is called 'other' in its PlantRig; allowed is the entry"),
    "shadow": ('name="broken"', 'name="wet_clutch"', "rig broken is called 'wet_clutch' in its PlantRig"),
    "node": ("node=PlantNode", "node=object", "rig broken: its node <class 'object'> lacks columns; allowed is a class"),
    "figures": ('figures=("regime', 'figures=("regim', "measure 'regim_error_nm' is unknown on the rig broken; did you mean"),
    "no figure": ('figures=("regime_error_nm", "peak_power_w")', "figures=()", "rig broken has no figures"),
    "fault": ("**OF_ONE_CLUTCH,", '**{k: v for k, v in OF_ONE_CLUTCH.items() if k != "fault"},', "measure 'fault' is unknown"),
    "measures": ("broken:MEASURES", "broken:MEASURE_", "rig broken: broken:MEASURE_ cannot be loaded: AttributeError"),
    "table": ("broken:MEASURES", "broken:PLATES", "rig broken: broken:PLATES is not a table of measures"),
}  # fmt: skip
BROKEN_IN_USE = {
    "nominal": ("    whole =", "    raise ValueError('bad')\n    whole =", "rig broken: nominal raises ValueError: bad"),
    "no parameters": ("load_overlay(changed, small) if changed else small", "None", "nominal returns None; a ParameterSet"),
    "profile": ("load_profile=load_profile", "load_profile=lambda name, seconds: 5", "load_profile returns 5, whose duration"),
    "profile raises": ("load_profile=load_profile", "load_profile=lambda name: 5", "load_profile raises TypeError: "),
    "sheet": ("picture:make_run_sheet", "picture:nope", "rig broken: clutch_hil.bench.pictures.picture:nope cannot be loaded"),
    "judge": ("result:judge_run", "result:nope", "rig broken: clutch_hil.bench.result:nope cannot be loaded"),
    "no status": ('"clutch_hil.bench.status:StatusLine"', '""', 'rig broken has an empty text .*; "module:name" is needed'),
    "status": ("clutch_hil.bench.status:StatusLine", "broken:PLATES", "rig broken: broken:PLATES is 0.5; a function or class"),
}  # fmt: skip


@pytest.fixture
def broken(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The small clutch as the rig `broken`, with a replacement in its module; what is to be told of it."""
    old, new, sentence = request.param
    text = SMALL.replace("small_clutch", "broken")
    assert old in text
    (tmp_path / "broken.py").write_text(text.replace(old, new), encoding="utf-8")
    metadata = tmp_path / "broken-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: broken\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{GROUP}]\nbroken = broken:RIG\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield sentence
    sys.modules.pop("broken", None)


@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN, indirect=True)
def test_a_rig_that_is_wrong_is_refused_where_it_is_looked_up(broken: str) -> None:
    with pytest.raises(InputError, match=broken):
        find_rig("broken")


@pytest.mark.parametrize("broken", BROKEN_IN_USE.values(), ids=BROKEN_IN_USE, indirect=True)
def test_a_rig_that_is_wrong_is_refused_before_a_run(broken: str, tmp_path: Path) -> None:
    def fail(done: int, total: int) -> None:
        raise AssertionError("it was played")

    with pytest.raises(InputError, match=broken):
        Simulation(choose_scenario(None, {"out": tmp_path, "seconds": 0.6}, "broken")).run(fail)
    assert not list(tmp_path.glob("*.parquet"))


@pytest.mark.parametrize(
    "broken",
    [
        ("float(np.max(", "float(1 / 0 + np.max(", "rig broken: measure peak_power_w raises ZeroDivisionError: "),
        ("float(np.max(", "str(np.max(", "measure peak_power_w returns '0.0'; a number in W is needed"),
    ],
    indirect=True,
)
def test_a_measure_that_fails_is_told(broken: str) -> None:
    zeros = np.zeros(3)
    with pytest.raises(InputError, match=broken):
        find_rig("broken").compute_measure(
            "peak_power_w", {"truth_clutch_torque_nm": zeros, "truth_slip_speed_rad_s": zeros}
        )


@pytest.mark.parametrize(
    "broken",
    [
        (
            "clutch_hil.bench.result:judge_run",
            "broken:load_nominal",
            "rig broken: broken:load_nominal raises TypeError: .*; the run is complete, in .*simulated.parquet",
        )
    ],
    indirect=True,
)
def test_a_judge_that_fails_leaves_the_run_and_names_it(broken: str, tmp_path: Path) -> None:
    simulation = Simulation(choose_scenario(None, {"out": tmp_path, "seconds": 0.6}, "broken"))
    with pytest.raises(InputError, match=broken):
        simulation.run(lambda done, total: None)
    assert len(list(tmp_path.glob("*.parquet"))) == 1


@pytest.mark.parametrize(
    "broken",
    [("status_at=", 'model_at="broken:peak_power", status_at=', "broken:peak_power raises TypeError: ")],
    indirect=True,
)
def test_a_model_that_fails_is_told(broken: str) -> None:
    with pytest.raises(InputError, match=broken):
        find_rig("broken").model()


@pytest.mark.parametrize(
    "broken",
    [
        (
            "clutch_hil.bench.pictures.picture:make_run_sheet",
            "broken:load_nominal",
            "rig broken: the picture .*TypeError",
        )
    ],
    indirect=True,
)
def test_a_picture_that_fails_is_told(broken: str) -> None:
    with pytest.raises(InputError, match=broken):
        draw_run(Run({"time_s": np.zeros(3)}, {"rig": "broken"}))


PAGE = (FOLDER.parents[1] / "add_a_rig.md").read_text(encoding="utf-8")
(POWER_NODE,) = re.findall(r"```python\n(class PowerNode.*?)```", PAGE, re.DOTALL)
OWN_NODE = (
    'PLANT = PlantRig(\n    name="broken",\n    node=PlantNode,',
    f'from protocols.node import Column\n\n{POWER_NODE}\nPLANT = PlantRig(\n    name="broken",\n    node=PowerNode,',
    "",
)


@pytest.mark.parametrize("broken", [OWN_NODE], indirect=True)
def test_a_node_of_ones_own_has_its_columns_and_the_same_plant(broken: str, tmp_path: Path) -> None:
    """Its steps are done: compiled calls would pass over them."""
    scenario = choose_scenario(None, {"out": tmp_path, "seconds": 1.0}, "broken")
    columns = Simulation(scenario).play(scenario.plant, 1).make_columns()
    power = columns.pop("truth_friction_power_w")
    np.testing.assert_array_equal(power, columns["truth_clutch_torque_nm"] * columns["truth_slip_speed_rad_s"])
    assert power.max() > 0.5 * POWER  # of 1 s, in which the torque still rises
    small = choose_scenario(None, {"out": tmp_path, "seconds": 1.0}, "small_clutch")
    for name, values in Simulation(small).play(small.plant, 1).make_columns().items():
        np.testing.assert_array_equal(columns[name], values, name)


OWN_STEPS = {  # what `PowerNode.show` does after its first line, and what is told of it
    "raises": ("        1 / 0", "ZeroDivisionError: division by zero, in PowerNode.show of .*broken.py line [0-9]+$"),
    "old name": ("        catalogue.effect", "AttributeError: .*effect is now plant_sim.effects.catalogue.find_effect"),
    "answers nonsense": ("        return 'two'", "TypeError: "),  # raised by the bench
}


@pytest.mark.parametrize("wrong", OWN_STEPS.values(), ids=OWN_STEPS)
@pytest.mark.parametrize("broken", [OWN_NODE], indirect=True)
def test_a_node_that_fails_while_it_runs_is_told_with_its_class_and_line(
    broken: str, wrong: tuple[str, str], tmp_path: Path
) -> None:
    step, sentence = wrong
    file = tmp_path / "broken.py"
    text = file.read_text(encoding="utf-8").replace("        row = dict(", f"{step}\n        row = dict(")
    file.write_text(f"from plant_sim.effects import catalogue\n{text}", encoding="utf-8")
    scenario = choose_scenario(None, {"out": tmp_path, "seconds": 0.6}, "broken")
    with pytest.raises(InputError, match=f"the node PowerNode of .*broken.py raises {sentence}"):
        Simulation(scenario).play(scenario.plant, 1)


def test_a_rig_of_two_packages_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    metadata = tmp_path / "lab_rigs-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: lab_rigs\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{GROUP}]\nwet_clutch = lab_rigs:RIG\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    find_rig.cache_clear()
    with pytest.raises(InputError, match="rig wet_clutch is offered by more than one package, clutch-hil, lab_rigs;"):
        find_rig("wet_clutch")
