"""What `make test` plays: every test, then what failed in real time once more, alone: `python -m tests [OPTIONS]`, pytest's.

A shared host takes the CPUs away for up to a second, and workers share what is left: services in real time rightly fault then.
So a failure there counts when the test also fails with nothing beside it. Whatever computes without a clock has one try.
Both tries are printed.
"""

import subprocess
import sys

import pytest

from tests.conftest import in_real_time

MANY = 12  # failures that are not the machine's any more


class Failures:
    """Plugin of pytest that keeps the names of tests that failed."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and report.nodeid not in self.names:
            self.names.append(report.nodeid)


def main(options: list[str]) -> int:
    failures = Failures()
    told = pytest.main(options, plugins=[failures])
    final = [name for name in failures.names if not in_real_time(name.partition("::")[0].removeprefix("tests/"))]
    if told != pytest.ExitCode.TESTS_FAILED or final or len(failures.names) > MANY:
        return int(told)
    print(f"\n{len(failures.names)} failed, all in real time: once more, alone", flush=True)
    alone = ["--numprocesses", "1"] if "--numprocesses" in options else []
    return subprocess.run([sys.executable, "-m", "pytest", *alone, *failures.names], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
