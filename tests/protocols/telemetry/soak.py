"""Ten minutes of telemetry at 1 kHz: a bench, and a listener that keeps up. Prints what came as JSON.

Runs beside the other tests (conftest.py), so that its load is theirs and theirs its:
`python -m tests.protocols.telemetry.soak SECONDS`.
"""

import json
import os
import sys
import tempfile
import time

import numpy as np

from clutch_hil.bench.timing.stalls import StallWatch
from clutch_hil.bench.timing.witness import WITNESS_PRIORITY
from protocols.telemetry.feed import Feed
from protocols.telemetry.keys import NODES
from protocols.telemetry.session import open_consumer_session
from tests.processes import ONE_CPU
from tests.protocols.telemetry.benches import bench, wait_for_bench

PERIOD = 1_000_000  # ns


def run_soak(seconds: float) -> dict[str, dict[str, float]]:
    """By node: rows that came, number of the last, rows lost, whether all were in order, age of rows when read [s],
    and how long the CPU of both stood still by slots that it came more than a period late for [s]."""
    with (
        tempfile.TemporaryDirectory(prefix="ch-") as folder,
        open_consumer_session() as session,
    ):
        os.environ["CLUTCH_HIL_BUS_DIR"] = folder
        with (
            bench("local:soak"),
            Feed(session, wait_for_bench(session, "local:soak"), live=False) as feed,
            StallWatch(int(ONE_CPU[1]), WITNESS_PRIORITY, PERIOD, PERIOD // 4, seconds) as watch,
        ):
            came = {node: {"rows": 0, "last": -1, "in_order": True} for node in NODES}
            ages: dict[str, list[float]] = {node: [] for node in NODES}
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                for batch in feed.read(0.2):
                    node = came[batch.node]
                    node["in_order"] &= batch.first_row == node["last"] + 1
                    node["rows"] += len(batch.rows)
                    node["last"] = batch.end - 1
                    ages[batch.node].append(time.monotonic() - batch[f"{batch.node}_clock_s"][-1])
        stood_still = PERIOD * len(watch.list_stalls(PERIOD)) / 1e9
        for node in NODES:
            age = np.percentile(ages[node], (50, 99, 100)).tolist()
            came[node] |= {"lost": feed.lost[node], "age_p50": age[0], "age_p99": age[1], "age_max": age[2]}
            came[node]["stood_still"] = stood_still
        return came


if __name__ == "__main__":
    print(json.dumps(run_soak(float(sys.argv[1]))))
