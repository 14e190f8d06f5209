"""The rotational tribometer of chapter 3 with any friction model between its disks.

What            motor, shaft, upper disk, friction contact, lower disk on ring dynamometers; shaker and weights load it
Equation        torsion and normal direction: `tribometer_structure`; motor: `tribometer_drive`
                torque of the contact M = r F(r (theta_2 - theta_1), N), F the friction law, r the mean radius of the disks
                normal contact N = N_1 ((d + tau d')/d_1)^n, 0 when negative; d the approach with runout and lift-up in it
                lift-up h' = rate (height (1 - exp(-|omega|/speed)) - h), omega the slip velocity
Integration     the structures exactly (matrix exponential), drive gains within; both contact forces held over a step at the
                value they have at its end, found by root finding from the unchanged state of the contact. Nothing grows and
                stick does not chatter: to a stiffness k of the contact the method adds a damper k dt/2, no more. First order in
                dt (tests/plant_sim/test_tribometer.py); runout, lift-up and saturation of the drive act one step late.
Assumptions     one friction force at the mean radius; the load acts at the shaft end; lift-up by speed alone, whatever the load
Valid range     up to 100 Hz, the usable band of the real one: responses within 4, 2, 1, 0.4 % at dt of 2e-4, 1e-4, 5e-5, 2e-5 s
                with the contact in stick. Resonances above keep their place, but the damper k dt/2 rules their height: at
                460 Hz the response is off by half even at 2e-5 s
Not modelled    tilting modes, friction that depends on the place on the disk, inertia of the weights
References      Janssens 2010, chapters 3 and 4

The friction model works in metres and newtons at the mean radius (0.075 m): a torque of 1 Nm is a force of 13.3 N.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from plant_sim.friction.model import FrictionModel, require, require_type
from plant_sim.friction.whole_number import require_whole
from plant_sim.rigs.tribometer_drive import Drive, Signal, sample_signal
from plant_sim.rigs.tribometer_integration import COLUMN_COUNT, advance
from plant_sim.rigs.tribometer_sensors import RINGS, Sensors
from plant_sim.rigs.tribometer_structure import Chain
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet, load_defaults

Array = np.ndarray
DEFAULTS = Path(__file__).parents[1] / "parameters" / "tribometer.toml"
STEP_LIMIT = 2e-4  # s: five steps in a period at 1 kHz, above all modes with the contact at its stiffest


class State(NamedTuple):
    """State of the rig at the end of a run."""

    tangential: Array  # (7,) angles [rad], velocities [rad/s] of table, disk, motor; friction [N]
    normal: Array  # (9,) displacements [m], velocities [m/s] of table, disk, shaft, downwards; runout, lift-up [m]; load [N]
    friction: Array  # (m,) state of the friction model
    preload: float  # N, at which the normal displacements are 0


@dataclass(frozen=True)
class Record:
    """Result of a run, (n,) arrays; those named `measured` have the noise and resolution of the sensors."""

    time_s: Array
    angle_rad: Array  # of the motor
    angle_measured: Array  # rad, encoder
    velocity_rad_s: Array  # of the motor
    slip_angle_rad: Array  # upper against lower disk
    slip_velocity_rad_s: Array
    friction_torque: Array  # Nm, of the contact on the lower disk
    torque_measured: Array  # Nm, dynamometers
    normal_load: Array  # N, in the contact
    normal_measured: Array  # N, dynamometers
    gap: Array  # m, (3, n): the three capacitive sensors; falls as the disks are pressed together
    motor_torque: Array  # Nm
    end: State  # to begin the next run with


class Tribometer:
    """The rig with `friction` between its disks.

    friction: a friction model in m and N at the mean radius. parameters: `load_nominal()`, or as changed by a user.
    sensors: whether the measured quantities have noise and finite resolution; else they are those of ideal sensors at the
    dynamometers, gaps and encoder. seed: of the noise.
    Raises InputError for an object that is not a friction model and for impossible parameters.
    """

    def __init__(
        self, friction: FrictionModel, parameters: ParameterSet | None = None, sensors: bool = True, seed: int = 0
    ) -> None:
        require_type("friction between the disks", friction, FrictionModel)
        self.friction = friction
        self.parameters = p = load_nominal() if parameters is None else parameters
        self.tangential, self.normal = make_chains(p)
        self.radius = mean_radius(p)  # m
        self._sensors = Sensors(p, seed) if sensors else None

    def make_torque_drive(self, torque: Signal, stiffness: float = 0.0) -> Drive:
        """Return a drive with the motor torque [Nm], plus a weak position loop of `stiffness` [Nm/rad] about angle 0.

        Sec. 3.10.
        """
        return Drive(torque=torque, stiffness=stiffness)

    def make_velocity_drive(self, velocity: Signal) -> Drive:
        """Return a proportional velocity control to `velocity` [rad/s], at most 2.4 rev/s."""
        return Drive(velocity=velocity, damping=self.parameters["motor.velocity_gain"].si)

    def make_position_drive(self, angle: Signal) -> Drive:
        """Return a proportional position control to `angle` [rad] around proportional velocity control."""
        gain = self.parameters["motor.velocity_gain"].si
        return Drive(angle=angle, stiffness=gain * self.parameters["motor.position_gain"].si, damping=gain)

    def make_spring_drive(self, angle: Signal, stiffness: float, damping: float = 0.0) -> Drive:
        """Return a motor pulled by a spring of `stiffness` [Nm/rad] whose far end is at `angle` [rad]; damper to the frame."""
        return Drive(angle=angle, stiffness=stiffness, damping=damping)

    def contact_stiffness(self, load: Array | float) -> Array:
        """Return the normal stiffness k_kf of the contact [N/m] at `load` [N], same shape."""
        p = self.parameters.list_si("normal")
        n = p["contact_exponent"]
        load = np.asarray(load, float)
        return n * p["contact_load"] / p["contact_approach"] * (load / p["contact_load"]) ** (1.0 - 1.0 / n)

    def approach(self, load: Array | float) -> Array:
        """Return the static approach of the disks [m] under `load` [N], same shape (fig 4.12)."""
        p = self.parameters.list_si("normal")
        ratio = np.asarray(load, float) / p["contact_load"]
        return p["contact_approach"] * ratio ** (1.0 / p["contact_exponent"])

    def run(
        self, drive: Drive, load: Signal, seconds: float, dt: float, every: int = 1, start: State | None = None
    ) -> Record:
        """Simulate `seconds` [s] in steps of `dt` [s], keeping every `every`-th sample and the first.

        load: normal load with the own weight (58 N) in it [N]; what varies of it is the shaker's, at most 35.7 N from its mean.
        start: the `end` of a former run; else at rest at angle 0, the contact in equilibrium with the first load.
        Signals are constants, functions of time, or have a value for each of the round(seconds/dt) + 1 samples.
        Raises InputError.
        """
        require_type("drive", drive, Drive)
        require("time step", dt, above=0.0, most=STEP_LIMIT, unit="s")
        require("duration", seconds, least=dt, most=1e6, unit="s")
        every = require_whole("samples between two kept ones", every)
        steps = round(seconds / dt)
        time = dt * np.arange(steps + 1)
        self._check_speed(sample_signal("drive velocity", drive.velocity, time))
        loads = self._check_load(sample_signal("load", load, time))
        begin = self._find_rest_state(float(loads[0])) if start is None else start
        require_type("start of the run", begin, State)
        if begin.friction.shape != self.friction.rest().shape:
            raise InputError(
                f"the start has {begin.friction.size} friction states; this model has {self.friction.rest().size}"
            )
        p, lift = self.parameters.list_si("normal"), self.parameters.list_si("lift")
        contact = np.array([
            begin.preload, float(self.approach(begin.preload)), p["contact_load"], p["contact_approach"],
            p["contact_exponent"], p["contact_time"], 0.5 * self.parameters["disks.runout"].si,
            lift["height"], lift["speed"], lift["rate"], self.radius,
        ])  # fmt: skip
        motor = np.array([drive.stiffness, drive.damping, self.parameters["motor.torque_limit"].si])
        gains = ((drive.stiffness, drive.damping), (0.0, 0.0))  # within the torque limit, and at it
        torsion = np.array([self.tangential.discretise(dt, *pair).T for pair in gains])
        normal = np.array([self.normal.discretise(dt).T])
        q, x, friction = (np.array(part, float) for part in begin[:3])
        kept = np.empty((steps // every + 1, COLUMN_COUNT))
        advance(
            self.friction.law, self.friction.parameters, friction, torsion, q, normal, x,
            motor, drive.compute_command(time), contact, loads, dt, every, kept,
        )  # fmt: skip
        return self._record(time[::every], kept, begin.preload, State(q, x, friction, begin.preload))

    def _find_rest_state(self, load: float) -> State:
        return State(np.zeros(7), np.array([*np.zeros(8), load]), self.friction.rest(load), load)

    def _record(self, time: Array, kept: Array, preload: float, end: State) -> Record:
        table, disk, motor, _, velocity, slip_velocity, sunk, lower, force, load, torque = kept.T.copy()
        slip = disk - table
        measured_torque = self.tangential.table_stiffness * table  # from the strain of the rings
        measured_load = preload + self.normal.table_stiffness * sunk
        gap = np.tile(sunk - lower - self.approach(preload), (RINGS, 1))
        angle = motor
        if self._sensors:
            gap = self._sensors.read_gap(gap[0], slip)
            measured_torque, measured_load = (
                self._sensors.read_torque(measured_torque),
                self._sensors.load(measured_load),
            )
            angle = self._sensors.read_encoder(motor)
        return Record(
            time_s=time, angle_rad=motor, angle_measured=angle, velocity_rad_s=velocity, slip_angle_rad=slip,
            slip_velocity_rad_s=slip_velocity, friction_torque=self.radius * force, torque_measured=measured_torque,
            normal_load=load, normal_measured=measured_load, gap=gap, motor_torque=torque, end=end,
        )  # fmt: skip

    def _check_load(self, load: Array) -> Array:
        most = self.parameters["load.most"].si
        swing = self.parameters["shaker.gain"].si * self.parameters["shaker.peak_current"].si
        if not (load.min() > 0.0 and load.max() <= most):
            raise InputError(f"load runs from {load.min():g} to {load.max():g} N; allowed is above 0 to {most:g} N")
        if (varied := float(np.abs(load - load.mean()).max())) > swing:
            raise InputError(f"load varies by {varied:g} N about its mean; the shaker gives at most {swing:g} N")
        return load

    def _check_speed(self, velocity: Array) -> None:
        limit = self.parameters["motor.speed_limit"].si
        if (most := float(np.abs(velocity).max())) > limit:
            raise InputError(f"drive velocity reaches {most:g} rad/s; the motor turns at most {limit:.4g} rad/s")


def load_nominal() -> ParameterSet:
    """Return the parameters of `parameters/tribometer.toml`."""
    return load_defaults(DEFAULTS)


def mean_radius(parameters: ParameterSet) -> float:
    """Return the mean radius of the disks [m]. Raises InputError."""
    inner, outer = parameters["disks.inner_diameter"].si, parameters["disks.outer_diameter"].si
    if not inner < outer:
        raise InputError(f"disks.inner_diameter is {inner:g} m; it must be below disks.outer_diameter, {outer:g} m")
    return 0.25 * (inner + outer)


def make_chains(parameters: ParameterSet) -> tuple[Chain, Chain]:
    """Return the structure in torsion and in the normal direction. Raises InputError."""
    t, n = parameters.list_si("tangential"), parameters.list_si("normal")
    springs = ("table_stiffness", "table_damping", "coupling_stiffness", "coupling_damping")
    torsion = Chain(
        (t["table_inertia"], t["disk_inertia"], parameters["motor.inertia"].si), *(t[name] for name in springs)
    )
    return torsion, Chain((n["table_mass"], n["disk_mass"], n["shaft_mass"]), *(n[name] for name in springs))
