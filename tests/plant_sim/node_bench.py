"""Test bench of the plant's node: its interface, kernels, rigs, profile and bus line are made up, and note their calls.

The schedule is the real one, but for its rigs.
"""

from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

import plant_sim.node.schedule
from plant_sim.effects.table import list_active_effects
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.wet_clutch import STATE, Whole
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from tests.mutation.mutants import load_mutant, parse_plain

NOMINAL = wet_clutch.load_nominal()
RATE, PERIOD = 512, 1 / 512  # Hz, s: times are sums of halves
SUMP, LEVEL, LEAKAGE = "oil.sump_temperature", "friction_level.level", "internal_leakage.conductance"
BOTH = "effects friction_level and internal_leakage exclude each other"
_RECORD = np.dtype([("motor_torque_limit", "f8"), ("sump", "f8")])


class MadeUpTable:
    """Effects of a rig, of which friction_level and internal_leakage exclude each other; a state remembers where it was."""

    def __init__(self, names: tuple[str, ...]) -> None:
        if {"friction_level", "internal_leakage"} <= set(names):
            raise InputError(BOTH)
        self.names, self.values, self.kernel = names, np.zeros(1), ("kernel", *names)

    def carry_over(self, states: np.ndarray, before: "MadeUpTable") -> np.ndarray:
        return np.append(states, len(before.names))


class MadeUpRig:
    """A rig that has its torque limit and its sump temperature in its record; `rested` is how its state was made."""

    def __init__(self, parameters: ParameterSet, also: tuple[str, ...] = ()) -> None:
        self.parameters, self.phase_pressures, self.rested = parameters, ("preload", "contact"), list[Any]()
        values = parameters["motor.torque_limit"].value, parameters[SUMP].value
        self.record = np.array([values], _RECORD)
        self.table = MadeUpTable(tuple(dict.fromkeys((*list_active_effects(parameters), *also))))

    def make_rest_state(self, speed: float, kelvin: float) -> Whole:
        self.rested.append((speed, kelvin))
        return Whole(np.zeros(1, np.dtype(STATE.descr)), np.array([7.0]))


_schedule: Any = load_mutant(parse_plain(plant_sim.node.schedule))
_schedule.Rig = MadeUpRig


class MadeUpProfile:
    """A profile of two rows until `duration` [s], with another speed at each time."""

    def __init__(self, duration: float = 0.5) -> None:
        self.duration, self.table = duration, np.arange(10.0).reshape(5, 2)

    def interpolate(self, time: float) -> Any:
        return SimpleNamespace(speed=3.0 + time)


class MadeUpLine:
    """A line whose number of frames is known once it is refreshed."""

    def __init__(self, bench: "NodeBench") -> None:
        self.lines, self.inbox, self.count, self._bench = "lines", "inbox", -1, bench
        for name in ("count_settled", "finish_send", "discard_used"):
            setattr(self, name, bench.note(name))

    def refresh(self) -> None:
        self._bench.log.append(("refresh",))
        self.count = 12


class NodeBench:
    """A node of `module`, real or changed, whose kernels note their calls in `log`; `done` is what a compiled call returns."""

    def __init__(self, module: ModuleType, **arguments: Any) -> None:
        self.module, self.log, self.done = module, list[tuple[Any, ...]](), tuple[int, ...]()
        log, bench = self.log, self

        class Schedule(_schedule.Schedule):  # type: ignore[misc]
            def make_rig(self, time: float) -> Any:
                log.append(("make_rig", time))
                return super().make_rig(time)

        class Node(module.PlantNode):  # type: ignore[name-defined,misc]
            def _begin(self) -> int:
                self.tick += 1
                log.append(("begin",))
                return 2

            def _show(self, k: int, rig: Any, whole: Any, sent: int) -> int:
                assert whole is self._state
                log.append(("show", k, float(rig.record["sump"][0]), sent))
                return 4

            def _pass_samples(self, sent: int) -> int:
                log.append(("pass", sent))
                return 5

        module.Schedule, module.note_sample = Schedule, self._note_sample  # type: ignore[attr-defined]
        module.move = self._move  # type: ignore[attr-defined]
        for name in ("run_real_time", "run_lockstep"):
            setattr(module, name, self._make_kernel(name))
        self.node: Any = Node(**{"rate": RATE, "parameters": NOMINAL} | arguments)
        self.begun = list(log)
        log.clear()
        self.line: Any = MadeUpLine(bench)
        self.beat: Any = SimpleNamespace(memory=("clock", "ring"), most=8)

    def note(self, name: str) -> Any:
        return lambda *arguments: self.log.append((name, *arguments))

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]

    def show(self, samples: int = 1) -> None:
        """Make samples, one a period."""
        for _ in range(samples):
            assert self.node.show() == 5

    def _note_sample(self, row: Any, time: float, interfaces: Any, y: Any, *pressures: Any) -> None:
        node = self.node
        assert row.base is node.record
        assert row.shape == node.record.shape
        assert interfaces is node._interfaces
        assert y is node._state.y
        self.log.append(("note", time, *pressures))

    def _move(self, interfaces: Any, y: Any, states: Any, record: Any, kernel: Any, *step: Any) -> None:
        node = self.node
        assert interfaces is node._interfaces
        assert y is node._state.y
        assert record is node._rig.record
        assert kernel is node._rig.table.kernel
        self.log.append(("move", states.tolist(), *step))

    def _make_kernel(self, name: str) -> Any:
        def kernel(*arguments: Any) -> tuple[int, ...]:
            memory = next(one for one in arguments if one is self.node.memory)
            self.log.append((name, *("memory" if one is memory else one for one in arguments)))
            return self.done

        return kernel
