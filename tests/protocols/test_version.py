"""Versions of the database: how their frames are protected. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType

import pytest
from e2e.crc import calculate_crc8

import protocols.can.version
from protocols.can.database import read_database
from protocols.can.frames import DBC, DBC_1


@pytest.fixture(scope="module")
def version() -> ModuleType:
    return protocols.can.version


def test_the_crc_of_version_2_is_that_of_the_specification(version: ModuleType) -> None:
    """AUTOSAR PRS_E2EProtocol, profile 5: the example with data ID 0x1234, offset 0 and data of zeros."""
    data, both = bytearray(8), version.VERSION_2
    both.protect(data, 0x1234)
    assert data == b"\x1c\xca" + bytes(6)
    assert both.check(bytes(data), 0x1234) is True
    assert both.check(bytes(data), 0x1235) is False
    for place in range(8):
        wrong = bytearray(data)
        wrong[place] ^= 1
        assert both.check(bytes(wrong), 0x1234) is False


def test_the_counter_of_version_2_stays(version: ModuleType) -> None:
    data = bytearray(b"\0\0\x07" + bytes(5))
    version.VERSION_2.protect(data, 1)
    assert data[2] == 7


def test_the_crc_of_version_1_is_over_the_bytes_after_it(version: ModuleType) -> None:
    data, old = bytearray(b"\x55\x0a\x01\x02"), version.VERSION_1
    old.protect(data, 9)
    assert data == bytes([calculate_crc8(b"\x0a\x01\x02")]) + b"\x0a\x01\x02"
    assert old.check(bytes(data), 8) is True  # it has no data ID
    for place in range(4):
        wrong = bytearray(data)
        wrong[place] ^= 1
        assert old.check(bytes(wrong), 9) is False


def test_the_layout_of_the_protection(version: ModuleType) -> None:
    old, new = version.VERSION_1, version.VERSION_2
    assert (old.number, old.lengths, old.protection) == (1, (2, 8), (("CRC", 0, 8), ("COUNTER", 8, 4)))
    assert (new.number, new.lengths, new.protection) == (2, (8, 8), (("CRC", 0, 16), ("COUNTER", 16, 8)))
    assert (old.counter_start, old.counter_modulus, old.needs_data_id) == (8, 16, False)
    assert (new.counter_start, new.counter_modulus, new.needs_data_id) == (16, 256, True)


def test_a_database_is_of_the_version_of_most_of_its_frames(version: ModuleType) -> None:
    old, new = read_database(DBC_1), read_database(DBC)
    assert version.find_version(new) is version.VERSION_2
    assert version.find_version(old) is version.VERSION_1
    ours = [message for message in new.messages if message.name in version.VERSION_2.carried]
    before = [message for message in old.messages if message.name in version.VERSION_2.carried]
    count = min(len(ours), len(before))
    for mixed, expected in ((count, version.VERSION_2), (count + 1, version.VERSION_1)):
        messages = [*before[: min(mixed, len(before))], *ours[: 2 * count - mixed]]
        if len(messages) == 2 * count:
            assert version.find_version(_Database(messages)) is expected


class _Database:
    """A database of some frames."""

    def __init__(self, messages: list[object]) -> None:
        self.messages = messages
