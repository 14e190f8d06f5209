"""docs/exercise_identify.md in a short form: two courses with real processes, identified, and Table 6.6 with the result."""

import json
from itertools import islice
from pathlib import Path

import pytest

from clutch_hil.commands.experiment_identify import play_own_courses
from clutch_hil.discrepancy.experiments.laboratory import plant_under_test
from tests.clutch_hil.identify.test_clutch_command import run_command

CLUTCH = Path(__file__).parents[3] / "docs" / "examples" / "other_clutch.toml"
PLAY = ("up", "--lockstep", "--profile", "table-6.6", "--no-adaptation", "--plant-parameters", CLUTCH)
TRUE = {
    "clutch.coulomb_slope": 17.0,
    "clutch.viscous_exponent": 0.4,
    "clutch.stribeck_speed": 6.0,
    "clutch.attraction": 40.0,
}


def follow(bus: str, out: Path, *words: object) -> dict:
    code, text = run_command(*PLAY, "--bus", bus, "--out", out, *words, "--json")
    assert code == 0, text
    return dict(json.loads(text[text.index("{") :]))


def test_another_clutch_is_identified_live_and_follows(tmp_path: Path, local_bus: str) -> None:
    before = follow(local_bus, tmp_path / "before")
    assert "its calibration belongs to another clutch" in before["calibration"]
    with plant_under_test(None, CLUTCH, None, 1, tmp_path) as plant:
        runs = list(
            islice(play_own_courses(plant, local_bus, True, False, tmp_path / "runs", False, None, False, True), 2)
        )
    code, text = run_command("identify", *runs, "--out", tmp_path / "mine")
    assert code == 0, text
    result = json.loads((tmp_path / "mine" / "identification.json").read_text(encoding="utf-8"))
    values = {one["name"]: one for one in result["parameters"]}
    for name, true in TRUE.items():
        assert values[name]["value"] == pytest.approx(true, rel=0.05)
    assert values["piston.contact_pressure"]["value"] == pytest.approx(2.65, abs=0.01)
    after = follow(local_bus, tmp_path / "after", "--controller-parameters", tmp_path / "mine" / "calibration.toml")
    assert after["calibration"] is None
    assert after["regime_error_nm"] < 0.25 * before["regime_error_nm"]
