"""The command: words that say nothing are refused before anything is begun."""

import errno
import json
import os
import shlex
import signal
import subprocess
import sys
from math import inf, nan
from pathlib import Path

import pytest
from typer.testing import CliRunner

from clutch_hil.bench.progress import ActivityLine, progress_bar
from clutch_hil.command import INTERRUPTED, UNREAD, format_json, make_application, write_summary
from protocols.errors import InputError
from tests.processes import PATIENCE, list_errors


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("controller", "--clutch", ""), "--clutch"),
        (("controller", "--clutch="), "--clutch"),
        (("inject", "friction_level", "--bus", " "), "--bus"),
        (("simulate", ""), "a word after 'simulate'"),
        (("",), "a word after 'clutch-hil'"),
    ],
)
def test_an_empty_word_is_refused(arguments: tuple[str, ...], named: str) -> None:
    refused = CliRunner().invoke(make_application(), arguments, prog_name="clutch-hil").exception
    assert isinstance(refused, InputError)
    assert str(refused) == f"{named} is empty; give a value, or leave it out"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("identify", "--seed", "-1"), "identify: invalid value '-1' for '--seed': allowed is 0 or more; "),
        (("simulate", "--workers", "two"), "simulate: invalid value 'two' for '--workers': "),
        (("simulate", "--workers"), "simulate: option '--workers' requires an argument; "),
        (("simulate", "--worker", "2"), "simulate: no such option: --worker"),
        (("identify",), "identify: missing argument 'RUN...'; "),
        (("convert", "a.parquet"), "convert: missing argument 'target'"),
        (("convert", "a.csv", "b.csv", "c.csv"), "convert: unexpected word: c.csv"),
        (
            ("effects", "--write"),
            "clutch-hil effects: option '--write' requires an argument; clutch-hil effects --help",
        ),
        (("simulat",), "clutch-hil: no such command 'simulat'; did you mean 'simulate'; "),
        (("--nosuch",), "clutch-hil: no such option: --nosuch; "),
        (("--nosuch", "simulate"), "clutch-hil: no such option: --nosuch; "),
        (("--version=3",), "clutch-hil: option '--version' does not take a value; "),
    ],
)
def test_a_wrong_option_is_told_in_one_sentence(arguments: tuple[str, ...], sentence: str) -> None:
    refused = CliRunner().invoke(make_application(), arguments, prog_name="clutch-hil").exception
    assert isinstance(refused, InputError)
    text = str(refused)
    assert sentence in text
    assert text.endswith("--help shows what is allowed")
    assert "\n" not in text


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--seeds", "0"), "--seeds is 0; allowed are 1 to 1000000, whole numbers"),
        (("--workers", "0"), "--workers is only for a sweep; --seeds or --vary starts one"),
        (("--rate", "-200"), "rate -200 Hz is not possible; allowed are 50 to 10000 Hz"),
        (("--seeds", "2", "--workers", "0"), "workers is 0; allowed are 1 to 256, whole numbers"),
        (("--seeds", "2", "--workers", "1000000"), "workers is 1000000; allowed are 1 to 256, whole numbers"),
        (("--seeds", "2", "--dask", "somewhere"), "no Dask scheduler answers at somewhere: "),
        (("--seeds", "2", "--dask", "-1"), "no Dask scheduler answers at -1: "),
        (
            ("--seeds", "2", "--dask", "tls://127.0.0.1:1"),
            "no Dask scheduler answers at tls://127.0.0.1:1: TLS expects a ",
        ),
        (
            ("--seeds", "2", "--dask", "tcp://127.0.0.1:1", "--workers", "2"),
            "workers = 2 and a cluster at ",
        ),
        (("--workers", "2"), "--workers is only for a sweep; --seeds or --vary starts one"),
        (("--dask", "tcp://127.0.0.1:1"), "--dask is only for a sweep; --seeds or --vary starts one"),
        (("--seeds", "99999999999"), "--seeds is 99999999999; allowed are 1 to 1000000, whole numbers"),
        (("--vary", "oil.heat_transfer=1:2:0"), "range 'oil.heat_transfer=1:2:0' is not possible; COUNT must be 1 to "),
        (("--vary", "oil.heat_transfer=1:2:9999999999"), "range 'oil.heat_transfer=1:2:9999999999' is not possible; "),
        (
            ("--vary", "oil.heat_transfer=1:inf:3"),
            "range 'oil.heat_transfer=1:inf:3' is not possible; LOW and HIGH must be ",
        ),
        (
            ("--vary", "oil.heat_transfer=nan:2:3"),
            "range 'oil.heat_transfer=nan:2:3' is not possible; LOW and HIGH must be ",
        ),
        (("--vary", "oil.heat_transfer=1:2"), "range 'oil.heat_transfer=1:2' is not of the form NAME=LOW:HIGH:COUNT"),
        (("--vary", "oil.heat_transfer=1:9:1000", "--seeds", "2000"), "2000000 runs are not possible; "),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_and_writes_nothing(
    arguments: tuple[str, ...], sentence: str, tmp_path: Path
) -> None:
    refused = CliRunner().invoke(make_application(), ("simulate", "--out", str(tmp_path / "out"), *arguments)).exception
    assert isinstance(refused, InputError)
    assert str(refused).startswith(sentence)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_wrong_option_of_the_process_is_one_line_and_exit_code_2() -> None:
    command = [sys.executable, "-m", "clutch_hil", "--nosuch"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == (
        "error: python -m clutch_hil: no such option: --nosuch; python -m clutch_hil --help shows what is allowed\n"
    )


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["scenarios", "--help"], ["demand", "--help"]])
def test_a_result_that_cannot_be_printed_is_one_line_and_exit_code_2(words: list[str]) -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "clutch_hil", *words]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    assert list_errors(done.stderr) == ["error: standard output cannot be written: No space left on device"]


@pytest.mark.parametrize("words", ["--version", "scenarios --json", "frames"])
def test_a_result_that_has_no_place_is_one_line_and_exit_code_2(words: str) -> None:
    """The standard output is closed, as by `>&-`: a verdict that nobody saw is none."""
    command = f"exec {shlex.quote(sys.executable)} -m clutch_hil {words} >&-"
    done = subprocess.run(command, shell=True, stderr=subprocess.PIPE, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    assert list_errors(done.stderr) == ["error: standard output cannot be written: Bad file descriptor"]


@pytest.mark.parametrize(
    "words",
    [
        "secure LONG",
        "view LONG.parquet --save x.rrd",
        "view --save LONG.rrd",
        "record LONG --seconds 1",
        "record LONG.parquet --seconds 1",
        "plant --profile LONG --bus local:none",
        "plant --profile LONG.csv --bus local:none",
        "plant --rig power_shift --profile LONG --bus local:none",
        "recover LONG",
        "reproduce 6.14 --out LONG",
        "effects backlash --out LONG",
        "simulate --out LONG",
        "simulate --junit LONG.xml",
        "discrepancy a.parquet --rig LONG.py:Model --out out",
    ],
)
def test_a_name_of_which_the_disk_cannot_tell_whether_it_exists_is_one_sentence(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that is too long, or is in a folder that others may not search."""
    monkeypatch.chdir(tmp_path)
    arguments = words.replace("LONG", "a" * 300).split()
    assert isinstance(CliRunner().invoke(make_application(), arguments).exception, InputError)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words", ["simulate --seconds 0.3", "up --seconds 0.3 --lockstep --no-telemetry", "effects backlash"]
)
def test_a_full_disk_leaves_no_new_folder(
    words: str, local_bus: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: object, **options: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("pyarrow.parquet.ParquetWriter.__init__", fail)
    monkeypatch.setattr("clutch_hil.bench.effect_sheets.effect_picture.draw_effects", fail)
    bus = ("--bus", local_bus) if words.startswith("up") else ()
    arguments = [*words.split(), *bus, "--out", str(tmp_path / "above" / "new")]
    refused = CliRunner().invoke(make_application(), arguments).exception
    assert isinstance(refused, InputError)
    assert "No space left on device" in str(refused)
    assert list(tmp_path.iterdir()) == []


def test_a_scenario_whose_name_is_too_long_for_its_run_is_one_sentence(tmp_path: Path) -> None:
    scenario = tmp_path / f"{'a' * 240}.toml"
    scenario.write_text('title = "x"\n[run]\nprofile = "engagement"\nseconds = 0.3\n')
    refused = (
        CliRunner().invoke(make_application(), ["simulate", str(scenario), "--out", str(tmp_path / "out")]).exception
    )
    assert isinstance(refused, InputError)
    assert str(refused).endswith("cannot be written: File name too long")
    assert list(tmp_path.iterdir()) == [scenario]


def test_a_result_that_nobody_reads_is_no_verdict() -> None:
    command = [sys.executable, "-m", "clutch_hil", "--help"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout
    process.stdout.close()
    assert process.stderr
    assert list_errors(process.stderr.read()) == []
    assert process.wait(PATIENCE) == UNREAD


@pytest.mark.parametrize(("words", "code"), [(["--version"], 0), (["--nosuch"], 2)])
def test_messages_that_cannot_be_printed_change_no_exit_code(words: list[str], code: int) -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "clutch_hil", *words]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=full, timeout=PATIENCE, check=False)
    assert done.returncode == code


def test_a_current_folder_that_was_removed_is_told(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    text = f"import os; from clutch_hil.command import main; os.chdir({str(gone)!r}); os.rmdir({str(gone)!r}); main()"
    command = [sys.executable, "-c", text, "scenarios"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    (message,) = list_errors(done.stderr)
    assert message.startswith("error: the current folder cannot be used: ")


def test_a_character_that_the_terminal_lacks_is_written_out() -> None:
    text = "import typer; from clutch_hil.command import run_main; run_main(lambda: typer.echo('\\u03a9 and \\udcff'))"
    command = [sys.executable, "-c", text]
    environment = os.environ | {"PYTHONIOENCODING": "latin-1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False, env=environment)
    assert (done.returncode, done.stdout, done.stderr) == (0, "\\u03a9 and \\udcff\n", "")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("doctor", "--cpu", "-1"), "CPU -1 does not exist; allowed are 0 to "),
        (("doctor", "--cpu", "99999999999999999999"), "CPU 99999999999999999999 does not exist; allowed are 0 to "),
        (("record", "."), ". cannot be recorded as ''; allowed are "),
        (("record", ".."), ".. cannot be recorded as ''; allowed are "),
        (("record", "/"), "/ cannot be recorded as ''; allowed are "),
        (("import", ".", "--draft"), "recording . cannot be read: it is a folder"),
        (("import", "a b.csv"), "--map is missing; `clutch-hil import --draft 'a b.csv'` writes a draft of one"),
        (("frames", "--write", "."), "file . cannot be written: it is a folder"),
        (("jitter", "--rates", "9" * 5000), "rates '999"),
        (("simulate", "--junit", "/"), "file / cannot be written: it is a folder"),
    ],
)
def test_what_cannot_be_is_refused_by_its_name(words: tuple[str, ...], sentence: str) -> None:
    refused = CliRunner().invoke(make_application(), words).exception
    assert isinstance(refused, InputError)
    assert str(refused).startswith(sentence)


def test_the_next_command_can_be_copied_whatever_the_names_are(tmp_path: Path) -> None:
    recording, target = tmp_path / "a b.csv", tmp_path / "m;ap.toml"
    recording.write_text("time_s,x\n0,1\n1,2\n2,3\n")
    message = CliRunner().invoke(make_application(), ("import", str(recording), "--draft", "--out", str(target))).output
    (line,) = (line for line in message.splitlines() if line.startswith("next: "))
    words = shlex.split(line.partition(", then ")[2])
    assert words == ["clutch-hil", "import", str(recording), "--map", str(target), "--out", "run.parquet"]


def test_json_knows_neither_nan_nor_infinity(tmp_path: Path) -> None:
    document = {"a": [nan, 1.0, (inf,)], "b": {"c": -inf}}
    write_summary(tmp_path / "summary.json", document)
    for text in ((tmp_path / "summary.json").read_text(), format_json(document, indent=1)):
        assert json.loads(text, parse_constant=pytest.fail) == {"a": [None, 1.0, [None]], "b": {"c": None}}


FILES_OF_A_COMMAND = """
import os
from clutch_hil.command import run_main

def list_files():
    with open("result", "w") as file:
        file.write(f"{file.fileno() > 2} {[os.readlink(f'/proc/self/fd/{number}') for number in range(3)]}")

run_main(list_files)
"""


def test_a_stream_that_is_closed_is_no_other_file(tmp_path: Path) -> None:
    """What a library prints would be written into the file that has its number."""
    (tmp_path / "files.py").write_text(FILES_OF_A_COMMAND)
    command = f"exec {shlex.quote(sys.executable)} -m files <&- >&- 2>&-"
    assert subprocess.run(command, shell=True, cwd=tmp_path, timeout=PATIENCE, check=False).returncode == 0
    assert (tmp_path / "result").read_text() == f"True {['/dev/null'] * 3}"


def test_a_name_with_brackets_is_no_markup() -> None:
    with ActivityLine("waiting for [/x]", quiet=True) as line:
        line.update("reading [red]a[/b].csv")
    with progress_bar("[/x]", quiet=True) as progress:
        progress(1, 2)


def test_without_a_word_it_shows_what_there_is() -> None:
    result = CliRunner().invoke(make_application(), [])
    assert result.exit_code == 2
    assert "simulate" in result.output
    assert isinstance(result.exception, SystemExit)


ENDED_WHILE_IT_EXECUTES = """
import os
import sys
from clutch_hil import command

command.make_application = lambda: lambda: exec(f"import os, time\\nos.kill({os.getpid()}, {sys.argv[1]})\\ntime.sleep(60)")
command.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_who_ends_it_while_a_text_is_executed_has_its_exit_code(number: signal.Signals, tmp_path: Path) -> None:
    """As dataclasses do while modules load; `python -m` then ends by SIGINT after a KeyboardInterrupt that was caught."""
    (tmp_path / "ended.py").write_text(ENDED_WHILE_IT_EXECUTES)
    command = [sys.executable, "-m", "ended", str(int(number))]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, check=False,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # `nohup make test` ignores it
    )  # fmt: skip
    assert done.returncode == INTERRUPTED, done.stderr
    assert list_errors(done.stderr) == ["interrupted: nothing half-written is left, compiled kernels are stored"]


def test_a_calibration_beside_a_file_says_how_it_is_given_for_one_of_them() -> None:
    words = ("simulate", "--calibration", "mine.toml", "--plant-parameters", "rig.toml")
    refused = CliRunner().invoke(make_application(), words, prog_name="clutch-hil").exception
    assert isinstance(refused, InputError)
    assert "--calibration and --plant-parameters were both given" in str(refused)
    assert "use --plant-parameters or --controller-parameters" in str(refused)


def test_a_sweep_of_one_run_a_value_tells_no_deviation(tmp_path: Path) -> None:
    vary = ("--seconds", "1.5", "--vary", "friction_level.level=0.9:1.1:2", "--workers", "1", "--out", str(tmp_path))
    message = [
        CliRunner().invoke(make_application(), ["simulate", *vary, "--seeds", seeds]).stdout for seeds in ("1", "2")
    ]
    assert ["+-" in text for text in message] == [False, True]
