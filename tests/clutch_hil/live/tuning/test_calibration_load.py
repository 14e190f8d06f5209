"""`clutch-hil tune --calibration` on a bench of real processes: all or nothing, and only while the clutch is open."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.identify.calibration import Calibration, Identified
from protocols.buses.bus import open_bus
from protocols.errors import InputError
from protocols.realtime import child as children
from tests.clutch_hil.live.running import Running, hear, run_command, running_bench, wait_until_open

SLOPE, CONTACT = 11.5, 2.4  # of the calibration: Nm/bar, bar
_SLIP_CONTROL = 2


@pytest.fixture(scope="module")
def bench() -> Iterator[Running]:
    with running_bench(telemetry=True) as running:
        yield running


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    plant = [Identified("clutch.coulomb_slope", SLOPE, 0.1, "Nm/bar", 10.8)]
    controller = {"model.coulomb_slope": (SLOPE, "a test"), "model.contact_pressure": (CONTACT, "a test")}
    path = tmp_path / "calibration.toml"
    Calibration("wet_clutch", plant, controller, np.eye(1), {}).write(path)
    return path


def read_values(bench: Running) -> dict[str, float]:
    done = run_command("tune", "--bus", bench.bus, "--json")
    names = ("controller.model.coulomb_slope", "controller.model.contact_pressure", "plant.clutch.coulomb_slope")
    sentence = json.loads(done.stdout)["parameters"]
    return {name: sentence[name]["value"] for name in names}


def load(bench: Running, path: Path, *options: str) -> dict:
    done = run_command("tune", "--calibration", str(path), *options, "--bus", bench.bus, "--json")
    assert done.exit_code == 0, done.exception
    return json.loads(done.stdout)


def find_refusal(bench: Running, path: Path, *options: str) -> str:
    done = run_command("tune", "--calibration", str(path), *options, "--bus", bench.bus)
    assert isinstance(done.exception, InputError)
    assert not done.stdout
    return str(done.exception)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('rig = "wet_clutch"', 'rig = "power_shift"', "is for the rig 'power_shift'; the rig on local:bench"),
        ("[calibration]", "[other]", "names no rig in a table"),
        ("value = 2.4", "value = 240.0", "contact_pressure = 240 bar is outside"),
        ("value = 2.4", 'value = 240.0, bounds = [0.1, 300.0]', "contact_pressure = 240 is outside"),
        ("value = 2.4", "value = nan", "contact_pressure = nan"),
        ('unit = "Nm/bar"', 'unit = "Nm"', "coulomb_slope is given in 'Nm'"),
        ("contact_pressure = {", "contact_presure = {", "contact_presure"),
        ("[controller.model]", "[other.model]", "has no table [controller]"),
        ("[controller.model]", "[controller.guard]", "guard"),
    ],
)  # fmt: skip
def test_what_cannot_be_taken_changes_nothing(
    bench: Running, calibration: Path, old: str, new: str, sentence: str
) -> None:
    before, text = read_values(bench), calibration.read_text(encoding="utf-8")
    assert old in text
    calibration.write_text(text.replace(old, new), encoding="utf-8")
    assert sentence in find_refusal(bench, calibration, "--with-plant")
    assert read_values(bench) == before


def test_a_file_that_is_not_there_is_told(bench: Running, tmp_path: Path) -> None:
    assert "does not exist" in find_refusal(bench, tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [(["--with-plant"], "--with-plant needs --calibration"), (["a=1", "--calibration", "c.toml"], "'a=1'")],
)
def test_options_that_do_not_go_together_are_told(options: list[str], sentence: str) -> None:
    done = run_command("tune", *options)
    assert sentence in str(done.exception)


def test_an_engaged_clutch_keeps_its_maps(bench: Running, calibration: Path) -> None:
    before = read_values(bench)
    words = ("demand", "--pressure", "2.6", "--speed", "10", "--bus", bench.bus)
    demand = subprocess.Popen(children.list_command(*words), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with open_bus(bench.bus) as port:
            hear(port, "CONTROLLER_STATUS", lambda status: status.phase == _SLIP_CONTROL)
        assert "is engaged (phase slip control)" in find_refusal(bench, calibration)
        assert read_values(bench) == before
    finally:
        demand.terminate()
        demand.wait()
    with open_bus(bench.bus) as port:
        wait_until_open(port)


def test_the_controller_gets_it_and_the_plant_only_on_demand(bench: Running, calibration: Path) -> None:
    before = read_values(bench)
    sentence = load(bench, calibration)
    changed = {f"{one['node']}.{one['name']}": one["new"] for one in sentence["changed"]}
    wanted = {"controller.model.coulomb_slope": SLOPE, "controller.model.contact_pressure": CONTACT}
    assert changed == wanted
    assert read_values(bench) == before | wanted
    done = run_command("tune", "--calibration", str(calibration), "--with-plant", "--bus", bench.bus)
    assert "plant.clutch.coulomb_slope  10.8 -> 11.5 Nm/bar" in done.stdout
    assert "as before: 2 values" in done.stdout
    assert read_values(bench) == wanted | {"plant.clutch.coulomb_slope": SLOPE}
