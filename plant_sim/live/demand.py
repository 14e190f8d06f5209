"""`clutch-hil demand`: a supervisor that asks for one torque, or for a profile, and tells whether it was reached."""

import time
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from plant_sim.live.supervisor import RATE, Answer, Supervisor
from plant_sim.profile import SPEED_LIMIT, TORQUE_LIMIT, Profile, Setpoint
from protocols.bus import open_bus
from protocols.errors import InputError
from protocols.stopping import Stop

_FOREVER = 1e9  # s, 31 years: a torque without an end is held until it is stopped
_STEADY = 0.5  # s of a constant demand after which the torque counts as settled: the loop rises in 0.25 s
_TOLERANCE = 0.10  # of the demand
_TOLERANCE_FLOOR = 0.3  # Nm, three times the regime error of the default controller
_SHOWN_EVERY = 0.1  # s, on a terminal: as often as the controller's status comes
_PLAIN_EVERY = 2.0  # s between lines where the output is no terminal


def torque_profile(torque: float, speed: float, seconds: float | None, ramp: float) -> Profile:
    """A torque [Nm] reached with `ramp` [Nm/s] and held, at a motor speed [rad/s], for `seconds`, None for ever.

    Raises InputError.
    """
    if not (isfinite(torque) and 0.0 <= torque <= TORQUE_LIMIT):
        raise InputError(f"torque {torque:g} Nm is outside 0..{TORQUE_LIMIT:g} Nm")
    if not (isfinite(speed) and 0.0 <= speed <= SPEED_LIMIT):
        raise InputError(f"speed {speed:g} rad/s is outside 0..{SPEED_LIMIT:g} rad/s")
    if not (isfinite(ramp) and ramp > 0.0):
        raise InputError(f"ramp {ramp:g} Nm/s is not possible; it must be above 0")
    rise = max(torque / ramp, 1.0 / RATE)
    profile = Profile(f"{torque:g} Nm", (0.0, rise, _FOREVER), (0.0, torque, torque), (speed,) * 3)
    return profile if seconds is None else profile.lasting(seconds)


@dataclass
class Regime:
    """Mean absolute error of the controller's estimate while the demand is steady."""

    steady_for: float = 0.0  # s
    samples: int = 0
    error_sum: float = 0.0  # Nm
    demand_sum: float = 0.0  # Nm
    _demand: float = field(default=0.0, repr=False)

    def add(self, demand: float, estimate: float) -> None:
        """One sample of RATE, both in Nm."""
        self.steady_for = self.steady_for + 1.0 / RATE if demand == self._demand else 0.0
        self._demand = demand
        if demand > 0.0 and self.steady_for > _STEADY:
            self.samples += 1
            self.error_sum += abs(estimate - demand)
            self.demand_sum += demand

    @property
    def error(self) -> float:
        """Regime error [Nm]; NaN when the demand never was steady."""
        return self.error_sum / self.samples if self.samples else float("nan")

    @property
    def demand(self) -> float:
        """Mean of the demand in regime [Nm]; NaN when it never was steady."""
        return self.demand_sum / self.samples if self.samples else float("nan")

    @property
    def reached(self) -> bool:
        """Whether the estimate was where it should be."""
        return self.error <= max(_TOLERANCE * self.demand, _TOLERANCE_FLOOR)


class Demand:
    """A profile to be asked for on a bus. Raises InputError when there is another supervisor or no controller."""

    def __init__(self, bus: str, profile: Profile) -> None:
        self._bus, self._profile = bus, profile
        self._regime = Regime()

    def run(self, quiet: bool) -> tuple[dict[str, Any], str, str, bool]:
        """Idle, engage, follow the profile to its end or to Ctrl-C, release; return document, text, verdict, good."""
        profile = self._profile
        with (
            Stop() as stop,
            open_bus(self._bus) as port,
            Supervisor(port) as supervisor,
            _StatusLine(profile.duration, quiet) as line,
        ):
            supervisor.idle(profile.at(0.0).speed)
            began = time.monotonic()
            setpoint, elapsed, objection = profile.at(0.0), 0.0, None
            while not (stop.asked or objection) and elapsed < profile.duration:
                setpoint = profile.at(elapsed)
                supervisor.ask("engage" if setpoint.engage else "idle", setpoint.torque, setpoint.speed)
                objection = supervisor.objection()
                answer = supervisor.heard.answer()
                if answer.torque_estimate is not None:
                    self._regime.add(setpoint.torque, answer.torque_estimate)
                line.show(elapsed, setpoint, answer)
                elapsed = time.monotonic() - began
            answer = supervisor.heard.answer()
            released = supervisor.release(setpoint.speed)
            return self._outcome(port.name, elapsed, answer, objection, released, stop.asked)

    def _outcome(
        self, bus: str, elapsed: float, answer: Answer, objection: str | None, released: bool, interrupted: bool
    ) -> tuple[dict[str, Any], str, str, bool]:
        regime, profile = self._regime, self._profile
        asked = any(torque > 0.0 for torque in profile.torque)
        good = objection is None and released and (regime.reached or not asked)
        figures = f"regime error {regime.error:.2f} Nm of {regime.demand:.2f} Nm"
        if objection:
            verdict = objection
        elif not released:
            verdict = "the clutch was not released within 2 s"
        elif not asked:
            verdict = "no torque was asked for"
        elif not regime.samples:
            verdict = f"not reached: no torque was held for {_STEADY:g} s"
        else:
            verdict = f"{'reached' if good else 'not reached'}, {figures}"
        if interrupted:
            verdict = f"interrupted after {elapsed:.1f} s; {verdict}"
        length = "until stopped" if profile.duration >= _FOREVER else f"{profile.duration:g} s"
        text = "\n".join(
            [
                f"read:    {profile.name} ({length}), the controller's status on {bus}",
                f"wrote:   set-points on {bus} for {elapsed:.1f} s; the clutch is "
                f"{'released' if released else 'not known to be released'}",
            ]
        )
        document = {
            "bus": bus,
            "demand": profile.name,
            "seconds": elapsed,
            "regime_error_nm": regime.error,
            "regime_demand_nm": regime.demand,
            "last_answer": asdict(answer),
            "released": released,
            "interrupted": interrupted,
            "verdict": verdict,
            "good": good,
        }
        return document, text, verdict, good


class _StatusLine:
    """What is asked for and what is answered, on one line of the terminal; nothing when `quiet`."""

    def __init__(self, duration: float, quiet: bool) -> None:
        self._quiet = quiet
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._every = _SHOWN_EVERY if self._console.is_terminal else _PLAIN_EVERY
        self._end = f"/{duration:g}" if duration < _FOREVER else ""
        self._next = 0.0

    def __enter__(self) -> "_StatusLine":
        if self._console.is_terminal and not self._quiet:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, elapsed: float, setpoint: Setpoint, answer: Answer) -> None:
        """Show it when it is time."""
        if self._quiet or elapsed < self._next:
            return
        self._next += self._every
        estimate, pressure = answer.torque_estimate, answer.pressure
        text = (
            f"{elapsed:6.1f}{self._end} s  {answer.phase or '-':<12}  demand {setpoint.torque:5.2f}"
            f"  estimate {'-' if estimate is None else f'{estimate:.2f}':>5} Nm"
            f"  pressure {'-' if pressure is None else f'{pressure:.2f}':>4} bar  speed {setpoint.speed:.2f} rad/s"
        )
        if self._console.is_terminal:
            self._live.update(Text(text, no_wrap=True, overflow="ellipsis"), refresh=True)
        else:
            self._console.print(text, soft_wrap=True, highlight=False)
