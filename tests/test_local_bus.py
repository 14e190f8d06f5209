"""The local bus between real processes: vcan's semantics, full queues, deaths, newcomers, python-can."""

import asyncio
import errno
import json
import os
import subprocess
import sys
import textwrap
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from protocols.local_bus import LocalBus
from protocols.local_channel import FrameLengthError, LocalChannel, OwnFrame
from tests.stopwatch import Stopwatch

PATIENCE_S = 10.0
IMPORTS = """
import json, os, struct, sys, time
import can
from protocols.local_bus import LocalBus
from protocols.local_channel import LocalChannel
def tell(value): print(json.dumps(value), flush=True)
def asked(): return sys.stdin.readline().strip()
def numbered(number): return struct.pack("=IB3xQ", 0x100, 8, number)
"""


class Process:
    """Another Python process: `tell(x)` there is `heard()` here, `ask(x)` here is `asked()` there."""

    def __init__(self, script: str, *arguments: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, "-c", IMPORTS + textwrap.dedent(script), *arguments],
            cwd=Path(__file__).parent.parent, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def ask(self, text: str = "") -> None:
        assert self.popen.stdin
        self.popen.stdin.write(text + "\n")
        self.popen.stdin.flush()

    def heard(self) -> Any:
        assert self.popen.stdout
        return json.loads(self.popen.stdout.readline())


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def start() -> Iterator[Callable[..., Process]]:
    processes: list[Process] = []

    def start_one(script: str, *arguments: str) -> Process:
        processes.append(Process(script, *arguments))
        return processes[-1]

    yield start_one
    for process in processes:
        process.popen.kill()
        process.popen.communicate()


def frame(number: int, identifier: int = 0x100) -> bytes:
    return identifier.to_bytes(4, "little") + b"\x08\0\0\0" + number.to_bytes(8, "little")


def number_of(raw: bytes) -> int:
    return int.from_bytes(raw[8:16], "little")


def take(channel: LocalChannel, count: int) -> list[bytes]:
    """The next `count` frames; fewer if they do not come."""
    frames: list[bytes] = []
    deadline = time.monotonic() + PATIENCE_S
    while len(frames) < count and channel.wait(deadline - time.monotonic()):
        frames += [raw for _, raw in channel.receive()]
    return frames


def socket_files(folder: Path, name: str = "b") -> set[str]:
    return {path.name for path in (folder / name).iterdir()} - {"lock"}


LISTENER = """
with LocalChannel("b") as channel:
    tell(channel.participant)
    frames = []
    while len(frames) < int(sys.argv[1]) and channel.wait(10):
        frames += channel.receive()
    tell([(stamp, frame.hex()) for stamp, frame in frames])
"""
SLEEPER = """
channel = LocalChannel("b")
tell(channel.participant)
asked()
"""


def test_every_other_process_gets_the_frame_with_its_send_time(start: Callable[..., Process]) -> None:
    listeners = [start(LISTENER, "1") for _ in range(2)]
    names = [listener.heard() for listener in listeners]
    with LocalChannel("b") as sender:
        before = time.time_ns()
        assert sorted(sender.participants) == sorted(names)
        assert sender.send(frame(42)) == 0
        after = time.time_ns()
        for listener in listeners:
            [(stamp, raw)] = listener.heard()
            assert raw == frame(42).hex()
            assert before <= stamp <= after
        assert sender.receive() == []


def test_own_frames_come_back_only_on_request() -> None:
    with LocalChannel("b", receive_own=True) as curious, LocalChannel("b") as other:
        curious.send(frame(1))
        other.send(frame(2))
        [(_, own), (_, foreign)] = curious.receive()
        assert (number_of(own), type(own)) == (1, OwnFrame)
        assert (number_of(foreign), type(foreign)) == (2, bytes)
        assert [number_of(raw) for _, raw in other.receive()] == [1]
        assert curious.participants == [other.participant]


def test_a_full_echo_is_counted_but_is_no_refusal() -> None:
    with LocalChannel("b", receive_own=True) as alone:
        assert [alone.send(frame(number)) for number in range(3000)] == [0] * 3000
        assert alone.refused[alone.participant] + len(alone.receive()) == 3000


def test_order_holds_over_20000_frames(start: Callable[..., Process]) -> None:
    sender = start("""
        with LocalChannel("b") as channel:
            tell(channel.participant)
            asked()
            for number in range(20000):
                while channel.send(numbered(number)):
                    time.sleep(0.0002)
        """)
    sender.heard()
    with LocalChannel("b") as reader:
        sender.ask()
        assert [number_of(raw) for raw in take(reader, 20000)] == list(range(20000))
        assert not reader.wait(0.0)


def test_frames_of_several_senders_are_merged_by_time() -> None:
    with LocalChannel("b") as reader, LocalChannel("b") as first, LocalChannel("b") as second:
        for number in range(100):
            (first if number % 3 else second).send(frame(number))
        received = reader.receive()
        assert [number_of(raw) for _, raw in received] == list(range(100))
        assert [stamp for stamp, _ in received] == sorted(stamp for stamp, _ in received)


def test_a_clock_set_back_does_not_reorder_a_sender(monkeypatch: pytest.MonkeyPatch) -> None:
    with LocalChannel("b") as reader, LocalChannel("b") as first, LocalChannel("b") as second:
        second.send(frame(9))
        for number, clock_ns in enumerate([3000, 2000, 1000]):
            monkeypatch.setattr(time, "time_ns", lambda clock_ns=clock_ns: clock_ns)
            first.send(frame(number))
        assert [number_of(raw) for _, raw in reader.receive()] == [0, 1, 2, 9]


def test_one_call_takes_a_bounded_number_of_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("protocols.local_channel._FRAMES_A_CALL", 100)
    with LocalChannel("b") as reader, LocalChannel("b") as sender:
        for number in range(150):
            sender.send(frame(number))
        assert [number_of(raw) for _, raw in reader.receive()] == list(range(100))
        assert [number_of(raw) for _, raw in reader.receive()] == list(range(100, 150))


def test_a_full_queue_is_refused_and_counted_while_others_get_everything() -> None:
    with LocalChannel("b") as sender, LocalChannel("b") as reader, LocalChannel("b") as stalled:
        got: list[bytes] = []
        refusals = 0
        for number in range(5000):
            refusals += sender.send(frame(number))
            got += [raw for _, raw in reader.receive()]
        kept = [number_of(raw) for raw in take(stalled, 5000 - refusals)]
        assert [number_of(raw) for raw in got] == list(range(5000))
        assert kept == list(range(len(kept)))
        assert refusals > 0
        assert sender.refused == {stalled.participant: refusals}
        assert sender.send(frame(1)) == 0


def test_a_stopped_process_does_not_delay_the_sender(start: Callable[..., Process]) -> None:
    sleeper = start(SLEEPER)
    name = sleeper.heard()
    with LocalChannel("b") as sender:
        watch = Stopwatch()
        refusals = sum(sender.send(frame(number)) for number in range(20000))
        assert watch.seconds() < 2.0
        assert sender.refused == {name: refusals}
        assert refusals > 15000


def test_python_can_send_fails_only_if_all_are_full() -> None:
    message = can.Message(arbitration_id=1)
    with LocalBus("b") as sender, LocalBus("b") as reader, LocalBus("b") as stalled:
        while not sender.raw.refused:
            sender.send(message)
            reader.recv(0)
        sender.send(message)
        assert sender.raw.refused == {stalled.raw.participant: 2}
        while sender.raw.send(frame(0)) < 2:
            pass
        with pytest.raises(can.CanOperationError, match="all 2 participants of local:b") as failure:
            sender.send(message)
        assert failure.value.error_code == errno.ENOBUFS


def test_sending_alone_is_no_error() -> None:
    with LocalBus("b") as alone:
        alone.send(can.Message(arbitration_id=1))
        assert alone.recv(0.01) is None


def test_a_killed_participant_disappears_and_the_next_newcomer_removes_its_file(
    start: Callable[..., Process], folder: Path
) -> None:
    sleeper = start(SLEEPER)
    name = sleeper.heard()
    with LocalChannel("b") as survivor:
        assert survivor.participants == [name]
        sleeper.popen.kill()
        sleeper.popen.wait()
        assert survivor.send(frame(1)) == 0
        assert survivor.participants == []
        assert not survivor.wait(0.0)
        assert socket_files(folder) == {name, survivor.participant}
        with LocalChannel("b") as newcomer:
            assert newcomer.participants == [survivor.participant]
            assert socket_files(folder) == {newcomer.participant, survivor.participant}
    assert socket_files(folder) == set()


@pytest.mark.parametrize("reader_sends_first", [False, True])
def test_what_a_sender_sent_before_it_left_arrives(start: Callable[..., Process], reader_sends_first: bool) -> None:
    # The sender leaves a frame of the reader unread: closing a socket with unread data resets the connection.
    with LocalChannel("b") as reader:
        sender = start("""
            with LocalChannel("b") as channel:
                tell(0)
                asked()
                for number in range(100):
                    channel.send(numbered(number))
            tell(1)
            """)
        sender.heard()
        reader.send(frame(7))
        sender.ask()
        sender.heard()
        if reader_sends_first:
            assert reader.send(frame(8)) == 0
        assert [number_of(raw) for raw in take(reader, 100)] == list(range(100))
        assert reader.participants == []


def test_a_sender_not_yet_let_in_is_heard_after_it_closed() -> None:
    with LocalChannel("b") as reader:
        with LocalChannel("b") as brief:
            brief.send(frame(5))
        assert [number_of(raw) for raw in take(reader, 1)] == [5]


def test_waiting_no_time_sees_what_a_newcomer_sent() -> None:
    with LocalChannel("b") as reader, LocalChannel("b") as newcomer:
        newcomer.send(frame(1))
        assert reader.wait(0.0)


def test_who_never_reads_does_not_run_out_of_descriptors() -> None:
    with LocalChannel("b") as only_sends:
        only_sends.send(frame(0))
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(200):
            with LocalChannel("b") as brief:
                brief.send(frame(1))
                only_sends.send(frame(2))
            only_sends.send(frame(3))
        assert len(os.listdir("/proc/self/fd")) - before < 70


def test_a_newcomer_hears_a_participant_that_only_sends(start: Callable[..., Process]) -> None:
    sender = start("""
        channel = LocalChannel("b")
        tell(channel.participant)
        while True:
            channel.send(numbered(1))
            time.sleep(0.001)
        """)
    sender.heard()
    for _ in range(3):
        with LocalChannel("b") as newcomer:
            assert newcomer.wait(PATIENCE_S)


def test_20_participants_in_4_processes_hear_every_frame_of_every_other_once(start: Callable[..., Process]) -> None:
    processes = [
        start("""
            channels = [LocalChannel("b") for _ in range(5)]
            tell([channel.participant for channel in channels])
            everyone = json.loads(asked())
            for number in range(50):
                for channel in channels:
                    me = everyone.index(channel.participant)
                    assert channel.send(numbered(1000 * me + number)) == 0
            heard = []
            for channel in channels:
                numbers = []
                while len(numbers) < 19 * 50 and channel.wait(10):
                    numbers += [int.from_bytes(frame[8:], "little") for _, frame in channel.receive()]
                heard.append([everyone.index(channel.participant), numbers])
            tell(heard)
            asked()
            tell([len(channel.receive()) for channel in channels])
            """)
        for _ in range(4)
    ]
    everyone = [name for process in processes for name in process.heard()]
    for process in processes:
        process.ask(json.dumps(everyone))
    listened = [line for process in processes for line in process.heard()]
    assert len(listened) == 20
    for me, numbers in listened:
        expected = {1000 * other + number for other in range(20) if other != me for number in range(50)}
        assert Counter(numbers) == Counter(expected)
    for process in processes:
        process.ask()
        assert process.heard() == [0] * 5


def test_two_that_open_at_the_same_moment_always_see_each_other(start: Callable[..., Process]) -> None:
    pair = [
        start("""
            tell(0)
            while True:
                name, moment = asked().split()
                while time.monotonic() < float(moment):
                    pass
                with LocalChannel(name) as channel:
                    tell(channel.participant)
                    asked()
                    tell(channel.participants)
                    asked()
            """)
        for _ in range(2)
    ]
    assert [process.heard() for process in pair] == [0, 0]
    for attempt in range(50):
        moment = time.monotonic() + 0.005
        for process in pair:
            process.ask(f"race{attempt} {moment}")
        first, second = (process.heard() for process in pair)
        for process in pair:
            process.ask()
        assert [process.heard() for process in pair] == [[second], [first]]
        for process in pair:
            process.ask()


def test_a_forked_child_neither_keeps_a_dead_parent_alive_nor_removes_its_file(
    start: Callable[..., Process], folder: Path
) -> None:
    parent = start("""
        channel = LocalChannel("b")
        child = os.fork()
        if child == 0:
            channel.close()
            tell(channel.participant)
            asked()
            os._exit(0)
        time.sleep(60)
        """)
    name = parent.heard()
    assert socket_files(folder) == {name}
    with LocalChannel("b") as other:
        assert other.participants == [name]
        parent.popen.kill()
        parent.popen.wait()
        assert other.participants == []


def test_two_buses_do_not_mix() -> None:
    with LocalChannel("b") as sender, LocalChannel("b") as same, LocalChannel("c") as different:
        sender.send(frame(1))
        assert len(same.receive()) == 1
        assert different.receive() == []
        assert different.participants == []


@pytest.mark.parametrize("size", [0, 4, 15, 17, 24, 71, 73])
def test_a_frame_of_a_wrong_length_is_refused(size: int) -> None:
    with LocalChannel("b") as sender, pytest.raises(FrameLengthError, match=f"frame of {size} bytes"):
        sender.send(bytes(size))


@pytest.mark.parametrize(("size", "length"), [(16, 9), (72, 65)])
def test_a_length_byte_beyond_the_frame_is_refused(size: int, length: int) -> None:
    with LocalChannel("b") as sender, pytest.raises(ValueError, match=f"length byte {length}"):
        sender.send(bytes([0, 0, 0, 0, length]).ljust(size, b"\0"))


@pytest.mark.parametrize("name", ["", "a/b", "..", "b.1", "x" * 33, "ä", "a b", "a\n"])
def test_a_bad_name_is_told_with_what_is_allowed(name: str) -> None:
    with pytest.raises(can.CanInitializationError, match="allowed are 1 to 32 of"):
        LocalBus(name)


def test_a_folder_too_long_for_a_socket_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", str(folder / ("long" * 25)))
    with pytest.raises(can.CanInitializationError, match="allowed are 107: set CLUTCH_HIL_BUS_DIR to a shorter"):
        LocalChannel("b")


def test_a_folder_that_is_a_file_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "file").touch()
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", str(folder / "file"))
    with pytest.raises(can.CanInitializationError, match="file/b cannot be used"):
        LocalChannel("b")


def test_a_folder_others_can_enter_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", "")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    LocalChannel("b").close()
    (folder / "clutch-hil").chmod(0o755)
    with pytest.raises(can.CanInitializationError, match="mode 0700"):
        LocalChannel("b")


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
    assert sender.heard() == "local:b"
    with LocalBus("b") as reader:
        assert reader.recv(0.01) is None
        sender.ask()
        received = reader.recv(None)
        assert received is not None
        assert received.arbitration_id == 0x77


def test_a_timeout_below_a_millisecond_is_kept() -> None:
    with LocalChannel("b") as channel:
        waits = []
        for _ in range(20):
            started = time.monotonic()
            assert not channel.wait(0.0002)
            waits.append(time.monotonic() - started)
        assert 0.0002 <= min(waits) < 0.0009


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
