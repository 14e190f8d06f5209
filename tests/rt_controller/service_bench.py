"""Test bench of the controller's service: clock, bus, node, outlet and what else it uses are made up, and note their calls."""

from types import ModuleType, SimpleNamespace
from typing import Any

from tests.call_log import NEVER, CallLog


class ServiceBench(CallLog):
    """A service of `module`, real or changed, whose parts note in `log` what is asked of them. settings: of the service.

    `stops`: after so many looks at it a stop is asked for.
    """

    def __init__(self, module: ModuleType, stops: int = NEVER, rate: int = 500, **settings: Any) -> None:
        super().__init__(stops)
        self.module = module
        self.node: Any = SimpleNamespace(
            record="record", late_cycles=-1, heartbeat_period=0.05, make_heartbeat=lambda state: ("heartbeat", state)
        )
        self.port: Any = SimpleNamespace(name="local:resolved", refused=0, down=0, send=self.note("sent"))
        self.outlet: Any = SimpleNamespace(
            changes=7, has_change=lambda: False, write=self.note("write"), tune=self.note("tune"), backlog=0
        )
        self.notifier: Any = SimpleNamespace(
            say=self.note("say"), extend_start=self.note("extend"), stop=self.note("stopping")
        )
        module.time = SimpleNamespace(monotonic=lambda: 50.0, sleep=self.note("sleep"))  # type: ignore[attr-defined]
        self.service = module.ControllerService("local:made-up", rate, **settings)
