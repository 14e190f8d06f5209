"""The local bus between real processes: vcan's semantics, full queues, deaths, newcomers."""

import json
import os
import socket
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from protocols.buses.local_channel import FrameLengthError, LocalChannel, OwnFrame
from tests.protocols.local_bus.participants import PATIENCE_S, Process, make_frame
from tests.stopwatch import Stopwatch


def read_number(raw: bytes) -> int:
    return int.from_bytes(raw[8:16], "little")


def take(channel: LocalChannel, count: int) -> list[bytes]:
    """The next `count` frames; fewer if they do not come."""
    frames: list[bytes] = []
    deadline = time.monotonic() + PATIENCE_S
    while len(frames) < count and channel.wait(deadline - time.monotonic()):
        frames += [raw for _, raw in channel.receive()]
    return frames


def list_socket_files(folder: Path, name: str = "b") -> set[str]:
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
    names = [listener.list_heard() for listener in listeners]
    with LocalChannel("b") as sender:
        before = time.time_ns()
        assert sorted(sender.participants) == sorted(names)
        assert sender.send(make_frame(42)) == 0
        after = time.time_ns()
        for listener in listeners:
            [(stamp, raw)] = listener.list_heard()
            assert raw == make_frame(42).hex()
            assert before <= stamp <= after
        assert sender.receive() == []


def test_own_frames_come_back_only_on_request() -> None:
    with LocalChannel("b", receive_own=True) as curious, LocalChannel("b") as other:
        curious.send(make_frame(1))
        other.send(make_frame(2))
        [(_, own), (_, foreign)] = curious.receive()
        assert (read_number(own), type(own)) == (1, OwnFrame)
        assert (read_number(foreign), type(foreign)) == (2, bytes)
        assert [read_number(raw) for _, raw in other.receive()] == [1]
        assert curious.participants == [other.participant]


def test_a_full_echo_is_counted_but_is_no_refusal() -> None:
    with LocalChannel("b", receive_own=True) as alone:
        assert [alone.send(make_frame(number)) for number in range(3000)] == [0] * 3000
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
    sender.list_heard()
    with LocalChannel("b") as reader:
        sender.ask()
        assert [read_number(raw) for raw in take(reader, 20000)] == list(range(20000))
        assert not reader.wait(0.0)


def test_frames_of_several_senders_are_merged_by_time() -> None:
    with LocalChannel("b") as reader, LocalChannel("b") as first, LocalChannel("b") as second:
        for number in range(100):
            (first if number % 3 else second).send(make_frame(number))
        received = reader.receive()
        assert [read_number(raw) for _, raw in received] == list(range(100))
        assert [stamp for stamp, _ in received] == sorted(stamp for stamp, _ in received)


def test_a_clock_set_back_does_not_reorder_a_sender(monkeypatch: pytest.MonkeyPatch) -> None:
    with LocalChannel("b") as reader, LocalChannel("b") as first, LocalChannel("b") as second:
        second.send(make_frame(9))
        for number, clock_ns in enumerate([3000, 2000, 1000]):
            monkeypatch.setattr(time, "time_ns", lambda clock_ns=clock_ns: clock_ns)
            first.send(make_frame(number))
        assert [read_number(raw) for _, raw in reader.receive()] == [0, 1, 2, 9]


def test_one_call_takes_a_bounded_number_of_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("protocols.buses.local_channel._FRAMES_A_CALL", 100)
    with LocalChannel("b") as reader, LocalChannel("b") as sender:
        for number in range(150):
            sender.send(make_frame(number))
        assert [read_number(raw) for _, raw in reader.receive()] == list(range(100))
        assert [read_number(raw) for _, raw in reader.receive()] == list(range(100, 150))


def test_a_full_queue_is_refused_and_counted_while_others_get_everything() -> None:
    with LocalChannel("b") as sender, LocalChannel("b") as reader, LocalChannel("b") as stalled:
        got: list[bytes] = []
        refusals = 0
        for number in range(5000):
            refusals += sender.send(make_frame(number))
            got += [raw for _, raw in reader.receive()]
        kept = [read_number(raw) for raw in take(stalled, 5000 - refusals)]
        assert [read_number(raw) for raw in got] == list(range(5000))
        assert kept == list(range(len(kept)))
        assert refusals > 0
        assert sender.refused == {stalled.participant: refusals}
        assert sender.send(make_frame(1)) == 0


def test_a_stopped_process_does_not_delay_the_sender(start: Callable[..., Process]) -> None:
    sleeper = start(SLEEPER)
    name = sleeper.list_heard()
    with LocalChannel("b") as sender:
        watch = Stopwatch()
        refusals = sum(sender.send(make_frame(number)) for number in range(20000))
        assert watch.read_seconds() < 2.0
        assert sender.refused == {name: refusals}
        assert refusals > 15000


def test_a_killed_participant_disappears_and_the_next_newcomer_removes_its_file(
    start: Callable[..., Process], folder: Path
) -> None:
    sleeper = start(SLEEPER)
    name = sleeper.list_heard()
    with LocalChannel("b") as survivor:
        assert survivor.participants == [name]
        sleeper.popen.kill()
        sleeper.popen.wait()
        assert survivor.send(make_frame(1)) == 0
        assert survivor.participants == []
        assert not survivor.wait(0.0)
        assert list_socket_files(folder) == {name, survivor.participant}
        with LocalChannel("b") as newcomer:
            assert newcomer.participants == [survivor.participant]
            assert list_socket_files(folder) == {newcomer.participant, survivor.participant}
    assert list_socket_files(folder) == set()


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
        sender.list_heard()
        reader.send(make_frame(7))
        sender.ask()
        sender.list_heard()
        if reader_sends_first:
            assert reader.send(make_frame(8)) == 0
        assert [read_number(raw) for raw in take(reader, 100)] == list(range(100))
        assert reader.participants == []


def test_a_sender_not_yet_let_in_is_heard_after_it_closed() -> None:
    with LocalChannel("b") as reader:
        with LocalChannel("b") as brief:
            brief.send(make_frame(5))
        assert [read_number(raw) for raw in take(reader, 1)] == [5]


def test_waiting_no_time_sees_what_a_newcomer_sent() -> None:
    with LocalChannel("b") as reader, LocalChannel("b") as newcomer:
        newcomer.send(make_frame(1))
        assert reader.wait(0.0)


def test_who_never_reads_does_not_run_out_of_descriptors() -> None:
    with LocalChannel("b") as only_sends:
        only_sends.send(make_frame(0))
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(200):
            with LocalChannel("b") as brief:
                brief.send(make_frame(1))
                only_sends.send(make_frame(2))
            only_sends.send(make_frame(3))
        assert len(os.listdir("/proc/self/fd")) - before < 70


def test_a_newcomer_hears_a_participant_that_only_sends(start: Callable[..., Process]) -> None:
    sender = start("""
        channel = LocalChannel("b")
        tell(channel.participant)
        while True:
            channel.send(numbered(1))
            time.sleep(0.001)
        """)
    sender.list_heard()
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
    everyone = [name for process in processes for name in process.list_heard()]
    for process in processes:
        process.ask(json.dumps(everyone))
    listened = [line for process in processes for line in process.list_heard()]
    assert len(listened) == 20
    for me, numbers in listened:
        expected = {1000 * other + number for other in range(20) if other != me for number in range(50)}
        assert Counter(numbers) == Counter(expected)
    for process in processes:
        process.ask()
        assert process.list_heard() == [0] * 5


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
    assert [process.list_heard() for process in pair] == [0, 0]
    for attempt in range(50):
        moment = time.monotonic() + 0.005
        for process in pair:
            process.ask(f"race{attempt} {moment}")
        first, second = (process.list_heard() for process in pair)
        for process in pair:
            process.ask()
        assert [process.list_heard() for process in pair] == [[second], [first]]
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
    name = parent.list_heard()
    assert list_socket_files(folder) == {name}
    with LocalChannel("b") as other:
        assert other.participants == [name]
        parent.popen.kill()
        parent.popen.wait()
        assert other.participants == []


@pytest.mark.parametrize("address", [None, "\0", "\0stranger", "\0one two three", "\0\udcff x", "file"])
def test_who_connects_and_is_no_participant_is_let_go(folder: Path, address: str | None) -> None:
    """As a program that looks into every socket: the loop of a service goes on."""
    with LocalChannel("b") as channel, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as stranger:
        if address is not None:
            stranger.bind(
                str(folder / address)
                if address == "file"
                else f"{address}{os.getpid()}".encode(errors="surrogateescape")
            )
        stranger.connect(str(folder / "b" / channel.participant))
        assert not channel.wait(0.0)
        assert channel.participants == []
        assert stranger.recv(1) == b""
        with LocalChannel("b") as other:
            assert channel.participants == [other.participant]


def test_two_buses_do_not_mix() -> None:
    with LocalChannel("b") as sender, LocalChannel("b") as same, LocalChannel("c") as different:
        sender.send(make_frame(1))
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


def test_a_timeout_below_a_millisecond_is_kept() -> None:
    with LocalChannel("b") as channel:
        waits = []
        for _ in range(20):
            started = time.monotonic()
            assert not channel.wait(0.0002)
            waits.append(time.monotonic() - started)
        assert 0.0002 <= min(waits) < 0.0009
