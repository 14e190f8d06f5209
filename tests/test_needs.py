"""Tests that lack something of the machine are skipped with the line that brings it, and listed at the end."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.needs import HEADING, MUST_HAVE, NEEDS

ROOT = Path(__file__).parents[1]
PLUGIN = """
from tests import needs

needs.NEEDS["anvil"] = needs.Need("an anvil", lambda: False, "apt-get install anvil")
needs.NEEDS["air"] = needs.Need("air", lambda: True, "open the window")
"""
TESTS = """
import pytest
from tests import needs

@pytest.mark.needs("air", "anvil")
def test_marked(): assert False

@pytest.mark.needs("air")
def test_there(): pass

@pytest.fixture
def iron(): needs.skip("anvil")

def test_finds_out(iron): assert False

def test_of_its_own(): pytest.skip("another reason")
"""


def play_tests(folder: Path, *options: str, **variables: str) -> subprocess.CompletedProcess[str]:
    (folder / "test_it.py").write_text(TESTS)
    (folder / "anvil.py").write_text(PLUGIN)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers = needs\n")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST_", MUST_HAVE))} | variables
    plugins = ("-p", "no:cacheprovider", "-p", "tests.needs", "-p", "anvil")
    command = [sys.executable, "-m", "tests", "-q", *plugins, "--rootdir", folder]
    return subprocess.run(
        [*command, *options, folder / "test_it.py"],
        cwd=ROOT,
        env=environment | {"PYTHONPATH": f"{ROOT}:{folder}"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("options", [(), ("--numprocesses", "1")])
def test_what_was_skipped_and_what_would_enable_it_is_listed(options: tuple[str, ...], tmp_path: Path) -> None:
    done = play_tests(tmp_path, *options)
    assert done.returncode == 0, done.stdout + done.stderr
    _, _, listed = done.stdout.partition(HEADING)
    assert "   2  needs an anvil: apt-get install anvil\n   1  another reason\n" in listed


def test_what_the_machine_must_have_is_no_reason_to_skip(tmp_path: Path) -> None:
    done = play_tests(tmp_path, **{MUST_HAVE: "anvil,vulkan"})
    assert done.returncode == 1
    assert "needs an anvil: apt-get install anvil; $CLUTCH_HIL_MUST_HAVE says that it is here" in done.stdout


def test_a_need_that_nobody_knows_is_an_error(tmp_path: Path) -> None:
    done = play_tests(tmp_path, **{MUST_HAVE: "anvli"})
    assert done.returncode == 4
    assert "CLUTCH_HIL_MUST_HAVE names 'anvli'; allowed are vulkan, chromium" in done.stdout + done.stderr


def test_every_need_says_in_one_line_what_brings_it() -> None:
    for need in NEEDS.values():
        assert need.what
        assert need.brings
        assert "\n" not in need.reason


def test_no_test_skips_by_a_condition_of_its_own() -> None:
    """What a test needs is in the table, where it can be listed with the line that brings it."""
    own = ("mark.skipif", "importorskip", "pytest.skip(")
    result = {
        f"{path.relative_to(ROOT)}: {word}"
        for path in (ROOT / "tests").rglob("*.py")
        if path.name not in ("needs.py", "test_needs.py")
        for word in own
        if word in path.read_text(encoding="utf-8")
    }
    assert result == set()
