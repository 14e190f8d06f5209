"""`clutch-hil demand`: a supervisor that demands torque, pressure, lock or a profile, and reports whether it was reached."""

import time
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from clutch_hil.bench.terminal import takes_text
from clutch_hil.live.driving.demand_defaults import PRESSURE_RAMP, TORQUE_RAMP
from clutch_hil.live.driving.demand_log import DemandLog
from clutch_hil.live.driving.supervisor import RATE, Answer, Supervisor
from plant_sim.profiles.profile import (
    FILL_PRESSURE,
    IDLE_FIRST,
    LATEST_TIME,
    PRESSURE_LIMIT,
    SPEED_LIMIT,
    TORQUE_LIMIT,
    Profile,
    Setpoint,
)
from protocols.buses.bus import open_bus
from protocols.can.request import Request
from protocols.errors import InputError
from protocols.realtime.stopping import Stop

_LEAST_RAMP = 1e-3  # Nm/s or bar/s: reaches the highest torque in 8 hours
_SETTLING_TIME = 0.5  # s of constant demand after which the torque counts as settled: the loop rises in 0.25 s
_TOLERANCE = 0.10  # regime error divided by torque demand
_TOLERANCE_FLOOR = 0.3  # Nm: three times the regime error of the default controller
_PRESSURE_TOLERANCE = 0.03  # bar: three times the noise and the resolution of the signal, 5 mbar each
_DRAW_PERIOD = 0.1  # s, on a terminal: as often as the controller's status comes
_LINE_PERIOD = 2.0  # s between lines where the output is no terminal


def make_torque_profile(
    torque: float, speed: float, seconds: float | None, ramp: float = TORQUE_RAMP, begin: float = 0.0
) -> Profile:
    """Return the profile of a torque [Nm] reached from `begin` [Nm] with `ramp` [Nm/s] and held, at a motor speed [rad/s].

    seconds: its length, None for unlimited. Raises InputError.
    """
    _check("torque", torque, TORQUE_LIMIT, "Nm", speed, ramp)
    rise = max(abs(torque - begin) / ramp, 1.0 / RATE)
    times = 0.0, IDLE_FIRST, IDLE_FIRST + rise, LATEST_TIME
    profile = Profile(f"{torque:g} Nm", times, (begin, begin, torque, torque), (speed,) * 4)
    return profile if seconds is None else profile.repeat_to(seconds)


def make_pressure_profile(
    pressure: float, speed: float, seconds: float | None, ramp: float = PRESSURE_RAMP, begin: float = 0.0
) -> Profile:
    """Return the profile of a pressure [bar] reached with `ramp` [bar/s] and held, at a motor speed [rad/s].

    seconds: its length, None for unlimited. The pressure rises from `begin` [bar]; from the pressure of the filled clutch if
    `begin` is 0. Raises InputError.
    """
    _check("pressure", pressure, PRESSURE_LIMIT, "bar", speed, ramp)
    first, least = begin or min(pressure, FILL_PRESSURE), 1.0 / RATE
    filled = IDLE_FIRST + least
    time = (0.0, IDLE_FIRST, filled, filled + max(abs(pressure - first) / ramp, least), LATEST_TIME)
    profile = Profile(f"{pressure:g} bar", time, (0.0,) * 5, (speed,) * 5, (begin, begin, first, pressure, pressure))
    return profile if seconds is None else profile.repeat_to(seconds)


def lock_profile(speed: float, seconds: float | None) -> Profile:
    """Return the profile of a locked clutch, at a motor speed [rad/s], for `seconds`, None for unlimited. Raises InputError."""
    _check_speed(speed)
    profile = Profile("lock", (0.0, LATEST_TIME), (0.0, 0.0), (speed, speed), lock=(1.0, 1.0))
    return profile if seconds is None else profile.repeat_to(seconds)


def _check(name: str, value: float, limit: float, unit: str, speed: float, ramp: float) -> None:
    if not (isfinite(value) and 0.0 <= value <= limit):
        raise InputError(f"{name} {value:g} {unit} is outside 0..{limit:g} {unit}")
    _check_speed(speed)
    if not (isfinite(ramp) and ramp >= _LEAST_RAMP):
        raise InputError(f"ramp {ramp:g} {unit}/s is not possible; it must be {_LEAST_RAMP:g} or more")


def _check_speed(speed: float) -> None:
    if not (isfinite(speed) and abs(speed) <= SPEED_LIMIT):
        raise InputError(f"speed {speed:g} rad/s is outside {-SPEED_LIMIT:g}..{SPEED_LIMIT:g} rad/s")


@dataclass
class Regime:
    """Regime error: mean absolute error of the controlled quantity while its demand is constant, in `unit`.

    The tolerance is `share` of the mean demand, but at least `floor`.
    """

    unit: str = "Nm"
    share: float = _TOLERANCE
    floor: float = _TOLERANCE_FLOOR
    steady_for: float = 0.0  # s
    samples: int = 0
    error_sum: float = 0.0
    demand_sum: float = 0.0
    _demand: float = field(default=0.0, repr=False)

    def add(self, demand: float, answer: float) -> None:
        """Add a sample; call it at RATE."""
        self.steady_for = self.steady_for + 1.0 / RATE if demand == self._demand else 0.0
        self._demand = demand
        if demand > 0.0 and self.steady_for > _SETTLING_TIME:
            self.samples += 1
            self.error_sum += abs(answer - demand)
            self.demand_sum += demand

    @property
    def error(self) -> float:
        """Return the regime error; NaN when the demand was never constant for long enough."""
        return self.error_sum / self.samples if self.samples else float("nan")

    @property
    def demand(self) -> float:
        """Return the mean demand in the regime; NaN when it was never constant for long enough."""
        return self.demand_sum / self.samples if self.samples else float("nan")

    @property
    def is_reached(self) -> bool:
        """Return whether the regime error is within its tolerance."""
        return self.error <= max(self.share * self.demand, self.floor)


@dataclass
class Lock:
    """Whether the clutch locked on demand, after what time [s], and whether it was still locked at the last demand."""

    asked_for: float = 0.0  # s
    locked_after: float | None = None  # s, since lock was first demanded
    locked: bool = False

    def add(self, asked: bool, clutch: str | None) -> None:
        """Add a sample; call it at RATE. asked: whether lock is demanded. clutch: state of the clutch."""
        if not asked:
            return
        self.asked_for += 1.0 / RATE
        self.locked = clutch == "locked"
        if self.locked and self.locked_after is None:
            self.locked_after = self.asked_for

    def __str__(self) -> str:
        """Return the result in words."""
        if self.locked_after is None:
            return f"not locked within {self.asked_for:.2f} s"
        return f"locked after {self.locked_after:.2f} s{'' if self.locked else ', later unlocked'}"


class Demand:
    """Demand a profile on a bus. Raises InputError when there is another supervisor or no controller.

    network: for the log of the demand (demand_log.py), which the bus does not carry.
    """

    def __init__(self, bus: str, profile: Profile, network: str | None = None) -> None:
        self._bus, self._profile, self._network = bus, profile, network
        self._lock = Lock()
        self._regimes = {
            Request.ENGAGE: Regime(),
            Request.PRESSURE: Regime("bar", share=0.0, floor=_PRESSURE_TOLERANCE),
        }

    def run(self, quiet: bool) -> tuple[dict[str, Any], str, str, bool]:
        """Demand idle, follow the profile to its end or to Ctrl-C, and release; return document, text, verdict, good."""
        profile = self._profile
        with (
            Stop() as stop,
            open_bus(self._bus) as port,
            DemandLog(port.name, self._network) as log,
            Supervisor(port) as supervisor,
            _StatusLine(profile.duration, quiet) as line,
        ):
            log.send(profile.name)
            supervisor.demand_idle(profile.interpolate(0.0).speed)
            began = time.monotonic()
            setpoint, elapsed, objection = profile.interpolate(0.0), 0.0, None
            while not (stop.asked or objection) and elapsed < profile.duration:
                setpoint = profile.interpolate(elapsed)
                supervisor.ask(*setpoint)
                objection = supervisor.explain_objection()
                answer = supervisor.received.answer()
                self._judge(setpoint, answer)
                line.show(elapsed, setpoint, answer)
                elapsed = time.monotonic() - began
            answer = supervisor.received.answer()
            released = supervisor.release(setpoint.speed)
            return self._describe_outcome(
                port.name, elapsed, answer, objection, released, stop.asked, log.describe_outcome()
            )

    def _judge(self, setpoint: Setpoint, answer: Answer) -> None:
        estimate = answer.torque_estimate
        self._lock.add(setpoint.request is Request.LOCK, answer.clutch)
        for request, demand, answered in (
            (Request.ENGAGE, setpoint.torque, None if estimate is None else abs(estimate)),  # the demand has no sign
            (Request.PRESSURE, setpoint.pressure, answer.pressure),
        ):
            if answered is not None:
                self._regimes[request].add(demand if setpoint.request is request else 0.0, answered)

    def _describe_outcome(
        self,
        bus: str,
        elapsed: float,
        answer: Answer,
        objection: str | None,
        released: bool,
        interrupted: bool,
        logged: str,
    ) -> tuple[dict[str, Any], str, str, bool]:
        profile = self._profile
        torque, pressure = self._regimes[Request.ENGAGE], self._regimes[Request.PRESSURE]
        asked = [
            regime
            for regime, demands in ((torque, profile.torque), (pressure, profile.pressure))
            if any(demand > 0.0 for demand in demands)
        ]
        locks = any(profile.lock)
        good = objection is None and released and all(r.is_reached for r in asked) and (self._lock.locked or not locks)
        errors = [f"regime error {r.error:.2f} {r.unit} of {r.demand:.2f} {r.unit}" for r in asked if r.samples]
        figures = ", ".join(errors + ([str(self._lock)] if locks else []))
        if objection:
            verdict = objection
        elif not released:
            verdict = "the clutch was not released within 2 s"
        elif not (asked or locks):
            verdict = "the demand had neither torque nor pressure nor lock"
        elif not asked:
            verdict = str(self._lock)
        elif not figures:
            verdict = f"not reached: no demand was held for {_SETTLING_TIME:g} s"
            verdict += "" if interrupted else "; it needs more --seconds, or a steeper --ramp of a torque or a pressure"
        else:
            verdict = f"reached, {figures}" if good else f"not reached, {figures}{answer.describe_clutch()}"
        if interrupted:
            verdict = f"interrupted after {elapsed:.1f} s; {verdict}"
        length = "until stopped" if profile.duration >= LATEST_TIME else f"{profile.duration:g} s"
        text = "\n".join(
            [
                f"read:    {profile.name} ({length}), the controller's status on {bus}",
                f"wrote:   set-points on {bus} for {elapsed:.1f} s; the clutch is "
                f"{'released' if released else 'possibly not released'}",
                logged,
            ]
        )
        document = {
            "bus": bus,
            "demand": profile.name,
            "seconds": elapsed,
            "regime_error_nm": torque.error,
            "regime_demand_nm": torque.demand,
            "regime_error_bar": pressure.error,
            "regime_demand_bar": pressure.demand,
            "locked_after_s": self._lock.locked_after,
            "locked": self._lock.locked,
            "last_answer": asdict(answer) | {"clutch": answer.clutch},
            "released": released,
            "interrupted": interrupted,
            "logged": logged,
            "verdict": verdict,
            "good": good,
        }
        return document, text, verdict, good


class _StatusLine:
    """Demand and response on one line of the terminal; nothing when `quiet`."""

    def __init__(self, duration: float, quiet: bool) -> None:
        self._quiet = quiet
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._every = _DRAW_PERIOD if self._console.is_terminal else _LINE_PERIOD
        self._end = f"/{duration:g}" if duration < LATEST_TIME else ""
        self._next = 0.0

    def __enter__(self) -> "_StatusLine":
        if self._console.is_terminal and not self._quiet:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, elapsed: float, setpoint: Setpoint, answer: Answer) -> None:
        """Show the line when the next one is due."""
        if self._quiet or elapsed < self._next or not takes_text(self._console):
            return
        self._next += self._every
        estimate, pressure = answer.torque_estimate, answer.pressure
        demand = {
            Request.PRESSURE: f"{setpoint.pressure:5.2f} bar",
            Request.LOCK: "    lock",
        }.get(setpoint.request, f"{setpoint.torque:5.2f} Nm")
        text = (
            f"{elapsed:6.1f}{self._end} s  {answer.phase or '-':<12}  {answer.clutch or '-':<8}  demand {demand}"
            f"  estimate {'-' if estimate is None else f'{estimate:z.2f}':>6} Nm"
            f"  pressure {'-' if pressure is None else f'{pressure:z.2f}':>4} bar  speed {setpoint.speed:.2f} rad/s"
        )
        if self._console.is_terminal:
            self._live.update(Text(text, no_wrap=True, overflow="ellipsis"), refresh=True)
        else:
            self._console.print(text, soft_wrap=True, highlight=False)
