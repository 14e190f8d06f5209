"""Catalogue: all host faults, their parameters, and a planned host fault."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from clutch_hil.bench.faults import clock, disk, interface, peers
from clutch_hil.bench.faults.bench_fault import BenchFault, Surroundings
from clutch_hil.bench.faults.host_fault import HostFault
from protocols.errors import InputError, suggest_closest
from protocols.files.parameters import Parameter, ParameterSet
from protocols.files.units import space_unit

HOST_FAULTS: dict[str, type[HostFault]] = {
    fault.name: fault for fault in (*disk.FAULTS, *clock.FAULTS, *interface.FAULTS, *peers.FAULTS)
}


@dataclass(frozen=True)
class PlannedHostFault(BenchFault):
    """The host fault `name` with `values` of its parameters, typical ones where none is given. Raises InputError."""

    kind = "host_fault"
    name: str
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.name not in HOST_FAULTS:
            raise InputError(f"host_fault is {self.name!r}; {suggest_closest(self.name, HOST_FAULTS)}")
        known = ParameterSet(
            {
                f"{self.name}.{p.name}": Parameter(f"{self.name}.{p.name}", p.typical, p.unit, 0.0, p.bounds, p.source)
                for p in HOST_FAULTS[self.name].parameters
            }
        )
        short = [p.name for p in HOST_FAULTS[self.name].parameters]
        for name in self.values:
            if name not in short:
                allowed = suggest_closest(name, short) if short else "it has none"
                raise InputError(f"host fault {self.name} has no parameter {name!r}; {allowed}")
        checked = known.with_values({f"{self.name}.{name}": value for name, value in self.values.items()})
        whole = {name.partition(".")[2]: value for name, value in checked.as_values().items()}
        object.__setattr__(self, "values", whole)

    @property
    def what(self) -> str:
        """See `BenchFault`."""
        units = {p.name: p.unit for p in HOST_FAULTS[self.name].parameters}
        words = [f"{name} {value:g}{space_unit(units[name])}" for name, value in self.values.items()]
        return f"{self.name}{' ' if words else ''}{', '.join(words)}"

    def check(self, bus: str, telemetry: bool) -> None:
        """See `BenchFault`."""
        HOST_FAULTS[self.name].check(bus, telemetry)

    def begin(self, around: Surroundings) -> Callable[[], None]:
        """See `BenchFault`."""
        return HOST_FAULTS[self.name].begin(around, self.values)
