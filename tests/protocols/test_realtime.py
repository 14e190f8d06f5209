"""What a process takes to be punctual: each measure alone, in a child, and told where the right is missing."""

import ctypes
import gc
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from clutch_hil.bench.host.machine import list_facts
from protocols.realtime.rights import MEASURES, LoopRequest, Measure, is_possible, prepare, relax

_PR_GET_TIMERSLACK = 30  # linux/prctl.h
CPU = max(os.sched_getaffinity(0))
PROJECT = Path(__file__).parents[2]


def run_in_child(sentence: str) -> Any:
    """What a function of this module returns in a process of its own, through JSON."""
    code = f"import json, tests.protocols.test_realtime as own; print(json.dumps(own.{sentence}()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def run_prepared() -> dict[str, object]:
    missing = prepare(CPU, 70)
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":\t" in line)
    return {
        "missing": missing,
        "scheduler": [os.sched_getscheduler(0), os.sched_getparam(0).sched_priority],
        "cpus": sorted(os.sched_getaffinity(0)),
        "locked_kb": int(status["VmLck"].split()[0]),
        "slack_ns": ctypes.CDLL(None).prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0),
        "collects": gc.isenabled(),
        "frozen": gc.get_freeze_count() > 0,
    }


@pytest.mark.needs("real-time priority", "memory locked")
def test_who_has_the_rights_gets_every_measure() -> None:
    result = run_in_child("run_prepared")
    absent = [
        m.missing for m in MEASURES if m.name == "CPU kept awake" and not os.access("/dev/cpu_dma_latency", os.W_OK)
    ]
    assert result["missing"] == absent
    assert result["scheduler"] == [os.SCHED_FIFO, 70]
    assert result["cpus"] == [CPU]
    assert result["locked_kb"] > 10_000
    assert result["slack_ns"] == 1 or result["scheduler"][0] == os.SCHED_FIFO  # of a real-time process none is kept
    assert (result["collects"], result["frozen"]) == (False, True)


def list_policies() -> list[int]:
    """Of scheduling: while each measure but the last is taken, once all are, and after."""
    seen: list[int] = []

    def watch_faults(measure: Measure) -> Measure:
        return measure._replace(take=lambda wanted: (measure.take(wanted), seen.append(os.sched_getscheduler(0))))

    prepare(CPU, 70, [watch_faults(measure) for measure in MEASURES])
    relax()
    return [*seen, os.sched_getscheduler(0)]


@pytest.mark.needs("real-time priority")
def test_only_the_loop_has_priority() -> None:
    """Getting ready and ending take tenths of a second, in which other loops on the CPU go on."""
    *before, ready, after = run_in_child("list_policies")
    assert set(before) == {os.SCHED_OTHER}
    assert (ready, after) == (os.SCHED_FIFO, os.SCHED_OTHER)


def count_faults() -> int:
    prepare()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        block = bytearray(8 << 20)
        del block
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def test_what_is_touched_beforehand_faults_no_more() -> None:
    """Blocks that come and go take pages that the process has."""
    assert run_in_child("count_faults") == 0


def test_a_measure_that_is_refused_is_told_and_the_others_are_taken() -> None:
    def refuse(wanted: LoopRequest) -> None:
        raise PermissionError

    taken: list[LoopRequest] = []
    measures = [MEASURES[0]._replace(take=refuse, missing="no priority"), MEASURES[1]._replace(take=taken.append)]
    assert prepare(3, 50, measures) == ["no priority"]
    assert taken == [LoopRequest(3, 50)]


def test_a_cpu_that_is_not_there_is_refused_without_any_harm() -> None:
    bind = next(m for m in MEASURES if m.name == "bound to a CPU")
    before = os.sched_getaffinity(0)
    assert not is_possible(bind, LoopRequest(4095))
    assert is_possible(bind, LoopRequest(CPU))
    assert os.sched_getaffinity(0) == before


def test_every_fact_that_is_not_good_says_what_to_do() -> None:
    result = list_facts()
    assert {"kernel", "clock source", "CAN interfaces"} <= {fact.name for fact in result}
    assert all(fact.state for fact in result)
    assert all(fact.remedy for fact in result if fact.good is False)


def test_the_doctor_tells_both_and_changes_nothing() -> None:
    done = subprocess.run(
        [sys.executable, "-P", "-m", "clutch_hil", "doctor", "--json"], capture_output=True, text=True, check=False
    )
    sentence = json.loads(done.stdout)
    assert [one["name"] for one in sentence["process"]] == [m.name for m in MEASURES]
    assert done.returncode == (0 if all(one["on"] for one in sentence["process"]) else 1)
    assert all(one["remedy"] for one in sentence["process"])
