"""Run cases of the battery: worker processes, one JSON file a case, nothing done twice.

A case's file is OUT/ENGINE/cases/CASE.json, ENGINE with its version; an answer to a case that has changed since does not count
(`validity.py`). A run that was stopped goes on where it was, on another machine, too, from what was kept beside the battery:
answers/ENGINE.jsonl.xz; answers/ENGINE-METHOD-SPLIT.jsonl.xz is what other methods said.

Cases are taken seed by seed, and of a seed in an order that has nothing to do with them: what a run has done so far is a fair
sample of what it would do.
"""

import hashlib
import json
import lzma
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from benchmarks.battery import judged
from benchmarks.battery.cases import FAMILIES, Case, cases
from benchmarks.battery.judged import Told
from benchmarks.battery.validity import content, valid
from clutch_hil.bench.executors import compute

ROOT = Path(__file__).parents[2]
_QUICK = {  # of --quick: one severity, noise and seed
    "severity": (2.0, 1.0), "noise": (0.02,)
}  # fmt: skip
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def chosen(split: str, families: Sequence[str] = FAMILIES, quick: bool = False, only: Sequence[str] = ()) -> list[Case]:
    """Cases of a split, in the order of the patterns `only` if there are any, each once. Raises InputError."""
    found = cases(split, families)
    if quick:
        first = min(case.seed for case in found)
        found = [c for c in found if c.severity in _QUICK["severity"] and c.noise in _QUICK["noise"]
                 and (c.seed == first or (c.family == "null" and c.seed < first + 5))]  # fmt: skip
    if only:
        found = [c for pattern in only for c in found if fnmatch(c.name, pattern)]
    return list(dict.fromkeys(found))


_KEPT = Path(__file__).with_name("answers")
_NOT_KEPT = ("generating_seconds", "load", "floors", "notes", "features", "ranking")  # no table needs them
_TRUTH_KEPT, _WEIGHED_KEPT = (
    ("effects", "severity", "noise", "celsius", "split"),
    ("closed", "excess", "gain", "margin"),
)


def kept(engine: str, method: str = "") -> dict[str, Told]:
    """Valid answers that were kept of an engine, or of another `method` behind its first steps, by case."""
    with suppress(FileNotFoundError), lzma.open(_kept_in(engine, method), "rt", encoding="utf-8") as lines:
        return {told["case"]: told for told in map(json.loads, lines) if valid(told)}
    return {}


def keep(answers: Sequence[Told], engine: str, method: str = "") -> Path:
    """Keep what tables need of answers, with those kept before; return the file.

    Of another method what was kept before is replaced: its limits are set anew by each run, and answers by other limits are
    another method's.
    """
    path = _kept_in(engine, method)
    before = {} if method else kept(engine)
    every = before | {told["case"]: told for told in answers if "error" not in told}
    path.parent.mkdir(exist_ok=True)
    part = path.with_suffix(".part")
    with lzma.open(part, "wt", encoding="utf-8") as file:
        for name in sorted(every):
            told = {key: value for key, value in every[name].items() if key not in _NOT_KEPT}
            told["truth"] = {key: value for key, value in told["truth"].items() if key in _TRUTH_KEPT}
            if "weighed" in told:
                told["weighed"] = {key: told["weighed"][key] for key in _WEIGHED_KEPT}
            file.write(json.dumps(told, default=float) + "\n")
    part.replace(path)
    return path


def _kept_in(engine: str, method: str) -> Path:
    return _KEPT / f"{engine}{method and '-' + method}.jsonl.xz"


class Cache:
    """Answers below `folder`, by case, and those that were `kept`."""

    def __init__(self, folder: Path, kept: Mapping[str, Told] | None = None) -> None:
        self.folder = folder
        self._kept = kept or {}

    def path(self, name: str) -> Path:
        """File of a case."""
        return self.folder / f"{name}.json"

    def read(self, name: str) -> Told | None:
        """What was said of a case; None if nothing, only an error, or of the case as it was before."""
        with suppress(FileNotFoundError, json.JSONDecodeError):
            told: Told = json.loads(self.path(name).read_text(encoding="utf-8"))
            return told if "error" not in told and valid(told) else None
        return self._kept.get(name)

    def write(self, told: Told) -> None:
        """Keep an answer: all of it or nothing."""
        path = self.path(told["case"])
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(told, indent=1, default=float), encoding="utf-8")
        part.replace(path)

    def all(self) -> list[Told]:
        """Every answer there is."""
        names = {str(path.relative_to(self.folder))[:-5] for path in self.folder.rglob("*.json")} | self._kept.keys()
        return [told for told in map(self.read, sorted(names)) if told]


@dataclass(frozen=True)
class Judging:
    """`judge` with as many `threads` as its worker has cores: what a worker is given."""

    judge: Callable[[str], Told]
    threads: int

    def __call__(self, name: str) -> Told:
        """What the engine says of the case of this name."""
        judged.use_threads(self.threads)
        return self.judge(name)


def run(
    names: Sequence[str],
    cache: Cache,
    jobs: int | None = None,
    judge: Callable[[str], Told] = judged.judge,
    address: str | None = None,
) -> Iterator[Told]:
    """Answers of all cases as they come, first those of the cache; the others by `jobs` processes, or by the Dask cluster at
    `address`, whose workers have this package and as many threads as they were given. Cores are shared out evenly.

    Raises InputError.
    """
    missing = []
    for name in names:
        told = cache.read(name)
        if told is None:
            missing.append(name)
        else:
            yield told
    if not missing:
        return
    missing.sort(key=lambda name: (name.rpartition("/s")[2], hashlib.sha256(name.encode()).digest()))
    cores = os.cpu_count() or 1
    threads = 1 if address else max(1, cores // (jobs or cores))
    with _threads_of_workers(threads):
        workers = None if address else min(jobs or cores, len(missing))
        for _, told in compute(Judging(judge, threads), missing, workers, address):
            told["content"] = content(told["case"])
            cache.write(told)
            yield told


@contextmanager
def _threads_of_workers(threads: int) -> Iterator[None]:
    """Numerical libraries of processes that are started meanwhile use so many threads: they read it when they are imported."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, str(threads)))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def line(told: Told) -> str:
    """One line on an answer."""
    if "error" in told:
        return f"{told['case']:58} ERROR {told['error'].strip().splitlines()[-1]}"
    w = told["weighed"]
    names = "+".join(told["effects"]) or " | ".join(
        "+".join(group) if isinstance(group, list) else group for group in told["alternatives"]
    )
    rivals = ", ".join(f"{r['name']} {r['closed']:.3f}" for r in told["rivals"][:3])
    return (
        f"{told['case']:58} {told['verdict']:15} {names or '-':40} closed {w['closed']:.3f} gain {w['gain']:.4f} "
        f"excess {w['excess']:.4f} margin {w['margin']:.3f} conf {told['confidence']:.2f} {told['seconds']:.0f} s "
        f"(cpu {told['cpu_seconds']:.0f}) [{rivals}]"
    )
