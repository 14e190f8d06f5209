"""These tests need a machine that has booted with the units of a bench: the guest of tests/test_boot.py plays them."""

from pathlib import Path

import pytest


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.needs("booted bench"), append=False)
