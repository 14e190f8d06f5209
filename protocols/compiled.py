"""Compiled kernels on disk: none older than a source it was made from, and a place for them where there is none.

Numba asks only whether the file of a function itself has changed. A kernel whose blocks, in other files, were edited or
updated would go on with the old physics, so such kernels are deleted before they are used.
"""

import atexit
import os
import re
import shutil
import tempfile
from pathlib import Path

_IMPORT = re.compile(r"^from (\w+(?:\.\w+)*) import (\([^)]*\)|.*)$", re.MULTILINE)


def place_cache(package: Path) -> None:
    """Keep kernels in a temporary folder where neither `package` nor ~/.cache can be written; children find it too."""
    variable = "NUMBA_CACHE_DIR"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    existing = next(folder for folder in (home, *home.parents) if folder.exists())
    if variable in os.environ or os.access(package, os.W_OK) or os.access(existing, os.W_OK):
        return
    os.environ[variable] = tempfile.mkdtemp(prefix="clutch-hil-kernels-")
    atexit.register(shutil.rmtree, os.environ[variable], ignore_errors=True)


def is_compiled(package: Path) -> bool:
    """Whether kernels of `package` are on disk, beside it."""
    return any(package.rglob("__pycache__/*.nbi"))


def drop_stale(package: Path, *used: Path) -> list[Path]:
    """Delete the cached kernels of `package` that are older than a module they import, directly or not; return them.

    `used`: packages beside it, from which it imports functions that become part of its kernels.
    """
    sources = {path: path.stat().st_mtime_ns for folder in (package, *used) for path in folder.rglob("*.py")}
    caches = {path: path.stat().st_mtime_ns for path in package.rglob("__pycache__/*.nbi")}
    if not caches or max(sources.values()) <= min(caches.values()):
        return []
    imported = {path: _imported(path, package, sources) for path in sources}
    stale = []
    for cache, made in caches.items():
        module = cache.parents[1] / f"{cache.name.partition('.')[0]}.py"
        if any(sources[path] > made for path in _reached(module, imported)):
            cache.unlink(missing_ok=True)
            stale.append(cache)
    return stale


def _imported(path: Path, package: Path, sources: dict[Path, int]) -> set[Path]:
    """Modules among `sources` that the module at `path` imports; all packages lie beside `package`."""
    found = set()
    for base, names in _IMPORT.findall(path.read_text(encoding="utf-8")):
        folder = package.parent.joinpath(*base.split("."))
        candidates = [folder, *(folder / name for name in re.findall(r"\w+", names))]
        found |= {candidate.with_suffix(".py") for candidate in candidates} & sources.keys()
    return found


def _reached(module: Path, imported: dict[Path, set[Path]]) -> set[Path]:
    reached, open_ends = set(), {module} & imported.keys()
    while open_ends:
        path = open_ends.pop()
        reached.add(path)
        open_ends |= imported[path] - reached
    return reached
