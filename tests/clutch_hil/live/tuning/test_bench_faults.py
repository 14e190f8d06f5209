"""`clutch-hil inject` of faults of processes and of the computer: words, and a bench that is asked while it runs."""

import time
from typing import Any

import pytest

import clutch_hil as ch
from clutch_hil.live.tuning.bench_faults import read_bench_fault
from protocols.errors import InputError
from tests.clutch_hil.live.running import RATE, run_command


@pytest.mark.parametrize(
    ("words", "process", "signal", "off", "request_"),
    [
        (["disk_slow", "delay=20"], None, None, False, {"host_fault": "disk_slow", "values": {"delay": 20.0}}),
        (["disk_slow", "delay=0.02 s"], None, None, False, {"host_fault": "disk_slow", "values": {"delay": 20.0}}),
        (["disk_full"], None, None, False, {"host_fault": "disk_full", "values": {}}),
        (["disk_full", "disk_slow"], None, None, True, {"end": ["disk_full", "disk_slow"]}),
        ([], "plant", None, False, {"process": "plant", "signal": "kill"}),
        ([], "plant", "stop", False, {"process": "plant", "signal": "stop"}),
        (["friction_level"], None, None, False, None),
        (["frame_loss", "commands=1"], None, None, False, None),
        (["valve.gain=2"], None, None, False, None),
        (["friction_level"], None, None, True, None),
        ([], None, None, False, None),
    ],
)
def test_words_become_a_request(
    words: list[str], process: str | None, signal: str | None, off: bool, request_: dict[str, Any] | None
) -> None:
    assert read_bench_fault(words, process, signal, off) == request_


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["disk_ful"], "effect or fault 'disk_ful' is unknown; did you mean disk_full"),
        (["disk_slow", "delay=x"], "delay=x needs a number after the ="),
        (["disk_slow", "delay=20 bar"], "disk_slow.delay is given in 'bar'; its unit is 'ms'; allowed are also s, us"),
        (["disk_slow", "dely=20 ms"], "host fault disk_slow has no parameter 'dely'; did you mean delay"),
        (["disk_full", "delay=20 ms"], "host fault disk_full has no parameter 'delay'; it has none"),
        (["disk_slow", "delay=20", "ms"], "'ms' is a unit without a number; write both as one word, such as NAME=34ms"),
        (["disk_slow", "delay=1", "delay=2"], "a parameter of disk_slow was given twice"),
        (["disk_slow", "frame_loss"], "inject a fault of the computer in a separate command"),
        (["frame_loss", "disk_slow"], "inject a fault of the computer in a separate command"),
        (
            ["disk_slow", "frame_loss", "--off"],
            "disk_slow and frame_loss cannot be combined; end a fault of the computer in a separate command",
        ),
        (
            ["disk_slow", "--ramp", "1"],
            "a fault of the bench and --ramp cannot be combined; allowed with it are --bus and start times",
        ),
        (["disk_slow", "--router", "tcp/1.2.3.4:7447"], "a fault of the bench and --router"),
        (["disk_slow", "--off", "--for", "3"], "a fault of the bench and --for"),
        (["disk_slow", "--freeze", "pressure"], "a fault of the bench and --freeze"),
        (["--process", "plant", "--clutch", "a"], "a fault of the bench and --clutch"),
        (["--process", "plant", "disk_slow"], "--process and disk_slow cannot be combined"),
        (["--process", "plant", "--off"], "--process and --off cannot be combined"),
        (["--signal", "kill"], "--signal was given without --process; give the service with --process"),
        (["disk_slow", "--bus", "local:nobody"], "no clutch-hil up of this user runs on bus local:nobody"),
    ],
)
def test_what_cannot_be_meant_is_told(arguments: list[str], sentence: str) -> None:
    done = run_command("inject", *arguments)
    assert isinstance(done.exception, InputError)
    assert sentence in str(done.exception)
    assert not done.stdout


def test_a_bench_is_asked_while_it_runs_and_its_run_says_what_was_done(local_bus: str) -> None:
    with ch.start_bench(bus=local_bus, rate=RATE) as bench:
        bench.wait(0.3)
        done = run_command("inject", "disk_slow", "delay=20", "--bus", bench.bus)
        assert not done.exception, done.exception
        assert "verdict: disk_slow delay 20 ms: planned from" in done.stdout
        bench.wait(0.3)
        assert "fault of the bench: disk_slow delay 20 ms" in run_command("inject", "--list", "--bus", bench.bus).stdout
        done = run_command("inject", "disk_slow", "--off", "--bus", bench.bus)
        assert "verdict: disk_slow delay 20 ms: ended" in done.stdout
        assert (
            "verdict: none of these faults was on"
            in run_command("inject", "disk_slow", "--off", "--bus", bench.bus).stdout
        )
        run_command("inject", "--process", "controller", "--signal", "stop", "--for", "0.1", "--bus", bench.bus)
        time.sleep(0.5)
        log = bench.stop().metadata["bench_faults"]
    assert [(one["fault"], one["does"]) for one in log] == [
        ("disk_slow delay 20 ms", "began"), ("disk_slow delay 20 ms", "ended"),
        ("controller stopped", "began"), ("controller stopped", "ended"),
    ]  # fmt: skip
