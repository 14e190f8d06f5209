"""Butterflies: the gap over a reciprocating position from recorded runs, and the TOML file of the lift-up function from them.

Units           columns as in `slide_record.py`. A position in rad needs the radius of the contact
File            kind "lift-up": values with 95 % intervals in SI, the contact that was known, runs with their SHA-256
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.identify.friction.lift_up import IdentifiedLiftUp, LiftRecord
from clutch_hil.identify.friction.result import as_toml
from clutch_hil.identify.friction.slide_record import Columns, check_values, find_column
from clutch_hil.recordings.checks.finding import refuse_hard
from clutch_hil.recordings.checks.repeated import find_repeated
from plant_sim.friction.lift_up import LiftUp
from protocols.errors import InputError, join_names, name_file_in_errors, name_run
from protocols.files.output_file import whole_file
from protocols.files.runs import read_columns
from protocols.files.toml_table import read_table

KIND = "lift-up"
LAWS: Mapping[str, str] = {"lift-up": "force", "lift-height": "height"}  # name of a law on the command line -> kind
UNITS = {"highest": "N", "speed_scale": "m/s", "attraction": "N/s", "height": "m", "rate": "1/s"}
KNOWN = ("mass", "stiffness", "power", "damping")  # of the contact: must be known
BESIDE = ("load", "radius")  # may be given as well: load [N] where no column has it, radius [m] of the contact
_NEEDED = ("mass", "stiffness")
_KEYS = (
    "kind",
    "law",
    "rig",
    "date",
    "verdict",
    "warnings",
    "error_m",
    "contact",
    "reach",
    "values",
    "correlation",
    "runs",
)


@dataclass(frozen=True)
class LiftUpResult:
    """A lift-up function, and where it came from: SHA-256 by run, date, rig."""

    lift_up: IdentifiedLiftUp
    runs: Mapping[str, str]
    rig: str = ""
    date: str = ""

    @property
    def verdict(self) -> str:
        """One line: the values, and what is left."""
        one = self.lift_up
        values = ", ".join(f"{name} {value:.4g} {UNITS[name]}" for name, value in one.values.items())
        doubts = f", {len(one.warnings)} warning{'s' * (len(one.warnings) != 1)}" if one.warnings else ""
        return f"lift-up by {one.kind}: {values}; {one.error:.3g} m RMS left{doubts}"

    def as_json(self) -> dict[str, Any]:
        """The document of `--json`, and of the file."""
        one = self.lift_up
        return {
            "kind": KIND, "law": next(name for name, kind in LAWS.items() if kind == one.kind), "rig": self.rig,
            "date": self.date, "verdict": self.verdict, "warnings": list(one.warnings), "error_m": one.error,
            "contact": {name: float(getattr(one.contact, name)) for name in KNOWN},
            "reach": {"speed_m_s": one.reach[0], "acceleration_m_s2": one.reach[1]},
            "values": {
                name: {"value": value, "low": one.intervals[name][0], "high": one.intervals[name][1], "unit": UNITS[name]}
                for name, value in one.values.items()
            },
            "correlation": {"names": list(one.values), "matrix": np.asarray(one.correlation).tolist()},
            "runs": [{"source": source, "sha256": digest} for source, digest in self.runs.items()],
        }  # fmt: skip

    def write(self, path: Path) -> None:
        """Write the TOML file; it appears when it is complete. Raises InputError."""
        with whole_file(path) as part:
            part.write_text(as_toml(self.as_json()), encoding="utf-8")


def read_lift_up(path: Path | str) -> IdentifiedLiftUp:
    """The lift-up function in a file that `clutch-hil identify --friction lift-up` wrote. Raises InputError."""
    path = Path(path)
    with name_file_in_errors("file", path):
        return _read_lift_up(path)


def _read_lift_up(path: Path) -> IdentifiedLiftUp:
    document = read_table(path, _KEYS)
    if document.need("kind", str) != KIND:
        raise InputError(f"file {path} is of the kind {document.get('kind', str)!r}; {KIND!r} is needed")
    if (law := document.need("law", str)) not in LAWS:
        raise InputError(f"file {path} has the law {law!r}; allowed are {join_names(LAWS)}")
    entries, known, reach = (
        document.read_subtable("values"),
        document.read_subtable("contact", KNOWN),
        document.read_subtable("reach"),
    )
    parts = {name: entries.read_subtable(name, ("value", "low", "high", "unit")) for name in entries}
    return IdentifiedLiftUp(
        kind=LAWS[law],
        values={name: one.need("value", float) for name, one in parts.items()},
        intervals={name: (one.need("low", float), one.need("high", float)) for name, one in parts.items()},
        correlation=np.array(document.read_subtable("correlation").get("matrix", list, []), float),
        error=document.need("error_m", float),
        contact=make_contact({name: known.need(name, float) for name in KNOWN}),
        reach=(reach.need("speed_m_s", float), reach.need("acceleration_m_s2", float)),
        warnings=tuple(document.get("warnings", list, [])),
    )


def make_contact(known: Mapping[str, float]) -> LiftUp:
    """The contact that is known, without lift. Raises InputError where mass or stiffness is missing."""
    if lacking := [name for name in _NEEDED if name not in known]:
        raise InputError(
            f"the {lacking[0]} of the contact is not given; a lift-up needs --hold {lacking[0]}=VALUE in SI units"
        )
    return LiftUp(0.0, 1.0, 1.0, known["mass"], known["stiffness"], known.get("power", 1.5), known.get("damping", 0.0))


def read_butterflies(
    runs: Sequence[Path], columns: Columns, gap: str, known: Mapping[str, float], low_pass: float
) -> tuple[list[LiftRecord], dict[str, str]]:
    """The butterflies of `runs`, and the SHA-256 of each file.

    known: radius [m] and load [N] where they are given. low_pass [Hz]: that the gap was recorded through. Raises InputError.
    """
    records, digests = [], {}
    seen: list[tuple[str, Mapping[str, np.ndarray]]] = []
    for path in runs:
        run, name = read_columns(path), str(path)
        digests[name] = compute_checksum(path)
        position, shown = (
            find_column(name, run, what, chosen) for what, chosen in (("position", columns.position), ("gap", gap))
        )
        for what, values in (("position", position), ("gap", shown)):
            if values is None:
                raise InputError(
                    f"{name_run(name)} has no column with a known name for the {what}; choose one of {', '.join(run.columns)}"
                )
        assert position is not None
        assert shown is not None
        load = find_column(name, run, "load", columns.load) if "load" not in known else None
        clock = columns.time or "time_s"
        if clock not in run.columns:
            raise InputError(f"{name_run(name)} has no column {clock!r} for the time")
        time = np.asarray(run.columns[clock], float)
        check_values(name, time, {"position": position[0], "gap": shown[0], **({"load": load[0]} if load else {})})
        if load is None and "load" not in known:
            raise InputError(
                f"{name_run(name)} has no column with a known name for the load; give --load COLUMN, or --hold load=VALUE in N"
            )
        radius = known.get("radius", 0.0)
        if position[1] == "rad" and not radius:
            raise InputError(
                f"{name_run(name)} has a position in rad; the contact's radius is needed: --hold radius=VALUE in m"
            )
        way = position[0] * (radius if position[1] == "rad" else 1.0)
        period = float(time[-1] - time[0]) / (time.size - 1)
        mean = known["load"] if load is None else float(np.mean(load[0]))
        records.append(LiftRecord(way, shown[0], period, mean, radius if position[1] == "rad" else 0.0, low_pass))
        seen.append((name, {"position": position[0], "gap": shown[0]}))
    refuse_hard(find_repeated(seen), "")
    return records, digests


def format_now() -> str:
    """Date of a result."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def draw_lift_up(result: LiftUpResult, records: Sequence[LiftRecord], shown: Sequence[np.ndarray]) -> Any:
    """Draw each butterfly as measured and modelled (`shown`), and F_N(v); a matplotlib Figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from clutch_hil.bench.pictures import palette

    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(result.verdict, x=0.01, ha="left", fontsize=10)
    wings, force = figure.subplots(1, 2)
    for k, (record, lift) in enumerate(zip(records, shown, strict=True)):
        part = record.judged_rows
        way = 1e3 * record.position[part]
        wings.plot(way, 1e6 * record.lift[part], color=palette.MEASURED, lw=1.4, label=None if k else "measured")
        wings.plot(way, 1e6 * lift[part], color=palette.ESTIMATE, lw=0.8, label=None if k else "model")
    speeds = np.linspace(0.0, result.lift_up.reach[0], 200)
    force.plot(speeds, result.lift_up.force(speeds, 0.0, records[0].load), color=palette.ESTIMATE)
    for axes, across, up in ((wings, "position [mm]", "gap [um]"), (force, "speed [m/s]", "F_N at constant speed [N]")):
        axes.set_xlabel(across)
        axes.set_ylabel(up)
        axes.grid(alpha=0.3)
    wings.legend(fontsize=8)
    return figure
