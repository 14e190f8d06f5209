"""The ten minutes as a process that is started with the first test and asked by the last."""

import json
import subprocess
import sys

SECONDS = 600.0
_END = 120.0  # s for the bench to come up before and to end after


class Soak:
    """Use as a context manager: leaving it ends what still runs."""

    def __enter__(self) -> "Soak":
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.telemetry.soak", str(SECONDS)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        return self

    def result(self) -> dict[str, dict[str, float]]:
        """What came, by node; waits for the end."""
        out, errors = self._process.communicate(timeout=SECONDS + _END)
        assert self._process.returncode == 0, errors
        return json.loads(out)

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.terminate()
            self._process.communicate()
