"""Request sender: sends damaged changes, injections, demands and queries to a running bench through zenoh."""

import itertools
import json
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import NamedTuple

import numpy as np
import zenoh

from clutch_hil.bench.faults.damage import Sound, damage
from clutch_hil.bench.faults.rubbish_peer import FRESH, QUESTIONS
from clutch_hil.live.tuning.tune import request_parameters
from protocols.telemetry.keys import NODES, Keys
from protocols.telemetry.session import open_consumer_session

MOST_REASON = 1000  # characters of a refusal
_RATE = 100.0  # requests a second at most; a bench that answers slowly gets fewer
_WORKERS = 40  # concurrent requests; ten of them may be waiting changes
_ANSWER_TIMEOUT = 10.0  # s: ten changes may wait, five are made per second; with margin for a busy machine
_LINK_PATIENCE = 30.0  # s for the first link to a publisher; the benchmark continues without one
_ODD_NAMES = ("ann", "x" * 5000, "a b", "\u00b5", "ann~", "-", "0", "a\nb", "'", '"', "%s", "..", "{}")
_TIMEOUT_REPLY = "Timeout"


class Outcome(NamedTuple):
    """Outcome of a request of a `kind`: `ok` whether it was done; `reason` of a refusal, None for an answer or no reply."""

    kind: str
    ok: bool
    reason: str | None


class RequestSender:
    """Sends damaged requests to a bench from threads while entered. counts: of outcomes by kind of request.

    longest: longest refusal. foreign: session whose answers do not count.
    """

    def __init__(self, bench: str, seed: int, foreign: zenoh.ZenohId) -> None:
        self.counts: dict[str, Counter[str]] = {}
        self.longest = self.unsendable = 0
        self._bench, self._foreign = bench, foreign
        self._random = np.random.default_rng(seed)
        self._seeds = itertools.count(1000 * seed)
        self._over = threading.Event()
        self._session = open_consumer_session()
        self._shipped: dict[str, dict[str, float]] = {}
        self._changes: list[tuple[str, str, bytes]] = []
        self._thread = threading.Thread(target=self._send_requests)
        self._failure: BaseException | None = None

    def __enter__(self) -> "RequestSender":
        end = time.monotonic() + _LINK_PATIENCE
        while not self._session.info.peers_zid() and time.monotonic() < end:
            time.sleep(0.01)
        for node in NODES:
            entries = request_parameters(self._session, self._bench, node)
            self._shipped[node] = {one["name"]: one["value"] for one in entries if not one["fixed"]}
        self._changes = list(self._list_sound_changes())
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._session.close()

    def finish(self) -> None:
        """Wait for the last answers. Raises the exception of a thread, if there was one."""
        self._over.set()
        self._thread.join()
        if self._failure:
            raise self._failure

    def _list_sound_changes(self) -> Iterator[tuple[str, str, bytes]]:
        """Yield the kind, node and payload of sound requests of each kind."""
        for node, values in self._shipped.items():
            few = dict(self._random.permutation(list(values.items()))[:6])
            yield "tune", node, json.dumps({name: float(value) for name, value in few.items()}).encode()
        for when in ({}, {"after": 0.2, "ramp": 0.1}, {"after": 0.1, "for": 0.2}, {"at": 1e6, "until": 2e6}):
            values = {"oil.sump_temperature": self._shipped["plant"]["oil.sump_temperature"]}
            yield "inject", "plant", json.dumps({"values": values, **when}).encode()
        yield "demand", "controller", json.dumps({"demand": "5 Nm"}).encode()

    def _send_requests(self) -> None:
        try:
            with ThreadPoolExecutor(_WORKERS) as pool:
                waiting: list[Future[Outcome | None]] = []
                restored = 0.0
                while not self._over.is_set():
                    if time.monotonic() > restored + FRESH:
                        restored = time.monotonic()
                        for node, values in self._shipped.items():
                            key = Keys(self._bench, node).change_by("fuzz")
                            waiting.append(pool.submit(self._send, "restore", key, json.dumps(values).encode()))
                    waiting.append(pool.submit(self._send, *self._draw()))
                    while len(waiting) >= _WORKERS:  # changes wait for their turn; other queries need not wait for them
                        done, still = wait(waiting, return_when=FIRST_COMPLETED)
                        waiting = list(still)
                        for one in done:
                            self._count(one.result())
                    time.sleep(1.0 / _RATE)
                for one in waiting:
                    self._count(one.result())
        except BaseException as error:
            self._failure = error

    def _draw(self) -> tuple[str, str, bytes | None]:
        """Return the kind, selector and payload of the next request."""
        if self._random.random() < 0.5:
            kind, node, sound = self._changes[self._random.integers(len(self._changes))]
            name = str(self._random.choice(_ODD_NAMES)) if self._random.random() < 0.2 else "fuzz"
            return kind, Keys(self._bench, node).change_by(name), self._damage(Sound(sound, True))
        leaf = str(self._random.choice(QUESTIONS))
        key = getattr(Keys(self._bench, str(self._random.choice(NODES))), leaf)
        if self._random.random() < 0.5:
            part = self._damage(Sound(b"from=100;to=900", True)).decode(errors="replace").replace("\0", "")
            key = f"{key}?{part}"
        return leaf, key, self._damage(Sound(b'{"valve.gain": 2.0}', True)) if self._random.random() < 0.3 else None

    def _damage(self, sound: Sound) -> bytes:
        return damage(sound, self._random, next(self._seeds))

    def _send(self, kind: str, selector: str, payload: bytes | None) -> Outcome | None:
        """Send a request and wait for the answer; return None if zenoh itself rejects the key."""
        try:
            replies = self._session.get(
                selector, payload=payload, timeout=_ANSWER_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE
            )
        except (zenoh.ZError, ValueError, UnicodeError):
            return None
        ok, late, reasons = False, False, []
        for reply in replies:
            if reply.replier_id is not None and reply.replier_id.zid == self._foreign:
                continue
            if reply.ok is not None:
                ok = True
            elif reply.err is not None and (reason := reply.err.payload.to_bytes()) != _TIMEOUT_REPLY.encode():
                reasons.append(reason.decode(errors="replace"))
            else:
                late = True
        # a history without rows has no reply, but the query ends
        return Outcome(kind, ok or (kind == "history" and not (late or reasons)), max(reasons, key=len, default=None))

    def _count(self, outcome: Outcome | None) -> None:
        if outcome is None:
            self.unsendable += 1
            return
        if outcome.reason is not None:
            self.longest = max(self.longest, MOST_REASON if "\n" in outcome.reason else len(outcome.reason))
        became = "answered" if outcome.ok else "refused" if outcome.reason is not None else "silent"
        self.counts.setdefault(outcome.kind, Counter())[became] += 1
