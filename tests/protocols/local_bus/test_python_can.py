"""The local bus as an interface of python-can: messages, filters, notifiers."""

import asyncio
import errno
import time
from collections.abc import Callable
from typing import Any

import can
import pytest

from protocols.buses.local_bus import LocalBus
from tests.protocols.local_bus.participants import PATIENCE_S, Process, make_frame


def test_python_can_send_fails_only_if_all_are_full() -> None:
    message = can.Message(arbitration_id=1)
    with LocalBus("b") as sender, LocalBus("b") as reader, LocalBus("b") as stalled:
        while not sender.raw.refused:
            sender.send(message)
            reader.recv(0)
        sender.send(message)
        assert sender.raw.refused == {stalled.raw.participant: 2}
        while sender.raw.send(make_frame(0)) < 2:
            pass
        with pytest.raises(can.CanOperationError, match="all 2 participants of local:b") as failure:
            sender.send(message)
        assert failure.value.error_code == errno.ENOBUFS


def test_sending_alone_is_no_error() -> None:
    with LocalBus("b") as alone:
        alone.send(can.Message(arbitration_id=1))
        assert alone.recv(0.01) is None


@pytest.mark.parametrize("name", ["", "a/b", "..", "b.1", "x" * 33, "ä", "a b", "a\n"])
def test_a_bad_name_is_told_with_what_is_allowed(name: str) -> None:
    with pytest.raises(can.CanInitializationError, match="allowed are 1 to 32 of"):
        LocalBus(name)


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=0x7FF, is_extended_id=False, data=[1, 2, 3]),
        can.Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, data=bytes(range(8))),
        can.Message(arbitration_id=0x10, is_extended_id=True),
        can.Message(arbitration_id=0x123, is_extended_id=False, is_remote_frame=True, dlc=5),
        can.Message(arbitration_id=0x4, is_error_frame=True, is_extended_id=False, data=bytes(8)),
        can.Message(arbitration_id=0x55, is_fd=True, data=bytes(range(64)), bitrate_switch=True),
        can.Message(arbitration_id=0x56, is_fd=True, data=bytes(8), error_state_indicator=True),
    ],
    ids=["standard", "extended", "small extended", "remote", "error", "fd with bit rate switch", "short fd"],
)
def test_a_message_arrives_as_it_was_sent(message: can.Message) -> None:
    with LocalBus("b", fd=True) as sender, LocalBus("b", fd=True) as reader:
        sender.send(message)
        received = reader.recv(PATIENCE_S)
        assert received is not None
        assert received.equals(message, timestamp_delta=None, check_channel=False)
        assert received.channel == "b"
        assert abs(received.timestamp - time.time()) < PATIENCE_S


def test_fd_data_is_padded_to_a_length_that_exists() -> None:
    with LocalBus("b", fd=True) as sender, LocalBus("b", fd=True) as reader:
        sender.send(can.Message(is_fd=True, data=b"123456789"))
        received = reader.recv(PATIENCE_S)
        assert received is not None
        assert (received.dlc, received.data) == (12, b"123456789\0\0\0")


def test_without_fd_no_fd_message_is_sent_or_received() -> None:
    with LocalBus("b") as classic, LocalBus("b", fd=True) as modern:
        with pytest.raises(can.CanOperationError, match="without fd"):
            classic.send(can.Message(is_fd=True))
        modern.send(can.Message(arbitration_id=1, is_fd=True))
        modern.send(can.Message(arbitration_id=2))
        received = classic.recv(0)
        assert received is not None
        assert received.arbitration_id == 2


def test_data_too_long_for_a_classic_frame_is_refused() -> None:
    with LocalBus("b") as sender, pytest.raises(can.CanOperationError, match="9 data bytes; allowed are up to 8"):
        sender.send(can.Message(data=bytes(9), dlc=9))


def test_filters_are_those_of_python_can() -> None:
    filters: Any = [{"can_id": 0x120, "can_mask": 0x7F0, "extended": False}, {"can_id": 0x5, "can_mask": 0xFF}]
    with LocalBus("b") as sender, LocalBus("b", can_filters=filters) as reader:
        for identifier, extended in [(0x123, False), (0x123, True), (0x133, False), (0x105, True), (0x12F, False)]:
            sender.send(can.Message(arbitration_id=identifier, is_extended_id=extended))
        passed = [message.arbitration_id for message in iter(lambda: reader.recv(0), None)]
        assert passed == [0x123, 0x105, 0x12F]
        reader.set_filters(None)
        sender.send(can.Message(arbitration_id=0x133))
        assert reader.recv(0) is not None


def test_own_messages_are_marked_as_sent() -> None:
    with LocalBus("b", receive_own_messages=True) as curious, LocalBus("b") as other:
        curious.send(can.Message(arbitration_id=1))
        other.send(can.Message(arbitration_id=2))
        received = [curious.recv(PATIENCE_S), curious.recv(PATIENCE_S)]
        assert [(m.arbitration_id, m.is_rx) for m in received if m] == [(1, False), (2, True)]


def test_recv_waits_for_a_message_of_another_process(start: Callable[..., Process]) -> None:
    sender = start("""
        with can.Bus("b", interface="local") as bus:
            tell(str(bus))
            asked()
            time.sleep(0.05)
            bus.send(can.Message(arbitration_id=0x77))
        """)
    assert sender.list_heard() == "local:b"
    with LocalBus("b") as reader:
        assert reader.recv(0.01) is None
        sender.ask()
        received = reader.recv(None)
        assert received is not None
        assert received.arbitration_id == 0x77


def test_a_notifier_thread_gets_periodic_messages() -> None:
    with LocalBus("b") as sender, LocalBus("b") as reader:
        listener = can.BufferedReader()
        notifier = can.Notifier(reader, [listener], timeout=0.05)
        task = sender.send_periodic(can.Message(arbitration_id=0x33), period=0.005)
        received = [listener.get_message(PATIENCE_S) for _ in range(5)]
        task.stop()
        notifier.stop()
        assert [message.arbitration_id for message in received if message] == [0x33] * 5


def test_an_asyncio_notifier_gets_every_message_of_a_burst() -> None:
    async def listen() -> list[int]:
        with LocalBus("b") as reader, LocalBus("b") as sender:
            listener = can.AsyncBufferedReader()
            notifier = can.Notifier(reader, [listener], loop=asyncio.get_running_loop())
            for identifier in range(200):
                sender.send(can.Message(arbitration_id=identifier))
            received = [await asyncio.wait_for(listener.get_message(), PATIENCE_S) for _ in range(200)]
            notifier.stop()
            return [message.arbitration_id for message in received]

    assert asyncio.run(listen()) == list(range(200))


def test_python_can_finds_the_interface_and_its_buses() -> None:
    assert LocalBus._detect_available_configs() == []
    with can.Bus("b", interface="local", bitrate=500_000) as bus, LocalBus("c"):
        assert isinstance(bus, LocalBus)
        assert [config["channel"] for config in can.detect_available_configs("local")] == ["b", "c"]
    assert LocalBus._detect_available_configs() == []


def test_a_bus_that_was_shut_down_says_so() -> None:
    bus = LocalBus("b")
    bus.shutdown()
    bus.shutdown()
    with pytest.raises(can.CanOperationError, match="local:b is shut down"):
        bus.recv(0)
    with pytest.raises(can.CanOperationError, match="local:b is shut down"):
        bus.send(can.Message())
