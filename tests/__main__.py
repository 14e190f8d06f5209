"""`python -m tests [OPTIONS OF PYTEST]`, used by `make test`: run all tests, then repeat alone those that failed in real time.

A shared host can take the CPUs away for up to a second, again and again for minutes. Services in real time then report faults,
which is correct. So a failure in real time counts only if the test also fails alone, after the host lets the machine run again.
Tests that do not depend on a clock have one try. All tries are printed.
"""

import sys
import time

import pytest

MANY = 10  # more files with failures than this are not explained by the machine
TRIES = 3
_LOOK = 0.001  # s between two checks whether this process runs
_STALL = 0.025  # s, delay of a check that counts as a stall; six cycles at 250 Hz, and five are a fault
_RUNS = 5.0  # s without a stall after which the machine is regarded as running
PATIENCE = 300.0  # s, longest wait for this


class Failures:
    """Plugin of pytest that collects the names of failed tests, whether all are real-time tests, and the skipped tests."""

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
    """Wait until the machine has run this process for 5 s without a stall; return the number of stalls."""
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
    if number > 1 and skipped:  # the list of the first try is far above by now
        from tests.needs import HEADING, list_skips

        print(f"\n{HEADING}", *list_skips(skipped), sep="\n", flush=True)
    return sentence


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
