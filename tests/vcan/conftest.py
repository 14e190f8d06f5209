"""These tests need a CAN kernel: they run where vcan0 is up, on the host or in the guest of tests/test_guest.py."""

from pathlib import Path

import pytest

from protocols.bus import resolve


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if resolve("auto") != "vcan0":
        for item in items:
            if Path(item.fspath).parent == Path(__file__).parent:
                item.add_marker(pytest.mark.skip(reason="no vcan0 here; tests/test_guest.py runs this in a guest"))
