"""Shared fixtures."""

import shutil
import tempfile
from collections.abc import Iterator

import pytest

import protocols  # noqa: F401  # sets the number of BLAS threads before numpy is imported


@pytest.fixture
def local_bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A local bus of its own, for this process and those it starts."""
    folder = tempfile.mkdtemp(prefix="ch-")  # short: socket paths hold 107 bytes
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", folder)
    yield "local:bench"
    shutil.rmtree(folder)
