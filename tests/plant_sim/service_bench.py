"""Test bench of the plant's service: clock, bus, node, outlet and what else it uses are made up, and note their calls."""

from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

from protocols.can.lifecycle import Lifecycle

NEVER = 10_000  # steps after which a test has gone wrong: a loop does not end


class ServiceBench:
    """A service `module`, real or changed, whose parts note in `log` what is asked of them.

    `stops`: after so many looks at it a stop is asked for. `now` [s] is the time; a frame that is waited for costs 1/8 s.
    """

    def __init__(self, module: ModuleType, stops: int = NEVER, rate: int = 500, **settings: Any) -> None:
        self.module, self.log, self.stops = module, list[tuple[Any, ...]](), stops
        self.now, self.looks = 50.0, 0
        self.node = self._make_node()
        self.line: Any = SimpleNamespace(inbox="inbox", count=0, port=SimpleNamespace(name="local:made-up"))
        for name in ("receive", "send", "clear"):
            setattr(self.line, name, self.note(name))
        self.clock: Any = SimpleNamespace(
            period_ns=2_000_000, woken_ns=3_000_000_000, lateness_ns=4_000, work_ns=5_000, late=6, start=self.note("start"),
            wait=self.note("wait", 0), summarise=lambda: f"summary {len(self.log)}",
        )  # fmt: skip
        self.beat = SimpleNamespace(record_cycle=self.note("record"), clock=self.clock)
        self.outlet: Any = SimpleNamespace(changes=7, has_change=lambda: False)
        for name in ("write", "tune"):
            setattr(self.outlet, name, self.note(name))
        module.time = SimpleNamespace(  # type: ignore[attr-defined]
            monotonic=lambda: self.now, monotonic_ns=lambda: round(self.now * 1e9)
        )
        self.rig = SimpleNamespace(name="rig", node=self.node, controllers=("a", "b"), nominal=lambda _: "nominal")
        self.service = module.PlantService("local:made-up", rate, self.rig, **settings)

    def _make_node(self) -> Any:
        node: Any = SimpleNamespace(
            steady=True, finished=False, tick=4, record="record", outbox="outbox", controller=Lifecycle.ACTIVE,
            answered_tick=4, late_cycles=-1, heartbeat_period=0.05, columns=("column",), first_rejected="rejected",
            count_receptions=lambda: "receptions", count_strays=lambda: "strays",
        )  # fmt: skip
        for name in ("take", "advance", "skip_periods", "receive", "inject"):
            setattr(node, name, self.note(f"node.{name}"))
        node.show = self.note("show", 3)
        node.run_real_time = self.note("run_real_time", 0)
        node.run_lockstep = self.note("run_lockstep", True)
        node.make_heartbeat = lambda lifecycle: ("heartbeat", lifecycle)
        node.list_safe_frames = lambda: ["safe", "last"]
        return node

    @property
    def asked(self) -> bool:
        """Of the service's stop."""
        self.looks += 1
        assert self.looks < NEVER
        return self.looks > self.stops

    def note(self, name: str, *results: Any) -> Callable[..., Any]:
        """A function that notes its calls; it returns the results in turn, and the last one from then on."""
        left = list(results)

        def call(*arguments: Any, **named: Any) -> Any:
            self.log.append((name, *arguments, *named.values()))
            assert len(self.log) < NEVER
            return (left.pop(0) if len(left) > 1 else left[0]) if left else None

        return call

    def run_real_time(self) -> Any:
        return self.service._run_in_real_time(self.node, self.line, self.outlet, self.beat, self)

    def run_lockstep(self) -> None:
        self.service._run_in_lockstep(self.node, self.line, self.outlet, self.beat, self)

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]
