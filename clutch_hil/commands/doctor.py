"""`clutch-hil doctor`: list what this machine lacks for a bench, and the commands that provide it."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON

_MARKS = {True: "on", False: "off", None: "-"}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(doctor)


def doctor(
    cpu: int | None = typer.Option(None, help="CPU for the loop"),
    json_output: bool = JSON,
) -> None:
    """List what a bench needs of this machine: rights, clocks, buses, network, units; and the command for what is missing."""
    import os

    from clutch_hil.bench.host.machine import NETWORK, list_facts
    from protocols.realtime.rights import MEASURES, LoopRequest, check_cpu, is_possible

    wanted = LoopRequest(max(os.sched_getaffinity(0)) if cpu is None else check_cpu(cpu))
    measures = [(m, is_possible(m, wanted)) for m in MEASURES]
    machine_facts = list_facts()
    lines = ["process: what each service sets for itself", ""]
    lines += [f"  {_MARKS[there]:<4} {m.name:<30} {m.why}" for m, there in measures]
    lines += ["", "machine", ""]
    lines += [f"  {_MARKS[fact.good]:<4} {fact.name:<30} {fact.state}" for fact in machine_facts]
    remedies = [(m.name, m.remedy) for m, there in measures if not there]
    remedies += [(fact.name, fact.remedy) for fact in machine_facts if fact.good is False]
    if remedies:
        lines += ["", "to turn on what is missing:", ""]
        lines += [f"  {name}\n      {remedy}" for name, remedy in remedies]
    off = [m.name for m, there in measures if not there]
    text = f"the loop lacks: {', '.join(off)}" if off else "the loop has every permission that it needs"
    count = sum(fact.good is False for fact in machine_facts)
    text += f"; {count} of {len(machine_facts)} settings of the machine could be better" if count else ""
    exposed = [fact.state for fact in machine_facts if fact.name == NETWORK and fact.good is False]
    text += "".join(f"; the network is open: {state}" for state in exposed)
    document = {
        "process": [{"name": m.name, "on": there, "remedy": m.remedy} for m, there in measures],
        "machine": [fact._asdict() for fact in machine_facts],
    }
    report(document, "\n".join(lines), text, not (off or exposed), json_output)
