"""Base class of the models of many asperities: a limit of the displacement of one sample, and sums over the asperities."""

from abc import abstractmethod
from typing import Any

import numpy as np
from numba import types

from plant_sim.friction import kernel
from plant_sim.friction.model import Array, FrictionModel, Trace, check_motion, check_real, require

_V, _SUMS = kernel.VECTOR, types.Array(types.float64, 2, "C")
# law, parameters, state, position, dt, load, sums
OBSERVE_SIGNATURE = types.void(kernel.LAW, _V, _V, _V, types.float64, _V, _SUMS)


class AsperityModel(FrictionModel):
    """A friction model of asperities that limits the displacement of one sample and gives sums over its state."""

    @property
    @abstractmethod
    def longest(self) -> float:
        """The longest displacement of one sample."""

    def step(self, state: Array, displacement: float, dt: float, load: float = 1.0) -> tuple[float, Array]:
        """Return the force and new state after `displacement`, at most `longest`, in `dt` under `load`. Raises InputError."""
        require("displacement", displacement, least=-self.longest, most=self.longest)
        return super().step(state, displacement, dt, load)

    def trace(self, position: Array, dt: float, load: Array | float = 1.0, state: Array | None = None) -> Trace:
        """Return the force and state at every sample of `position` (n,), at most `longest` apart; see `FrictionModel.trace`.

        Raises InputError.
        """
        self._refuse_jumps(check_real("position", position))
        return super().trace(position, dt, load, state)

    def play(
        self, observe: Any, position: Array, dt: float, load: Array | float, state: Array | None
    ) -> tuple[Array, Array]:
        """Return the sums over the asperities by the jitted `observe` (OBSERVE_SIGNATURE), (5, n), and the last state.

        The other arguments, and the force of the first sample, as in `trace`. Raises InputError.
        """
        position, loads = check_motion(position, load)
        require("time step", dt, above=0.0, unit="s")
        self._refuse_jumps(position)
        last, sums = self.start(state, float(loads[0])), np.empty((5, position.size))
        first_force = self.law(self.parameters, last, 0.0, float(dt), loads[0], np.empty_like(last))
        observe(self.law, self.parameters, last, position, float(dt), loads, sums)
        if state is not None:
            sums[0, 0] = first_force
        return sums, last

    def _refuse_jumps(self, position: Array) -> None:
        with np.errstate(over="ignore"):
            travel = float(np.abs(np.diff(np.ravel(position))).max(initial=0.0))
        require("longest displacement of one sample", travel, most=self.longest)
