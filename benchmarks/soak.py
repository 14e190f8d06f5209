"""Soak: a bench at 1 kHz that records and publishes, with an intermittent viewer; its use of resources must not grow.

Every `_EVERY` seconds memory, descriptors, threads and shared memory of each process are read from /proc, and the computing
time of the cycles from the rings. Computing time is judged relative to newly started benches (new_benches.py), because
other programs slow down both. Slopes are Theil and Sen's, with their 95 % interval, after the first fifth of
the time. The interval assumes independent samples, which is not quite true: it is rather too narrow than too wide.

The bench belongs to the benchmark's own process, `up`. So samples go to a file: in memory they would add to its growth.
"""

import json
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from scipy.stats import theilslopes

from benchmarks.loop import Target
from benchmarks.new_benches import NODES, NewBenches, new_benches
from benchmarks.requests import compute_percentiles, read_work
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import Bench
from protocols.errors import InputError, InterruptionError
from protocols.realtime.child import end_child, list_command
from protocols.realtime.stopping import Stop

_EVERY = 5.0  # s between samples
_ENDING = 10.0  # s for a viewer to end after it was asked to
_VIEWER = 30.0  # s that a viewer runs, and is absent
_WARM = 0.2  # share of the time that is not judged: buffers fill, and modules are loaded on first use
_LEAST, _FEWEST = 60.0, 10  # s, and samples: fewer give no slope
_LEAST_MEDIANS = 3  # of new benches, which give fewer samples
_MOST_SECONDS = 7 * 86400.0  # s: chosen; rows are recorded all the time
_DAY = 86400.0  # s
_MIB = 1 << 20
_OTHER_BUS = "local:soak-new"  # of the new benches
# Growth in a day that is accepted, of a process: a month of it is 3 GiB, and the descriptors of a service are 1024
_MOST = {"memory [MiB]": 100.0, "shared memory [MiB]": 10.0, "descriptors": 5.0, "threads": 1.0}
_MOST_WORK = 0.1  # growth during the soak of a median computing time over that of new benches, as a share of it
_WORK, _NEW, _OVER = "work, p50 [us]", "work of new benches, p50 [us]", "work over that of new benches"


def measure_soak(bus: str, seconds: float, say: Callable[[str], None]) -> tuple[list[Target], dict[str, Any]]:
    """Run a bench for `seconds` [s]; return targets, and the samples of every process. Raises InputError."""
    if not _LEAST <= seconds <= _MOST_SECONDS:
        raise InputError(f"--seconds is {seconds:g} for a soak; allowed are {_LEAST:g} to {_MOST_SECONDS:g} s")
    count, viewers = 0, 0
    with tempfile.TemporaryDirectory() as folder, Stop() as stop, new_benches(_OTHER_BUS) as new:
        samples = Path(folder, "samples.jsonl")
        bench = Bench(Scenario.of(RunSettings(seconds=seconds + 60.0, out=Path(folder))), bus)
        with bench.start(stop, say) as session:
            began, viewer, turned = time.monotonic(), None, 0.0
            command = [*list_command("view", "--web", "--no-open", "--bus", session.bus)]
            try:
                while (passed := time.monotonic() - began) < seconds and not stop.asked:
                    if passed >= turned:
                        turned = passed + _VIEWER
                        if viewer:
                            end_child(viewer, _ENDING)
                            viewer = None
                        else:
                            viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                            viewers += 1
                    rows = read_work(session, _EVERY)
                    work = {node: compute_percentiles(own)["p50_us"] for node, own in rows.items()}
                    sample = {
                        "time_s": time.monotonic() - began,
                        "used": _sample_processes(viewer, new),
                        "work": {_WORK: work, _NEW: new.read()},
                    }
                    with samples.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(sample) + "\n")
                    count += 1
                    if not count % 12:
                        say(f"soak: {passed:.0f} of {seconds:.0f} s")
            finally:
                if viewer:
                    end_child(viewer, _ENDING)
            session.finish(interrupted=True)
            rows_lost = sum(ring.lost for ring in session.rings)
        if count < _FEWEST:
            raise InterruptionError(
                f"the soak was ended after {count} samples; a slope needs {_FEWEST}. Nothing is kept"
            )
        document = {**_read_samples(samples), "viewers": viewers, "rows_lost": rows_lost}
    return _judge(document), document


def tabulate_soak(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of a table: first, last and slope per day with its interval, for every sampled quantity."""
    rows = [("process", "what", "first", "last", "growth a day", "95 % interval")]
    for name, quantity, values in _list_series(document):
        slope, low, high = _find_slope(document["times_s"], values)
        known = [value for value in values if np.isfinite(value)] or [np.nan]
        cells = f"{known[0]:.4g}", f"{known[-1]:.4g}", f"{slope:.3g}", f"{low:.3g} to {high:.3g}"
        rows.append((name, quantity, *cells))
    return rows


def _judge(document: dict[str, Any]) -> list[Target]:
    """Return targets for the upper ends of the intervals: a quantity that is not shown to be constant fails."""
    worst = dict.fromkeys(_MOST, 0.0)
    targets = []
    for name, quantity, values in _list_series(document):
        high = _find_slope(document["times_s"], values)[2]
        if quantity in _MOST:
            worst[quantity] = max(worst[quantity], high)
        elif quantity == _OVER:
            share = high * document["times_s"][-1] / _DAY / float(np.nanmedian(values))
            what = f"{name}: growth of the work over that of new benches during the soak"
            targets.append(Target(what, share, "", "at most", _MOST_WORK))
    for quantity, growth in worst.items():
        targets.append(Target(f"{quantity}: growth in a day, worst process", growth, "", "at most", _MOST[quantity]))
    targets.append(Target("rows lost by the recording", float(document["rows_lost"]), "", "at most", 0.0))
    return targets


def _read_samples(path: Path) -> dict[str, Any]:
    """Return the times [s], and the samples of each quantity of each process."""
    times: list[float] = []
    used: dict[str, dict[str, list[float]]] = {}
    work: dict[str, dict[str, list[float]]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        sample = json.loads(line)
        times.append(sample["time_s"])
        for series, values_by_name in ((used, sample["used"]), (work, sample["work"])):
            for name, values in values_by_name.items():
                for kind, value in values.items():
                    series.setdefault(name, {}).setdefault(kind, []).append(value)
    return {"times_s": times, "used": used, "work": work}


def _list_series(document: dict[str, Any]) -> list[tuple[str, str, list[float]]]:
    """Return name, quantity and samples of each process that ran all the time."""
    series = [
        (name, quantity, values)
        for name, own in document["used"].items()
        for quantity, values in own.items()
        if len(values) == len(document["times_s"])
    ]
    work = document["work"]
    for node in NODES:
        own, new = work[_WORK][node], work[_NEW][node]
        over = (np.array(own) / np.array(new)).tolist()
        series += [(node, quantity, values) for quantity, values in ((_WORK, own), (_NEW, new), (_OVER, over))]
    return series


def _find_slope(times: list[float], values: list[float]) -> tuple[float, float, float]:
    """Return the slope per day of the samples after the warm-up, and the ends of its interval."""
    kept = [(t, v) for t, v in zip(times, values, strict=True) if t >= _WARM * times[-1] and np.isfinite(v)]
    if len(kept) < _LEAST_MEDIANS:
        return np.nan, np.nan, np.nan
    slope = theilslopes([v for _, v in kept], [t for t, _ in kept])
    return _DAY * float(slope.slope), _DAY * float(slope.low_slope), _DAY * float(slope.high_slope)


def _sample_processes(viewer: subprocess.Popen[bytes] | None, new: NewBenches) -> dict[str, dict[str, float]]:
    """Return the resource use of each process of the bench, by the words of its command after the interpreter."""
    own = psutil.Process()
    samples = {"up": _sample(own.pid)}
    children = own.children(recursive=True)
    others = {child.pid for child in psutil.Process(new.process).children(recursive=True)}
    for child in children:
        if child.pid in others:
            continue
        try:
            words = child.cmdline()
            if (viewer and child.pid == viewer.pid) or "--multiprocessing-fork" in words:
                continue
            place = words.index("-m") + 1
            samples[" ".join(_name(words[place:]))] = _sample(child.pid)
        except (psutil.Error, ValueError, OSError):  # it has just ended, or belongs to the viewer
            continue
    return samples


def _name(words: list[str]) -> list[str]:
    """Return the module and role of a process: `clutch_hil plant`, `protocols.telemetry plant`."""
    return [words[0], *(Path(word).stem for word in words[1:2])]


def _sample(pid: int) -> dict[str, float]:
    status = dict(
        line.split(":", 1)
        for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
        if ":" in line
    )
    kib = {name: float(status[name].split()[0]) for name in ("RssAnon", "RssShmem")}
    return {
        "memory [MiB]": kib["RssAnon"] * 1024 / _MIB,
        "shared memory [MiB]": kib["RssShmem"] * 1024 / _MIB,
        "descriptors": float(len(list(Path(f"/proc/{pid}/fd").iterdir()))),
        "threads": float(status["Threads"]),
    }
