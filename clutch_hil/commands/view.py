"""`clutch-hil view`: show a running bench, or recorded runs, in the viewer."""

import os
from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BENCH, FROM, JSON, OVERWRITE, ROUTER, TO
from protocols.errors import InputError

RUNS = typer.Argument(
    None, metavar="[RUN]...", help="a recorded run, or two side by side; the running bench if not given"
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(view)


def view(
    runs: list[Path] | None = RUNS,
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    from_s: float = FROM,
    to_s: float = TO,
    web: bool = typer.Option(False, "--web", help="show it in a browser; needs no network"),
    save: Path | None = typer.Option(None, help="write the rows to an .rrd file; with this alone nothing is shown"),
    window: bool = typer.Option(False, "--window", help="show a window as well with --save"),
    seconds: float | None = typer.Option(
        None, help="how long, in s; until the window is closed or Ctrl-C if not given"
    ),
    port: int | None = typer.Option(None, help="port of the viewer's data; 9876 or a free one if not given"),
    web_port: int | None = typer.Option(None, help="port of the page; 9090 or a free one if not given"),
    address: str = typer.Option(
        "127.0.0.1",
        help="address of this machine on which the page is served; others can open it with the token in its address",
    ),
    headless: bool = typer.Option(False, "--headless", help="a viewer without a window, for pictures and tests"),
    memory: str | None = typer.Option(
        None, help="memory for rows; the oldest are dropped first; 1GB, with --web 256MB, if not given"
    ),
    no_open: bool = typer.Option(False, "--no-open", help="do not open a browser"),
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Show a running bench, or recorded runs, in rerun's viewer."""
    os.environ.setdefault("RUST_LOG", "off")  # we count and report errors of rerun
    from clutch_hil.live.viewer.rrd_writer import check_rrd
    from clutch_hil.live.viewer.viewer import Viewer, WebViewer
    from protocols.files.stretch import Stretch

    if seconds is not None and not seconds > 0.0:
        raise InputError(f"--seconds is {seconds:g} s; allowed is more than 0 s")
    if web + headless + window > 1:
        raise InputError("more than one of --web, --headless and --window was given; only one is allowed")
    of_page = {f"--address {address}": address != "127.0.0.1", f"--web-port {web_port}": web_port is not None}
    if odd := [option for option, given in (of_page | {"--no-open": no_open}).items() if given and not web]:
        raise InputError(f"{odd[0]} was given without --web; it is an option of --web")
    if save and not (web or headless or window):
        of_viewer = {f"--port {port}": port is not None, f"--memory {memory}": memory is not None}
        of_viewer |= {f"--seconds {seconds}": bool(runs) and seconds is not None}  # for a bench, they limit the file
        if odd := [option for option, given in of_viewer.items() if given]:
            raise InputError(f"{odd[0]} was given without a viewer; with --save it needs --web or --window")
    if runs and (bus or router):
        option = "--bus" if bus else "--router"
        raise InputError(
            f"{option} {bus or router} and run {runs[0]} cannot be combined; {option} is for the running bench"
        )
    stretch = Stretch(from_s, to_s)
    if not runs and not stretch.is_whole:
        raise InputError("--from or --to was given without a run; for a running bench use --seconds")
    if save:
        check_rrd(save, overwrite, runs or ())

    def say(text: str) -> None:
        typer.echo(text, err=True)

    viewer: Viewer | None = None
    if web:
        viewer = WebViewer(port, web_port, memory, browser=not no_open, address=address)
    elif headless or window or not save:
        viewer = Viewer(port, memory, headless)
    if runs:
        from clutch_hil.live.run_replay import Replay

        replayed = Replay(runs, stretch).run(viewer, save, seconds, say)
        report(replayed.document, replayed.text, replayed.verdict, replayed.good, json_output)
    else:
        from clutch_hil.live.viewer.view import LiveView

        watched = LiveView(bus, router, seconds).run(viewer, save, say)
        report(watched.document, watched.text, watched.verdict, watched.good, json_output)
