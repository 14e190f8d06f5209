"""Catalogue: all bus faults and their parameters."""

from collections.abc import Mapping

from plant_sim.bus_faults import content, order, senders
from plant_sim.bus_faults.bus_fault import BusFault
from protocols.files.parameters import Parameter, ParameterSet

BUS_FAULTS: dict[str, type[BusFault]] = {
    fault.name: fault for fault in (*order.FAULTS, *content.FAULTS, *senders.FAULTS)
}
PARAMETERS = ParameterSet(
    {
        name: Parameter(name, p.off, p.unit, 0.0, p.bounds, p.source)
        for fault in BUS_FAULTS.values()
        for p in fault.parameters
        for name in (f"{fault.name}.{p.name}",)
    }
)  # at values with all faults off


def select_bus_faults(values: Mapping[str, float]) -> dict[str, float]:
    """Return those of `values`, by dotted name, that belong to a bus fault."""
    return {name: value for name, value in values.items() if name.partition(".")[0] in BUS_FAULTS}
