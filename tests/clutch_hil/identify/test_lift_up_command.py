"""`clutch-hil identify --friction lift-height`: from run files of butterflies to a file that can be read back."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from clutch_hil.commands.identify_lift_up import FILES
from clutch_hil.friction import read_lift_up
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import write_run
from tests.clutch_hil.identify.test_clutch_command import run_command

HEIGHT, SCALE, RATE = 2e-6, 0.4, 300.0  # m, m/s, 1/s: of a film that is made here
PERIOD, NOISE = 2e-4, 1e-9  # s, m
CONTACT = ("--hold", "mass=0.5", "--hold", "stiffness=1e10", "--hold", "load=120")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder, files = tmp_path_factory.mktemp("butterflies"), []
    for number, (frequency, stroke) in enumerate(((4.5, 0.006), (9.0, 0.012))):
        time = PERIOD * np.arange(4000)
        way = stroke * np.sin(2.0 * np.pi * frequency * time)
        steady = HEIGHT * (1.0 - np.exp(-np.abs(np.gradient(way, PERIOD)) / SCALE))
        keep = np.exp(-RATE * PERIOD)
        lift = lfilter([0.5 * (1.0 - keep)] * 2, [1.0, -keep], steady)
        noise = NOISE * np.random.default_rng(number).standard_normal(len(time))
        columns = {"time_s": time, "way": 1e3 * way, "gap_um": 1e6 * (lift + noise) + 3.0, "turn_rad": way / 0.02}
        files.append(folder / f"butterfly{number}.parquet")
        write_run(Run(columns, {"sample_rate_hz": 1.0 / PERIOD}, {}), files[-1])
    return files


def test_a_film_is_identified_and_its_file_reads_back(tmp_path: Path, runs: list[Path]) -> None:
    out = tmp_path / "film"
    words = ("--friction", "lift-height", "--position", "way:mm", *CONTACT, "--rig", "mine", "--out", out)
    code, text = run_command("identify", *runs, *words, "--json")
    assert code == 0, text
    sentence = json.loads(text)
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)
    for name, true in (("height", HEIGHT), ("speed_scale", SCALE), ("rate", RATE)):
        value = sentence["values"][name]
        assert value["value"] == pytest.approx(true, rel=0.01)
        assert value["low"] <= true <= value["high"]
    lift_up = read_lift_up(out / FILES[0])
    assert dict(lift_up.values) == {name: one["value"] for name, one in sentence["values"].items()}
    assert lift_up.contact.mass == 0.5
    assert lift_up.force(0.2, 0.0, 120.0) > 0.0
    assert "sha256" in (out / FILES[0]).read_text(encoding="utf-8")
    code, text = run_command("identify", *runs, *words)
    assert (code, "--overwrite" in text) == (2, True)


def test_an_angle_needs_the_radius(tmp_path: Path, runs: list[Path]) -> None:
    words = ("--friction", "lift-height", "--position", "turn_rad", *CONTACT, "--out", tmp_path / "film")
    code, text = run_command("identify", *runs, *words)
    assert code == 2
    assert "--hold radius=VALUE" in text


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--hold", "mass=1"], "the stiffness of the contact is not given"),
        ([*CONTACT, "--hold", "colour=1"], "--hold colour is not a parameter of a lift-up"),
        (["--hold", "mass=1", "--hold", "stiffness=1e9"], "has no column with a known name for the load"),
        ([*CONTACT, "--gap", "nosuch"], "'nosuch'"),
        ([*CONTACT, "--force", "way"], "--force is not an option of --friction lift-height"),
        ([*CONTACT, "--hold", "load=0"], "load of the butterflies is 0 N"),
        ([*CONTACT, "--gap", "way:N"], "allowed is what can be converted into m"),
    ],
)
def test_wrong_words_are_one_sentence(tmp_path: Path, runs: list[Path], words: list[str], sentence: str) -> None:
    options = ("--friction", "lift-height", "--position", "way:mm", *words, "--out", tmp_path / "film")
    code, text = run_command("identify", *runs, *options)
    assert code == 2
    assert sentence in text
    assert not list(tmp_path.glob("film/*"))


def test_a_gap_without_a_lift_up_is_told(tmp_path: Path, runs: list[Path]) -> None:
    code, text = run_command("identify", *runs, "--gap", "gap_um", "--out", tmp_path / "film")
    assert code == 2
    assert "--gap is only for --friction" in text


@pytest.mark.parametrize(
    ("text", "sentence"),
    [('kind = "friction"', "'lift-up' is needed"), ('kind = "lift-up"\nlaw = "gms"', "allowed are")],
)
def test_a_file_of_something_else_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "lift_up.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_lift_up(path)
