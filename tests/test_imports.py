"""What a process loads: nobody what it must not know, the real-time path nothing heavy. Who may import whom: `make lint`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FORBIDDEN = {
    "protocols": {"plant_sim", "rt_controller", "clutch_hil"},
    "plant_sim": {"rt_controller", "clutch_hil"},
    "rt_controller": {"plant_sim", "clutch_hil"},
    "clutch_hil": {"benchmarks", "tests"},
}
# Not on the real-time path: they start threads, allocate much, or take seconds to load. Numba is: what it compiles is loaded
# before the loop begins; it looks at the name scipy, whose parts are not loaded by that. Nor are they when kernels are loaded.
HEAVY = ("zenoh", "rerun", "scipy.linalg", "scipy.optimize", "matplotlib", "pandas", "pint", "pyarrow")
REAL_TIME = "rt_controller.loop.service"
PATIENCE_S = 120.0  # numba and matplotlib load in seconds on an idle machine; seven times that was seen on a full one

# In a process of its own: import what the arguments name; tell what was loaded and who first asked for the heavy ones.
IMPORTER = """
import importlib, json, sys, traceback
heavy, names = json.loads(sys.argv[1]), json.loads(sys.argv[2])
asked = {}
class Witness:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name in heavy and name not in asked:
            frames = [f for f in traceback.extract_stack()[:-1] if not f.filename.startswith("<frozen")]
            asked[name] = f"{frames[-1].filename}:{frames[-1].lineno}"
sys.meta_path.insert(0, Witness)
failed = {}
for name in names:
    try:
        importlib.import_module(name)
    except Exception as error:
        failed[name] = repr(error)
loaded = sorted({name.partition(".")[0] for name in sys.modules} | set(heavy) & set(sys.modules))
print(json.dumps({"loaded": loaded, "asked": asked, "failed": failed}))
"""


def list_files(package: str) -> list[Path]:
    result = sorted((ROOT / package).rglob("*.py"))
    assert result, f"{package} has no modules"
    return result


def make_module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def import_in_another_process(*names: str) -> dict[str, dict[str, str]]:
    answer = subprocess.run(
        [sys.executable, "-c", IMPORTER, json.dumps(HEAVY), json.dumps(names)],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=True,
    )  # fmt: skip
    return json.loads(answer.stdout)


@pytest.mark.parametrize("package", FORBIDDEN)
def test_every_module_loads_and_brings_nothing_forbidden(package: str) -> None:
    modules = [
        make_module_name(path) for path in list_files(package) if path.name != "__main__.py"
    ]  # __main__ runs the command
    sentence = import_in_another_process(*modules)
    assert not sentence["failed"]
    assert not FORBIDDEN[package] & set(sentence["loaded"])


def test_the_real_time_path_loads_nothing_heavy() -> None:
    sentence = import_in_another_process(REAL_TIME)
    assert not sentence["failed"]
    assert not {name: sentence["asked"].get(name) for name in HEAVY if name in sentence["loaded"]}


WARM = """
import sys
from plant_sim.node.plant_node import PlantNode
from rt_controller.loop.service import ControllerService
PlantNode.warm()
ControllerService.warm()
print([name for name in {names} if name in sys.modules])
"""


def test_kernels_load_nothing_heavy() -> None:
    names = [*HEAVY, "cffi.api"]
    answer = subprocess.run(
        [sys.executable, "-c", WARM.format(names=names)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=5 * PATIENCE_S,  # it compiles every kernel where none is kept: 80 s on an idle machine
    )
    assert answer.stdout.strip() == "[]"


PRODUCT = """
import sys
import numpy as np
from numba import njit
import protocols
@njit
def multiply(a, b):
    return a @ b
print(multiply(np.eye(2), np.array([[1.0, 2.0], [3.0, 4.0]])).tolist(), "scipy.linalg" in sys.modules)
"""


def test_a_kernel_can_have_a_matrix_product() -> None:
    """As an effect of a user may; Numba takes it from SciPy's linear algebra."""
    answer = subprocess.run(
        [sys.executable, "-c", PRODUCT], cwd=ROOT, capture_output=True, text=True, check=True, timeout=PATIENCE_S
    )
    assert answer.stdout.strip() == "[[1.0, 2.0], [3.0, 4.0]] True"


def test_the_witness_of_this_test_sees_a_heavy_import() -> None:
    sentence = import_in_another_process("protocols.files.runs")
    assert "pyarrow" in sentence["loaded"]
    assert "runs.py" in sentence["asked"]["pyarrow"]
