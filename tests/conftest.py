"""Shared fixtures."""

import os
import shutil
import tempfile
from collections.abc import Iterator

import pytest

# before numpy is imported: threads for matrices of a few rows only fight for the cores (5 s became 41 s beside other work)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture
def local_bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A local bus of its own, for this process and those it starts."""
    folder = tempfile.mkdtemp(prefix="ch-")  # short: socket paths hold 107 bytes
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", folder)
    yield "local:bench"
    shutil.rmtree(folder)
