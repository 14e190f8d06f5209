"""The data acquisition of a rig whose sensors show given values."""

from typing import Any

import numpy as np

from plant_sim.rigs import wet_clutch
from plant_sim.rigs.sensors import Counts, Sensors
from protocols.files.units import BAR, ZERO_CELSIUS

PERIOD = 1e-3  # s
QUIET = {"sensors.pressure_noise": 0.0, "sensors.temperature_noise": 0.0, "sensors.torque_noise": 0.0}
LSB = {"pressure": 4.8828125e-3, "temperature": 0.09765625, "motor_torque": 0.0244140625, "clutch_torque": 50 / 32768}


class Acquisition:
    """Noise, effects and converters of a rig with some parameters `changed`, by dotted name and each in its unit.

    Effects named in `also` are attached while they are off.
    """

    def __init__(self, changed: dict[str, float], seed: int = 1, also: tuple[str, ...] = ()) -> None:
        self._rig = wet_clutch.Rig(wet_clutch.load_nominal().with_values(changed), also)
        self._sensors = Sensors(seed)
        self._effects = self._rig.table.make_rest_states()

    def tune(self, changed: dict[str, float]) -> None:
        """Change parameters between two samples."""
        before, self._rig = self._rig, wet_clutch.Rig(self._rig.parameters.with_values(changed))
        self._effects = self._rig.table.carry_over(self._effects, before.table)

    def sample(self, bar: float = 0, degc: float = 0, motor: float = 0, clutch: float = 0, rad: float = 0) -> Counts:
        """Counts of a sample, a period after the one before."""
        y = np.zeros(1, wet_clutch.STATE)
        y["sensed_pressure"], y["sensed_temperature"] = bar * BAR, degc + ZERO_CELSIUS
        y["sensed_motor_torque"], y["sensed_clutch_torque"], y["angle"] = motor, clutch, rad
        counts, state = self._sensors.sample(self._rig, wet_clutch.Whole(y, self._effects), PERIOD)
        self._effects = state.effects
        return counts

    def read(self, **values: float) -> dict[str, float]:
        """Physical values of a sample, by the steps: bar, degC, Nm, Nm."""
        result: dict[str, Any] = self.sample(**values)._asdict()
        return {name: result[name] * LSB[name] for name in LSB}
