"""Lines that services print: each is read once, however long their logs become."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from clutch_hil.bench.services import Services

LINES = 10_000  # of a service in a long run: 0.2 MB


@pytest.fixture
def services() -> Iterator[Services]:
    """Services that are not started; the tests write their logs."""
    made = Services({"plant": [], "controller": []})
    for name in made.names:
        made._log(name).touch()
    yield made
    made._shared.remove()


def count_read_bytes() -> int:
    """Bytes that this process has read so far, of files and pipes."""
    return int(Path("/proc/self/io").read_text().split()[1])


def test_a_line_is_read_once_it_is_whole_and_only_once(services: Services) -> None:
    with services._log("plant").open("w", buffering=1) as plant:
        plant.write("first\n\nsecond \xe4")
        plant.flush()
        assert services.read_new_lines() == [("plant", "first")]
        plant.write(" goes on\n")
        services._log("controller").write_bytes(b"\xff is no text\n")
        assert services.read_new_lines() == [("plant", "second \xe4 goes on"), ("controller", "\ufffd is no text")]
        assert services.read_new_lines() == []


def test_what_was_read_before_is_not_read_again(services: Services) -> None:
    """The bench looks twenty times a second; a log that is read as a whole each time would take its CPU."""
    with services._log("plant").open("w", buffering=1) as plant:
        plant.writelines(f"line {k} of a service\n" for k in range(LINES))
        assert len(services.read_new_lines()) == LINES
        plant.write("the last\n")
        before = count_read_bytes()
        assert services.read_new_lines() == [("plant", "the last")]
        assert count_read_bytes() - before < 1000
