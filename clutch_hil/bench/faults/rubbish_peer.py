"""Rubbish peer: a program that publishes damaged messages under the keys of a bench, and answers in the name of its nodes.

    python -m clutch_hil.bench.faults.rubbish_peer BENCH RATE SEED [NETWORK]

The program publishes RATE messages per second until it is asked to end. NETWORK is that of a consumer: a router, or a file of
`secure`.
"""

import itertools
import json
import sys
import threading
import time

import numpy as np
import zenoh

from clutch_hil.bench.faults.damage import Sound, damage
from protocols.realtime.stopping import Stop
from protocols.telemetry.keys import NODES, Keys
from protocols.telemetry.session import open_consumer_session, open_publisher_session

QUESTIONS = ("history", "last", "describe", "parameters", "events", "requests")
FRESH = 2.0  # s, after which sound copies are taken again, and changed parameters are restored
_LOOK = 0.05  # s between checks whether to end
RUBBISH_RATE = 50.0  # Hz, of messages: as many as a node publishes


class RubbishPeer:
    """Publish rubbish under the keys of a bench while entered, from a thread, and answer requests with rubbish.

    rate: of messages [Hz]. network: of a consumer; on loopback if None. published, answered: number of messages and answers.
    zid: of its session.
    """

    def __init__(self, bench: str, seed: int, rate: float = RUBBISH_RATE, network: str | None = None) -> None:
        self.published = self.answered = 0
        self._bench, self._period, self._network = bench, 1.0 / rate, network
        self._random = np.random.default_rng(seed + 1)
        self._seeds = itertools.count(1000 * seed + 500)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._turn)

    def __enter__(self) -> "RubbishPeer":
        network = self._network
        self._listener = open_consumer_session(network)
        # in a network with certificates or a router, this peer connects as a consumer
        self._speaker = open_consumer_session(network) if network else open_publisher_session()
        self.zid = self._speaker.info.zid()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._listener.close()
        self._speaker.close()

    def _turn(self) -> None:
        subscribers = [
            self._listener.declare_subscriber(Keys(self._bench, node).record, zenoh.handlers.RingChannel(1))
            for node in NODES
        ]
        now = {"by": "ann", "time": time.time(), "row": 7}
        sound = {
            (node, leaf): Sound(json.dumps({"node": node, **now, **more}).encode(), True)
            for node in NODES
            for leaf, more in (
                ("event", {"name": "valve.gain", "unit": "bar/V", "new": 2.0, "old": 2.5}),
                ("request", {"kind": "tune", "values": {"valve.gain": 2.0}}),
            )
        }
        keys = [getattr(Keys(self._bench, node), leaf) for node in NODES for leaf in QUESTIONS]
        queryables = [self._speaker.declare_queryable(key, zenoh.handlers.FifoChannel(64)) for key in keys]
        answers = dict.fromkeys(keys, Sound(b"[]", True))
        token, fresh = None, 0.0
        while not self._over.is_set():
            if time.monotonic() > fresh + FRESH:
                fresh = time.monotonic()
                for node, subscriber in zip(NODES, subscribers, strict=True):
                    if (sample := subscriber.try_recv()) is not None:
                        sound[node, "record"] = Sound(sample.payload.to_bytes(), False)
                answers |= self._ask_for_answers([key for key in keys if not key.endswith("/history")])
                token = self._speaker.liveliness().declare_token(Keys(self._bench, f"node{self.published}").alive)
            node, leaf = list(sound)[self._random.integers(len(sound))]
            payload = damage(sound[node, leaf], self._random, next(self._seeds))
            self._speaker.put(getattr(Keys(self._bench, node), leaf), payload)
            self.published += 1
            for key, queryable in zip(keys, queryables, strict=True):
                while (query := queryable.try_recv()) is not None:
                    node, leaf = key.split("/")[-2:]
                    answer = sound.get((node, "record"), answers[key]) if leaf == "history" else answers[key]
                    query.reply(key, damage(answer, self._random, next(self._seeds)))
                    query.drop()
                    self.answered += 1
            self._over.wait(self._period)
        del token

    def _ask_for_answers(self, keys: list[str]) -> dict[str, Sound]:
        """Return sound answers of the bench."""
        waiting = {key: self._listener.get(key, timeout=1.0, target=zenoh.QueryTarget.ALL) for key in keys}
        answers = {}
        for key, replies in waiting.items():
            for reply in replies:
                if reply.ok is not None and reply.replier_id is not None and reply.replier_id.zid != self.zid:
                    answers[key] = Sound(reply.ok.payload.to_bytes(), True)
        return answers


def _run(bench: str, rate: str, seed: str, network: str | None = None) -> None:
    with Stop() as stop, RubbishPeer(bench, int(seed), float(rate), network):
        while not stop.asked:
            time.sleep(_LOOK)


if __name__ == "__main__":
    _run(*sys.argv[1:])
