"""The position axis of section 5.9: a table on a slide with any friction model, moved by a DC motor under PID control.

What            motor force moves a mass against friction; an encoder and a PID controller; a feedforward of the desired motion
Equation        M x'' = F_m - F(x, N),  F the friction law under the normal load N
                F_m = PID(r - y) + F_ff + w, within the limit; y the position in steps of the encoder, w noise of the
                current loop; PID, backward differences, acts one control period after its sample: the time of computation
Integration     `friction.coupled`: backward Euler for the mass, friction at the end of the step, steps of at most 50 us; the
                motor force is held over a control period. First order in the step (tests/plant_sim/test_position_axis.py)
Assumptions     stiff drive, current loop infinitely fast; load held over a control period
Valid range     stick resonances up to 500 Hz
Not modelled    backlash and compliance of the spindle, cogging, friction that depends on the place
References      Janssens 2010, sec. 5.9, fig 5.10
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, pi
from pathlib import Path

import numpy as np
from numba import njit, types
from numba.core.types import float64, int64

from plant_sim.friction.coupled import balance
from plant_sim.friction.kernel import LAW, VECTOR
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.model import Array, FrictionModel, check_real, require, require_type
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet, load_defaults

DEFAULTS = Path(__file__).parents[1] / "parameters" / "position_axis.toml"
STEP_LIMIT = 5e-5  # s: forty steps in a period of the stick resonance at 500 Hz
ELEMENTS = 10  # of the axis's true friction: the larger number of the thesis (sec. 5.5)
LEAST_SAMPLES = 2  # of a run: a velocity needs two
COLUMNS = 4  # of a run: position, velocity, motor force, friction

# Of the PID controller, as multiples of the crossover frequency w: usual loop shaping for a mass, the most phase at w
DERIVATIVE_FACTOR = 3.0  # derivative time times w
INTEGRAL_FACTOR = 10.0  # integral time times w
ROLL_OFF_FACTOR = 10.0  # corner of the derivative's filter over w

Trajectory = Callable[[Array], Array]  # time [s] (n,) -> desired position [m] (n,); smooth


@dataclass(frozen=True)
class Run:
    """One run of the axis, (n,) arrays, one sample a control period; the motor force is that of the period after the sample.

    Measured, as a real axis records them: `time_s`, `position` [m], `velocity` [m/s] (central difference of `position`),
    `motor_force` [N], `normal_load` [N]. Desired: `reference` [m]. True: `true_position` [m],
    `true_velocity` [m/s], `friction` [N].
    """

    time_s: Array
    position: Array
    velocity: Array
    motor_force: Array
    normal_load: Array
    reference: Array
    true_position: Array
    true_velocity: Array
    friction: Array

    @property
    def error(self) -> Array:
        """Reference minus true position [m] (n,)."""
        return self.reference - self.true_position


@njit(inline="always")
def quantise(position, resolution):
    """Return the position [m] in whole steps of an encoder of `resolution` [m]."""
    return np.floor(position / resolution + 0.5) * resolution


_ADVANCE_SIGNATURE = types.void(
    LAW, VECTOR, VECTOR, float64, types.UniTuple(float64, 4), float64, float64,
    VECTOR, VECTOR, VECTOR, VECTOR, float64, int64, types.Array(types.float64, 2, "C"),
)  # fmt: skip


@njit(_ADVANCE_SIGNATURE, cache=True)
def advance(
    law, parameters, friction, mass, gains, limit, resolution, reference, extra, noise, load, period, substeps, kept
):
    """Run the axis from rest at 0 over the samples of `reference` [m] (n,); `friction` is the state and is overwritten.

    gains: proportional [N/m], integral [N/(m s)], derivative [Ns/m], its filter's time [s]; extra: feedforward [N] (n,);
    noise [N] (n,); load [N] (n,); kept: (n, COLUMNS).
    """
    proportional, integral, derivative, filter_time = gains
    dt = period / substeps
    inertia = mass / dt**2
    new_friction = np.empty_like(friction)
    position = velocity = force = 0.0
    summed = rate = last = waiting = 0.0  # N, N, m, N: of the controller
    for k in range(reference.size):
        kept[k, 0], kept[k, 1], kept[k, 3] = position, velocity, force
        error = reference[k] - quantise(position, resolution)
        rate = (filter_time * rate + derivative * (error - last)) / (filter_time + period)
        last = error
        asked = waiting + extra[k]
        motor = min(max(asked, -limit), limit)
        waiting = proportional * error + summed + rate  # computed during this period, acts in the next
        if motor == asked:  # hold the integral while the motor is at its limit
            summed += integral * period * error
        motor += noise[k]
        kept[k, 2] = motor
        for _ in range(substeps):
            drive = mass * velocity / dt + motor
            step, force = balance(law, parameters, friction, inertia, drive, dt, load[k], new_friction)
            friction[:] = new_friction
            position += step
            velocity = step / dt


class PositionAxis:
    """The axis with `friction` in its slide; without one, the friction of its parameters.

    parameters: `load_nominal()`, or as changed by a user. Raises InputError.
    """

    def __init__(self, friction: FrictionModel | None = None, parameters: ParameterSet | None = None) -> None:
        self.parameters = p = load_nominal() if parameters is None else parameters
        self.friction = load_nominal_friction(p) if friction is None else friction
        require_type("friction of the axis", self.friction, FrictionModel)
        self.mass = p["table.mass"].si
        self.load = p["table.load"].si  # N, of a run that names none
        self.period = 1.0 / p["controller.rate"].si  # s
        self._substeps = ceil(self.period / STEP_LIMIT - 1e-9)

    @property
    def gains(self) -> tuple[float, float, float, float]:
        """Proportional [N/m], integral [N/(m s)], derivative [Ns/m] gain and its filter's time [s]."""
        w = 2.0 * pi * self.parameters["controller.bandwidth"].si
        unit = abs(1.0 + 1.0 / (INTEGRAL_FACTOR * 1j) + DERIVATIVE_FACTOR * 1j / (1.0 + 1j / ROLL_OFF_FACTOR))
        proportional = self.mass * w**2 / unit  # the loop with the mass alone has gain 1 at w
        return (
            proportional,
            proportional * w / INTEGRAL_FACTOR,
            proportional * DERIVATIVE_FACTOR / w,
            1.0 / (ROLL_OFF_FACTOR * w),
        )

    def simulate(
        self,
        trajectory: Trajectory,
        seconds: float,
        feedforward: Array | float = 0.0,
        load: Array | float | None = None,
        seed: int = 0,
    ) -> Run:
        """Follow `trajectory`, which begins at 0, for `seconds` [s] under PID control, from rest.

        feedforward: force [N] added in each control period (`position_feedforward`), load [N]: both scalar or (n,);
        seed: of the noise. Raises InputError.
        """
        time = self.times(seconds)
        return self._run(time, trajectory(time), self.gains, feedforward, load, np.random.default_rng(seed))

    def respond(self, motor_force: Array, load: Array | float | None = None, seed: int | None = None) -> Run:
        """Return the motion under `motor_force` [N] (n,), one value a control period, without control, from rest.

        load [N]: scalar or (n,); seed: of the sensor noise, None for ideal sensors. Raises InputError.
        """
        force = check_real("motor force [N]", motor_force)
        if force.ndim != 1 or force.size < LEAST_SAMPLES:
            raise InputError(
                f"motor force has shape {force.shape}; one value for each of {LEAST_SAMPLES} periods or more is needed"
            )
        time = self.period * np.arange(force.size)
        random = None if seed is None else np.random.default_rng(seed)
        return self._run(
            time, np.zeros(force.size), (0.0, 0.0, 0.0, self.period), force, load, random, current_loop=0.0
        )

    def times(self, seconds: float) -> Array:
        """Return the time [s] of the control periods of a run of `seconds` [s]. Raises InputError."""
        require("length of the run", seconds, least=self.period, most=1e5, unit="s")
        return self.period * np.arange(round(seconds / self.period) + 1)

    def _run(
        self,
        time: Array,
        reference: Array,
        gains: tuple[float, float, float, float],
        feedforward: Array | float,
        load: Array | float | None,
        random: np.random.Generator | None,
        current_loop: float = 1.0,
    ) -> Run:
        p, n = self.parameters, time.size
        reference = _count_samples("reference position [m]", reference, n)
        extra = _count_samples("feedforward force [N]", feedforward, n)
        loads = _count_samples("normal load [N]", self.load if load is None else load, n)
        require("least normal load", float(loads.min()), least=0.0, unit="N")
        require("start of the reference", abs(float(reference[0])), most=p["sensors.resolution"].si, unit="m")
        w, u, v = np.zeros((3, n)) if random is None else random.standard_normal((3, n))
        kept, state = np.empty((n, COLUMNS)), self.friction.rest(float(loads[0]))
        advance(
            self.friction.law, self.friction.parameters, state, self.mass, gains, p["motor.force_limit"].si,
            p["sensors.resolution"].si, reference, extra, current_loop * p["motor.force_noise"].si * w, loads, self.period,
            self._substeps, kept,
        )  # fmt: skip
        position = quantise(kept[:, 0], p["sensors.resolution"].si) if random is not None else kept[:, 0].copy()
        return Run(
            time,
            position,
            np.gradient(position, self.period),
            kept[:, 2] + p["sensors.force_noise"].si * u,
            loads + p["sensors.load_noise"].si * v,
            reference,
            *kept[:, [0, 1, 3]].T,
        )


def load_nominal() -> ParameterSet:
    """Return the parameters of `position_axis.toml`."""
    return load_defaults(DEFAULTS)


def load_nominal_friction(parameters: ParameterSet) -> XGMS:
    """Return XGMS of the group `friction`: elements that slip in geometric progression, weighted alike. Raises InputError."""
    p = parameters.list_si("friction")
    if not p["first_break"] < p["last_break"]:
        raise InputError(f"friction.first_break is {p['first_break']:g} m; it must be below friction.last_break")
    law = LoadLaw(p["coefficient"], 1.0 / p["fall"], p["load_scale"])
    limits = np.full(ELEMENTS, float(law(parameters["table.load"].si)) / ELEMENTS)
    return XGMS(
        friction=law,
        stiffness=limits / np.geomspace(p["first_break"], p["last_break"], ELEMENTS),
        weights=limits / limits.sum(),
        beta=p["beta"],
        stribeck_velocity=p["stribeck_velocity"],
        viscous=p["viscous"],
        attraction=p["attraction"],
    )


def _count_samples(name: str, values: Array | float, n: int) -> Array:
    values = check_real(name, values)
    if values.shape not in ((), (n,)):
        raise InputError(f"{name} has shape {values.shape}; one finite number or one for each of {n} samples is needed")
    return np.full(n, values)
