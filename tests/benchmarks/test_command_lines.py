"""The commands of benchmarks: what they are asked for wrongly is refused in one sentence before anything is computed."""

import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import benchmark
from benchmarks.battery.__main__ import main as battery
from benchmarks.battery.rivals.__main__ import main as rivals
from benchmarks.battery.run import ROOT
from benchmarks.battery.thresholds import main as thresholds
from benchmarks.dirty_channels import main as dirty_channels
from benchmarks.mutated_inputs import mutate_inputs
from benchmarks.mutated_requests import mutate_requests
from clutch_hil.command import make_command
from protocols.errors import InputError
from tests.processes import PATIENCE

COMMANDS = {
    "benchmarks": benchmark,
    "battery": battery,
    "rivals": rivals,
    "thresholds": thresholds,
    "dirty_channels": dirty_channels,
    "mutated_inputs": mutate_inputs,
    "mutated_requests": mutate_requests,
}


def refuse(command: str, *arguments: str) -> str:
    """Run a command; return the sentence with which it refuses."""
    result = CliRunner().invoke(make_command(COMMANDS[command]), arguments, prog_name=command)
    assert isinstance(result.exception, InputError), result.output
    assert "\n" not in str(result.exception)
    return str(result.exception)


@pytest.mark.parametrize("command", COMMANDS)
def test_an_unknown_option_is_refused(command: str) -> None:
    assert refuse(command, "--nosuch").startswith(f"{command}: no such option: --nosuch")


@pytest.mark.parametrize(
    ("command", "arguments", "sentence"),
    [
        (
            "benchmarks",
            "nosuch",
            "benchmark 'nosuch' does not exist; known are clutches, friction, kills, loop, requests, soak",
        ),
        ("benchmarks", "soak --seconds -5", "--seconds is -5 for a soak; allowed are 60 to "),
        ("benchmarks", "kills --kills 0", "--kills is 0; allowed are 1 to 1000"),
        ("benchmarks", "kills --kills 1001", "--kills is 1001; allowed are 1 to 1000"),
        ("benchmarks", "soak --seconds nan", "--seconds is nan for a soak; "),
        ("benchmarks", "requests --seconds -1", "--seconds is -1 for requests; allowed are more than 0, to 86400 s"),
        ("benchmarks", "requests --seconds nan", "--seconds is nan for requests; "),
        ("battery", "--split test", "split 'test' is unknown; "),
        ("battery", "--families twin", "family 'twin' is unknown; "),
        (
            "battery",
            "--only nothing --quick",
            "no case of the split development suits --families single,null,unknown,pair,",
        ),
        ("battery", "--jobs 0", "battery: invalid value '0' for '--jobs': "),
        ("battery", "--jobs 2 --dask tcp://127.0.0.1:1", "--jobs 2 and --dask tcp://127.0.0.1:1 were given together; "),
        ("battery", "--check --done", "--check and --done were given together; "),
        ("battery", "--done", "no answer to such a case is in FOLDER/engine-"),
        ("battery", "--done --split evaluation --docs FOLDER/file", "folder FOLDER/file/battery cannot be made: "),
        ("battery", "--done --split evaluation --log FOLDER/no/log", "log FOLDER/no/log cannot be written: "),
        ("battery", "--out FOLDER/file", "folder FOLDER/file/engine-"),
        ("rivals", "--jobs 0", "rivals: invalid value '0' for '--jobs': "),
        ("thresholds", "FOLDER", "no answers of the development split are below FOLDER; "),
        ("dirty_channels", "--sound -1", "dirty_channels: invalid value '-1' for '--sound': "),
        ("mutated_inputs", "--minutes 0", "--minutes is 0; "),
        ("mutated_requests", "--minutes 0", "--minutes is 0; allowed are more than 0, to 10080"),
        ("mutated_requests", "--minutes nan", "--minutes is nan; "),
    ],
)
def test_a_wrong_value_is_refused_and_nothing_is_written(
    command: str, arguments: str, sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    words = arguments.replace("FOLDER", str(tmp_path)).split()
    if command == "battery" and "--out" not in words:
        words += ["--out", str(tmp_path)]
    assert refuse(command, *words).startswith(sentence.replace("FOLDER", str(tmp_path)))
    assert [path.name for path in tmp_path.rglob("*")] == ["file"]


def test_a_process_ends_by_exit_code_2() -> None:
    command = [sys.executable, "-m", "benchmarks.battery", "--split", "test"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    message = done.stderr.removeprefix("loading modules\n")  # on a slow machine
    assert message == "error: split 'test' is unknown; known are development, evaluation\n"
