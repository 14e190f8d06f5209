"""The experiments of chapter 4 on the virtual tribometer: each takes a rig and returns measured signals.

What            break-away, pre-sliding, friction lag, Stribeck curve, stick-slip, lift-up
Equation        torque, load and angle are those measured, through one zero-phase low-pass of 100 Hz: the bandwidth of the rig
                (sec. 3.11); velocity is the derivative of the filtered angle
Assumptions     every run starts from rest
Valid range     that of the rig
Not modelled    running-in, averaging over several runs
References      Janssens 2010, secs. 4.1, 4.2.2, 4.3
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.signal import butter, sosfiltfilt

from plant_sim.friction.model import check_element_values, check_real, require
from plant_sim.friction.whole_number import require_whole
from plant_sim.rigs.tribometer import Record, Tribometer
from plant_sim.rigs.tribometer_drive import Drive
from plant_sim.rigs.tribometer_sensors import RINGS
from protocols.errors import InputError

Array = np.ndarray
BANDWIDTH = 100.0  # Hz, sec. 3.11
DT = 1e-4  # s, integration step; chosen
KEPT_EVERY = 5  # steps between kept samples: 2 kHz, so that the sensors' noise is filtered and not aliased
SETTLING_ANGLE = 0.1  # rad before a steady state is read: a thousand times the travel before sliding
KICK_TIME = 0.05  # s of a velocity that is high enough to start sliding; chosen
READING_TIME = 0.5  # s over which a steady state is averaged; chosen
SLOWEST_SLIDING = 1e-6  # rad/s; chosen
BREAK_AWAY_RATIO = 1.6  # upper bound of break-away friction over that of slowest sliding, for the contacts here
HIGHEST_COEFFICIENT = 0.3  # -, above the 0.25 measured at 50 N (fig 4.14)
STICK_SPEED, BURST_SPEED = 0.1, 1.5  # of the driven speed: stick-slip falls below the one and exceeds the other


@dataclass(frozen=True)
class Motion:
    """Measured (n,): `time` [s], `angle` [rad], `velocity` [rad/s], `torque` [Nm], `load` [N], mean `gap` [m].

    `record`: the whole run, unfiltered, with quantities that no sensor measures.
    """

    time: Array
    angle: Array
    velocity: Array
    torque: Array
    load: Array
    gap: Array
    record: Record

    def cut(self, start: float, stop: float) -> "Motion":
        """Return the samples with start <= time < stop [s]; the record stays whole."""
        inside = (self.time >= start) & (self.time < stop)
        names = ("time", "angle", "velocity", "torque", "load", "gap")
        return replace(self, **{name: getattr(self, name)[inside] for name in names})


@dataclass(frozen=True)
class Steady:
    """Means in steady sliding at each `speed` [rad/s] (k,): `torque` [Nm] with its `spread` over a run, `load` [N]."""

    speed: Array
    torque: Array
    spread: Array
    load: Array

    def coefficient(self, radius: float) -> Array:
        """Return the friction coefficient [-] (k,) at the mean `radius` [m] (eq 4.3, one contact)."""
        return self.torque / (self.load * radius)  # 4.3


@dataclass(frozen=True)
class Coupling:
    """Coupling that pulls the motor in the stick-slip experiment: `stiffness` [Nm/rad] and `damping` [Nm s/rad].

    Raises InputError.
    """

    stiffness: float
    damping: float

    def __post_init__(self) -> None:
        require("stiffness of the coupling", self.stiffness, above=0.0, unit="Nm/rad")
        require("damping of the coupling", self.damping, least=0.0, unit="Nm s/rad")


def run_and_filter(rig: Tribometer, drive: Drive, load: float, seconds: float) -> Motion:
    """Run the rig for `seconds` [s] under `load` [N] and filter its measured signals. Raises InputError."""
    record = rig.run(drive, load, seconds, DT, every=KEPT_EVERY)
    rate = 1.0 / (KEPT_EVERY * DT)
    low_pass = butter(2, BANDWIDTH, fs=rate, output="sos")
    wanted = (record.angle_measured, record.torque_measured, record.normal_measured, record.gap.mean(axis=0))
    angle, torque, normal, gap = (sosfiltfilt(low_pass, values) for values in wanted)
    return Motion(record.time_s, angle, np.gradient(angle, record.time_s), torque, normal, gap, record)


def measure_break_away(rig: Tribometer, load: float, acceleration: float) -> tuple[float, Motion]:
    """Return the break-away torque [Nm], the highest on the way from rest to gross sliding, and the run (sec. 4.1.1).

    The velocity demanded rises at `acceleration` [rad/s^2], to well beyond break-away. Raises InputError.
    """
    require("acceleration", acceleration, above=0.0, unit="rad/s^2")
    # rad/s, of the demand at break-away: the motor is held back by friction over the gain of the velocity loop
    held = BREAK_AWAY_RATIO * _expect_torque(rig, SLOWEST_SLIDING, load) / rig.parameters["motor.velocity_gain"].si
    seconds = (held + (2.0 * SETTLING_ANGLE * acceleration) ** 0.5) / acceleration
    motion = run_and_filter(rig, rig.make_velocity_drive(lambda time: acceleration * time), load, seconds)
    return float(motion.torque.max()), motion


def saw_tooth(corners: Sequence[float] | Array, speed: float, time: Array) -> Array:
    """Return the position command [rad] at `time` [s] (n,), from one of `corners` [rad] to the next at `speed` [rad/s]."""
    return np.interp(time, corner_times(corners, speed), corners)


def corner_times(corners: Sequence[float] | Array, speed: float) -> Array:
    """Return the times [s] at which a saw-tooth of `speed` [rad/s] reaches each of its `corners` [rad], same shape."""
    return np.append(0.0, np.cumsum(np.abs(np.diff(corners)))) / speed


def play_pre_sliding(rig: Tribometer, load: float, corners: Sequence[float] | Array, speed: float) -> Motion:
    """Play a saw-tooth under proportional position control (sec. 4.1.2); arguments as `saw_tooth`.

    Raises InputError.
    """
    corners = check_real("corners [rad]", corners)
    require("speed", speed, above=0.0, unit="rad/s")
    seconds = float(corner_times(corners, speed)[-1])
    return run_and_filter(rig, rig.make_position_drive(lambda time: saw_tooth(corners, speed, time)), load, seconds)


def play_reciprocation(rig: Tribometer, load: float, amplitude: float, frequency: float, periods: int) -> Motion:
    """Return a sine of position of `amplitude` [rad] at `frequency` [Hz]: `periods` after the first (secs. 4.1.3, 4.3).

    Raises InputError.
    """
    require_whole("number of periods", periods)
    require("amplitude", amplitude, unit="rad")
    require("frequency", frequency, above=0.0, most=BANDWIDTH, unit="Hz")
    drive = rig.make_position_drive(lambda time: amplitude * np.sin(2.0 * pi * frequency * time))
    motion = run_and_filter(rig, drive, load, (periods + 1.25) / frequency)
    return motion.cut(1.0 / frequency, (periods + 1.0) / frequency)


def play_oscillation(
    rig: Tribometer, load: float, offset: float, swing: float, frequency: float, periods: int
) -> Motion:
    """Return a sine of velocity of `swing` around `offset` [rad/s] at `frequency` [Hz]: `periods` after the first three.

    Sec. 4.1.3. Raises InputError when the velocity would not stay above 0.
    """
    require_whole("number of periods", periods)
    require("frequency", frequency, above=0.0, most=BANDWIDTH, unit="Hz")
    if not 0.0 < swing < offset:
        raise InputError(f"swing is {swing:g} rad/s about {offset:g} rad/s; allowed is above 0 to below the offset")
    # rad/s, mean demand: the proportional loop falls behind by friction over its gain, as in `measure_stribeck`
    mean = offset + _expect_torque(rig, offset, load) / rig.parameters["motor.velocity_gain"].si
    drive = rig.make_velocity_drive(lambda time: mean - swing * np.cos(2.0 * pi * frequency * time))
    return run_and_filter(rig, drive, load, (periods + 3.5) / frequency).cut(
        3.0 / frequency, (periods + 3.0) / frequency
    )


def measure_branches(motion: Motion, speeds: Array) -> tuple[Array, Array]:
    """Return the mean torque [Nm] (k,) accelerating, and decelerating, between neighbours of `speeds` (k + 1,) above 0 [rad/s].

    The acceleration is the sign of the change of the velocity through a period, read from the filtered angle.
    """
    gains = np.gradient(motion.velocity, motion.time) > 0.0
    bins = np.digitize(motion.velocity, speeds)
    means = [
        [motion.torque[(bins == k) & (gains == gaining)].mean() for k in range(1, speeds.size)]
        for gaining in (True, False)
    ]
    return np.array(means[0]), np.array(means[1])


def measure_stribeck(rig: Tribometer, load: float, speeds: Sequence[float] | Array) -> Steady:
    """Return the steady friction at each of `speeds` [rad/s], each run from rest under velocity control (sec. 4.1.4).

    Raises InputError.
    """
    most = RINGS * rig.parameters["sensors.normal_range"].si
    require("load, which the normal dynamometers must read,", load, above=0.0, most=most, unit="N")
    rows = []
    gain = rig.parameters["motor.velocity_gain"].si
    for speed in check_element_values("speed [rad/s]", speeds):
        settle = KICK_TIME + min(SETTLING_ANGLE / speed, 1.0)
        droop = _expect_torque(rig, speed, load) / gain  # rad/s, of the proportional loop: set off by hand
        kick = 2.0 * _expect_torque(rig, SLOWEST_SLIDING, load) / gain  # rad/s, to begin to slide
        command = np.full(round((settle + READING_TIME) / DT) + 1, speed + droop)
        command[: round(KICK_TIME / DT)] += kick
        drive = rig.make_velocity_drive(command)
        motion = run_and_filter(rig, drive, load, settle + READING_TIME).cut(settle, settle + READING_TIME)
        rows.append((motion.velocity.mean(), motion.torque.mean(), motion.torque.std(), motion.load.mean()))
    return Steady(*np.array(rows).T)


def _expect_torque(rig: Tribometer, speed: float, load: float) -> float:
    """Return the expected steady friction torque [Nm] at `speed` [rad/s]."""
    return float(rig.friction.steady_state(speed * rig.radius, load)) * rig.radius


def play_stick_slip(rig: Tribometer, load: float, speed: float, coupling: Coupling, seconds: float) -> Motion:
    """Drive the motor at `speed` [rad/s] through a soft `coupling` (sec. 4.1.5). Raises InputError."""
    require("speed", speed, above=0.0, unit="rad/s")
    drive = rig.make_spring_drive(lambda time: speed * time, coupling.stiffness, coupling.damping)
    return run_and_filter(rig, drive, load, seconds)


def has_stick_slip(motion: Motion, speed: float) -> bool:
    """Return whether in the last half of `motion` the slip falls below a tenth of `speed` and exceeds 1.5 times it.

    `speed`: driven speed [rad/s].
    """
    slip = motion.record.slip_velocity_rad_s[motion.record.time_s > 0.5 * motion.record.time_s[-1]]
    return bool(slip.min() < STICK_SPEED * speed and slip.max() > BURST_SPEED * speed)


def map_stick_slip(
    rig_at: Callable[[float], Tribometer],
    loads: Sequence[float] | Array,
    speeds: Sequence[float] | Array,
    coupling: Coupling,
) -> Array:
    """Return whether there is stick-slip at each of `loads` [N] and `speeds` [rad/s]: bool (loads, speeds).

    `rig_at` gives the rig of a load, such as `Contacts().make_dry_rig`. Raises InputError.
    """
    pairs = [[_has_stick_slip(rig_at(load), load, speed, coupling) for speed in speeds] for load in loads]
    return np.array(pairs, bool)


def _has_stick_slip(rig: Tribometer, load: float, speed: float, coupling: Coupling) -> bool:
    """Return whether there is stick-slip, after a time in which any contact slips three times."""
    wind_up = HIGHEST_COEFFICIENT * load * rig.radius / (coupling.stiffness * speed)  # s
    return has_stick_slip(play_stick_slip(rig, load, speed, coupling, max(4.0, 3.0 * wind_up)), speed)


def find_critical_speed(
    rig: Tribometer, load: float, coupling: Coupling, bounds: tuple[float, float], steps: int
) -> float:
    """Return the speed [rad/s] above which stick-slip ceases, by `steps` halvings of the logarithm of `bounds` [rad/s].

    Raises InputError unless there is stick-slip at the lower bound and none at the upper. Where the Stribeck curve is flat at
    rest (eq 1.4) there is none far below either: stick-slip is a band of speeds.
    """
    require_whole("number of halvings", steps, least=0)

    def sticks_at(speed: float) -> bool:
        return _has_stick_slip(rig, load, speed, coupling)

    low, high = bounds
    if not sticks_at(low) or sticks_at(high):
        raise InputError(f"stick-slip does not end between {low:g} and {high:g} rad/s under {load:g} N")
    for _ in range(steps):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if sticks_at(middle) else (low, middle)
    return (low * high) ** 0.5
