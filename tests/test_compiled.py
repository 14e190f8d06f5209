"""Cached kernels are dropped when a module they are made from is newer, and only then."""

import os
from pathlib import Path

import pytest

from protocols.compiled import drop_stale, place_cache

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


def test_nothing_is_dropped_when_nothing_changed(package: Path) -> None:
    assert drop_stale(package) == []
    assert len(list(package.rglob("*.nbi"))) == len(MODULES)


def test_a_cache_without_its_source_is_left_alone(package: Path) -> None:
    (package / "alone.py").unlink()
    os.utime(package / "block.py", (300, 300))
    assert all("alone" not in path.name for path in drop_stale(package))


def test_kernels_have_a_place_where_nothing_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    place_cache(tmp_path)
    assert "NUMBA_CACHE_DIR" not in os.environ
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    monkeypatch.setattr("protocols.compiled.tempfile.mkdtemp", lambda prefix: str(tmp_path / prefix))
    monkeypatch.setattr("protocols.compiled.atexit.register", lambda *args, **kwargs: None)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "kept")
    place_cache(tmp_path)
    assert os.environ["NUMBA_CACHE_DIR"] == "kept"
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    place_cache(tmp_path)
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "clutch-hil-kernels-")
