"""A new effect is one file: with nothing edited elsewhere it is listed, shown, simulated, and fitted by `discrepancy`."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clutch_hil.bench.effect_sheets.effect_page import list_published_names, names, rewrite_page
from clutch_hil.bench.effect_sheets.effect_text import is_ours, sort_effects
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from plant_sim.effects.catalogue import VARIABLE, load_effects
from plant_sim.effects.effect import Effect
from protocols.errors import InputError
from protocols.files.runs import read_run
from tests.clutch_hil.live.running import run_command

MARKDOWN = ".md"
PAGE = Path(__file__).parents[3] / "docs" / "effects.md"
NEW = '''"""Torque ripples as the teeth of the hub mesh.

What            each tooth of the hub carries its share of the torque a little earlier or later than its neighbour
Equation        M = M_0 + a cos(n theta + phi)
Assumptions     one order n; theta at mid-step
Valid range     a 0..5 Nm, n 0.5..200 a turn
Not modelled    clearance of the teeth (backlash)
References      [D] of a test
"""

from math import cos

from plant_sim.effects.display import Display
from plant_sim.effects.effect import Effect, Shape, Strength
from plant_sim.effects.signals import TORQUE
from plant_sim.effects.start import StrongestOrder


def mesh(s, c, p, x, h):
    """Add the ripple to the torque of closed plates."""
    s.torque += s.contact * p.amplitude * cos(p.order * (s.angle + 0.5 * h * s.slip) + p.phase)


EFFECT = Effect(
    block="friction",
    laws={TORQUE: mesh},
    parameters=(
        Strength("amplitude", "Nm", off=0.0, typical=0.5, bounds=(0.0, 5.0), source="[D] of a test"),
        Shape("order", "1", typical=17.0, bounds=(0.5, 200.0), source="[D] teeth of the hub"),
        Shape("phase", "rad", typical=0.5, bounds=(-3.2, 3.2), source="[D] of a test"),
    ),
    display=Display("crawl", column="clutch_torque_nm", over="shaft_angle_rad"),
    start=StrongestOrder("clutch_torque_nm"),
)
'''
SAMPLES, PERIOD = 4000, 1e-3  # of a run, s
ORDER_STEP = 0.05  # orders are tried at multiples of this
AMPLITUDE = 0.1  # relative error of the start's amplitude; measured 0.03


@pytest.fixture
def new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Effect:
    """The new effect, from a folder of the user's."""
    folder = tmp_path / "effects"
    folder.mkdir()
    (folder / "hub_mesh.py").write_text(NEW, encoding="utf-8")
    monkeypatch.setenv(VARIABLE, str(folder))
    return load_effects()["hub_mesh"]


def read_document(*arguments: str) -> Any:
    """The JSON document of a command."""
    done = run_command(*arguments, "--json")
    assert done.exit_code == 0, done.exception
    return json.loads(done.stdout)


def simulate_turning() -> dict[str, np.ndarray]:
    """Columns of a run (n,): pressed plates that slip at changing speed; measured ones as they are at rest."""
    time = PERIOD * np.arange(SAMPLES)
    still = dict.fromkeys(("shaft_angle_rad", "clutch_torque_nm", "motor_torque_nm", "slip_speed_rad_s"), 0.0 * time)
    return still | {
        "time_s": time,
        "valve_voltage_v": np.full(SAMPLES, 1.36),
        "motor_speed_demand_rad_s": 20.0 + 5.0 * np.sin(time),
        "cylinder_pressure_bar": 0.0 * time,
        "oil_temperature_degc": np.full(SAMPLES, 70.0),
    }


def test_it_is_listed(new: Effect) -> None:
    (listed,) = [one for one in read_document("effects") if one["name"] == "hub_mesh"]
    assert listed["title"] == "Torque ripples as the teeth of the hub mesh"
    assert listed["candidate"]
    assert not listed["ours"]


def test_it_is_shown_as_its_file_says(new: Effect, tmp_path: Path) -> None:
    sheet = read_document("effects", "hub_mesh", "--out", str(tmp_path))
    assert sheet["shown"]["excitation"] == "slip of 4 rad/s, 3.4 bar"
    assert sheet["shown"]["column"] == "clutch_torque_nm"
    assert sheet["shown"]["largest"] == pytest.approx(0.5, rel=0.1)  # its amplitude, but for what the rig answers
    assert Path(sheet["picture"]).stat().st_size > 10_000


def test_it_is_shown_again_and_its_picture_kept(new: Effect, tmp_path: Path) -> None:
    words = ("effects", "hub_mesh", "--out", str(tmp_path))
    run_command(*words)
    picture = tmp_path / "effect-hub_mesh.png"
    picture.write_bytes(b"kept")
    again = run_command(*words)
    assert again.exit_code == 0
    assert f"wrote:   nothing; {picture} exists already, --overwrite replaces it\n" in again.stdout
    assert picture.read_bytes() == b"kept"
    run_command(*words, "--overwrite")
    assert picture.read_bytes() != b"kept"


def test_it_is_simulated(new: Effect, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("[hub_mesh]\namplitude = 0.5  # Nm\n", encoding="utf-8")
    with_it = read_document(
        "simulate", "--seconds", "2", "--plant-parameters", str(rig), "--out", str(tmp_path / "with")
    )
    without = read_document("simulate", "--seconds", "2", "--out", str(tmp_path / "without"))
    torques = [read_run(Path(result["run"]))["truth_clutch_torque_nm"] for result in (with_it, without)]
    assert np.abs(torques[0] - torques[1]).max() > 0.25


def test_it_is_a_candidate_whose_fit_begins_where_its_file_says(new: Effect) -> None:
    model = WetClutch()
    (candidate,) = [one for one in model.candidates if one.name == "hub_mesh"]
    run, baseline = simulate_turning(), {name: p.value for name, p in model.parameters.items()}
    hidden = {"hub_mesh.amplitude": 0.8, "hub_mesh.order": 23.0, "hub_mesh.phase": -1.0}
    without, with_it = model.simulate(run, baseline, {}), model.simulate(run, baseline, hidden)
    measured = run | with_it | {"shaft_angle_rad": PERIOD * np.cumsum(with_it["slip_speed_rad_s"])}
    residuals = {column: with_it[column] - without[column] for column in with_it}
    (start,) = model.suggest_starts(candidate, measured, residuals)
    assert start["hub_mesh.order"] == pytest.approx(23.0, abs=ORDER_STEP)
    assert start["hub_mesh.amplitude"] == pytest.approx(0.8, rel=AMPLITUDE)


def test_it_joins_the_page_when_the_command_writes_it(new: Effect) -> None:
    page = PAGE.read_text(encoding="utf-8")
    written = rewrite_page(page, sort_effects(load_effects().values()))
    assert list_published_names(written) - list_published_names(page) == names([new])
    row = (
        "| friction | `hub_mesh` | Torque ripples as the teeth of the hub mesh | amplitude [Nm], order, phase [rad] |\n"
    )
    assert written.replace(row, "") == page


def test_the_command_writes_only_effects_of_this_package(new: Effect, tmp_path: Path) -> None:
    page = tmp_path / "effects.md"
    text = PAGE.read_text(encoding="utf-8")
    page.write_text(re.sub(r"(?<=begin hooks -->\n).*?(?=<!-- end)", "", text, flags=re.DOTALL), encoding="utf-8")
    result = read_document("effects", "--write", str(page))
    assert page.read_text(encoding="utf-8") == text
    assert result["wrote"] == [str(page), str(tmp_path / "effects.png")]
    assert (tmp_path / "effects.png").stat().st_size > 50_000


@pytest.mark.parametrize(
    ("stem", "suffix", "content", "sentence"),
    [
        ("page", "", b"", "has the suffix -; a Markdown page ends with .md"),
        ("page", ".png", b"\x89PNG", "has the suffix .png; a Markdown page ends with .md"),
        ("none", MARKDOWN, None, "does not exist"),
        ("binary", MARKDOWN, b"\xff\xfe\x00", "cannot be read: it is not UTF-8 text"),
        ("empty", MARKDOWN, b"", "the page has no parts to write"),
        ("part", MARKDOWN, b"<!-- begin effect -->\n<!-- end -->", "part 'effect' is unknown; did you mean effects"),
    ],
)
def test_what_is_no_page_is_refused_and_stays(
    stem: str, suffix: str, content: bytes | None, sentence: str, tmp_path: Path
) -> None:
    page = tmp_path / f"{stem}{suffix}"
    if content is not None:
        page.write_bytes(content)
    error = run_command("effects", "--write", str(page)).exception
    assert isinstance(error, InputError)
    assert str(error).startswith(f"page {page}")
    assert sentence in str(error)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == (
        {} if content is None else {page.name: content}
    )


def test_a_page_stays_as_it_is_where_its_picture_cannot_be_written(tmp_path: Path) -> None:
    page = tmp_path / f"page{MARKDOWN}"
    text = "<!-- picture of valve_delay -->\n<!-- begin hooks -->\nold\n<!-- end -->\n"
    page.write_text(text, encoding="utf-8")
    (tmp_path / "page.png").mkdir()
    error = run_command("effects", "--write", str(page)).exception
    assert isinstance(error, InputError)
    assert str(error) == f"file {tmp_path / 'page.png'} cannot be written: Is a directory"
    assert page.read_text(encoding="utf-8") == text
    assert sorted(path.name for path in tmp_path.iterdir()) == [page.name, "page.png"]


def test_a_published_name_stays() -> None:
    page, ours = PAGE.read_text(encoding="utf-8"), sort_effects(filter(is_ours, load_effects().values()))
    assert {"backlash", "backlash.gap", "residual_torque.pressure_lag"} <= list_published_names(page)
    assert list_published_names(page) <= names(ours)
    kept = [effect for effect in ours if effect.name != "valve_delay"]
    with pytest.raises(InputError, match=r"published names are gone: valve_delay, valve_delay\.delay;"):
        rewrite_page(page, kept)


WRONG = {
    'Display("crawl"': ('Display("craul"', "excitation 'craul' of its display is unknown; did you mean crawl"),
    'column="clutch_torque_nm"': (
        'column="clutch_torque"',
        "column 'clutch_torque' of its display is unknown; did you mean",
    ),
    'over="shaft_angle_rad"': (
        'over="angle_rad"',
        "over 'angle_rad' of its display is unknown; did you mean shaft_angle_rad",
    ),
    "over=": ("beside='backlsh', over=", "is shown together with 'backlsh', which is unknown; did you mean backlash"),
    'display=Display("crawl", ': ("display=dict(", "display is {.*}; a Display.* is needed"),
    'StrongestOrder("clutch_torque_nm")': ('"order"', "start is 'order'; a Start .* is needed"),
    '"phase", "rad"': (
        '"angle", "rad"',
        "start sets 'phase', which is not a parameter; known are ",
    ),
}


@pytest.mark.parametrize("right", WRONG)
def test_what_its_file_gets_wrong_is_said_in_one_sentence(
    right: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong, reason = WRONG[right]
    assert right in NEW
    (tmp_path / "wrong.py").write_text(NEW.replace(right, wrong), encoding="utf-8")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    error = run_command("effects", "wrong").exception
    assert isinstance(error, InputError)
    assert re.search(reason, str(error)), error
    assert "\n" not in str(error)


def test_a_start_from_a_column_that_the_rig_lacks_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = NEW.replace('StrongestOrder("clutch_torque_nm")', 'StrongestOrder("clutch_torque")')
    (tmp_path / "wrong.py").write_text(text, encoding="utf-8")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    with pytest.raises(InputError, match="effect wrong: its start reads the column 'clutch_torque', which is unknown;"):
        WetClutch()
