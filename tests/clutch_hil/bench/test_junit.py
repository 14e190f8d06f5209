"""Verdicts of scenarios as JUnit XML: what a test bench reads of them."""

from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

from clutch_hil.bench.junit import check_junit
from clutch_hil.command import make_application
from protocols.errors import InputError

PROFILE = "time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,10\n0.1,0,10\n0.3,8,10\n0.5,8,10\n"
GOOD = "[limits]\npeak_torque_nm = { least = 7, most = 12 }\nrise_time_s = { most = 0.5 }\n"
BAD = "[limits]\npeak_torque_nm = { most = 2.5 }\n"

# What is written, all of it allowed by junit-10.xsd of Jenkins' xUnit plug-in: (attributes, children in their order).
STRUCTURE = {
    "testsuites": ({"name", "time", "tests", "failures", "errors"}, ["testsuite"]),
    "testsuite": (
        {"name", "timestamp", "hostname", "time", "tests", "failures", "errors", "skipped"},
        ["properties", "testcase", "system-out"],
    ),
    "properties": (set(), ["property"]),
    "property": ({"name", "value"}, []),
    "testcase": ({"name", "classname", "time"}, ["failure", "error"]),
    "failure": ({"message", "type"}, []),
    "error": ({"message", "type"}, []),
    "system-out": (set(), []),
}


def simulate(folder: Path, *arguments: object):
    options = ["--out", folder / "runs", "--junit", folder / "out.xml"]
    return CliRunner().invoke(make_application(), ["simulate", *map(str, [*arguments, *options])])


def write_scenario(folder: Path, name: str, limits: str, title: str = "x") -> Path:
    (folder / "short.csv").write_text(PROFILE)
    path = folder / f"{name}.toml"
    path.write_text(f'title = "{title}"\n[run]\nprofile = "short.csv"\nseed = 7\n{limits}')
    return path


def check_structure(element: ElementTree.Element) -> None:
    attributes, children = STRUCTURE[element.tag]
    assert set(element.keys()) == attributes
    order = [children.index(child.tag) for child in element]
    assert order == sorted(order)
    for child in element:
        check_structure(child)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> ElementTree.Element:
    """A good, a broken and an unlimited scenario in one file."""
    folder = tmp_path_factory.mktemp("junit")
    files = [write_scenario(folder, name, limits) for name, limits in (("good", GOOD), ("bad", BAD), ("free", ""))]
    result = simulate(folder, *files)
    assert result.exit_code == 1
    assert "verdict: failed: bad" in result.stdout
    return ElementTree.parse(folder / "out.xml").getroot()


def test_the_file_has_the_structure_that_readers_expect(root: ElementTree.Element) -> None:
    assert root.tag == "testsuites"
    check_structure(root)


def test_a_scenario_is_a_suite_and_a_limit_a_case(root: ElementTree.Element) -> None:
    cases = {suite.get("name"): [case.get("name") for case in suite.iter("testcase")] for suite in root}
    assert cases == {
        "good": ["7 <= peak_torque_nm <= 12 Nm", "rise_time_s <= 0.5 s", "fault = none"],
        "bad": ["peak_torque_nm <= 2.5 Nm", "fault = none"],
        "free": ["run"],
    }


def test_a_failure_tells_value_and_limit(root: ElementTree.Element) -> None:
    (failure,) = root.iter("failure")
    assert str(failure.text).startswith("peak_torque_nm <= 2.5 Nm: 8.")
    assert failure.get("message") == failure.text


def test_counts_and_times_add_up(root: ElementTree.Element) -> None:
    assert [root.get(key) for key in ("tests", "failures", "errors")] == ["6", "1", "0"]
    assert [suite.get("failures") for suite in root] == ["0", "1", "0"]
    for suite in root:
        times = [float(case.get("time", "")) for case in suite.iter("testcase")]
        assert sum(times) == pytest.approx(float(suite.get("time", "")))


def test_properties_tell_seed_and_versions(root: ElementTree.Element) -> None:
    sentence = {p.get("name"): p.get("value") for p in root[0].iter("property")}
    assert sentence["seed"] == "7"
    assert sentence["version clutch-hil"] == version("clutch-hil")
    assert sentence["file"].endswith("good.toml")


def test_text_that_xml_cannot_hold_is_replaced(tmp_path: Path) -> None:
    result = simulate(tmp_path, write_scenario(tmp_path, "odd", GOOD, title="a \\u0007 <&> \\u00b0"))
    assert result.exit_code == 0
    root = ElementTree.parse(tmp_path / "out.xml").getroot()
    assert root.find(".//property[@name='title']").get("value") == "a ? <&> °"  # type: ignore[union-attr]


def test_a_name_that_xml_cannot_hold_is_replaced(tmp_path: Path) -> None:
    result = simulate(tmp_path, write_scenario(tmp_path, "odd\x01name", GOOD))
    assert result.exit_code == 0, result.output
    root = ElementTree.parse(tmp_path / "out.xml").getroot()
    assert root[0].get("name") == "odd?name"
    assert {case.get("classname") for case in root.iter("testcase")} == {"clutch_hil.odd?name"}


def test_a_run_that_fails_stands_as_an_error_and_the_others_go_on(tmp_path: Path, monkeypatch) -> None:
    from clutch_hil.bench import result as module

    judge = module.judge_run

    def broken(path: Path, *arguments):
        if "first" in path.name:
            raise InputError("the disk is full")
        return judge(path, *arguments)

    monkeypatch.setattr(module, "judge_run", broken)
    result = simulate(tmp_path, *(write_scenario(tmp_path, name, GOOD) for name in ("first", "second")))
    assert result.exit_code == 1
    root = ElementTree.parse(tmp_path / "out.xml").getroot()
    check_structure(root)
    (error,) = root.iter("error")
    assert str(error.text).startswith("the disk is full; the run is complete, in ")
    assert root[1].get("failures") == "0"


@pytest.mark.parametrize("count", [1, 2])
def test_a_blind_run_tells_its_limits_and_nothing_of_its_scenario(tmp_path: Path, count: int) -> None:
    secret = "[effects]\nfriction_level = {}\n[plant]\noil.sump_temperature = 71\n"
    file = write_scenario(
        tmp_path, "weak-oil", f"{secret}[limits]\npeak_torque_nm = {{ most = 99 }}\n", title="hidden title"
    )
    result = simulate(tmp_path, *[file] * count, "--blind")
    assert result.exit_code == 0, result.exception
    assert "read:    a scenario, blind" in result.stdout
    root = ElementTree.parse(tmp_path / "out.xml").getroot()
    check_structure(root)
    assert [suite.get("name") for suite in root] == ["blind"] * count
    assert [case.get("name") for case in root[0].iter("testcase")] == ["peak_torque_nm <= 99 Nm", "fault = none"]
    sentence = {p.get("name") for p in root[0].iter("property")}
    assert {name for name in sentence if not name.startswith("version ")} == {"rig", "rate", "law", "adaptation"}
    for word in ("weak-oil", "hidden title", "friction_level", "short", "seed"):
        assert word not in result.stdout
        assert word not in (tmp_path / "out.xml").read_text()


@pytest.mark.parametrize("file", ["/proc/out.xml", "x" * 251 + ".xml", "x" * 300])
def test_a_name_that_cannot_be_written_is_told_before_the_run(tmp_path: Path, file: str) -> None:
    options = ["--out", tmp_path / "runs", "--junit", tmp_path / "xml" / file]
    result = CliRunner().invoke(
        make_application(), ["simulate", str(write_scenario(tmp_path, "x", GOOD)), *map(str, options)]
    )
    assert "cannot be written" in str(result.exception)
    assert not [path for folder in ("runs", "xml") for path in (tmp_path / folder).glob("*")]


def test_a_run_that_is_refused_leaves_no_verdict(tmp_path: Path, monkeypatch) -> None:
    def full(*_: object) -> None:
        assert not list(tmp_path.glob("out.xml*"))  # what was tried is gone
        raise InputError("the disk is full")

    monkeypatch.setattr("clutch_hil.bench.result.judge_run", full)
    assert isinstance(simulate(tmp_path, write_scenario(tmp_path, "x", GOOD)).exception, InputError)
    assert not list(tmp_path.glob("out.xml*"))


def test_a_file_that_cannot_be_written_is_told_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "out.xml").mkdir()
    result = simulate(tmp_path, write_scenario(tmp_path, "x", GOOD))
    assert "out.xml cannot be written: it is a folder" in str(result.exception)
    assert not list((tmp_path / "runs").glob("*.parquet"))


def test_a_folder_is_told_as_one_whatever_the_rights_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(InputError, match=r"^file / cannot be written: it is a folder"):
        check_junit(Path("/"), False, [])
