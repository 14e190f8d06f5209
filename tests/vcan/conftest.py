"""These tests need a CAN kernel: they run where vcan0 is up, on the host or in the guest of tests/test_guest.py."""

from pathlib import Path

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.needs("vcan0"), append=False)  # told before what else it needs
