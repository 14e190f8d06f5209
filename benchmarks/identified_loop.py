"""Closed loop of identified rigs: how well a controller with an identified calibration follows the torque of Table 6.6.

The rig is the plant of clutch-hil with the true parameters. `python -m benchmarks.identification --closed-loop` plays every rig
that it identifies.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import clutch_hil as ch
from clutch_hil.bench.judgement.calibration_check import describe_mismatch
from clutch_hil.identify.controller_values import derive_controller_values
from plant_sim.rigs import wet_clutch
from rt_controller.loop.parameter_sets import load_controller_parameters

WORSE = 1.2  # allowed regime error over that of a controller that knows the rig: issue 31
NO_FAULT = "none"


@dataclass(frozen=True)
class Followed:
    """Result of a controller: its `fault`, a word; regime error [Nm], NaN if 90 % of the demand was never reached.

    warned: whether the result of the run warns that the calibration is of another clutch.
    """

    fault: str
    error: float
    warned: bool

    @property
    def text(self) -> str:
        """Result in words."""
        return self.fault if self.fault != NO_FAULT else f"{self.error:.3g} Nm{', warned' if self.warned else ''}"


@dataclass(frozen=True)
class Loop:
    """Table 6.6 followed by three controllers.

    One knows the rig, one has the identified and one the shipped calibration.
    """

    known: Followed
    identified: Followed
    shipped: Followed

    @property
    def ratio(self) -> float:
        """Regime error with the identified calibration over that of a controller that knows the rig; infinite on a fault."""
        return self.identified.error / self.known.error if self.identified.fault == NO_FAULT else float("inf")

    @property
    def is_told(self) -> bool:
        """Whether a shipped calibration that follows worse than allowed ends in a fault or a warning."""
        one = self.shipped
        return one.fault != NO_FAULT or one.warned or one.error <= WORSE * self.known.error

    def __str__(self) -> str:
        return f"known {self.known.text}, identified {self.identified.text}, shipped {self.shipped.text}"


def follow_torque(true: Mapping[str, float], calibration: Path) -> Loop:
    """Play Table 6.6 on a rig of these `true` values with three controllers, none of which adapts."""
    declared = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    plant = {name: value for name, value in true.items() if name.partition(".")[0] != "sensors"}
    known = {
        name: value
        for name, (value, _) in derive_controller_values(true, declared, load_controller_parameters()).items()
    }

    def follow(**controller: object) -> Followed:
        run = ch.simulate(profile="table-6.6", plant=plant, adaptation=False, **controller)  # type: ignore[arg-type]
        measures = ch.measure_run(run)
        warned = describe_mismatch(run.columns, run.metadata["controller_parameters"]) is not None
        return Followed(str(measures["fault"]), float(measures["regime_error_nm"]), warned)

    return Loop(follow(controller=known), follow(controller_parameters=calibration), follow())
