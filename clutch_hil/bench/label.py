"""Label: what the result of a run shows of its scenario. The label of a blind run hides the scenario."""

from collections.abc import Mapping
from dataclasses import dataclass

from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.sealed import select_public_settings


@dataclass(frozen=True)
class Label:
    """name: of the result. what: the input, as text. changes: parameter files, as text. properties: all of it, for XML."""

    name: str
    what: str
    changes: str
    properties: Mapping[str, str]

    @classmethod
    def of(cls, scenario: Scenario, blind: bool = False) -> "Label":
        """Return the label of a scenario. A blind one has no name, title or file, and only the settings in a blind run."""
        settings = scenario.settings.as_text()
        if blind:
            return cls("blind", "a scenario, blind", "", {"rig": scenario.rig.name} | select_public_settings(settings))
        what = f"scenario {scenario.path}" if scenario.path else f"profile {scenario.name}"
        properties = {"title": scenario.title, "rig": scenario.rig.name, "file": str(scenario.path or "-")}
        return cls(scenario.name, what, scenario.settings.describe_changes(), properties | settings)

    def read(self, seconds: float) -> str:
        """Return what was read, with its length `seconds` [s], as text."""
        return f"{self.what} ({seconds:g} s){self.changes}"
