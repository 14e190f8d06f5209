"""Replay of a recorded bus log through the controller; the answers are equal to the bit on every computer.

Method          one cycle for each sample, with all frames since the sample before, as in lock-step. The pace of the log has no
                effect. Frames of the controller in the log are not given to the controller, but compared with its answers
Digest          SHA-256 of identifiers and payloads of VALVE_COMMAND, MOTOR_COMMAND and CONTROLLER_STATUS in the order of
                sending. Heartbeats are excluded, as they contain the session number
Version 1       its logs are converted, see `bench_log.py`. In this process set-points keep the smaller steps of version 1; a
                controller on a bus gets the steps of version 2
Assumptions     the answers are equal only if parameters and law are those of the controller in the log
"""

import hashlib
import subprocess
import time
from dataclasses import dataclass, field
from typing import Any

from protocols.buses.bus import Port, open_bus
from protocols.can.frames import Frame, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError
from protocols.realtime.child import end_child, list_command, spawn
from rt_controller.loop.bench_log import COMPARED_FRAMES, Log
from rt_controller.loop.node import ControllerNode

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


def answer_log(log: Log, node: ControllerNode) -> Answers:
    """Run a log through a controller in this process; return its answers."""
    compared_ids = {load_frames()[name].can_id for name in COMPARED_FRAMES}
    if log.setpoint:
        node.read_setpoints_by(log.setpoint)
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
    compared_ids, valve_id = {frames[name].can_id for name in COMPARED_FRAMES}, frames["VALVE_COMMAND"].can_id
    heartbeat = frames["CONTROLLER_HEARTBEAT"]
    command = list_command(
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
        finally:
            end_child(process, _ANSWER_TIMEOUT)  # it sends the safe commands first
    return answers


def _await_heartbeat(port: Port, heartbeat_id: int, process: Any) -> None:
    """Wait for the first heartbeat of a process. Raises InputError when it ends before, or takes too long."""
    end = time.monotonic() + _START_TIMEOUT
    while True:
        if port.wait(0.1) and any(frame.can_id == heartbeat_id for frame in port.receive()):
            return
        if process.poll() is not None or time.monotonic() > end:
            raise InputError(f"no controller started on {port.name}")


def _add_answer(answers: Answers, log: Log, index: int, frames: list[Frame]) -> None:
    """Add the answer to sample `index`, and compare its valve command, the last frame, with the log."""
    answers.add(frames)
    if index in log.answers:
        answers.logged += 1
        answers.equal += log.is_answer(index, frames[-1].data)
