"""Test bench of a controller as a node: its cycle is made up, and notes its calls. For tests with a module as argument."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from protocols.can.frame_batch import unload
from protocols.can.frames import Frame
from protocols.files.parameters import load_defaults
from rt_controller.loop import parameter_sets

_load_once = cache(load_defaults)  # a node reads two files, which do not change


class Call(NamedTuple):
    """A call of the made-up cycle, or of the reception before it: its arguments, the batch as frames."""

    name: str
    states: np.ndarray
    settings: np.ndarray
    frames: list[Frame]
    more: tuple[Any, ...]  # slots, outbox


class NodeBench:
    """The controller node of a `module`, real or changed, which is made with the other arguments.

    calls: those at its beginning, and from then on. result: what a cycle returns; refusal: what is returned before the first.
    """

    def __init__(self, module: ModuleType, *arguments: Any, **named: Any) -> None:
        self.calls, self.result, self.refusal = list[Call](), 0, 0
        for name, made_up in {"run_cycle": self._run_cycle, "receive_before_start": self._receive}.items():
            setattr(module, name, made_up)
        with patch.object(parameter_sets, "load_defaults", _load_once):
            self.node: Any = module.ControllerNode(*arguments, **named)
        self.beginning, self.calls = self.calls, []
        self.state, self.settings = (one.view(np.recarray)[0] for one in (self.node.states, self.node.settings))

    def _run_cycle(self, states: Any, settings: Any, inbox: Any, count: int, *more: Any) -> int:
        self.calls.append(Call("run_cycle", states, settings, unload(inbox[:count]), more))
        return self.result

    def _receive(self, states: Any, settings: Any, inbox: Any, count: int) -> int:
        self.calls.append(Call("receive_before_start", states, settings, unload(inbox[:count]), ()))
        return self.refusal


@contextmanager
def written(text: str) -> Iterator[Path]:
    """A parameter file with a text, for as long as the context lasts."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "written.toml"
        path.write_text(text)
        yield path
