"""Suite: run one scenario, or several in turn with one verdict, and measure their duration."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from clutch_hil.bench.junit import Case, write_junit
from clutch_hil.bench.label import Label
from clutch_hil.bench.progress import format_table
from clutch_hil.bench.recording import make_writable
from clutch_hil.bench.result import Result
from clutch_hil.bench.simulate import Simulation
from protocols.errors import InputError


def run_one(label: Label, run: Callable[[], Result], junit: Path | None) -> Result:
    """Run one scenario with this label by `run`; also write its result to the file `junit` if given. Raises InputError."""
    case = _time_run(label, run)
    assert case.result is not None
    return _write_verdicts(case.result, [case], junit)


def run_suite(simulated: Sequence[Simulation], progress: Callable[[float, int], None], junit: Path | None) -> Result:
    """Run several scenarios; return one result, also written to `junit` if given. An error in one does not stop the others."""
    for one in simulated:
        make_writable(one.scenario.settings.out)
    cases = []
    for before, one in enumerate(simulated):
        cases.append(_try_scenario(one, before, len(simulated), progress))
        progress(before + 1, len(simulated))
    rows = [("scenario", "s", "verdict")]
    rows += [(c.label.name, f"{c.seconds:.1f}", c.result.verdict if c.result else c.error) for c in cases]
    failed = [case.label.name for case in cases if not (case.result and case.result.good)]
    verdict = f"failed: {', '.join(failed)}" if failed else f"passed: {len(cases)} scenarios"
    lines = [f"read:    {case.label.what}" for case in cases]
    lines += [f"wrote:   {case.result.document['run']}" for case in cases if case.result]
    documents = [
        {"scenario": case.label.name, "error": case.error} | (case.result.document if case.result else {})
        for case in cases
    ]
    document = {"scenarios": documents, "verdict": verdict, "good": not failed}
    return _write_verdicts(Result(document, "\n".join([*lines, format_table(rows)]), verdict, not failed), cases, junit)


def _try_scenario(one: Simulation, before: int, total: int, progress: Callable[[float, int], None]) -> Case:
    began, clock = _format_now(), time.monotonic()
    try:
        return _time_run(one.label, lambda: one.run(lambda done, cycles: progress(before + done / cycles, total)))
    except InputError as error:
        return Case(one.label, None, str(error), began, time.monotonic() - clock)


def _time_run(label: Label, run: Callable[[], Result]) -> Case:
    began, clock = _format_now(), time.monotonic()
    return Case(label, run(), "", began, time.monotonic() - clock)


def _format_now() -> datetime:
    return datetime.now().astimezone()


def _write_verdicts(result: Result, cases: Sequence[Case], junit: Path | None) -> Result:
    if junit is None:
        return result
    write_junit(junit, cases)
    return replace(result, document=result.document | {"junit": str(junit)}, text=f"{result.text}\nwrote:   {junit}")
