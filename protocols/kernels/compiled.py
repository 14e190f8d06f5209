"""Compiled kernels on disk: none from another state of the sources, and a place for them where there is none.

Numba asks only whether the file of a function itself has changed. A kernel whose blocks, in other files, were edited or
updated would go on with the old physics, so such kernels are deleted before they are used.
"""

import atexit
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterable
from importlib.metadata import entry_points
from pathlib import Path

from protocols.errors import InputError

VARIABLE = "NUMBA_CACHE_DIR"
_IMPORT = re.compile(r"^from (\w+(?:\.\w+)*) import (\([^)]*\)|.*)$", re.MULTILINE)
_OURS = "clutch-hil"  # the folder in a cache, in which each state of the sources has one
_UNKEPT = "clutch-hil-unkept-"  # the folder of a cache that goes with the command
_TEMPORARY: list[Path] = []  # such folders of this process


def place_cache(package: Path) -> None:
    """Keep kernels where they can be written: beside `package`, else in $NUMBA_CACHE_DIR or ~/.cache; children find it, too.

    Away from their sources each state of these has kernels of its own, so that none is stale. Where neither place can be
    written they are in a temporary folder. Raises InputError where the variable names no place.
    """
    given = os.environ.get(VARIABLE)
    if given and Path(given).parent.name == _OURS:  # placed already
        return
    if not given and _writable(package / "__pycache__"):
        return
    base = Path(given) if given else _home()
    if base is None or not _writable(base):
        if given:
            raise InputError(f"{VARIABLE} is {given}, which cannot be written; set it to a folder that can, or to none")
        base = Path(tempfile.mkdtemp(prefix=_UNKEPT))
        _TEMPORARY.append(base)
        atexit.register(discard)
    os.environ[VARIABLE] = str(base / _OURS / _state(_packages(package.parent)))


def discard() -> None:
    """Delete the kernels that cannot be kept, if this process has made a folder for them."""
    while _TEMPORARY:
        shutil.rmtree(_TEMPORARY.pop(), ignore_errors=True)


def lasting() -> bool:
    """Whether compiled kernels outlive the command."""
    return _UNKEPT not in os.environ.get(VARIABLE, "")


def kept() -> str:
    """What becomes of compiled kernels when the command ends, for people."""
    if not lasting():
        return f"compiled kernels cannot be kept here: set {VARIABLE} to a folder that can be written"
    return "compiled kernels are kept"


def _home() -> Path | None:
    """The user's folder for caches, None for a user without a home."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        return None


def _writable(folder: Path) -> bool:
    """Whether a folder can be written, or made."""
    existing = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    return existing.is_dir() and os.access(existing, os.W_OK)


def _packages(beside: Path) -> list[Path]:
    """Folders of all that make the command, which lie `beside` each other."""
    points = [point for group in ("clutch_hil.commands", "clutch_hil.nodes") for point in entry_points(group=group)]
    names = {point.module.partition(".")[0] for point in points} | {__name__.partition(".")[0]}
    return [beside / name for name in sorted(names)]


def _state(packages: Iterable[Path]) -> str:
    """A name for where the sources are and when each was written."""
    known = hashlib.sha256()
    for path in sorted(path for package in packages for path in package.rglob("*.py")):
        known.update(f"{path}\0{path.stat().st_mtime_ns}\0".encode())
    return known.hexdigest()[:16]


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
