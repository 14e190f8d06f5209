"""`clutch-hil scenarios`: list the shipped scenarios."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(scenarios)


def scenarios(json_output: bool = JSON) -> None:
    """List the scenarios that come with the bench, with their limits."""
    from clutch_hil.bench.scenario import FOLDER, find_shipped_scenarios, load_scenario

    lines, document = [f"read:    {FOLDER}"], []
    for scenario in map(load_scenario, find_shipped_scenarios()):
        limits = list(map(str, scenario.limits))
        lines += [
            f"{scenario.name} ({scenario.rig.name}, {scenario.duration:.1f} s): {scenario.title}",
            f"    {', '.join(limits) or '-'}",
        ]
        entry = {"name": scenario.name, "title": scenario.title, "about": scenario.about, "rig": scenario.rig.name}
        document.append(entry | {"seconds": scenario.duration, "limits": limits, "file": str(scenario.path)})
    verdict = f"{len(document)} scenarios; run them with clutch-hil simulate NAME or clutch-hil up NAME"
    report(document, "\n".join(lines), verdict, True, json_output)
