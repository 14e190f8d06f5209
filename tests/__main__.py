"""What `make test` plays: every test, then what failed in real time again, alone: `python -m tests [OPTIONS]`, pytest's.

A shared host takes the CPUs away for up to a second, for minutes on end, and workers share what is left: services in real time
rightly fault then. So a failure there counts when the test also fails with nothing beside it, once the machine runs again.
Whatever computes without a clock has one try. All tries are printed.
"""

import sys
import time

import pytest

MANY = 10  # files with failures that are not the machine's any more
TRIES = 3
_LOOK = 0.001  # s between two looks at whether this process is run,
_STALL = 0.025  # s: how much later one means that it was not; six cycles at 250 Hz, of which five are a fault
_RUNS = 5.0  # s without such a one: the machine runs
PATIENCE = 300.0  # s that are waited for it


class Failures:
    """Plugin of pytest that keeps the names of tests that failed, whether all did in real time, and what was skipped."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.in_real_time = True
        self.skipped: list[pytest.TestReport] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped and not hasattr(report, "wasxfail"):
            self.skipped.append(report)
        if report.failed and report.nodeid not in self.names:
            self.names.append(report.nodeid)
            self.in_real_time &= "real_time" in report.keywords  # the marker (conftest.py)


def count_stalls_before_run() -> int:
    """Wait until the machine has run this process for a while; return how often it had not."""
    count, begin = 0, time.monotonic()
    since = last = begin
    while last - since < _RUNS and last - begin < PATIENCE:
        time.sleep(_LOOK)
        now = time.monotonic()
        if now - last > _LOOK + _STALL:
            count, since = count + 1, now
        last = now
    return count


def main(options: list[str]) -> int:
    failures = Failures()
    sentence = int(pytest.main(options, plugins=[failures]))
    skipped, number = failures.skipped, 1
    alone = ["--numprocesses", "1"] if "--numprocesses" in options else []
    while number < TRIES:
        files = {name.partition("::")[0] for name in failures.names}
        if sentence != pytest.ExitCode.TESTS_FAILED or not failures.in_real_time or not 0 < len(files) <= MANY:
            break
        number += 1
        stalls = count_stalls_before_run()
        print(
            f"\n{len(failures.names)} failed, all in real time; try {number} of {TRIES}, alone, after {stalls} stalls",
            flush=True,
        )
        names, failures = failures.names, Failures()
        sentence = int(pytest.main([*alone, *names], plugins=[failures]))
    if number > 1 and skipped:  # the first try's list is far above by now
        from tests.needs import HEADING, list_skips

        print(f"\n{HEADING}", *list_skips(skipped), sep="\n", flush=True)
    return sentence


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
