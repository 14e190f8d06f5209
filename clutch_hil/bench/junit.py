"""JUnit: write verdicts of scenarios as the XML that test benches and continuous integration read.

A scenario is a test suite and each of its limits a test case. A scenario without limits has one case, its own verdict. A
scenario that could not be run has one case with an error. Layout: junit-10.xsd of Jenkins' xUnit plug-in
(jenkinsci/xunit-plugin).
"""

import platform
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from clutch_hil.bench.label import Label
from clutch_hil.bench.metadata import list_versions
from clutch_hil.bench.recording import make_writable
from clutch_hil.bench.result import Result
from clutch_hil.bench.scenario import Scenario
from protocols.files.output_file import check_can_be_file, check_new_file, whole_file

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # XML 1.0, sec. 2.2


class Case(NamedTuple):
    """One run of the scenario with this label: its result, or None and the `error`; start `began`, duration `seconds` [s]."""

    label: Label
    result: Result | None
    error: str
    began: datetime
    seconds: float


def check_junit(path: Path | None, overwrite: bool, scenarios: Sequence[Scenario]) -> None:
    """Raise InputError where no file can be written at `path`, or it would overwrite another one; call it before the run."""
    if path is not None:
        check_can_be_file(path)
        make_writable(path.parent)
        inputs = (
            file for s in scenarios for file in (s.path, s.settings.plant_parameters, s.settings.controller_parameters)
        )
        check_new_file(path, overwrite, [file for file in inputs if file])


def write_junit(path: Path, cases: Sequence[Case]) -> None:
    """Write the verdicts of `cases` to `path`. Raises InputError; no partial file is left."""
    suites = [_name_suite(case) for case in cases]
    root = ElementTree.Element("testsuites", name="clutch-hil", time=f"{sum(case.seconds for case in cases):.3f}")
    for count in ("tests", "failures", "errors"):
        root.set(count, str(sum(int(suite.get(count, "0")) for suite in suites)))
    root.extend(suites)
    ElementTree.indent(root)
    _clean(root)
    with whole_file(path) as part:
        ElementTree.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _name_suite(case: Case) -> ElementTree.Element:
    label, result = case.label, case.result
    suite = ElementTree.Element(
        "testsuite",
        name=label.name,
        timestamp=case.began.isoformat(timespec="seconds"),
        hostname=platform.node(),
        time=f"{case.seconds:.3f}",
    )
    texts = {**label.properties, **{f"version {name}": version for name, version in list_versions().items()}}
    properties = ElementTree.SubElement(suite, "properties")
    for name, value in texts.items():
        ElementTree.SubElement(properties, "property", name=name, value=value)
    if result is None:
        _add(suite, "run", "error", case.error)
    elif result.judgements:
        for judgement in result.judgements:
            _add(suite, str(judgement.limit), "" if judgement.holds else "failure", str(judgement))
    else:
        _add(suite, "run", "" if result.good else "failure", result.verdict)
    suite[1].set("time", f"{case.seconds:.3f}")  # the first case: all cases come from one run
    ElementTree.SubElement(suite, "system-out").text = result.text if result else case.error
    for count, tag in (
        ("tests", "testcase"),
        ("failures", "*/failure"),
        ("errors", "*/error"),
        ("skipped", "*/skipped"),
    ):
        suite.set(count, str(len(suite.findall(tag))))
    return suite


def _add(suite: ElementTree.Element, name: str, bad: str, text: str) -> None:
    """Add a test case; `bad` is empty, failure or error."""
    classname = f"clutch_hil.{suite.get('name')}"
    element = ElementTree.SubElement(suite, "testcase", name=name, classname=classname, time="0.000")
    if bad:
        ElementTree.SubElement(element, bad, message=text, type=bad).text = text


def _clean(root: ElementTree.Element) -> None:
    """Replace characters that XML does not allow in every text: a name may be that of a file, which allows any character."""
    for element in root.iter():
        element.text = _NOT_XML.sub("?", element.text) if element.text else element.text
        for name, value in element.items():
            element.set(name, _NOT_XML.sub("?", value))
