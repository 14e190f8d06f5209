"""Replay of a recorded bus log through the controller; the answers are equal to the bit on every computer.

Method          one cycle for each sample, with all frames since the sample before, as in lock-step. The pace of the log has no
                effect. Frames of the controller in the log are not given to the controller, but compared with its answers
Digest          SHA-256 of identifiers and payloads of VALVE_COMMAND, MOTOR_COMMAND and CONTROLLER_STATUS in the order of
                sending. Heartbeats are excluded, as they contain the session number
Assumptions     for equal answers, parameters and law are those of the controller in the log
"""

import hashlib
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can

from protocols.buses.bus import Port, open_bus
from protocols.can.frames import Frame, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError
from protocols.realtime.child import clutch_hil, spawn
from rt_controller.loop.node import ControllerNode

_COMPARED_FRAMES = ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_STATUS")
_FRAMES_BEFORE_START = 64  # frames before the first sample that its cycle still receives, as in service.py
_START_TIMEOUT = 30.0  # s for the start of a controller process
_ANSWER_TIMEOUT = 5.0  # s for an answer of the process, and for its end
_LAST_COUNTER = 7  # alive counter of the final heartbeat, which ends the controller process


@dataclass
class Answers:
    """Answers of a controller: number of `cycles`; `logged` valve commands, and how many are `equal`; `seconds`; digest."""

    cycles: int = 0
    logged: int = 0
    equal: int = 0
    seconds: float = 0.0
    _digest: Any = field(default_factory=hashlib.sha256)

    def add(self, frames: list[Frame]) -> None:
        """Add the compared frames of one cycle."""
        self.cycles += 1
        for can_id, data in frames:
            self._digest.update(can_id.to_bytes(2, "little") + data)

    @property
    def digest(self) -> str:
        """SHA-256 of all answers, in hexadecimal digits."""
        return str(self._digest.hexdigest())


class Log:
    """Samples of a log and the valve commands that answered them. Raises InputError for a file that is no log of the bench.

    rate [Hz]; `samples`: frames by sample; `answers`: payloads by index of the sample; `seconds`: duration of the log.
    """

    def __init__(self, path: Path) -> None:
        codecs = load_frames()
        by_id = {codec.can_id: codec.name for codec in codecs.values()}
        own = {codecs[name].can_id for name in (*_COMPARED_FRAMES, "CONTROLLER_HEARTBEAT")}
        second = load_frames(clutch="b")["ENCODER"].can_id
        encoder, valve = codecs["ENCODER"], codecs["VALVE_COMMAND"]
        heartbeat = codecs["PLANT_HEARTBEAT"]
        self.rate = 0
        self.samples: list[list[Frame]] = []
        self.answers: dict[int, bytes] = {}  # payload of the valve command by index of its sample
        self.seconds = 0.0
        ticks: dict[int, int] = {}
        inbox: list[Frame] = []
        first = last = 0.0
        for message in _messages(path):
            can_id, data = message.arbitration_id, bytes(message.data)
            if can_id == second and not message.is_extended_id:
                raise InputError(
                    f"log {path} is of a run of two clutches, whose controllers hear each other; what can be replayed is a"
                    " log of one clutch"
                )
            if can_id not in by_id or message.is_extended_id:
                continue
            first, last = first or message.timestamp, message.timestamp
            if can_id in own:
                if can_id == valve.can_id and (index := ticks.get(valve.raw(data).sample_tick)) is not None:
                    self.answers.setdefault(index, data)
                continue
            if can_id == heartbeat.can_id:
                state = heartbeat.unpack(data)
                self.rate = self.rate or state.rate
                if state.lifecycle == Lifecycle.FINALIZED:
                    break
            inbox.append(Frame(can_id, data))
            if can_id == encoder.can_id:
                ticks[encoder.raw(data).sample_tick] = len(self.samples)
                self.samples.append(inbox)
                inbox = []
        if not self.samples or not self.rate:
            raise InputError(f"log {path} has no {'sample' if not self.samples else 'heartbeat'} of a plant")
        self.samples[0] = self.samples[0][-_FRAMES_BEFORE_START:]
        self.seconds = last - first


def _messages(path: Path) -> Iterator[can.Message]:
    """Yield the messages of a log. Raises InputError when it cannot be read."""
    try:
        with can.LogReader(path) as reader:
            yield from reader
    except FileNotFoundError:
        raise InputError(f"log {path} does not exist") from None
    except Exception as error:  # each reader has exception types of its own
        raise InputError(f"log {path} cannot be read: {' '.join(str(error).split())}") from None


def answer_log(log: Log, node: ControllerNode) -> Answers:
    """Run a log through a controller in this process; return its answers."""
    compared_ids = {load_frames()[name].can_id for name in _COMPARED_FRAMES}
    answers, began = Answers(), time.perf_counter()
    for index, inbox in enumerate(log.samples):
        sent = node.step(node.listen(inbox) if index == 0 else inbox)
        _add_answer(answers, log, index, [frame for frame in sent if frame.can_id in compared_ids])
    answers.seconds = time.perf_counter() - began
    return answers


def answer_log_on_bus(bus: str, log: Log, arguments: list[str]) -> Answers:
    """Run a log through a controller process on a bus, in lock-step; return its answers.

    `arguments` are options of `clutch-hil controller`. Raises InputError when the process ends or does not answer.
    """
    frames = load_frames()
    compared_ids, valve_id = {frames[name].can_id for name in _COMPARED_FRAMES}, frames["VALVE_COMMAND"].can_id
    heartbeat = frames["CONTROLLER_HEARTBEAT"]
    command = clutch_hil(
        "controller", "--bus", bus, "--lockstep", "--no-telemetry", "--rate", str(log.rate), *arguments
    )
    answers = Answers()
    with open_bus(bus) as port:
        process = spawn(command, subprocess.DEVNULL)
        try:
            _await_heartbeat(port, heartbeat.can_id, process)
            began = time.perf_counter()
            for index, inbox in enumerate(log.samples):
                for frame in inbox:
                    port.send(frame)
                answer: list[Frame] = []
                end = time.monotonic() + _ANSWER_TIMEOUT
                while not (answer and answer[-1].can_id == valve_id):
                    if process.poll() is not None or time.monotonic() > end:
                        raise InputError(f"the controller on {bus} has not answered sample {index}")
                    if port.wait(0.1):
                        answer += [frame for frame in port.receive() if frame.can_id in compared_ids]
                _add_answer(answers, log, index, answer)
            answers.seconds = time.perf_counter() - began
            plant = frames["PLANT_HEARTBEAT"]
            port.send(Frame(plant.can_id, plant.pack(_LAST_COUNTER, lifecycle=Lifecycle.FINALIZED, rate=log.rate)))
            process.wait(_ANSWER_TIMEOUT)
        finally:
            process.kill()
            process.wait()
    return answers


def _await_heartbeat(port: Port, heartbeat_id: int, process: Any) -> None:
    """Wait for the first heartbeat of a process. Raises InputError when it ends before, or takes too long."""
    end = time.monotonic() + _START_TIMEOUT
    while True:
        if port.wait(0.1) and any(frame.can_id == heartbeat_id for frame in port.receive()):
            return
        if process.poll() is not None or time.monotonic() > end:
            raise InputError(f"no controller came up on {port.name}")


def _add_answer(answers: Answers, log: Log, index: int, frames: list[Frame]) -> None:
    """Add the answer to sample `index`, and compare its valve command, the last frame, with the log."""
    answers.add(frames)
    if index in log.answers:
        answers.logged += 1
        answers.equal += frames[-1].data == log.answers[index]
