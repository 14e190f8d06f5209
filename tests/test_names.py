"""Names of tests: the same in every process, as pytest-xdist needs; otherwise no test runs."""

import os
import subprocess
import sys

import pytest

from tests.conftest import TESTS

pytestmark = pytest.mark.slow  # it collects all tests once more


def test_names_depend_neither_on_the_process_nor_on_the_time(request: pytest.FixtureRequest) -> None:
    # The other process starts later and has another number and another order of sets; it must not take itself for a worker
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    made = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "--override-ini", "addopts="],
        cwd=TESTS.parent, env=environment | {"PYTHONHASHSEED": "7"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    names = set(made.stdout.splitlines())
    assert [item.nodeid for item in request.session.items if item.nodeid not in names] == []
