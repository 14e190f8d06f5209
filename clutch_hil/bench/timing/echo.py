"""Echo: measure the latency of the bus alone. Run as `python -m clutch_hil.bench.timing.echo JSON`.

A source sends the plant's frames. An echo answers each sample with a command. Neither computes anything. The role `raw` uses
the frames of this package. The role `python-can` uses message objects and cantools, as a simple implementation would.
"""

import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from subprocess import Popen
from typing import Any

import can
import cantools.database

from protocols.buses.bus import open_bus
from protocols.can.frames import COUNTER_MODULUS, DBC, Frame, load_frames
from protocols.realtime.child import spawn
from protocols.realtime.clock import Clock
from protocols.realtime.rights import prepare
from protocols.realtime.stopping import Stop

_STOP_CHECK_INTERVAL = 0.2  # s without a sample, after which an echo checks whether to end


@dataclass(frozen=True)
class Echo:
    """A process on `bus`; `role` is source, raw or python-can.

    It runs on the CPU `cpu` with the SCHED_FIFO priority `priority`. A source sends at `rate` [Hz] for `seconds` [s]. An echo
    creates the file `ready` when it starts to answer, and answers until SIGTERM.
    """

    role: str
    bus: str
    rate: int
    seconds: float
    cpu: int
    priority: int
    ready: str = ""

    def spawn(self) -> "Popen[bytes]":
        """Start the role in a separate process."""
        return spawn([sys.executable, "-P", "-m", "clutch_hil.bench.timing.echo", json.dumps(asdict(self))])

    def run(self) -> None:
        """Play the role in this process."""
        {"source": self._write_source, "raw": self._echo_raw, "python-can": self._echo_python_can}[self.role]()

    def _write_source(self) -> None:
        frames = load_frames()
        analog, encoder = frames["ANALOG_SENSORS"], frames["ENCODER"]
        clock = Clock(1_000_000_000 // self.rate)
        with open_bus(self.bus, []) as port:
            prepare(self.cpu, self.priority)
            clock.start(time.monotonic_ns() + clock.period_ns)
            for tick in range(round(self.seconds * self.rate)):
                clock.wait()
                port.send(Frame(analog.can_id, analog.pack_raw(tick, **dict.fromkeys(analog.signals, 100))))
                port.send(
                    Frame(
                        encoder.can_id,
                        encoder.pack_raw(tick, shaft_angle=tick % 2**17, sample_tick=encoder.wrap("sample_tick", tick)),
                    )
                )
                clock.end_cycle()

    def _echo_raw(self) -> None:
        frames = load_frames()
        analog, encoder, valve = (frames[name] for name in ("ANALOG_SENSORS", "ENCODER", "VALVE_COMMAND"))
        with Stop() as stop, open_bus(self.bus, [analog.can_id, encoder.can_id]) as port:
            prepare(self.cpu, self.priority)
            Path(self.ready).touch()
            while not stop.asked:
                if port.wait(_STOP_CHECK_INTERVAL):
                    for can_id, data in port.receive():
                        if can_id == analog.can_id:
                            analog.unpack(data)
                        elif can_id == encoder.can_id:
                            tick = encoder.raw(data).sample_tick
                            port.send(
                                Frame(
                                    valve.can_id, valve.pack(tick, valve_enable=1, valve_voltage=1.0, sample_tick=tick)
                                )
                            )

    def _echo_python_can(self) -> None:
        database: Any = cantools.database.load_file(DBC)
        analog, encoder, valve = (
            database.get_message_by_name(name) for name in ("ANALOG_SENSORS", "ENCODER", "VALVE_COMMAND")
        )
        local = self.bus.startswith("local:")
        channel, interface = (self.bus.removeprefix("local:"), "local") if local else (self.bus, "socketcan")
        filters = [{"can_id": m.frame_id, "can_mask": 0x7FF} for m in (analog, encoder)]
        with Stop() as stop, can.Bus(channel, interface=interface, can_filters=filters) as bus:
            prepare(self.cpu, self.priority)
            Path(self.ready).touch()
            while not stop.asked:
                message = bus.recv(_STOP_CHECK_INTERVAL)
                if message is None:
                    continue
                if message.arbitration_id == analog.frame_id:
                    analog.decode(bytes(message.data))
                elif message.arbitration_id == encoder.frame_id:
                    values: dict[str, Any] = encoder.decode(bytes(message.data))
                    tick = values["SAMPLE_TICK"]
                    signals = {
                        "COUNTER": tick % COUNTER_MODULUS,
                        "VALVE_ENABLE": 1,
                        "VALVE_VOLTAGE": 1.0,
                        "SAMPLE_TICK": tick,
                    }
                    data = valve.encode(dict.fromkeys((signal.name for signal in valve.signals), 0) | signals)
                    bus.send(can.Message(arbitration_id=valve.frame_id, data=data, is_extended_id=False))


if __name__ == "__main__":
    Echo(**json.loads(sys.argv[1])).run()
