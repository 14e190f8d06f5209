"""Fault of the clock: the time of day jumps, as after a long time without a time server."""

import time
from collections.abc import Callable, Mapping

from clutch_hil.bench.faults.bench_fault import Surroundings
from clutch_hil.bench.faults.host_fault import SOURCE, HostFault, has_capability
from plant_sim.effects.effect import Shape
from protocols.errors import InputError

_SET_TIME = 25  # CAP_SYS_TIME of linux/capability.h
_DAY = 86400.0  # s


class ClockStep(HostFault):
    """The time of day of the whole computer jumps by so many s; at its end it is set back."""

    name = "clock_step"
    parameters = (Shape("step", "s", 3600.0, (-_DAY, _DAY), SOURCE),)

    @classmethod
    def check(cls, bus: str, telemetry: bool) -> None:
        """See `HostFault`."""
        if not has_capability(_SET_TIME):
            raise InputError(
                "clock_step sets the time of this computer, and this user has no permission; CAP_SYS_TIME is needed"
            )

    @classmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """See `HostFault`."""
        before, began = time.clock_gettime(time.CLOCK_REALTIME), time.monotonic()
        _set_time(before + values["step"])
        return lambda: _set_time(before + time.monotonic() - began)


def _set_time(seconds: float) -> None:
    try:
        time.clock_settime(time.CLOCK_REALTIME, seconds)
    except OSError as error:
        raise InputError(f"the time of this computer cannot be set: {error.strerror}") from None


FAULTS = (ClockStep,)
