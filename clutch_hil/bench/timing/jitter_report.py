"""Report of `clutch-hil jitter`: a table, ratios to the witness, to cyclictest and to an echo, a picture, a verdict."""

import platform
from collections.abc import Mapping, Sequence
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.pictures import palette
from clutch_hil.bench.progress import format_table
from clutch_hil.bench.timing.jitter import SWEEP_TRIGGERS, Point
from clutch_hil.bench.timing.loads import Load
from clutch_hil.bench.timing.measurements import Measurements, Setting, summarise
from protocols.errors import InputError, format_count

_SERVICES = ("plant", "controller")
_FOOTPRINT_COLUMNS = ("page faults plant", "controller", "collections", "threads")
_PERCENTILES = ("p50", "p99", "p99.9", "p99.99", "max")
# Rating of a machine by the p99.9 of the wake-up [us], in the bands of LinuxCNC's latency test, which takes the maximum
BANDS = ((20.0, "excellent"), (50.0, "good"), (100.0, "fair"), (1000.0, "poor: sometimes late at 1 kHz"))
UNUSABLE = "unusable for a fixed rate"
KNEE = 0.002  # largest share of late cycles at which the loop still keeps a rate
MOST_UNEXPLAINED = 100.0  # unexplained late cycles per million: more give a bad verdict


def check_setting(setting: Setting, cpus: Sequence[int]) -> Setting:
    """Return `setting` if it can be measured on the allowed `cpus`. Raises InputError."""
    if setting.cpu not in cpus:
        raise InputError(f"CPU {setting.cpu} is not possible; allowed are {', '.join(map(str, cpus))}")
    if not 1.0 <= setting.piece <= 60.0:
        raise InputError(
            f"{setting.seconds:g} s in {format_count(setting.rounds, 'round')} is not possible; allowed are"
            f" {setting.rounds:g} to {60 * setting.rounds:g} s"
        )
    return setting


def make_document(
    setting: Setting, loads: Sequence[Load], measured: Mapping[str, Measurements], interrupted: bool
) -> dict[str, Any]:
    """Return all measurements, for JSON."""
    phases: dict[str, Any] = {}
    for name, one in measured.items():
        if not one.durations:
            continue
        entry: dict[str, Any] = {what: summarise(one.join_rounds(what)) for what in one.durations}
        if one.witness:
            entry["witness"] = summarise(np.concatenate(one.witness))
        entry |= _count_cycles(one)
        phases[name] = entry
    return {
        "machine": f"{platform.machine()}, Linux {platform.release()}, Python {platform.python_version()}",
        "bus": setting.bus, "rate_hz": setting.rate, "cpu": setting.cpu, "spin_us": setting.spin_us,
        "seconds": setting.seconds, "rounds": setting.rounds, "telemetry": setting.telemetry,
        "loads": [load.name for load in loads],
        "interrupted": interrupted, "phases": phases, "ratios": _compute_ratios(phases),
    }  # fmt: skip


def _count_cycles(one: Measurements) -> dict[str, Any]:
    """Return numbers of cycles and, where there were services, their footprint."""
    counts: dict[str, Any] = {"cycles": one.cycles, "near": one.near, "late": one.late, "unexplained": one.unexplained}
    return counts | ({"footprint": {k: dict(v) for k, v in one.footprint.items()}} if one.footprint else {})


def _compute_share(measurement: Mapping[str, Any]) -> str:
    """Return the percentage of all cycles that are near a spike or a stall."""
    return f"{100.0 * measurement['near'] / max(measurement['cycles'], 1):.2f}"


def _format_footprint(measurement: Mapping[str, Any]) -> tuple[str, ...]:
    """Return cells of the table: page faults of plant and controller, then collections and new threads of both together."""
    footprint = measurement.get("footprint", {})
    faults = [str(one["minor_faults"] + one["major_faults"]) for one in (footprint.get(k) for k in _SERVICES) if one]
    both = [str(sum(one[what] for one in footprint.values())) for what in ("collections", "threads_begun")]
    return (*faults, *both) if footprint else ("-",) * 4


def _compute_ratios(phases: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return ratios of p50, p99 and p99.9 between phases of one run."""
    ratios = []

    def add_ratio(name: str, what: str, beside: str, other: Mapping[str, float]) -> None:
        own = phases[name][what]
        shares = {p: own[p] / other[p] for p in ("p50", "p99", "p99.9") if p in own and p in other and other[p] > 0.0}
        ratios.append({"of": f"{what} of {name}", "to": beside, **shares})

    for name in phases:
        if "wake" in phases[name] and "witness" in phases[name] and name != "closed loop, bus":
            add_ratio(name, "wake", "its witness", phases[name]["witness"])
        if "wake" in phases[name] and "cyclictest" in phases and name not in ("cyclictest", "closed loop, bus"):
            add_ratio(name, "wake", "cyclictest", phases["cyclictest"]["wake"])
    for echo in ("echo, raw frames", "echo, python-can and cantools"):
        if echo in phases and "closed loop, bus" in phases:
            add_ratio("closed loop, bus", "latency", echo, phases[echo]["latency"])
    return ratios


def format_text(measurement: Mapping[str, Any]) -> str:
    """Format the tables of `make_document`."""
    rows: list[tuple[str, ...]] = [("phase", "us", *_PERCENTILES)]
    for name, one in measurement["phases"].items():
        durations = [what for what in ("wake", "witness", "step", "latency", "period") if what in one]
        rows += [
            (name if what == durations[0] else "", what, *(_format_number(one[what].get(p, nan)) for p in _PERCENTILES))
            for what in durations
        ]
    counts = [("phase", "cycles", "near %", "late", "unexplained", "a million", *_FOOTPRINT_COLUMNS)]
    for name, one in measurement["phases"].items():
        if "period" in one:
            million = 1e6 * one["unexplained"] / max(one["cycles"], 1)
            late = (
                str(one["cycles"]),
                _compute_share(one),
                str(one["late"]),
                str(one["unexplained"]),
                f"{million:.0f}",
            )
            counts.append((name, *late, *_format_footprint(one)))
    ratios: list[tuple[str, ...]] = [("ratio of", "to", "p50", "p99", "p99.9")]
    ratios += [
        (one["of"], one["to"], *(_format_number(one.get(p, nan), 2) for p in ("p50", "p99", "p99.9")))
        for one in measurement["ratios"]
    ]
    load = f"load: {', '.join(measurement['loads'])}" if measurement["loads"] else "load: none"
    return "\n".join(
        [
            f"machine: {measurement['machine']}; {load}",
            "",
            format_table(rows),
            "",
            format_table(counts),
            "",
            format_table(ratios),
        ]
    )


def sweep_document(
    setting: Setting, loads: Sequence[Load], measured: Mapping[Point, Measurements], interrupted: bool
) -> dict[str, Any]:
    """Return the measurements at each rate, for JSON, and the knee [Hz] of each trigger.

    The knee is the highest rate up to which every measured rate has at most the share KNEE of late cycles.
    """
    rates: list[dict[str, Any]] = []
    knee: dict[str, int | None] = {}
    over: set[str] = set()  # triggers that exceeded the share at a lower rate
    for (rate, trigger), one in sorted(measured.items(), key=lambda item: (SWEEP_TRIGGERS.index(item[0][1]), item[0])):
        knee.setdefault(trigger, None)
        late = one.late / one.cycles if one.cycles and not one.failure else inf
        if late > KNEE:
            over.add(trigger)
        elif trigger not in over:
            knee[trigger] = rate
        if late == inf:
            rates.append({"rate_hz": rate, "trigger": trigger, "failure": one.failure})
            continue
        durations = {what: summarise(one.join_rounds(what)) for what in ("wake", "step", "period")}
        rates.append({"rate_hz": rate, "trigger": trigger, **_count_cycles(one), "late_share": late, **durations})
    machine = f"{platform.machine()}, Linux {platform.release()}, Python {platform.python_version()}"
    return {
        "machine": machine, "bus": setting.bus, "cpu": setting.cpu, "spin_us": setting.spin_us,
        "seconds": setting.seconds, "rounds": setting.rounds, "telemetry": setting.telemetry,
        "loads": [load.name for load in loads], "interrupted": interrupted, "rates": rates, "knee_hz": knee,
    }  # fmt: skip


def sweep_text(measurement: Mapping[str, Any]) -> str:
    """Format the table by rate of `sweep_document`."""
    rows: list[tuple[str, ...]] = [
        ("trigger", "rate Hz", "period us", "cycles", "near %", "late %", "unexplained", "wake p50", "p99", "step p50", "p99",
         *_FOOTPRINT_COLUMNS)
    ]  # fmt: skip
    for one in measurement["rates"]:
        at = (one["trigger"], str(one["rate_hz"]), f"{1e6 / one['rate_hz']:.0f}")
        if "failure" in one:
            rows.append((*at, "failed", *["-"] * 11))
            continue
        percentiles = [_format_number(one[what].get(p, nan)) for what in ("wake", "step") for p in ("p50", "p99")]
        counts = (str(one["cycles"]), _compute_share(one), f"{100.0 * one['late_share']:.3f}", str(one["unexplained"]))
        rows.append((*at, *counts, *percentiles, *_format_footprint(one)))
    load = f"load: {', '.join(measurement['loads'])}" if measurement["loads"] else "load: none"
    return "\n".join([f"machine: {measurement['machine']}; {load}", "", format_table(rows)])


def judge_sweep(measurement: Mapping[str, Any]) -> tuple[str, bool]:
    """Return the verdict line of a sweep, and whether the loop keeps any rate."""
    knee = {trigger: rate for trigger, rate in measurement["knee_hz"].items() if rate is not None}
    if measurement["interrupted"]:
        return "interrupted: what was measured so far is printed", False
    if not knee:
        return f"no rate is kept with at most {100.0 * KNEE:g} % late", False
    rates = " and ".join(f"{rate} Hz with trigger {trigger}" for trigger, rate in knee.items())
    return f"up to {rates}, at most {100.0 * KNEE:g} % of the cycles are late", True


def judge(measurement: Mapping[str, Any]) -> tuple[str, bool]:
    """Return the verdict line, and whether it is good. Late cycles that the machine does not explain count against the loop."""
    if measurement["interrupted"]:
        return "interrupted: what was measured so far is printed", False
    phases = measurement["phases"]
    loop = phases["closed loop, clock"]
    tail = loop["wake"].get("p99.9", loop["wake"]["max"])
    band = next((name for most, name in BANDS if tail <= most), UNUSABLE)
    unexplained = (
        1e6 * sum(p["unexplained"] for p in phases.values()) / max(sum(p["cycles"] for p in phases.values()), 1)
    )
    good = unexplained <= MOST_UNEXPLAINED
    return (
        f"this machine is {band} (wake-up p99.9 {tail:.0f} us); {unexplained:.0f} late cycles per million are not"
        " caused by the machine",
        good,
    )


def draw(setting: Setting, measured: Mapping[str, Measurements], path: Path) -> None:
    """Draw histograms of wake-up and latency, and their tails, on logarithmic axes, into a PNG at `path`."""
    from matplotlib.figure import Figure

    figure = Figure((11.0, 7.5), layout="constrained")
    colours = {name: palette.CYCLE[i % len(palette.CYCLE)] for i, name in enumerate(measured)}
    for row, what in enumerate(("wake", "latency")):
        durations = {name: one.join_rounds(what) for name, one in measured.items() if what in one.durations}
        if not durations:
            continue
        left, right = figure.add_subplot(2, 2, 2 * row + 1), figure.add_subplot(2, 2, 2 * row + 2)
        top = max(float(values.max()) for values in durations.values())
        edges = np.geomspace(0.1, max(top, 10.0) * 1.1, 90)
        for name, values in durations.items():
            clipped = np.clip(values, edges[0], None)
            style: dict[str, Any] = {"where": "post", "label": name, "color": colours[name]}
            left.step(edges[:-1], np.histogram(clipped, edges)[0] / len(values), **style)
            right.step(np.sort(clipped), 1.0 - np.arange(len(values)) / len(values), **style)
        what_it_is = "wake-up after its slot" if what == "wake" else "sample frame to command frame"
        left.set(
            xscale="log",
            yscale="log",
            xlabel="time [us] (smaller values are shown as 0.1)",
            ylabel="share of cycles",
            title=what_it_is,
        )
        right.set(
            xscale="log", yscale="log", xlabel="time [us]", ylabel="share of later cycles", title=f"{what_it_is}: tail"
        )
        for axes in (left, right):
            axes.grid(alpha=0.3)
        right.legend(fontsize=8, loc="upper right")
    title = f"Jitter at {setting.rate} Hz on {setting.bus}, CPU {setting.cpu}"
    figure.suptitle(title, parse_math=False)  # a name may have a $
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _format_number(value: float, digits: int = 1) -> str:
    return "-" if value != value else f"{value:.{digits}f}"
