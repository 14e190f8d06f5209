"""Test bench of the controller's service: clock, bus, node, outlet and what else it uses are made up, and note their calls."""

from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

NEVER = 10_000  # steps after which a test has gone wrong: a loop does not end


class ServiceBench:
    """A service of `module`, real or changed, whose parts note in `log` what is asked of them. settings: of the service.

    `stops`: after so many looks at it a stop is asked for.
    """

    def __init__(self, module: ModuleType, stops: int = NEVER, rate: int = 500, **settings: Any) -> None:
        self.module, self.log, self.stops, self.looks = module, list[tuple[Any, ...]](), stops, 0
        self.node: Any = SimpleNamespace(
            record="record", late_cycles=-1, heartbeat_period=0.05, make_heartbeat=lambda state: ("heartbeat", state)
        )
        self.port: Any = SimpleNamespace(name="local:resolved", refused=0, down=0, send=self.note("sent"))
        self.outlet: Any = SimpleNamespace(
            changes=7, has_change=lambda: False, write=self.note("write"), tune=self.note("tune")
        )
        self.notifier: Any = SimpleNamespace(
            say=self.note("say"), extend_start=self.note("extend"), stop=self.note("stopping")
        )
        module.time = SimpleNamespace(monotonic=lambda: 50.0, sleep=self.note("sleep"))  # type: ignore[attr-defined]
        self.service = module.ControllerService("local:made-up", rate, **settings)

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
            self.log.append((name, *arguments, *([named] if named else [])))
            assert len(self.log) < NEVER
            return (left.pop(0) if len(left) > 1 else left[0]) if left else None

        return call

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]
