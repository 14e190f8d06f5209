"""Commands for the terminal: ask for torque, pressure or lock, watch, tune."""

import typer

from protocols.command import report
from protocols.errors import InputError

BUS = typer.Option("auto", help="vcan0, can0, local:NAME or auto")
BENCH = typer.Option(None, "--bus", help="bus of the bench, where several are running")
ROUTER = typer.Option(None, help="zenoh router of another machine, such as tcp/192.168.1.5:7447")
NAMES = typer.Argument(
    None, metavar="[NAME[=VALUE]]...", help="parameters to show, or to set; a group such as torque. shows all of it"
)
JSON = typer.Option(False, "--json", help="print the result as JSON")
_SPEED = 10.47  # rad/s, 100 rpm: where the profile `engagement` begins
_RAMP = 40.0  # Nm/s: as the profile `engagement` rises
_PRESSURE_RAMP = 4.0  # bar/s: as the experiments rise (plant_sim/experiments.py)


def register(app: typer.Typer) -> None:
    """Add the commands of the terminal."""
    app.command(context_settings={"ignore_unknown_options": True})(demand)  # -1 is a torque, and refused as one
    for command in (panel, monitor, tune):
        app.command()(command)


def demand(
    torque: float | None = typer.Argument(None, help="torque to hold [Nm]"),
    speed: float | None = typer.Option(None, help=f"speed of the motor, either way, in rad/s; {_SPEED:g} if not given"),
    seconds: float | None = typer.Option(None, help="how long; until Ctrl-C, or to the profile's end, if not given"),
    pressure: float | None = typer.Option(None, help="cylinder pressure to hold instead of a torque, in bar"),
    lock: bool = typer.Option(False, "--lock", help="close the clutch totally instead: carry what is applied"),
    ramp: float | None = typer.Option(
        None, help=f"rise of the demand; {_RAMP:g} Nm/s or {_PRESSURE_RAMP:g} bar/s if not given"
    ),
    profile: str | None = typer.Option(None, help="name of a profile, or a CSV file, instead of TORQUE"),
    bus: str = BUS,
    json_output: bool = JSON,
) -> None:
    """Ask the controller for a torque, for a pressure, to lock, or for a profile, and tell whether it was reached."""
    from plant_sim.live.demand import Demand, lock_profile, pressure_profile, torque_profile
    from plant_sim.profile import load_profile

    given = [str(value) for value in (torque, pressure, profile) if value is not None] + ["--lock"] * lock
    if len(given) != 1:
        told = " and ".join(given) or "none of them"
        raise InputError(f"demand needs one of TORQUE, --pressure, --lock and --profile; given are {told}")
    at_speed = _SPEED if speed is None else speed
    if torque is not None:
        asked = torque_profile(torque, at_speed, seconds, _RAMP if ramp is None else ramp)
    elif pressure is not None:
        asked = pressure_profile(pressure, at_speed, seconds, _PRESSURE_RAMP if ramp is None else ramp)
    elif lock:
        if ramp is not None:
            raise InputError(f"demand was given --lock and --ramp {ramp:g}; a ramp is for a TORQUE or a --pressure")
        asked = lock_profile(at_speed, seconds)
    elif speed is not None or ramp is not None:
        raise InputError(f"demand was given --profile {profile} and --speed or --ramp; they are not for a profile")
    else:
        asked = load_profile(str(profile), seconds)
    report(*Demand(bus, asked).run(quiet=json_output), json_output)


def panel(bus: str = BUS) -> None:
    """Drive the clutch from the keyboard."""
    from plant_sim.live.panel import drive

    report({}, *drive(bus), as_json=False)


def monitor(
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    once: bool = typer.Option(False, help="print one look and end"),
    seconds: float | None = typer.Option(None, help="how long; until Ctrl-C if not given"),
    json_output: bool = JSON,
) -> None:
    """Watch a running bench in the terminal."""
    from plant_sim.live.monitor import watch

    report(*watch(bus, router, once, seconds, json_output), json_output)


def tune(
    names: list[str] | None = NAMES,
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    json_output: bool = JSON,
) -> None:
    """List, show and set the parameters of the running services."""
    from plant_sim.live.tune import tuned

    report(*tuned(names or [], bus, router), json_output)
