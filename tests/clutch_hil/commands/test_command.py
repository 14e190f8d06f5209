"""The command: words that say nothing are refused before anything is begun."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from clutch_hil.command import INTERRUPTED, application
from protocols.errors import InputError
from tests.processes import PATIENCE, said


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("controller", "--clutch", ""), "--clutch"),
        (("controller", "--clutch="), "--clutch"),
        (("inject", "friction_level", "--bus", " "), "--bus"),
        (("simulate", ""), "a word after 'simulate'"),
        (("",), "a word after 'clutch-hil'"),
    ],
)
def test_an_empty_word_is_refused(arguments: tuple[str, ...], named: str) -> None:
    refused = CliRunner().invoke(application(), arguments).exception
    assert isinstance(refused, InputError)
    assert str(refused) == f"{named} is empty; a value is needed, or leave it away"


ENDED_WHILE_IT_EXECUTES = """
import os
import sys
from clutch_hil import command

command.application = lambda: lambda: exec(f"import os, time\\nos.kill({os.getpid()}, {sys.argv[1]})\\ntime.sleep(60)")
command.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_ends_it_while_a_text_is_executed_has_its_exit_code(number: signal.Signals, tmp_path: Path) -> None:
    """As dataclasses do while modules load; `python -m` then ends by SIGINT after a KeyboardInterrupt that was caught."""
    (tmp_path / "ended.py").write_text(ENDED_WHILE_IT_EXECUTES)
    command = [sys.executable, "-m", "ended", str(int(number))]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == INTERRUPTED, done.stderr
    assert said(done.stderr) == ["interrupted: nothing half-written is left, compiled kernels are kept"]
