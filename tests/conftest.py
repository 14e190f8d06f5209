"""Shared fixtures."""

import shutil
import tempfile
from collections.abc import Iterator

import pytest

import protocols  # noqa: F401  # sets the number of BLAS threads before numpy is imported
from tests.telemetry.soak_process import Soak

_SOAK = "test_soak.py"


@pytest.fixture
def local_bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A local bus of its own, for this process and those it starts."""
    folder = tempfile.mkdtemp(prefix="ch-")  # short: socket paths hold 107 bytes
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", folder)
    yield "local:bench"
    shutil.rmtree(folder)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The soak is asked last for what has run since the first test."""
    items.sort(key=lambda item: item.path.name == _SOAK)


@pytest.fixture(scope="session", autouse=True)
def soak(request: pytest.FixtureRequest) -> Iterator[Soak | None]:
    """Ten minutes of telemetry beside all other tests; nothing where its test is not among them."""
    if any(item.path.name == _SOAK for item in request.session.items):
        with Soak() as soak:
            yield soak
    else:
        yield None
