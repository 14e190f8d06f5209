"""`clutch-hil identify --friction`: what it reads and writes, and wrong input, which leaves no file."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import clutch_hil as ch
from clutch_hil.command import make_application
from clutch_hil.commands.identify_friction import FILES
from protocols.errors import InputError

PERIOD = 0.005  # s
MASS, COULOMB, VISCOUS, OFFSET = 2.0, 5.0, 30.0, 0.7  # kg, N, Ns/m, N
OWN_UNITS = ("--position", "way:mm", "--force", "pull:kN")


def make_strokes(seconds: float = 12.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], position [m] and force [N] of an axis that goes to and fro at changing speeds."""
    time = PERIOD * np.arange(round(seconds / PERIOD))
    a, b = (0.04, 2.0 * np.pi * 0.5), (0.015, 2.0 * np.pi * 1.3)
    position = sum(size * np.sin(rate * time) for size, rate in (a, b))
    speed = sum(size * rate * np.cos(rate * time) for size, rate in (a, b))
    acceleration = sum(-size * rate**2 * np.sin(rate * time) for size, rate in (a, b))
    noise = np.random.default_rng(1).normal(0.0, 0.05, time.size)
    force = MASS * acceleration + COULOMB * np.sign(speed) + VISCOUS * speed + OFFSET + noise
    return time, position, force


def write_csv(path: Path, change: Callable[[dict[str, np.ndarray]], object] = lambda columns: None) -> Path:
    """A text file of `strokes` in mm and kN, as `change` leaves it."""
    time, position, force = make_strokes()
    columns = {"time_s": time, "way": 1e3 * position, "pull": 1e-3 * force}
    change(columns)
    np.savetxt(path, np.column_stack(list(columns.values())), "%.9g", ",", header=",".join(columns), comments="")
    return path


def run(*arguments: str | Path) -> tuple[str, BaseException | None]:
    result = CliRunner().invoke(make_application(), ["identify", *map(str, arguments)])
    return result.stdout, result.exception


def test_a_law_is_identified_written_and_read_back(tmp_path):
    recording = write_csv(tmp_path / "run.csv")
    terms = ("--terms", "mass,offset,viscous")
    printed, error = run(recording, "--friction", "stribeck", *OWN_UNITS, *terms, "--out", tmp_path / "out", "--json")
    assert error is None
    document = json.loads(printed)
    assert document["wrote"] == [str(tmp_path / "out" / name) for name in FILES]
    law = ch.read_friction(tmp_path / "out" / FILES[0])
    for name, true in (("mass", MASS), ("static_force", COULOMB), ("viscous", VISCOUS), ("offset", OFFSET)):
        assert law[name] == pytest.approx(true, rel=0.01)
        assert document["parameters"][name]["value"] == law[name]
    assert law.model.steady_state(0.1) == pytest.approx(COULOMB + 0.1 * VISCOUS, rel=0.01)
    assert (tmp_path / "out" / FILES[1]).read_bytes().startswith(b"\x89PNG")


def test_the_text_ends_with_what_was_read_and_written_and_a_verdict(tmp_path):
    recording = write_csv(tmp_path / "run.csv")
    command = (recording, "--friction", "stribeck", *OWN_UNITS, "--terms", "mass,viscous", "--out", tmp_path / "out")
    printed, error = run(*command)
    assert error is None
    read, wrote, verdict = printed.splitlines()[-3:]
    assert read.split() == ["read:", str(recording)]
    assert wrote == "wrote:   " + ", ".join(str(tmp_path / "out" / name) for name in FILES)
    assert verdict.startswith("verdict: stribeck + mass + viscous: ")
    _, refused = run(*command)
    assert isinstance(refused, InputError)
    assert "exists already" in str(refused)
    assert run(*command, "--overwrite")[1] is None


def _put(name: str, values: float | Callable[[np.ndarray], np.ndarray]) -> Callable[[dict[str, np.ndarray]], object]:
    def change(columns: dict[str, np.ndarray]) -> None:
        columns[name] = values(columns[name]) if callable(values) else np.full(columns[name].size, values)

    return change


def _cut(columns: dict[str, np.ndarray]) -> None:
    for name in columns:
        columns[name] = columns[name][:0]


def _with_nan(values: np.ndarray) -> np.ndarray:
    return np.where(np.arange(values.size) == 17, np.nan, values)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (_cut, "row"),
        (_put("way", 3.0), "position stays at 0.003 m"),
        (_put("pull", 0.0), "force stays at 0 N"),
        (_put("pull", _with_nan), "the force is not a number in row 17"),
        (_put("pull", lambda pull: -pull), "reverse its sign"),
        (_put("pull", lambda pull: 1e20 * pull), "allowed is up to"),
        (_put("way", lambda way: 10.0 * np.arange(way.size)), "the speed is constant"),
        (_put("time_s", lambda time: np.where(time > 5.0, 5.0, time)), "time"),
        (lambda columns: columns.pop("pull"), "has no column 'pull'"),
    ],
    ids=["no row", "stuck", "no force", "nan", "reversed", "huge", "constant speed", "time stops", "no column"],
)
def test_wrong_recordings_are_refused_in_a_sentence_and_leave_nothing(tmp_path, change, sentence):
    recording = write_csv(tmp_path / "run.csv", change)
    printed, error = run(recording, "--friction", "stribeck", *OWN_UNITS, "--out", tmp_path / "out")
    assert isinstance(error, InputError)
    assert sentence in str(error)
    assert "\n" not in str(error)
    assert printed == ""
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--friction", "lugr"), "friction law 'lugr' is unknown"),
        (("--friction", "zzzz"), "lift-up, lift-height"),
        (("--friction", "gms", "--low-pass", "1e9"), "low-pass is 1e+09 Hz; allowed is below 100 Hz"),
        (("--friction", "stribeck", "--elements", "2"), "law stribeck has no elements"),
        (("--friction", "gms", "--elements", "0"), "number of elements is 0; allowed are 1 and more"),
        (("--friction", "gms", "--terms", "viscos"), "term 'viscos' is unknown"),
        (("--friction", "lugre", "--terms", "fall"), "law lugre has no term 'fall'"),
        (("--friction", "xgms"), "law xgms needs the load"),
        (("--friction", "gms", "--starts", "0"), "number of starts is 0"),
        (("--friction", "gms", "--low-pass", "-1"), "low-pass is -1 Hz"),
        (("--friction", "gms", "--rate", "nan"), "rate is nan Hz"),
        (("--friction", "gms", "--load", "lod"), "has no column 'lod' for the load"),
        (("--friction", "gms", "--position", "way:parsnip"), "parsnip"),
        (("--friction", "gms", "--force", "pull:mm"), "for the force is in 'mm'"),
    ],
)
def test_wrong_options_are_refused_in_a_sentence_and_leave_nothing(tmp_path, arguments, sentence):
    recording = write_csv(tmp_path / "run.csv")
    _, error = run(recording, *OWN_UNITS, *arguments, "--out", tmp_path / "out")
    assert isinstance(error, InputError)
    assert sentence in str(error)
    assert not (tmp_path / "out").exists()


def test_a_file_without_names_asks_for_a_map(tmp_path):
    recording = tmp_path / "run.csv"
    recording.write_text("1.0\t2.0\n" * 200)
    _, error = run(recording, "--friction", "gms", "--out", tmp_path / "out")
    assert isinstance(error, InputError)
    assert "read it with a map" in str(error)


def test_a_missing_law_and_a_file_that_would_be_lost_are_refused(tmp_path):
    recording = write_csv(tmp_path / "run.csv")
    _, error = run(recording, "--out", tmp_path / "out")
    assert "lacks the column valve_voltage_v" in str(error)  # without --friction it must be a clutch's run
    lost = write_csv(tmp_path / FILES[0])
    _, error = run(lost, "--friction", "gms", "--out", tmp_path, "--overwrite")
    assert "is read by this command and would be lost" in str(error)


def test_files_appear_together_or_not_at_all(tmp_path, monkeypatch):
    """An interruption while the last of them is written leaves none, so that the command can be given again."""

    def interrupt(*given: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("clutch_hil.identify.friction.result.IdentifiedFriction.write", interrupt)
    recording = write_csv(tmp_path / "run.csv")
    run(recording, "--friction", "stribeck", *OWN_UNITS, "--terms", "mass", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()
