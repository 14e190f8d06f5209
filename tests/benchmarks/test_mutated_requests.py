"""Damaged requests through zenoh, for some seconds: a real bench answers or refuses each, and it and its consumers live on."""

from benchmarks.mutated_requests import measure_mutated_requests, tabulate_consumers, tabulate_loops, tabulate_requests
from protocols.telemetry.keys import NODES

SECONDS = 8.0


def test_a_bench_lives_on_under_damaged_requests_and_rubbish(local_bus: str) -> None:
    targets, document = measure_mutated_requests(SECONDS / 60.0, 1, lambda line: None, local_bus)
    assert [target.name for target in targets if not target.is_met] == [], document
    asked = document["asked"]
    assert {"tune", "inject", "demand", "history", "last", "describe", "parameters", "events", "requests"} <= set(asked)
    # the damage reaches what is behind the parser, and some of it is accepted
    assert all(asked[kind].get("refused") for kind in ("tune", "inject"))
    assert sum(asked[kind].get("answered", 0) for kind in ("tune", "inject")) > 0
    assert document["changes"] > 0
    assert document["published"] > SECONDS
    assert len(tabulate_requests(document)) == 1 + len(asked)
    assert len(tabulate_loops(document)) == 1 + 2 * len(NODES)
    assert len(tabulate_consumers(document)) > 1
