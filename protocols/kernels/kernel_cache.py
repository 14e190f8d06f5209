"""Kernel cache: where compiled kernels are stored on disk, and removal of those that are older than their sources.

Numba checks only the file of the function itself. A kernel that includes functions of other, changed files would still use the
old code. So such kernels are deleted before use.
"""

import atexit
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from protocols.kernels.compiling import keep_in_memory

VARIABLE = "NUMBA_CACHE_DIR"
_IMPORT = re.compile(r"^from (\w+(?:\.\w+)*) import (\([^)]*\)|.*)$", re.MULTILINE)
_SOURCES = ("*.py", "*.dbc")  # of kernels: code, and frame definitions, whose constants become part of the code
_CACHE_NAME = "clutch-hil"  # folder in a cache, with one folder for each state of the sources
_TEMPORARY_PREFIX = "clutch-hil-unkept-"  # of the name of a cache folder that is removed after the command
_BESIDE = Path(__file__).parents[
    2
]  # folder of the packages, where kernels are kept beside the sources if it can be written
_TEMPORARY: list[Path] = []  # such folders of this process


def prepare_cache(package: Path, *used: Path) -> None:
    """Choose the folder for the kernels of `package`; delete stale kernels beside its sources, if these are used.

    used: other packages whose functions become part of these kernels.
    """
    place_cache(package)
    if VARIABLE not in os.environ:
        drop_stale(package, *used)


def place_cache(package: Path) -> None:
    """Choose the folder for kernels: beside `package`, else in $NUMBA_CACHE_DIR or ~/.cache; also for child processes.

    Away from the sources, each state of the sources has its own folder, so that no kernel is stale. If no folder is writable, a
    temporary folder is used; without one, kernels are kept only in memory. An import never fails because of this.
    """
    given = os.environ.get(VARIABLE)
    if given and Path(given).parent.name == _CACHE_NAME:  # placed already
        return
    if not given and _is_writable(package / "__pycache__"):
        return
    base = Path(given) if given else _find_user_cache()
    if base is None or not _is_writable(base):
        try:
            base = Path(tempfile.mkdtemp(prefix=_TEMPORARY_PREFIX))
        except OSError:
            os.environ.pop(VARIABLE, None)
            keep_in_memory()
            return
        _TEMPORARY.append(base)
        atexit.register(discard_temporary)
    os.environ[VARIABLE] = str(base / _CACHE_NAME / _hash_sources(_list_packages(package.parent)))


def discard_temporary() -> None:
    """Delete the temporary folders with kernels that this process has made."""
    while _TEMPORARY:
        shutil.rmtree(_TEMPORARY.pop(), ignore_errors=True)


def are_kept() -> bool:
    """Return whether compiled kernels stay on disk after the command."""
    place = os.environ.get(VARIABLE)
    return _TEMPORARY_PREFIX not in place if place else _is_writable(_BESIDE)


def describe_keeping() -> str:
    """Return a message on whether compiled kernels are stored after the command."""
    if not are_kept():
        return f"compiled kernels cannot be stored here: set {VARIABLE} to a writable folder"
    return "compiled kernels are stored"


def _find_user_cache() -> Path | None:
    """Return the user's folder for caches, None for a user without a home."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        return None


def _is_writable(folder: Path) -> bool:
    """Return whether a folder can be written, or created."""
    existing = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    return existing.is_dir() and os.access(existing, os.W_OK)


def _list_packages(beside: Path) -> list[Path]:
    """Return the folders of the packages of the command, which are all in the folder `beside`."""
    from importlib.metadata import entry_points  # takes 15 ms, and most processes do not come here

    points = [point for group in ("clutch_hil.commands", "clutch_hil.nodes") for point in entry_points(group=group)]
    names = {point.module.partition(".")[0] for point in points} | {__name__.partition(".")[0]}
    return [beside / name for name in sorted(names)]


def _hash_sources(packages: Iterable[Path]) -> str:
    """Hash of the paths and write times of all sources, as a folder name."""
    known = hashlib.sha256()
    sources = (path for package in packages for pattern in _SOURCES for path in package.rglob(pattern))
    for path, time in _read_write_times(sorted(sources)):
        known.update(f"{path}\0{time}\0".encode())
    return known.hexdigest()[:16]


def drop_stale(package: Path, *used: Path) -> list[Path]:
    """Delete the cached kernels of `package` that are older than a module they import, directly or not; return their paths.

    used: other packages whose functions become part of these kernels. Remaining kernels get the time of the newest source, so
    that the next command need not check again.
    """
    caches = dict(_read_write_times(package.rglob("__pycache__/*.nbi")))
    if not caches:
        return []
    sources = {path: time for folder in (package, *used) for path, time in _read_write_times(folder.rglob("*.py"))}
    frames = {  # newest DBC of each folder; reading a folder once for each of its modules took half of this function's time
        folder: max((time for _, time in _read_write_times(folder.glob(_SOURCES[1]))), default=0)
        for folder in {path.parent for path in sources}
    }
    for path, time in sources.items():  # a DBC in the folder of a module counts as part of it
        sources[path] = max(time, frames[path.parent])
    newest = max(sources.values())
    if newest <= min(caches.values()):
        return []
    imported = {path: _find_imports(path, package, sources) for path in sources}
    stale = []
    for cache, made in caches.items():
        module = cache.parents[1] / f"{cache.name.partition('.')[0]}.py"
        if any(sources[path] > made for path in _find_reachable(module, imported)):
            cache.unlink(missing_ok=True)
            stale.append(cache)
        elif made < newest:
            with suppress(OSError):  # owned by another user, or already deleted
                os.utime(cache, ns=(newest, newest))
    return stale


def _read_write_times(paths: Iterable[Path]) -> Iterator[tuple[Path, int]]:
    """Yield files and their modification times [ns].

    A missing file is skipped: another command removed it, or it is an editor's lock, a dangling link.
    """
    for path in paths:
        try:
            time = path.stat().st_mtime_ns
        except FileNotFoundError:
            continue
        yield path, time


def _find_imports(path: Path, package: Path, sources: dict[Path, int]) -> set[Path]:
    """Return the modules among `sources` that the module at `path` imports; all packages are in the folder of `package`."""
    imported = set()
    for base, names in _IMPORT.findall(path.read_text(encoding="utf-8")):
        folder = package.parent.joinpath(*base.split("."))
        candidates = [folder, *(folder / name for name in re.findall(r"\w+", names))]
        imported |= {candidate.with_suffix(".py") for candidate in candidates} & sources.keys()
    return imported


def _find_reachable(module: Path, imported: dict[Path, set[Path]]) -> set[Path]:
    reached, open_ends = set(), {module} & imported.keys()
    while open_ends:
        path = open_ends.pop()
        reached.add(path)
        open_ends |= imported[path] - reached
    return reached
