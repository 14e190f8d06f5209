"""Kills: benches that record at 1 kHz, with a process killed by SIGKILL at a random time, and what remains of them.

Each trial starts `clutch-hil up`, sometimes with `clutch-hil record`, on its own local bus. It kills the parent, a service, the
telemetry of a service, the recorder, or all at once, while the bench starts, runs or ends. The others end by themselves or on
request. Then `clutch-hil recover` and `up`, or only `up`, are started. Each recording must be readable, up to a second
before the kill, without a gap, and nothing else may remain.
"""

import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.loop import Target
from clutch_hil.bench.run_file import read_run
from protocols.errors import InputError, InterruptionError
from protocols.files.journal import list_journals
from protocols.files.runs import read_columns
from protocols.realtime.child import list_command
from protocols.realtime.shared_folder import list_dead_folders
from protocols.realtime.stopping import Stop

VICTIMS = ("parent", "plant", "controller", "plant telemetry", "controller telemetry", "recorder", "all at once")
_PHASES = {"start": 0.2, "run": 0.6, "end": 0.2}  # phase -> share of the kills
_LONGEST = {"start": 2.0, "run": 3.0, "end": 0.8}  # s after the beginning of the phase, latest time of the kill
_RECORDER_SHARE = 0.4  # share of benches with a recorder, if it is not the victim
_MOST_KILLS = 1000
_MOST_LOST = 1.0  # s of a recording before the kill
_RATE = 1000  # Hz
_BUS = "local:kills"
_LONG, _SHORT = 120.0, 2.0  # s, profiles that end after the kill and before it
_BEFORE_END = 1.5  # s recorded before a bench is asked to end
_FEW_ROWS = "0.3"  # s of the next start
_PATIENCE = 120.0  # s for a bench to start, or to end
_ASKED_AFTER = {"up": 1.0, "record": 3.0}  # s after the kill at which remaining processes are asked to end
_ASKED_AGAIN = 3.0  # s
_LATE_DRAWS = 5  # repetitions of a kill whose victim had already ended
_POLL_PERIOD = 0.01  # s


@dataclass(frozen=True)
class Plan:
    """A kill: `victim` of VICTIMS, `delay` [s] after the beginning of the `phase`.

    recorder: whether `record` runs too. by_profile: whether the bench ends with its profile, not on request. recover: whether
    `clutch-hil recover` comes before the next start.
    """

    victim: str
    phase: str
    delay: float
    recorder: bool
    by_profile: bool
    recover: bool


@dataclass
class Outcome:
    """State after a kill; times in s.

    needed: number of recordings with rows a second before the kill, which must exist. readable: number of them that can be
    read. lost: of each existing recording, the missing time before the kill. gaps: number of rows that do not follow the
    previous row. left: remains after the next start, other than recordings. waited: remains before it. reports: messages of the
    next start about recordings.
    """

    plan: Plan
    after_start: float = 0.0
    needed: int = 0
    readable: int = 0
    lost: list[float] = field(default_factory=list)
    gaps: int = 0
    left: list[str] = field(default_factory=list)
    waited: list[str] = field(default_factory=list)
    reports: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)


def measure_kills(kills: int, seed: int, say: Callable[[str], None]) -> tuple[list[Target], dict[str, Any]]:
    """Run `kills` trials; return targets, and the state after each. Raises InputError."""
    if not 1 <= kills <= _MOST_KILLS:
        raise InputError(f"--kills is {kills}; allowed are 1 to {_MOST_KILLS}")
    outcomes: list[Outcome] = []
    late = 0
    with Stop() as stop:
        random = np.random.default_rng(seed)
        try:
            for number, victim in enumerate(_draw_victims(random, kills)):
                for _ in range(_LATE_DRAWS):
                    if outcome := _play(_draw_plan(random, victim), stop):
                        break
                    late += 1
                else:
                    raise InputError(f"the {victim} had ended before each of {_LATE_DRAWS} kills")
                outcomes.append(outcome)
                say(f"kill {number + 1} of {kills}: {_describe(outcome)}")
        except InterruptionError:  # report the trials so far; the number of kills is not met
            if not outcomes:
                raise
    lost = [seconds for outcome in outcomes for seconds in outcome.lost]
    needed = sum(outcome.needed for outcome in outcomes)
    document = {"kills": [asdict(outcome) for outcome in outcomes], "seed": seed, "came_too_late": late}
    return [
        Target("kills", float(len(outcomes)), "", "at least", float(kills)),
        Target("recordings that can be read", float(sum(o.readable for o in outcomes)), "", "at least", float(needed)),
        Target("lost before the kill, most", max(lost, default=0.0), "s", "at most", _MOST_LOST),
        Target("gaps in the rows", float(sum(outcome.gaps for outcome in outcomes)), "", "at most", 0.0),
        Target("left after the next start", float(sum(len(o.left) for o in outcomes)), "", "at most", 0.0),
    ], document


def tabulate_kills(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of a table by process: kills, recordings, seconds lost, and remains before and after the next start."""
    rows = [
        (
            "killed",
            "kills",
            "recordings",
            "readable",
            "lost, median [s]",
            "lost, most [s]",
            "left for the next start",
            "left",
        )
    ]
    for victim in VICTIMS:
        own = [kill for kill in document["kills"] if kill["plan"]["victim"] == victim]
        lost = [seconds for kill in own for seconds in kill["lost"]]
        figures = (f"{np.median(lost):.3f}", f"{max(lost):.3f}") if lost else ("-", "-")
        counts = [str(sum(kill[name] for kill in own)) for name in ("needed", "readable")]
        left = [str(sum(len(kill[name]) for kill in own)) for name in ("waited", "left")]
        rows.append((victim, str(len(own)), *counts, *figures, *left))
    return rows


def _describe(outcome: Outcome) -> str:
    lost = f"{max(outcome.lost):.3f} s lost at most" if outcome.lost else "no recording had begun"
    parts = [f"{outcome.readable} of {outcome.needed} recordings readable, {lost}", *outcome.complaints]
    if outcome.gaps:
        parts.append(f"{outcome.gaps} gaps")
    if outcome.readable < outcome.needed:
        parts += outcome.reports
    if outcome.left:
        parts.append(f"left: {', '.join(outcome.left)}")
    plan = outcome.plan
    return f"{plan.victim}, {plan.phase}, {outcome.after_start:.2f} s after the start: {'; '.join(parts)}"


def _draw_victims(random: np.random.Generator, kills: int) -> list[str]:
    """Return a random order of victims, each of VICTIMS equally often."""
    rounds = [random.permutation(VICTIMS) for _ in range(-(-kills // len(VICTIMS)))]
    return [str(victim) for victim in np.concatenate(rounds)[:kills]]


def _draw_plan(random: np.random.Generator, victim: str) -> Plan:
    phase = str(random.choice(list(_PHASES), p=list(_PHASES.values())))
    by_profile, recover = (bool(one) for one in random.random(2) < 0.5)
    recorder = victim == "recorder" or bool(random.random() < _RECORDER_SHARE)
    return Plan(victim, phase, float(random.uniform(0.0, _LONGEST[phase])), recorder, by_profile, recover)


def _play(plan: Plan, stop: Stop) -> Outcome | None:
    """Start a bench, kill the victim, start the next bench and judge; return None if the victim had already ended."""
    with tempfile.TemporaryDirectory(prefix="ch-kills-") as folder, _Trial(Path(folder), plan, stop) as trial:
        trial.wait_for_phase()
        if not trial.kill():
            return None
        trial.await_ends()
        trial.start_next()
        return trial.judge()


class _Trial:
    """A bench in `folder` with a kill by `plan`. Leaving it as a context manager kills all remaining processes."""

    def __init__(self, folder: Path, plan: Plan, stop: Stop) -> None:
        self._plan, self._stop = plan, stop
        self._outcome = Outcome(plan)
        self._runs, self._buses, self._own = (folder / name for name in ("runs", "bus", "tmp"))
        for place in (self._runs, self._buses, self._own):
            place.mkdir()
        # environment of each process: its marker identifies the processes; temporary files go to a known folder
        self._environment = os.environ | {"CLUTCH_HIL_BUS_DIR": str(self._buses), "TMPDIR": str(self._own)}
        self._logs = folder
        self._sizes: dict[Path, int] = {}  # bytes of each journal when it was first seen
        self._began: dict[str, float] = {}  # s of CLOCK_MONOTONIC, when rows of each recording were first seen
        self._end = self._killed = 0.0  # s of CLOCK_MONOTONIC, when the bench was asked to end, and of the kill
        self._dead: list[Path] = []  # folders of shared memory before the next start
        self._next_run = ""
        seconds = _SHORT if plan.phase == "end" and plan.by_profile else _LONG
        self._started = time.monotonic()
        bench = "--bus", _BUS, "--rate", str(_RATE), "--profile", "engagement", "--seconds", str(seconds)
        self._up = self._start("up", *bench, "--out", str(self._runs))
        self._record = self._start("record", self._seen, "--bus", _BUS) if plan.recorder else None

    def __enter__(self) -> "_Trial":
        return self

    def __exit__(self, *_: object) -> None:
        for pid in self._list_processes():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for process in (self._up, self._record):
            if process:
                process.wait()

    @property
    def _seen(self) -> str:
        return str(self._runs / "seen.parquet")

    def wait_for_phase(self) -> None:
        """Wait until the time of the kill. Raises InputError if the bench ends before."""
        plan = self._plan
        recording = "record" if plan.victim == "recorder" else "up"
        if plan.phase == "start":
            self._wait(lambda: self._find_victims(), "start")
        else:
            self._wait(lambda: recording in self._began, "record")
        if plan.phase == "end":
            self._sleep(_BEFORE_END)
            self._end = time.monotonic()
            if not plan.by_profile:
                self._ask_to_end(self._up, self._record)
        self._sleep(plan.delay)

    def kill(self) -> bool:
        """Kill the victim; return whether there was one."""
        victims = self._find_victims()
        self._killed = time.monotonic()
        self._outcome.after_start = self._killed - self._started
        for pid in victims:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        return bool(victims)

    def await_ends(self) -> None:
        """Wait for all other processes; ask remaining ones to end."""
        asked = {name: self._killed + after for name, after in _ASKED_AFTER.items()}
        deadline = self._killed + _PATIENCE
        while (there := self._list_processes()) and time.monotonic() < deadline:
            for name, process in (("up", self._up), ("record", self._record)):
                if process and process.poll() is None and time.monotonic() > asked[name]:
                    asked[name] += _ASKED_AGAIN
                    self._ask_to_end(process)
            self._look()
        for pid, name in there.items():
            self._outcome.left.append(f"process {name}")
            os.kill(pid, signal.SIGKILL)
        self._up.wait()
        self._dead = list_dead_folders()
        self._outcome.waited = [*self._list_remains(), *(f"memory {folder.name}" for folder in self._dead)]

    def start_next(self) -> None:
        """Start the next command or bench, which removes the remains of the killed process."""
        before = {path.name for path in self._runs.iterdir()}
        if self._plan.recover:
            self._run("recover", str(self._runs))
            journals = [f"{path.name} after recover" for path in list_journals(self._runs)]
            self._outcome.left += journals + [
                f"{folder.name} after recover" for folder in self._dead if folder.exists()
            ]
        bench = "--bus", _BUS, "--seconds", _FEW_ROWS, "--no-telemetry", "--json", "--out", str(self._runs)
        document = json.loads(self._run("up", *bench))
        self._next_run = Path(document["run"]).name
        if self._next_run in before:
            self._outcome.complaints.append(f"the next start wrote over {self._next_run}")

    def judge(self) -> Outcome:
        """Read the recordings, and search for remains."""
        outcome = self._outcome
        outcome.left += [*self._list_remains(), *(f"memory {folder.name}" for folder in self._dead if folder.exists())]
        outcome.left += [f"process {name}" for name in self._list_processes().values()]
        files = sorted(path for path in self._runs.glob("*.parquet") if path.name != self._next_run)
        seen = [path for path in files if path.name.startswith("seen")]
        by_recorder = {"up": [path for path in files if path not in seen], "record": seen}
        for recorder, own in by_recorder.items():
            needed = recorder in self._began and self._began[recorder] < self._killed - _MOST_LOST
            outcome.needed += needed
            outcome.gaps += max(len(own) - 1, 0)
            try:
                lost = [self._read(path) for path in own]
            except InputError as error:
                outcome.complaints.append(str(error))
                continue
            outcome.readable += needed and bool(own)
            outcome.lost += [min(lost)] if lost else []
        return outcome

    def _read(self, path: Path) -> float:
        """Read a recording, count its gaps, and return the missing time before the kill or the end of the bench [s]."""
        last, clock, gaps = _read_run_end(path)
        self._outcome.gaps += gaps
        read_run(path)  # also refuses a recording with gaps
        if self._plan.phase == "end" and self._plan.by_profile and last > _SHORT - 1.5 / _RATE:
            return 0.0  # the profile had ended
        asked = self._end if self._plan.phase == "end" and not self._plan.by_profile else np.inf
        return max(min(self._killed, asked) - clock, 0.0)

    def _list_remains(self) -> list[str]:
        """Return the files other than recordings: in the folder, of the bus, and temporary ones."""
        runs = [path.name for path in self._runs.iterdir() if path.suffix not in (".parquet", ".png")]
        buses = [f"bus {path.name}" for path in self._buses.glob("*/*") if path.name != "lock"]
        return [*runs, *buses, *(f"temporary {path.name}" for path in self._own.iterdir())]

    def _find_victims(self) -> list[int]:
        """Return the processes to kill; empty if the victim does not run."""
        there, victim = self._list_processes(), self._plan.victim
        if victim == "all at once":
            return [*there] if self._up.poll() is None else []
        names = {"parent": "up", "recorder": "record"}
        return [pid for pid, name in there.items() if name == names.get(victim, victim)][:1]

    def _list_processes(self) -> dict[int, str]:
        """Return the name by number of each running process of this bench, the oldest first."""
        return dict(_list_processes(f"CLUTCH_HIL_BUS_DIR={self._buses}".encode()))

    def _look(self) -> None:
        """Wait a little, and note which recordings have begun."""
        self._stop.check("the first kill was not played to its end; nothing is kept")
        time.sleep(_POLL_PERIOD)
        for path in list_journals(self._runs):
            with suppress(OSError):  # the journal has become a complete run file
                size = path.stat().st_size
                if size > self._sizes.setdefault(path, size):  # there are rows after the header
                    self._began.setdefault("record" if path.name.startswith("seen") else "up", time.monotonic())

    def _sleep(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._look()

    def _wait(self, ready: Callable[[], object], what: str) -> None:
        while not ready():
            if self._up.poll() is not None or time.monotonic() > self._started + _PATIENCE:
                raise InputError(f"the bench did not {what}: {self._read_last_line('up')}")
            self._look()

    def _ask_to_end(self, *processes: "subprocess.Popen[bytes] | None") -> None:
        for process in processes:
            if process and process.poll() is None:
                process.send_signal(signal.SIGINT)

    def _start(self, *arguments: str) -> "subprocess.Popen[bytes]":
        with (self._logs / f"{arguments[0]}.log").open("wb") as log:
            return subprocess.Popen(
                list_command(*arguments), env=self._environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                start_new_session=True,
            )  # fmt: skip

    def _run(self, *arguments: str) -> str:
        """Run a command to its end; return its output. Raises InputError if it fails."""
        done = subprocess.run(
            list_command(*arguments), env=self._environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=2 * _PATIENCE, check=False,
        )  # fmt: skip
        if done.returncode not in (0, 1):
            raise InputError(
                f"after a kill of {self._plan.victim}, {arguments[0]} ended so: {done.stderr.strip()[-500:]}"
            )
        lines = f"{done.stdout}\n{done.stderr}".splitlines()
        self._outcome.reports += [line for line in lines if "recovered " in line or "samples, no run" in line]
        return done.stdout

    def _read_last_line(self, name: str) -> str:
        lines = (self._logs / f"{name}.log").read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "no message"


def _read_run_end(path: Path) -> tuple[float, float, int]:
    """Return the time of the last row [s] of the rig and of CLOCK_MONOTONIC, and the number of gaps between rows."""
    run = read_columns(path)
    gaps = int(np.sum(np.abs(np.diff(run["time_s"]) * _RATE - 1.0) > 1e-3))
    return float(run["time_s"][-1]), float(run["plant_clock_s"][-1]), gaps


def _list_processes(marker: bytes) -> Iterator[tuple[int, str]]:
    """Yield the number and name of each process with `marker` in its environment, in the order of their numbers."""
    for pid in sorted(int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()):
        with suppress(OSError):  # it has ended, or is another user's
            if marker in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0"):
                yield pid, _name(Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0"))


def _name(words: list[str]) -> str:
    """Return the name of a process, from the words of its command: `plant`, `plant telemetry`, `record`."""
    module, *rest = words[words.index("-m") + 1 :] if "-m" in words else words
    if module == "clutch_hil":
        return rest[0]
    return f"{Path(rest[0]).stem} telemetry" if module == "protocols.telemetry" else " ".join(words)[:60]
