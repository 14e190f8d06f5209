"""Run cases of the battery in worker processes; keep one JSON file per case, and run no case twice.

The file of a case is OUT/ENGINE/cases/CASE.json; ENGINE contains the version of the engine. An answer does not count if
its case has changed since (`validity.py`). A run that was stopped can be continued, also on another machine:
answers/ENGINE.jsonl.xz beside this file holds answers for the repository, answers/ENGINE-METHOD-SPLIT.jsonl.xz those of
another method.

Cases run seed by seed, within a seed in a random order. So what has been run so far is a fair sample of the whole.
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

from benchmarks.battery import judgement
from benchmarks.battery.cases import FAMILIES, Case, list_cases
from benchmarks.battery.score import Answer
from benchmarks.battery.validity import format_engine_name, hash_content, is_valid
from clutch_hil.bench.sweeps.executors import compute
from protocols.files.output_file import whole_file

ROOT = Path(__file__).parents[2]
_QUICK_VALUES = {  # values of the cases that --quick selects; null cases have severity 1
    "severity": (2.0, 1.0), "noise": (0.02,)
}  # fmt: skip
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def select_cases(
    split: str, families: Sequence[str] = FAMILIES, quick: bool = False, only: Sequence[str] = ()
) -> list[Case]:
    """Select cases of a split, each once, in the order of the patterns `only` if there are any. Raises InputError."""
    selected = list_cases(split, families)
    if quick:
        first = min(case.seed for case in selected)
        selected = [c for c in selected if c.severity in _QUICK_VALUES["severity"] and c.noise in _QUICK_VALUES["noise"]
                 and (c.seed == first or (c.family == "null" and c.seed < first + 5))]  # fmt: skip
    if only:
        selected = [c for pattern in only for c in selected if fnmatch(c.name, pattern)]
    return list(dict.fromkeys(selected))


_KEPT_FOLDER = Path(__file__).with_name("answers")
# no table of the page needs them
_DROPPED_FIELDS = ("generating_seconds", "load", "floors", "notes", "features", "ranking")
_KEPT_TRUTH_FIELDS, _KEPT_WEIGHED_FIELDS = (
    ("effects", "severity", "noise", "celsius", "split"),
    ("closed", "excess", "gain", "margin"),
)


def read_kept_answers(engine: str, method: str = "") -> dict[str, Answer]:
    """Read the valid answers kept for a version of the engine, or for another `method` on the same cases; by case."""
    with suppress(FileNotFoundError), lzma.open(_find_kept_file(engine, method), "rt", encoding="utf-8") as lines:
        return {answer["case"]: answer for answer in map(json.loads, lines) if is_valid(answer)}
    return {}


def keep_answers(answers: Sequence[Answer], engine: str, method: str = "") -> Path:
    """Keep answers in the repository, together with those kept before; return the file.

    Only fields that tables need are kept. Answers of another method replace those kept before, because each run sets new
    limits of the method. Raises InputError if the file cannot be written.
    """
    path = _find_kept_file(engine, method)
    before = {} if method else read_kept_answers(engine)
    merged = before | {answer["case"]: answer for answer in answers if "error" not in answer}
    with whole_file(path) as part, lzma.open(part, "wt", encoding="utf-8") as file:
        for name in sorted(merged):
            answer = {key: value for key, value in merged[name].items() if key not in _DROPPED_FIELDS}
            answer["truth"] = {key: value for key, value in answer["truth"].items() if key in _KEPT_TRUTH_FIELDS}
            if "weighed" in answer:
                answer["weighed"] = {key: answer["weighed"][key] for key in _KEPT_WEIGHED_FIELDS}
            file.write(json.dumps(answer, default=float) + "\n")
    return path


def _find_kept_file(engine: str, method: str) -> Path:
    return _KEPT_FOLDER / f"{engine}{method and '-' + method}.jsonl.xz"


class Cache:
    """Answers in files below `folder`, and those `kept` in the repository, by case."""

    def __init__(self, folder: Path, kept: Mapping[str, Answer] | None = None) -> None:
        self.folder = folder
        self._kept = kept or {}

    def find_path(self, name: str) -> Path:
        """Return the file of a case."""
        return self.folder / f"{name}.json"

    def read(self, name: str) -> Answer | None:
        """Return the answer to a case; None if there is none, only an error, or an answer to an earlier version of the case."""
        with suppress(FileNotFoundError, json.JSONDecodeError):
            answer: Answer = json.loads(self.find_path(name).read_text(encoding="utf-8"))
            return answer if "error" not in answer and is_valid(answer) else None
        return self._kept.get(name)

    def write(self, answer: Answer) -> None:
        """Write an answer to its file, completely or not at all. Raises InputError."""
        with whole_file(self.find_path(answer["case"])) as part:
            part.write_text(json.dumps(answer, indent=1, default=float), encoding="utf-8")

    def read_all(self) -> list[Answer]:
        """Read all answers, in the order of their names."""
        names = {str(path.relative_to(self.folder))[:-5] for path in self.folder.rglob("*.json")} | self._kept.keys()
        return [answer for answer in map(self.read, sorted(names)) if answer]


@dataclass(frozen=True)
class Judging:
    """`judge` with as many `threads` as its worker has cores: the function sent to a worker."""

    judge: Callable[[str], Answer]
    threads: int

    def __call__(self, name: str) -> Answer:
        """Judge the case of this name."""
        judgement.use_threads(self.threads)
        return self.judge(name)


def run_cases(
    names: Sequence[str],
    cache: Cache,
    jobs: int | None = None,
    judge: Callable[[str], Answer] = judgement.judge,
    address: str | None = None,
) -> Iterator[Answer]:
    """Yield the answers to all cases, first those of the cache.

    The others are computed by `jobs` processes, one for each core if None, which share the cores evenly, or by the Dask cluster
    at `address`. Its workers must have this package, and use the threads that they were started with. Raises InputError.
    """
    missing = []
    for name in names:
        answer = cache.read(name)
        if answer is None:
            missing.append(name)
        else:
            yield answer
    if not missing:
        return
    missing.sort(key=lambda name: (name.rpartition("/s")[2], hashlib.sha256(name.encode()).digest()))
    cores = os.cpu_count() or 1
    threads = 1 if address else max(1, cores // (jobs or cores))
    with _set_worker_threads(threads):
        workers = None if address else min(jobs or cores, len(missing))
        for _, answer in compute(Judging(judge, threads), missing, workers, address):
            answer |= {"content": hash_content(answer["case"]), "engine": format_engine_name()}
            cache.write(answer)
            yield answer


@contextmanager
def _set_worker_threads(count: int) -> Iterator[None]:
    """Set the threads of numerical libraries in processes started in the `with` block to `count`; read on import."""
    before = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(_THREAD_VARIABLES, str(count)))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def format_answer(answer: Answer) -> str:
    """Format an answer as one line of the log."""
    if "error" in answer:
        return f"{answer['case']:58} ERROR {answer['error'].strip().splitlines()[-1]}"
    w = answer["weighed"]
    names = "+".join(answer["effects"]) or " | ".join(
        "+".join(group) if isinstance(group, list) else group for group in answer["alternatives"]
    )
    rivals = ", ".join(f"{r['name']} {r['closed']:.3f}" for r in answer["rivals"][:3])
    return (
        f"{answer['case']:58} {answer['verdict']:15} {names or '-':40} closed {w['closed']:.3f} gain {w['gain']:.4f} "
        f"excess {w['excess']:.4f} margin {w['margin']:.3f} conf {answer['confidence']:.2f} {answer['seconds']:.0f} s "
        f"(cpu {answer['cpu_seconds']:.0f}) [{rivals}]"
    )
