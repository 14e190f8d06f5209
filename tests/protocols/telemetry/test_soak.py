"""Ten minutes at 1 kHz, played beside all other tests: nothing is lost."""

import json
import subprocess
import sys

import pytest

SECONDS = 600.0
RATE = 1000  # Hz
SHARE = 0.9  # of the slots in which a cycle ran at least, where the CPU did: the other tests have the machine too
MEDIAN_AGE = 0.1  # s from a cycle to its row at a listener; 0.015 typical
END = 120.0  # s for the bench to come up before and to end after

each_node = pytest.mark.parametrize("node", ["plant", "controller"])


@pytest.fixture(scope="module")
def came() -> dict[str, dict[str, float]]:
    """What came in ten minutes, by node; a process of its own listened, so that no garbage of these tests delays it."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.protocols.telemetry.soak", str(SECONDS)],
        capture_output=True, text=True, timeout=SECONDS + END, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


# Four statements of two nodes: a worker of pytest-xdist that has more than two tests before it is given no others, which
# would wait for the soak.


@each_node
def test_every_row_comes(came: dict[str, dict[str, float]], node: str, capsys: pytest.CaptureFixture[str]) -> None:
    with capsys.disabled():
        print(f"\n{node}: {json.dumps(came[node])}", file=sys.stderr)  # a worker of pytest-xdist has no stdout
    assert came[node]["rows"] == came[node]["last"] + 1
    assert came[node]["lost"] == 0


@each_node
def test_rows_come_in_order(came: dict[str, dict[str, float]], node: str) -> None:
    assert came[node]["in_order"]


@each_node
def test_cycles_run_while_the_machine_is_full(came: dict[str, dict[str, float]], node: str) -> None:
    assert came[node]["rows"] > SHARE * (SECONDS - came[node]["stood_still"]) * RATE


@each_node
def test_rows_come_soon(came: dict[str, dict[str, float]], node: str) -> None:
    assert came[node]["age_p50"] < MEDIAN_AGE
