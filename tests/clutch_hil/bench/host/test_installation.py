"""Units are installed by one command, into a folder too; what it wrote is removed, what others wrote or changed is not."""

import errno
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from clutch_hil.bench.host import installation, unit_files
from clutch_hil.bench.host.installation import Installation
from clutch_hil.bench.host.unit_files import UNITS, BenchSettings, Program, check_program, make_files, name_unit
from plant_sim.effects.catalogue import VARIABLE
from protocols.can.size import DATABASE
from protocols.errors import InputError
from rt_controller.loop.parameter_sets import OWN_LIMITS
from tests.clutch_hil.live.running import run_command
from tests.processes import PATIENCE

# Overall exposure that `systemd-analyze security` may find, of 10
MOST_EXPOSURE = {"plant": 1.5, "controller": 1.5, "recorder": 1.2, "view": 1.2}
SYSTEM = "etc/systemd/system"
TREE = Path(__file__).parents[4]


def run_service(root: Path, *arguments: str) -> tuple[int, dict, str]:
    """Exit code, document and error of `clutch-hil service`, whose InputError the command would print, and end with 2."""
    done = run_command("service", *arguments, "--root", str(root), "--json")
    if isinstance(done.exception, InputError):
        return 2, {}, str(done.exception)
    return done.exit_code, json.loads(done.stdout), ""


def list_files(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*")}


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine's root folder with a file of somebody else; the project may be in a temporary folder."""
    monkeypatch.setattr(unit_files, "_TEMPORARY", ())
    folder = tmp_path / "root"
    (folder / "etc/udev/rules.d").mkdir(parents=True)
    (folder / "etc/udev/rules.d/10-other.rules").write_text("# not ours\n")
    return folder


@pytest.fixture
def installed(root: Path) -> Path:
    code, document, error = run_service(root, "install")
    assert code == 0, error
    assert set(document["wrote"]) < list_files(root)
    return root


def test_a_full_disk_is_told_by_the_file_and_leaves_no_part_of_it(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_text = Path.write_text

    def refuse(path: Path, text: str, **options: str) -> int:
        write_text(path, text[:10], **options)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # without the path, as of a write

    monkeypatch.setattr(Path, "write_text", refuse)
    code, _, error = run_service(root, "install")
    assert (code, error) == (2, f"{root}/etc/clutch-hil/installed.json cannot be changed: No space left on device")
    assert [name for name in list_files(root) if name.endswith(".part")] == []


def test_units_of_a_bench_of_another_size_have_its_files(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {unit_files.PATH_VARIABLES[place]: tmp_path / place.lower() for place in ("DATABASE", "LIMITS")}
    for variable, path in files.items():
        path.write_text("")
        monkeypatch.setenv(variable, os.path.relpath(path))
    monkeypatch.setattr(unit_files.stat, "S_IXOTH", 0)  # pytest's folders are for one user alone
    code, _, error = run_service(root, "install")
    assert code == 0, error
    lines = (root / "etc/clutch-hil/bench.conf").read_text().splitlines()
    for variable, path in files.items():
        assert f"{variable}={path}" in lines
    assert "CLUTCH_HIL_EFFECTS=" in lines


def test_the_files_of_the_units_are_those_that_processes_read() -> None:
    assert list(unit_files.PATH_VARIABLES.values()) == [DATABASE, OWN_LIMITS, VARIABLE]


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        ("/no/such.dbc", "/no/such.dbc of CLUTCH_HIL_DATABASE does not exist"),
        ("/root/mine.dbc", "/root/mine.dbc of CLUTCH_HIL_DATABASE is below /root, which units cannot see; move it"),
        (
            "/opt/my lab.dbc",
            "/opt/my lab.dbc of CLUTCH_HIL_DATABASE cannot be in bench.conf; allowed are paths without",
        ),
        (
            "/proc/self/environ",
            "of CLUTCH_HIL_DATABASE cannot be read by the user clutch-hil of the units: chmod o+rX /proc",
        ),
    ],
)
def test_a_file_that_units_cannot_read_is_refused(
    root: Path, monkeypatch: pytest.MonkeyPatch, path: str, sentence: str
) -> None:
    before = list_files(root)
    monkeypatch.setenv(DATABASE, path)
    with pytest.raises(InputError, match=re.escape(sentence)):
        unit_files.read_paths(os.environ)
    assert list_files(root) == before


def test_uninstall_leaves_nothing(installed: Path) -> None:
    (installed / "var/cache/clutch-hil").mkdir(parents=True)
    (installed / "var/cache/clutch-hil/kernel").write_text("compiled")
    code, document, error = run_service(installed, "uninstall")
    assert (code, document["left"]) == (0, {}), error
    assert list_files(installed) == {
        "etc",
        "etc/udev",
        "etc/udev/rules.d",
        "etc/udev/rules.d/10-other.rules",
        "var",
        "var/cache",
    }


@pytest.mark.parametrize("group_before", [False, True])
def test_uninstall_gives_back_the_group_and_the_rights_that_the_machine_had(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group_before: bool
) -> None:
    """On a machine that runs; commands of the system are noted."""
    commands: list[tuple[str, ...]] = []
    asked = {("getent", "group", "clutch-hil"): "clutch-hil:x:999:me" if group_before else ""}
    monkeypatch.setattr(installation, "_run", lambda *command, needed=False: commands.append(command))
    monkeypatch.setattr(installation, "_ask", lambda *command: asked.get(command, ""))
    device = tmp_path / "latency"
    device.touch(0o600)
    monkeypatch.setattr(installation, "_LATENCY", device)
    units = Installation(root)
    units._live = True
    units.install({}, {}, "vcan0", start=False)
    device.chmod(0o660)  # as the rule of udev does
    units.uninstall()
    assert device.stat().st_mode & 0o777 == 0o600
    assert ("userdel", "clutch-hil") in commands
    assert (("groupdel", "clutch-hil") in commands) is not group_before


def test_what_others_changed_is_told_and_left_unless_purged(installed: Path) -> None:
    changed = installed / "etc/clutch-hil/bench.conf"
    changed.write_text(changed.read_text() + "# mine\n")
    recording = installed / "var/lib/clutch-hil/runs/a.parquet"
    recording.parent.mkdir(parents=True)
    recording.write_text("rows")
    assert run_service(installed, "status")[1]["changes"] == {"etc/clutch-hil/bench.conf": "changed"}
    code, _, error = run_service(installed, "install")
    assert (code, error) == (
        2, f"file {changed} was changed since it was installed; --overwrite replaces it"
    )  # fmt: skip
    code, document, _ = run_service(installed, "uninstall")
    assert code == 0
    assert document["left"] == {
        "etc/clutch-hil/bench.conf": "it was changed since it was installed",
        "var/lib/clutch-hil": "it contains recordings of the user clutch-hil",
    }
    assert changed.exists()
    assert recording.exists()
    assert run_service(installed, "status")[1]["units"] == []
    code, document, error = run_service(installed, "uninstall", "--purge")
    assert (code, document["left"]) == (0, {}), error
    assert not [name for name in list_files(installed) if "clutch" in name]


def test_purge_removes_what_was_changed_and_recorded(installed: Path) -> None:
    (installed / "etc/clutch-hil/bench.conf").write_text("# mine\n")
    recording = installed / "var/lib/clutch-hil/runs/a.parquet"
    recording.parent.mkdir(parents=True)
    recording.write_text("rows")
    assert run_service(installed, "uninstall", "--purge")[1]["left"] == {}
    assert not [name for name in list_files(installed) if "clutch" in name]


def test_another_install_replaces_the_first(installed: Path) -> None:
    code, _, error = run_service(installed, "install", "--bus", "can0", "--bitrate", "500000", "--rate", "500")
    assert code == 0, error
    assert "BitRate=500000" in (installed / "etc/systemd/network/60-clutch-hil-can0.network").read_text()
    assert not list(installed.rglob("*vcan0*"))
    started = {path.name for path in (installed / SYSTEM / "clutch-hil.target.wants").iterdir()}
    assert started == {"clutch-hil-controller.service", "clutch-hil-view.service"}  # a rig is there, no plant
    run_service(installed, "uninstall")
    assert not [name for name in list_files(installed) if "clutch" in name]


def test_a_file_of_somebody_else_is_not_replaced(root: Path) -> None:
    (root / SYSTEM).mkdir(parents=True)
    other = root / SYSTEM / "clutch-hil.target"
    other.write_text("# another bench\n")
    before = list_files(root)
    code, _, error = run_service(root, "install")
    assert code == 2
    assert error == f"file {other} exists, but clutch-hil has not written it; --overwrite replaces it"
    assert list_files(root) == before


def test_a_note_that_names_other_files_is_refused(installed: Path) -> None:
    note = installed / "etc/clutch-hil/installed.json"
    document = json.loads(note.read_text())
    document["files"]["../passwd"] = "0"
    note.write_text(json.dumps(document))
    code, _, error = run_service(installed, "uninstall")
    assert (code, error) == (2, f"{note} is not a list of installed files of this version")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("start",), "service 'start' is unknown; allowed are install, status, uninstall"),
        (("uninstall",), "no units of clutch-hil are installed below {root}"),
        (("install", "--purge"), "--purge was given with service install; it is only for service uninstall"),
        (("status", "--bus", "can0"), "--bus was given with service status; it is only for service install"),
        (("install", "--bus", "local:x"), "bus 'local:x' is not a CAN interface for units; allowed are names such as"),
        (("install", "--cpu", "999"), "CPU 999 does not exist; allowed are 0 to "),
        (("install", "--rate", "0"), "rate 0 Hz is not possible; allowed are 50 to 10000 Hz"),
        (("install", "--bus", "can0", "--bitrate", "0"), "bit rate 0 bit/s is not possible; allowed are 10000 to 1000000"),
        (("install", "--rate", "7"), "rate 7 Hz is not possible; allowed are 50 to 10000 Hz"),
        (("install", "--bus", "can0", "--bitrate", "5"), "bit rate 5 bit/s is not possible; allowed are 10000 to 1000000"),
        (("install", "--bitrate", "500000"), "--bitrate 500000 was given for vcan0; a virtual bus has none"),
        (("install", "--start", "motor"), "unit 'motor' is unknown; allowed are controller, plant, recorder, view"),
    ],
)  # fmt: skip
def test_wrong_input_gets_one_sentence(root: Path, arguments: tuple[str, ...], error: str) -> None:
    before = list_files(root)
    code, _, line = run_service(root, *arguments)
    assert code == 2
    assert line.startswith(error.format(root=root)), line
    assert list_files(root) == before


def test_a_program_that_units_cannot_run_is_refused(tmp_path: Path) -> None:
    """pytest's folder is temporary."""
    (tmp_path / "deploy/systemd").mkdir(parents=True)
    with pytest.raises(InputError, match="is in a temporary folder, which units cannot see"):
        check_program(Program(Path(sys.executable), tmp_path, (tmp_path,)))
    with pytest.raises(InputError, match="has no deploy/systemd"):
        check_program(Program(Path(sys.executable), tmp_path / "deploy", ()))


def test_a_unit_has_no_place_left_to_fill(installed: Path) -> None:
    for path in (installed / "etc").rglob("*"):
        if path.is_file():
            assert not re.search(r"@[A-Z_]+@", path.read_text()), path


@pytest.mark.needs("systemd-analyze")
@pytest.mark.parametrize("place", ["/opt/clutch-hil", "/home/me/clutch-hil", "/root/clutch-hil"])
@pytest.mark.parametrize("name", UNITS)
def test_units_are_as_little_exposed_as_promised(tmp_path: Path, name: str, place: str) -> None:
    for path, text in make_files(BenchSettings(), Program(Path(sys.executable), TREE, (Path(place),))).items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    command = ["systemd-analyze", "security", "--no-pager", "--offline=true", f"--root={tmp_path}", name_unit(name)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    result = re.search(rf"Overall exposure level for {re.escape(name_unit(name))}: ([\d.]+)", done.stdout)
    assert result, done.stdout + done.stderr
    assert float(result[1]) <= MOST_EXPOSURE[name], done.stdout


@pytest.mark.needs("systemd-analyze")
def test_systemd_understands_every_line(installed: Path) -> None:
    """Under the root alone, where no unit of the machine is: all that is told is about ours, or what ours wait for."""
    environment = os.environ | {
        "SYSTEMD_UNIT_PATH": f"{installed / SYSTEM}:/usr/lib/systemd/system:/lib/systemd/system"
    }
    command = ["systemd-analyze", "verify", "--no-pager", "--man=no", "clutch-hil.target", *map(name_unit, UNITS)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False)
    ours = [line for line in done.stderr.splitlines() if "clutch" in line]
    assert not ours, ours


@pytest.mark.needs("systemd-analyze")
def test_a_line_that_systemd_does_not_know_is_seen(installed: Path) -> None:
    unit = installed / SYSTEM / name_unit("plant")
    unit.write_text(unit.read_text().replace("[Service]", "[Service]\nProtectEverything=yes"))
    with pytest.raises(AssertionError, match="ProtectEverything"):
        test_systemd_understands_every_line(installed)
