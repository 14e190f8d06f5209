"""`clutch-hil inject`: inject effects and faults into a running plant."""

from math import inf

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BENCH, JSON, ROUTER
from protocols.errors import InputError

WORDS = typer.Argument(
    None,
    metavar="[EFFECT [SHORT=VALUE]... | GROUP.NAME=VALUE]...",
    help="effects, faults of the bus or of the computer to switch on, at typical values or the given ones, and parameters to"
    " set; a value may have a unit, such as 34psi; lists what is on now if not given",
)
FREEZE = typer.Option([], help="sensor that freezes; may be given more than once")
BIAS = typer.Option([], metavar="SENSOR=VALUE", help="sensor offset by this value; may be given more than once")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(inject)


def inject(
    words: list[str] | None = WORDS,
    off: bool = typer.Option(False, "--off", help="switch the effects off, release the sensors"),
    freeze: list[str] = FREEZE,
    bias: list[str] = BIAS,
    process: str | None = typer.Option(
        None,
        help="service of the clutch-hil up on this computer that receives a signal: plant, controller or controller_b",
    ),
    signal: str | None = typer.Option(None, help="signal of --process: kill, the default, or stop"),
    list_all: bool = typer.Option(False, "--list", help="list what is on now, and what is planned"),
    clutch: str | None = typer.Option(None, help="clutch a or b, on a rig with two"),
    at: float | None = typer.Option(None, help="when, in s of the plant's time; now if not given"),
    after: float | None = typer.Option(None, help="when, in s from now"),
    ramp: float | None = typer.Option(None, help="length of the ramp to the new values, in s"),
    until: float | None = typer.Option(None, help="go back at this time, in s of the plant's time"),
    hold: float | None = typer.Option(None, "--for", help="go back this long after the end of the ramp, in s"),
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    json_output: bool = JSON,
) -> None:
    """Change the running plant, now, later or along a ramp: effects, parameters, sensors, faults of the bus.

    Faults of processes and of the computer are injected into the clutch-hil up of this computer.
    """
    from functools import partial

    from clutch_hil.live.tuning.bench_faults import read_bench_fault, run_bench_fault
    from clutch_hil.live.tuning.inject import find_unit, parse_values, run_injection, show_state
    from protocols.can.two_clutches import check_clutch

    given = {"at": at, "after": after, "until": until, "for": hold}
    for name, seconds in (given | {"ramp": ramp}).items():
        if seconds is not None and not 0.0 <= seconds < inf:
            raise InputError(f"--{name} is {seconds:g} s; allowed are 0 and more")
    if (request := read_bench_fault(words or [], process, signal, off)) is not None:
        others = {
            "--freeze": freeze,
            "--bias": bias,
            "--clutch": clutch,
            "--ramp": ramp,
            "--list": list_all,
            "--router": router,
        }
        others |= {f"--{name}": seconds for name, seconds in given.items()} if off else {}  # it ends now
        if beside := [name for name, value in others.items() if value not in (None, [], False)]:
            raise InputError(
                f"a fault of the bench and {beside[0]} cannot be combined; allowed with it are --bus and start times"
            )
        report(*run_bench_fault(request, {name: s for name, s in given.items() if s is not None}, bus), json_output)
        return
    prefix = "" if clutch is None else f"{check_clutch(clutch)}."
    unit_of = partial(find_unit, prefix=prefix, bus=bus, router=router)
    values = {prefix + name: v for name, v in parse_values(words or [], off, freeze, bias, unit_of).items()}
    when = {name: seconds for name, seconds in (given | {"ramp": ramp}).items() if seconds is not None}
    if not values:
        if when or off:
            raise InputError(
                "inject was given a time or --off but nothing to inject; give an effect, GROUP.NAME=VALUE, --freeze or --bias"
            )
        report(*show_state(bus, router), json_output)
        return
    if list_all:
        raise InputError("--list and something to inject were both given; only one of them is allowed")
    report(*run_injection(values, when, bus, router), json_output)
