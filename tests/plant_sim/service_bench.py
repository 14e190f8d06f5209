"""Test bench of the plant's service: clock, bus, node, outlet and what else it uses are made up, and note their calls."""

from types import ModuleType, SimpleNamespace
from typing import Any

from protocols.can.lifecycle import Lifecycle
from tests.call_log import NEVER, CallLog


class ServiceBench(CallLog):
    """A service `module`, real or changed, whose parts note in `log` what is asked of them.

    `stops`: after so many looks at it a stop is asked for. `now` [s] is the time; a frame that is waited for costs 1/8 s.
    """

    def __init__(self, module: ModuleType, stops: int = NEVER, rate: int = 500, **settings: Any) -> None:
        super().__init__(stops)
        self.module, self.now = module, 50.0
        self.node = self._make_node()
        self.line: Any = SimpleNamespace(inbox="inbox", count=0, port=SimpleNamespace(name="local:made-up"))
        for name in ("receive", "send", "clear"):
            setattr(self.line, name, self.note(name))
        self.clock: Any = SimpleNamespace(
            period_ns=2_000_000, woken_ns=3_000_000_000, lateness_ns=4_000, work_ns=5_000, late=6, start=self.note("start"),
            wait=self.note("wait", 0), summarise=lambda: f"summary {len(self.log)}",
        )  # fmt: skip
        self.beat = SimpleNamespace(record_cycle=self.note("record"), clock=self.clock)
        self.outlet: Any = SimpleNamespace(changes=7, has_change=lambda: False, backlog=0)
        for name in ("write", "tune"):
            setattr(self.outlet, name, self.note(name))
        module.time = SimpleNamespace(  # type: ignore[attr-defined]
            monotonic=lambda: self.now, monotonic_ns=lambda: round(self.now * 1e9), sleep=self.note("sleep")
        )
        self.rig = SimpleNamespace(
            name="rig", node=self.node, controllers=("a", "b"), load_parameters=lambda: "nominal"
        )
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

    def run_real_time(self) -> Any:
        return self.service._run_in_real_time(self.node, self.line, self.outlet, self.beat, self)

    def run_lockstep(self) -> None:
        self.service._run_in_lockstep(self.node, self.line, self.outlet, self.beat, self)
