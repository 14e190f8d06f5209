"""Test bench of the plant's interface: a rig, compiled steps and a bus that are made up, and note their calls."""

from collections.abc import Sequence
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from plant_sim.rigs import wet_clutch
from protocols.can.frame_batch import load, unload
from protocols.can.frames import Frame
from protocols.files.parameters import ParameterSet

NOMINAL = wet_clutch.load_nominal()
RATE, PERIOD = 512, 1 / 512  # Hz, s: times are sums of halves
NO_TABLES = np.zeros((0, 5, 0))


class MadeUpBus:
    """A bus that is clear or not; each frame that it passes on comes with another last byte, and once more."""

    def __init__(self, log: list[tuple[Any, ...]], clear: bool) -> None:
        self.log, self.clear, self.copies = log, clear, 2
        self.begun: list[Any] = [SimpleNamespace(to_dict=lambda rate: {"begun at": rate})]

    def is_clear(self, time: float) -> bool:
        self.log.append(("is_clear", time))
        return self.clear

    def begin(self, time: float) -> list[Any]:
        self.log.append(("begin", time))
        return self.begun

    def check(self, injections: Sequence[Any], now: float) -> None:
        self.log.append(("check", list(injections), now))

    def pass_commands(self, tick: int, frames: list[Frame]) -> list[Frame]:
        return self._pass_on("commands", tick, frames)

    def pass_samples(self, tick: int, frames: list[Frame]) -> list[Frame]:
        return self._pass_on("samples", tick, frames)

    def _pass_on(self, direction: str, tick: int, frames: list[Frame]) -> list[Frame]:
        self.log.append((direction, tick, frames))
        return [Frame(can_id, data[:-1] + b"\xff") for can_id, data in frames * self.copies]


class InterfaceBench:
    """An interface of a `module`, real or changed; its compiled steps note in `log` what they are given.

    `taken`: the frames of each call of `take`, of which `why` is the result. `node` has a rig whose sample is `shown`.
    """

    def __init__(
        self, module: ModuleType, clutches: int = 1, rate: int = RATE, parameters: ParameterSet = NOMINAL,
        setpoints: np.ndarray = NO_TABLES, columns: Sequence[str] = (), session: int = 9,
    ) -> None:  # fmt: skip
        self.module, self.log = module, list[tuple[Any, ...]]()
        self.taken, self.why, self.shown = list[list[Frame]](), 0, [Frame(0x101, b"sample")]
        bench = self

        class Board(module.Interface):  # type: ignore[name-defined,misc]
            def show(self) -> int:
                bench.log.append(("show",))
                return load(self.outbox, bench.shown)

            def advance(self) -> None:
                bench.log.append(("advance",))

        Board.columns = columns
        seeds = [5, 6, 7][:clutches]
        self.node: Any = Board(rate, [parameters, *[NOMINAL] * (clutches - 1)], seeds, session, setpoints)
        self.settings = self.node._settings.view(np.recarray)[0]
        self.state = self.node._interfaces.view(np.recarray)[0]
        for name in ("take", "begin", "show", "skip_periods"):
            setattr(module, name, getattr(self, f"_{name}"))

    def disturb(self, clear: bool = False) -> MadeUpBus:
        """Put the interface on a made-up bus."""
        self.node.bus = bus = MadeUpBus(self.log, clear)
        return bus

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]

    def _check_memory(self, interfaces: np.ndarray, settings: np.ndarray) -> None:
        assert interfaces is self.node._interfaces
        assert settings is self.node._settings

    def _take(self, interfaces: np.ndarray, settings: np.ndarray, inbox: np.ndarray, count: int) -> int:
        self._check_memory(interfaces, settings)
        self.taken.append(unload(inbox[:count]))
        return self.why

    def _skip_periods(self, interfaces: np.ndarray, settings: np.ndarray, periods: int) -> None:
        self._check_memory(interfaces, settings)
        self.log.append(("skip_periods", periods))

    def _begin(self, interfaces: np.ndarray, settings: np.ndarray, *more: Any) -> int:
        self._check_memory(interfaces, settings)
        self.log.append(("begin", *more))
        return 3

    def _show(self, interfaces: np.ndarray, settings: np.ndarray, *more: Any) -> int:
        self._check_memory(interfaces, settings)
        self.log.append(("show", *more))
        return 5
