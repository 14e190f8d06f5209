"""Cached kernels are dropped when a module they are made from is newer, and only then; and they have a place."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from protocols.kernels import kernel_cache
from protocols.kernels.kernel_cache import VARIABLE, describe_keeping, drop_stale, place_cache
from tests.processes import PATIENCE

ROOT = Path(__file__).parents[2]
MODULES = {
    "block.py": "",
    "law.py": "from package import block\n",
    "rig.py": "from package.folder.deep import (\n    one,\n    two,\n)\n",
    "folder/deep.py": "from package.law import thing\nfrom package.rig import loop\n",
    "alone.py": "import math\n",
}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    root = tmp_path / "package"
    for name, text in MODULES.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        os.utime(path, (100, 100))
        cache = path.parent / "__pycache__" / f"{path.stem}.kernel-1.py311.nbi"
        cache.parent.mkdir(exist_ok=True)
        cache.write_text("")
        os.utime(cache, (200, 200))
    return root


@pytest.mark.parametrize(
    ("edited", "stale"),
    [
        ("block.py", {"block", "law", "deep", "rig"}),
        ("law.py", {"law", "deep", "rig"}),
        ("rig.py", {"deep", "rig"}),
        ("alone.py", {"alone"}),
    ],
)
def test_kernels_follow_what_they_are_made_from(package: Path, edited: str, stale: set[str]) -> None:
    os.utime(package / edited, (300, 300))
    dropped = drop_stale(package)
    assert {path.name.partition(".")[0] for path in dropped} == stale
    assert not any(path.exists() for path in dropped)
    assert drop_stale(package) == []


def test_kernels_follow_a_dbc_as_they_follow_the_module_beside_it(package: Path) -> None:
    (package / "folder" / "rig.dbc").touch()
    os.utime(package / "folder" / "rig.dbc", (300, 300))
    assert {path.name.partition(".")[0] for path in drop_stale(package)} == {"deep", "rig"}


def test_a_lock_of_an_editor_and_a_kernel_that_another_command_removes_stop_no_import(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Emacs marks a file that is not saved by a link beside it, .#NAME, to what is no file."""
    for name in (".#block.py", "folder/.#frames.dbc", "__pycache__/gone.kernel-1.py311.nbi"):
        (package / name).symlink_to("me@host.123:456")
    os.utime(package / "alone.py", (300, 300))
    assert {path.name.partition(".")[0] for path in drop_stale(package)} == {"alone"}
    monkeypatch.setattr(kernel_cache, "_list_packages", lambda beside: [package])
    monkeypatch.setenv(VARIABLE, str(package.parent / "kernels"))
    place_cache(package)


def test_a_kernel_that_stays_is_not_looked_at_again(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.utime(package / "alone.py", (300, 300))
    assert len(drop_stale(package)) == 1
    monkeypatch.setattr(kernel_cache, "_find_imports", None)
    assert drop_stale(package) == []
    os.utime(package / "block.py", (400, 400))
    monkeypatch.undo()
    assert len(drop_stale(package)) == 4


def test_nothing_is_dropped_when_nothing_changed(package: Path) -> None:
    assert drop_stale(package) == []
    assert len(list(package.rglob("*.nbi"))) == len(MODULES)


def test_a_cache_without_its_source_is_left_alone(package: Path) -> None:
    (package / "alone.py").unlink()
    os.utime(package / "block.py", (300, 300))
    assert all("alone" not in path.name for path in drop_stale(package))


@pytest.mark.parametrize("name", ["plant_sim", "rt_controller", "clutch_hil"])
def test_a_package_names_all_packages_that_its_compiled_modules_import(name: str) -> None:
    """Else a kernel stays that has old code of such a package inside."""
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / name).rglob("*.py")}
    compiled = [text for text in texts.values() if "from numba import" in text]
    imported = {package for text in compiled for package in re.findall(r"^from (\w+)\.", text, re.MULTILINE)}
    (call,) = re.findall(r"^prepare_cache\(.*\)$", texts[ROOT / name / "__init__.py"], re.MULTILINE)
    own = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {name}
    assert imported & own == set(re.findall(r'"(\w+)"', call))


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Close a folder to us, who may be root."""
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / ".cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    access, shut = os.access, set[Path]()
    monkeypatch.setattr(os, "access", lambda path, mode: access(path, mode) and not shut & {path, *path.parents})
    return shut.add


def test_kernels_are_beside_their_sources(package: Path, closed: Callable[[Path], None]) -> None:
    place_cache(package)
    assert VARIABLE not in os.environ
    assert describe_keeping() == "compiled kernels are stored"


def test_kernels_of_sources_that_cannot_be_written_are_at_home(
    package: Path, closed: Callable[[Path], None], tmp_path: Path
) -> None:
    closed(package / "__pycache__")
    place_cache(package)
    placed = Path(os.environ[VARIABLE])
    assert placed.parent == tmp_path / "home" / ".cache" / "clutch-hil"
    assert describe_keeping() == "compiled kernels are stored"
    place_cache(package)  # of the other side, or in a child
    assert os.environ[VARIABLE] == str(placed)


def test_each_state_of_the_sources_has_kernels_of_its_own(
    package: Path, closed: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("protocols.kernels.kernel_cache._list_packages", lambda beside: [package])
    places = set()
    for edited in (None, "block.py", "folder/deep.py"):
        if edited:
            os.utime(package / edited, (300, 300))
        for _ in range(2):
            monkeypatch.setenv(VARIABLE, str(tmp_path / "given"))
            place_cache(package)
            places.add(Path(os.environ[VARIABLE]))
    assert len(places) == 3
    assert {place.parent for place in places} == {tmp_path / "given" / "clutch-hil"}


def test_where_nothing_can_be_written_kernels_last_as_long_as_the_command(
    package: Path, closed: Callable[[Path], None], tmp_path: Path
) -> None:
    closed(package / "__pycache__")
    closed(tmp_path / "home")
    (tmp_path / "home").mkdir()
    place_cache(package)
    assert Path(os.environ[VARIABLE]).is_relative_to(tmp_path)
    assert describe_keeping() == "compiled kernels cannot be stored here: set NUMBA_CACHE_DIR to a writable folder"


def test_a_place_that_was_given_and_is_none_is_replaced_by_a_temporary_one(
    package: Path, closed: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "kernels"))
    place_cache(package)
    assert describe_keeping().startswith("compiled kernels cannot be stored here: set NUMBA_CACHE_DIR")


def test_without_any_folder_an_import_goes_on(
    package: Path, closed: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def none(prefix: str) -> str:
        raise FileNotFoundError(2, "No usable temporary directory found")

    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "kernels"))
    asked = []
    monkeypatch.setattr("tempfile.mkdtemp", none)
    monkeypatch.setattr("protocols.kernels.kernel_cache.keep_in_memory", lambda: asked.append(True))
    place_cache(package)
    assert VARIABLE not in os.environ
    assert asked


def test_a_kernel_that_can_be_kept_nowhere_is_compiled_and_runs() -> None:
    code = """
from protocols.kernels.compiling import keep_in_memory
keep_in_memory()
import numba
from numba.core.caching import CacheImpl
CacheImpl._locator_classes = []  # as where no folder can be written
@numba.njit(cache=True)
def double(x):
    return 2.0 * x
print(double(4.0))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "8.0"), done.stderr
