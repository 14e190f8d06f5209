"""Faults of the disk that the run is recorded on."""

from collections.abc import Callable, Mapping

from clutch_hil.bench.faults.bench_fault import Surroundings
from clutch_hil.bench.faults.host_fault import SOURCE, HostFault
from plant_sim.effects.effect import Shape
from protocols.files.disk import Disk, be_full, have_no_fault, make_slow

_MS = 1e-3  # s


class DiskFull(HostFault):
    """Nothing more can be written into the run; the run ends there, and `clutch-hil recover` has its samples."""

    name = "disk_full"
    parameters = ()

    @classmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """See `HostFault`."""
        return _put(around.disk, be_full)


class DiskSlow(HostFault):
    """Each write into the run takes so many ms longer."""

    name = "disk_slow"
    parameters = (Shape("delay", "ms", 500.0, (1.0, 10_000.0), SOURCE),)

    @classmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """See `HostFault`."""
        return _put(around.disk, make_slow(_MS * values["delay"]))


def _put(disk: Disk, fault: Callable[[], None]) -> Callable[[], None]:
    """Apply a fault to a disk; return a function that removes it if it is still active."""
    disk.before_write = fault

    def take_out() -> None:
        if disk.before_write is fault:
            disk.before_write = have_no_fault

    return take_out


FAULTS = DiskFull, DiskSlow
