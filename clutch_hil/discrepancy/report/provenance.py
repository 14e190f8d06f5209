"""Provenance: the section with notes, run files and their hashes, versions, command and computing time."""

from importlib.metadata import version
from platform import python_version

from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.residuals import compute_period, list_times
from clutch_hil.discrepancy.result import Result, Trace
from clutch_hil.page.markup import Html, join, make_element, make_table, make_value
from clutch_hil.page.wording import format_number

_PACKAGES = ("clutch-hil", "numpy", "scipy", "numba", "matplotlib", "rerun-sdk")


def make_section(pictures: Pictures, files: list[str], command: str) -> tuple[str, list[Html]]:
    """Return heading and contents of the section. files: names of the other report files. command: the command line."""
    result = pictures.result
    notes = make_element("ul", join([make_element("li", note) for note in result.notes])) if result.notes else Html("")
    versions = [*(f"{name} {version(name)}" for name in _PACKAGES), f"Python {python_version()}"]
    made = {
        "rig": result.rig,
        "extended from": result.model or "",
        "command": make_element("code", command) if command else "",
        "time taken": join([make_value(result.seconds, format_number(result.seconds)), " s"], ""),
        "versions": ", ".join(versions),
        "files with this page": ", ".join(files),
    }
    items = [join([make_element("dt", key), make_element("dd", text)], "") for key, text in made.items() if text]
    header = ("run", "use", "length", "rate", "SHA-256 of the file")
    return "Notes and provenance", [
        notes,
        make_table(header, _list_runs(result), "  nnh"),
        make_element("dl", join(items)),
    ]


def _list_runs(result: Result) -> list[tuple[str, ...]]:
    traces = {trace.name: trace for trace in result.traces}
    names = dict.fromkeys([*result.hashes, *traces])
    return [(name, *_format_size(result, traces.get(name)), result.hashes.get(name, "")) for name in names]


def _format_size(result: Result, trace: Trace | None) -> tuple[str, str, str]:
    if trace is None:
        return "", "", ""
    seconds = list_times(trace)[-1] - list_times(trace)[0] + compute_period(trace)
    use = "left out in turn" if result.held_out == "in turn" else "held out" if trace.held_out else "fitted"
    return use, f"{format_number(float(seconds))} s", f"{format_number(1.0 / compute_period(trace), 4)} Hz"
