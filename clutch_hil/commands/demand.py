"""`clutch-hil demand`: demand a torque, a pressure, a locked clutch, or a profile from the controller."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BUS, JSON, ROUTER
from clutch_hil.live.driving.demand_defaults import PRESSURE_RAMP, SPEED, TORQUE_RAMP
from protocols.errors import InputError


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(context_settings={"ignore_unknown_options": True})(demand)


def demand(
    torque: float | None = typer.Argument(None, help="torque to hold [Nm]"),
    speed: float | None = typer.Option(
        None, help=f"speed of the motor, positive or negative, in rad/s; {SPEED:g} if not given"
    ),
    seconds: float | None = typer.Option(None, help="how long; until Ctrl-C, or to the profile's end, if not given"),
    pressure: float | None = typer.Option(None, help="cylinder pressure to hold instead of a torque, in bar"),
    lock: bool = typer.Option(False, "--lock", help="lock the clutch instead: it carries whatever torque is applied"),
    ramp: float | None = typer.Option(
        None, help=f"rise of the demand; {TORQUE_RAMP:g} Nm/s or {PRESSURE_RAMP:g} bar/s if not given"
    ),
    profile: str | None = typer.Option(None, help="name of a profile, or a CSV file, instead of TORQUE"),
    bus: str = BUS,
    router: str | None = ROUTER,
    json_output: bool = JSON,
) -> None:
    """Ask the controller for a torque, a pressure, a lock or a profile, and say whether it was reached."""
    from clutch_hil.live.driving.demand import Demand, lock_profile, make_pressure_profile, make_torque_profile
    from plant_sim.profiles.profile import load_profile

    given = [str(value) for value in (torque, pressure, profile) if value is not None] + ["--lock"] * lock
    if len(given) != 1:
        words = " and ".join(given) or "none"
        raise InputError(f"demand needs one of TORQUE, --pressure, --lock and --profile; given: {words}")
    at_speed = SPEED if speed is None else speed
    if torque is not None:
        wanted = make_torque_profile(torque, at_speed, seconds, TORQUE_RAMP if ramp is None else ramp)
    elif pressure is not None:
        wanted = make_pressure_profile(pressure, at_speed, seconds, PRESSURE_RAMP if ramp is None else ramp)
    elif lock:
        if ramp is not None:
            raise InputError(f"--lock and --ramp {ramp:g} cannot be combined; a ramp needs a TORQUE or a --pressure")
        wanted = lock_profile(at_speed, seconds)
    elif speed is not None or ramp is not None:
        raise InputError(f"--profile {profile} cannot be combined with --speed or --ramp; the profile sets both")
    else:
        wanted = load_profile(str(profile), seconds)
    report(*Demand(bus, wanted, router).run(quiet=json_output), json_output)
