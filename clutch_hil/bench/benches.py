"""Benches: the one that runs a scenario live, by the scenario's rig."""

from collections.abc import Sequence
from typing import Protocol

from clutch_hil.bench.label import Label
from clutch_hil.bench.result import Result
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.shift import ShiftBench
from clutch_hil.bench.up import Bench
from protocols.errors import InputError


class Live(Protocol):
    """A scenario that is ready to be run live, whatever its rig, and what its result says of it."""

    @property
    def label(self) -> Label: ...

    def run(self, quiet: bool = False) -> Result:
        """Run to the end of the profile or Ctrl-C."""


def bench(
    scenario: Scenario,
    bus: str,
    lockstep: bool,
    telemetry: bool,
    router: str | None,
    viewer: Sequence[str] | None,
    blind: bool,
    pace: Sequence[str] = (),
) -> Live:
    """The bench of a scenario's rig; arguments as of `Bench`. Raises InputError."""
    if lockstep and pace:
        raise InputError(f"{pace[0]} was given and --lockstep, which has no clock; allowed is one of them")
    if scenario.rig == "wet_clutch":
        return Bench(scenario, bus, lockstep, telemetry, router, viewer, blind, pace)
    if blind:
        raise InputError(f"scenario {scenario.name} of the rig {scenario.rig} cannot be blind; allowed is wet_clutch")
    return ShiftBench(scenario, bus, lockstep, telemetry, router, viewer, pace=pace)
