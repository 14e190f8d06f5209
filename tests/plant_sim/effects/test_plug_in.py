"""An effect is one file: the one of docs/effects.md, and files that cannot be effects."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clutch_hil.bench.effect_sheets.effect_text import split_sections
from plant_sim.effects.catalogue import VARIABLE, load_effects
from plant_sim.effects.effect import SECTIONS
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.realtime import child
from tests.clutch_hil.live.running import run_command
from tests.processes import list_errors

PAGE = (Path(__file__).parents[3] / "docs" / "effects.md").read_text(encoding="utf-8")
EXAMPLE = next(block for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "EFFECT = " in block)
ENABLING = 10.0  # ms of CPU, from switching on to the end of the next step; measured 0.4 ms, compiling one law takes 35
DITHER = 40.0  # Hz, of the example
LINE = 10.0  # times what lies beside it in the spectrum of the pressure; measured 146, and 1.1 without the effect


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder of effects with the page's example in it, for this process and those it starts."""
    made = tmp_path / "effects"
    made.mkdir()
    (made / "valve_dither.py").write_text(EXAMPLE, encoding="utf-8")
    monkeypatch.setenv(VARIABLE, str(made))
    return made


def read_document(*arguments: str) -> Any:
    """The document of a command in a process of its own."""
    done = subprocess.run(child.list_command(*arguments, "--json"), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_an_effect_is_one_new_file(folder: Path, tmp_path: Path) -> None:
    sheet = read_document("effects", "valve_dither", "--out", str(tmp_path))
    assert (sheet["ours"], sheet["hooks"], sheet["block"]) == (False, ["COMMAND"], "valve")
    assert sheet["shown"]["times_resolution"] > 1.0
    assert Path(sheet["picture"]).stat().st_size > 10_000
    rig = tmp_path / "rig.toml"
    rig.write_text("[valve_dither]\namplitude = 2.0  # bar\n", encoding="utf-8")
    result = read_document("simulate", "--seconds", "3", "--plant-parameters", str(rig), "--out", str(tmp_path))
    run = read_run(Path(result["run"]))
    assert run.metadata["plant_parameters"]["valve_dither.amplitude"] == 2.0
    pressure = run["cylinder_pressure_bar"][1000:]
    size = np.abs(np.fft.rfft((pressure - pressure.mean()) * np.hanning(pressure.size)))
    line = round(DITHER * pressure.size * 1e-3)
    assert size[line] > LINE * np.median(size[line + 10 : line + 60])


def test_the_list_marks_whose_an_effect_is(folder: Path) -> None:
    text = run_command("effects").stdout
    assert f"  valve_dither (no candidate; from {folder}): Dither of the valve: " in text
    assert f"  friction_level: {load_effects()['friction_level'].title}\n" in text
    assert re.search(r"amplitude +bar +off 0 +typical 1 +0\.\.5 +\[D\] 4 % of 25 bar", text)
    assert text.rstrip().endswith("of them candidates of `clutch-hil discrepancy`")
    listed = json.loads(run_command("effects", "--json").stdout)
    assert [one["name"] for one in listed if not one["ours"]] == ["valve_dither"]
    assert {one["name"] for one in listed} == set(load_effects())


def test_the_sheet_of_an_effect_tells_all_of_it(tmp_path: Path) -> None:
    effect = load_effects()["piston_seal_friction"]
    done = run_command("effects", effect.name, "--out", str(tmp_path))
    assert done.exit_code == 0
    for name in ("What", *SECTIONS, "Hooks", "States", "Excludes", "Candidate"):
        assert re.search(rf"^{name} +\S", done.stdout, re.MULTILINE), name
    for p in effect.parameters:
        assert p.source in done.stdout
    assert f"wrote:   {tmp_path / 'effect-piston_seal_friction.png'}\n" in done.stdout
    assert re.search(r"^with - without +[▁▂▃▄▅▆▇]{40} ", done.stdout, re.MULTILINE)
    assert re.search(r"verdict: at typical values the clutch torque changes by up to [\d.]+ Nm", done.stdout)


BROKEN = {
    "empty": ("", r"defines no EFFECT = Effect\(\.\.\.\)"),
    "syntax": ("def", "cannot be loaded: SyntaxError"),
    "name": ("import nowhere_to_be_found", "cannot be loaded: ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
    "moved": (
        "from plant_sim.effects.backlash import EFFECT",
        r"plant_sim\.effects\.backlash is now plant_sim\.effects\.drive\.backlash$",
    ),
    "section": (EXAMPLE.replace("Assumptions", "Assumed    "), "effect section: its file's docstring lacks 'Assumptions'"),
    "unit": (EXAMPLE.replace('"bar"', '"barr"'), "effect unit, parameter amplitude: unit 'barr' is unknown"),
    "Pump-Puls": (EXAMPLE, r"effect file \S+: 'Pump-Puls' is not a valid name of an effect"),
    "rival": (EXAMPLE.replace("candidate=False", "excludes=('backlsh',)"), "excludes 'backlsh', .* did you mean backlash"),
    "bounds": (EXAMPLE.replace("typical=1.0", "typical=9.0"), r"bounds\.amplitude = 9 bar is outside 0..5"),
    "off": (EXAMPLE.replace("typical=1.0", "typical=0.0"), "effect off: amplitude is off at its typical value 0 bar"),
    "block": (EXAMPLE.replace('block="valve"', 'block="spool"'), "block 'spool' is unknown; allowed are valve, hydraulics"),
    "ends": ("import sys; sys.exit(3)", "cannot be loaded: SystemExit: 3"),
    "twice": (EXAMPLE.replace('Shape("frequency"', 'Shape("amplitude"'), "effect twice has 2 parameters 'amplitude'; allowed"),
    "state": (EXAMPLE.replace('"phase", "rad"', '"phase", "radd"'), "effect state, state phase: unit 'radd' is unknown"),
    "size": (EXAMPLE.replace('"phase", "rad"', '"phase", "rad", 0'), "state phase has the size 0; allowed are 1 to 100000"),
    "sizes": (EXAMPLE.replace('"phase", "rad"', '"phase", "rad", 10**12'), "state phase has the size 1000000000000; allowed"),
    "dotted": (EXAMPLE.replace('"amplitude"', '"ampli.tude"'), "'ampli.tude' is not a valid name for its parameters"),
    "rank": (EXAMPLE.replace("candidate=False", "rank='x'"), "effect rank: rank is 'x'; a whole number is needed"),
    "rate": (EXAMPLE.replace("candidate=False", "rate=5"), r"effect rate: rate is 5; a function rate\(p, c\) is needed"),
    "hook": (EXAMPLE.replace("{COMMAND: shake}", "{99: shake}"), "laws must be a table of one or more hooks"),
    "borrowed": (
        EXAMPLE.replace("COMMAND: shake", "COMMAND: scale").replace(
            "from math", "from plant_sim.effects.valve.valve_gain import scale\nfrom math"
        ),
        r"effect file \S+borrowed\.py: its law scale is of plant_sim\.effects\.valve\.valve_gain; allowed are functions that",
    ),
    "friction_level": (EXAMPLE, r"effect friction_level of \S+ exists already, in \S+friction_level\.py"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_file_that_is_no_effect_is_told_in_one_sentence(name: str, folder: Path) -> None:
    text, reason = BROKEN[name]
    (folder / f"{name}.py").write_text(text, encoding="utf-8")
    error = run_command("effects").exception
    assert isinstance(error, InputError)
    assert re.search(reason, str(error)), error
    assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        ("s.demand +=", "s.demnad +=", "s.demnad is unknown; did you mean demand"),
        ("p.amplitude", "p.amplitud", "p.amplitud is unknown; did you mean amplitude"),
        ("+= p.amplitude * sin(x.phase)", "= open(x.phase)", "open"),
    ],
)
def test_a_law_that_cannot_be_compiled_is_told(before: str, after: str, reason: str, folder: Path) -> None:
    (folder / "wrong.py").write_text(EXAMPLE.replace(before, after), encoding="utf-8")
    error = run_command("effects", "wrong").exception
    assert isinstance(error, InputError)
    assert re.fullmatch(rf"effect wrong \(\S+wrong\.py\) cannot be compiled: .*{reason}.*", str(error)), error


SINE = "s.demand += p.amplitude * sin(x.phase)"


@pytest.mark.parametrize(
    ("after", "reason"),
    [
        ("raise ValueError('too\\nmuch')", "raises ValueError: too much; no exception is allowed there"),
        ("s.demand += p.amplitude * (0.0 * s.slip / 0.0)", "makes s.demand nan at typical values; the values must"),
        ("x.phase = 1.0 / (p.amplitude - 1e5)", "makes x.phase inf at typical values; the values must be finite"),
        ("s.torque += p.amplitude * sin(x.phase)", "changes s.torque; it may change only s.demand, s.supply_pressure"),
        ("c.piston_area *= 1.1", "changes c.piston_area; it may change only s.demand, s.supply_pressure"),
        ("p.amplitude *= 1.1", "changes p.amplitude; it may change only s.demand, s.supply_pressure"),
    ],
)
def test_a_law_that_is_wrong_where_it_is_called_is_told(after: str, reason: str, folder: Path, tmp_path: Path) -> None:
    (folder / "wrong.py").write_text(EXAMPLE.replace(SINE, after), encoding="utf-8")
    error = run_command("effects", "wrong", "--out", str(tmp_path)).exception
    assert isinstance(error, InputError)
    sentence = rf"effect wrong \(\S+wrong\.py\): its law at COMMAND {re.escape(reason)}.*"
    assert re.fullmatch(sentence, str(error)), error


def test_a_law_that_moves_a_state_without_a_step_is_told(folder: Path) -> None:
    text = EXAMPLE.replace("COMMAND", "TORQUE").replace(SINE, "x.phase += 1.0")
    (folder / "wrong.py").write_text(text, encoding="utf-8")
    sentence = r"its law at TORQUE changes x\.phase in a call with h = 0; no state may change there"
    with pytest.raises(InputError, match=sentence):
        wet_clutch.Rig(wet_clutch.load_nominal(), also=("wrong",))


@pytest.mark.parametrize(
    ("rate", "reason"), [("1 / 0", "ZeroDivisionError: division by zero"), ("'much'", "ValueError: could not convert")]
)
def test_a_rate_that_fails_is_told(rate: str, reason: str, folder: Path) -> None:
    text = EXAMPLE.replace("candidate=False", f"rate=lambda p, c: {rate}")
    (folder / "wrong.py").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"effect wrong .*: its rate raises {reason}"):
        wet_clutch.Rig(wet_clutch.load_nominal().with_values({"wrong.amplitude": 1.0}))


def test_an_effect_that_is_wrong_is_refused_though_it_is_off(folder: Path) -> None:
    (folder / "wrong.py").write_text(EXAMPLE.replace(SINE, "s.torque += 1.0"), encoding="utf-8")
    with pytest.raises(InputError, match=r"effect wrong .* changes s\.torque"):
        wet_clutch.warm()


def test_a_law_of_the_rig_may_not_change_its_sensors(folder: Path) -> None:
    text = EXAMPLE.replace("COMMAND", "RIG").replace(SINE, "c.sensors_pressure_bits += 1.0")
    (folder / "wrong.py").write_text(text, encoding="utf-8")
    with pytest.raises(
        InputError, match=r"at RIG changes c.sensors_pressure_bits; it may change only fields of c, except"
    ):
        wet_clutch.Rig(wet_clutch.load_nominal(), also=("wrong",))


def test_an_effect_cannot_hide_parameters_of_the_rig(folder: Path) -> None:
    (folder / "valve.py").write_text(EXAMPLE, encoding="utf-8")
    with pytest.raises(InputError, match="effect valve has the name of a parameter group of the rig;"):
        wet_clutch.load_nominal()


def test_what_is_wrong_ends_with_exit_code_2(folder: Path) -> None:
    done = subprocess.run(child.list_command("effects", "valve_ditter"), capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (error,) = list_errors(done.stderr)
    assert re.fullmatch("error: effect 'valve_ditter' is unknown; did you mean valve_dither.*", error)


def test_a_folder_that_does_not_exist_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "/no/such/folder")
    error = run_command("effects").exception
    assert str(error) == f"folder /no/such/folder of {VARIABLE} does not exist"
    monkeypatch.setenv(VARIABLE, __file__)
    error = run_command("effects").exception
    assert str(error) == f"folder {__file__} of {VARIABLE} is a file; a folder of effect files is needed"


ENABLE = """
import json, time
from plant_sim.effects.catalogue import load_effects
from plant_sim.node.plant_node import PlantNode
PlantNode.warm()
node = PlantNode()
node.sample(); node.advance()
took = {}
for effect in load_effects().values():
    began = time.process_time()
    node.tune(effect.list_typical_values())
    node.sample(); node.advance()
    took[effect.name] = 1e3 * (time.process_time() - began)
    assert node.make_row()
    node.tune(effect.list_off_values())
print(json.dumps(took))
"""


def test_switching_on_compiles_nothing(folder: Path) -> None:
    done = subprocess.run([sys.executable, "-c", ENABLE], capture_output=True, text=True, check=True)
    took = json.loads(done.stdout)
    assert "valve_dither" in took, "a user's effect as well"
    slowest = max(took, key=lambda name: took[name])
    median = np.median(list(took.values()))
    print(f"\nCPU from switching on to the next sample: {slowest} {took[slowest]:.2f} ms, median {median:.2f} ms")
    assert took[slowest] < ENABLING


def test_the_example_has_every_section(folder: Path) -> None:
    assert list(split_sections(load_effects()["valve_dither"])) == ["What", *SECTIONS]
    assert "valve_dither.amplitude" in wet_clutch.load_nominal()


def test_the_lock_of_an_editor_is_no_effect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Emacs marks a file that is not saved by a link beside it, to what is no file."""
    (tmp_path / ".#mine.py").symlink_to("me@host.123:456")
    ours = load_effects()
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert load_effects() == ours
