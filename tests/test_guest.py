"""Where the host has no CAN kernel, the vcan tests run in a guest that has one."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import needs

ROOT = Path(__file__).parents[1]
LEAST = 21  # vcan tests; the one that needs `tc` may be skipped where iproute2 is not installed
PATIENCE = 1500  # s; 260 to 340 where the host runs the machine
NO_GUEST = 3  # exit code of can_guest.py where no guest can run


@pytest.mark.needs("no vcan0")
def test_the_vcan_tests_pass_in_a_guest_with_a_can_kernel() -> None:
    environment = os.environ | {"TMPDIR": "/tmp"}
    reports = ROOT / "runs" / "jitter-vcan"  # kept: the timing on a CAN kernel
    reports.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        [
            *(sys.executable, ROOT / "deploy/guest/can_guest.py"),
            *("--timeout", str(PATIENCE), "--writable", reports, "--sources", ROOT, "--"),
            *("env", "PYTEST_ADDOPTS=-p no:cacheprovider --basetemp /tmp/vcan-tests"),
            *(sys.executable, "-m", "tests", "tests/vcan"),
        ],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == NO_GUEST:
        needs.skip("guest", done.stderr.strip().splitlines()[-1])
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    passed = sum(map(int, re.findall(r"(\d+) passed", done.stdout)))
    assert passed >= LEAST, done.stdout
