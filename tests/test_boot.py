"""The units of a bench in a machine that boots: a guest with systemd and a CAN kernel, which plays tests/booted."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from clutch_hil.bench.host.unit_files import UNITS
from protocols.kernels.kernel_cache import VARIABLE
from tests import needs

ROOT = Path(__file__).parents[1]
LEAST = 13  # tests of tests/booted
PATIENCE = 1500  # s; 300 on two CPUs beside other work
NO_GUEST = 3  # exit code of can_guest.py where no guest can run
RATE = "50"  # Hz, the lowest: a guest now and then stands still for 50 ms and more, and five cycles are a fault
WARM = """
from clutch_hil.bench.rig import DEFAULT_RIG, find_rig
from plant_sim.node.plant_service import PlantService
from rt_controller.loop.service import ControllerService
PlantService("", 1000, find_rig(DEFAULT_RIG).plant).warm()
ControllerService.warm()
"""


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """Files of a machine on which the units were installed, with kernels, as a guest would compile for ten minutes."""
    started = [word for name in UNITS for word in ("--start", name)]
    command = [
        sys.executable,
        "-m",
        "clutch_hil",
        "service",
        "install",
        "--root",
        str(tmp_path),
        "--rate",
        RATE,
        *started,
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    kernels = tmp_path / "var/cache/clutch-hil"
    placed = Path(os.environ.get(VARIABLE, "."))
    if placed.parent.name == "clutch-hil" and placed.is_dir():
        shutil.copytree(placed, kernels / "clutch-hil" / placed.name)
    else:
        kernels.mkdir(parents=True)
        subprocess.run([sys.executable, "-c", WARM], check=True, env=os.environ | {VARIABLE: str(kernels)}, cwd=ROOT)
    return tmp_path


@pytest.mark.needs("systemd", "lasting folder")
def test_the_units_work_on_a_machine_that_boots(image: Path) -> None:
    done = subprocess.run(
        [
            *(sys.executable, ROOT / "deploy/guest/can_guest.py", "--boot", "--image", image, "--sources", ROOT),
            *("--timeout", str(PATIENCE), "--"),
            *(
                "env",
                "PYTEST_ADDOPTS=-p no:cacheprovider --basetemp /run/booted-tests",
                "CLUTCH_HIL_MUST_HAVE=booted bench",
            ),
            *(sys.executable, "-m", "pytest", "tests/booted", "-v", "-x"),
        ],
        cwd=ROOT,
        env=os.environ | {"TMPDIR": "/tmp"},
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
