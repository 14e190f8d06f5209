"""Label: what the result of a run says of the scenario it comes from, and of a blind one does not say."""

from collections.abc import Mapping
from dataclasses import dataclass

from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.sealed import public_settings


@dataclass(frozen=True)
class Label:
    """`name` of a result, `what` was read with the files that `changes` it, for people; `properties` for machines."""

    name: str
    what: str
    changes: str
    properties: Mapping[str, str]

    @classmethod
    def of(cls, scenario: Scenario, blind: bool = False) -> "Label":
        """The label of a scenario; a blind one has neither name, title nor file, and of its settings what a blind run has."""
        settings = scenario.settings.as_text()
        if blind:
            return cls("blind", "a scenario, blind", "", {"rig": scenario.rig.name} | public_settings(settings))
        what = f"scenario {scenario.path}" if scenario.path else f"profile {scenario.name}"
        properties = {"title": scenario.title, "rig": scenario.rig.name, "file": str(scenario.path or "-")}
        return cls(scenario.name, what, scenario.settings.changes(), properties | settings)

    def read(self, seconds: float) -> str:
        """What was read, a profile of `seconds` [s], for people."""
        return f"{self.what} ({seconds:g} s){self.changes}"
