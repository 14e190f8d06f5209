"""Errors of users' code are told in one sentence with function, file and line; errors of the bench keep their traceback."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from clutch_hil.command import run_main
from protocols import user_code
from protocols.errors import InputError
from protocols.user_code import describe_error, find_user_line, locate_class, tell_node_failure
from protocols.user_file import load_user_file

SOURCE = """\
class Node:
    def show(self):
        return 1 / 0

    def read(self, path):
        return open(path)


def hand_on(function):
    return function()


"""


class _BenchNode:
    """A node of the bench, as far as its module says."""


_BenchNode.__module__ = "plant_sim.node.plant_node"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The module `lab_node` of a user's package, which offers it to the bench."""
    metadata = tmp_path / "lab_node-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: lab-node\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[clutch_hil.rigs]\nlab = lab_node:RIG\n")
    (tmp_path / "lab_node.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield tmp_path / "lab_node.py"
    sys.modules.pop("lab_node", None)


def _node() -> object:
    return importlib.import_module("lab_node").Node()


def test_the_line_of_a_user_is_told(file: Path) -> None:
    with pytest.raises(ZeroDivisionError) as raised:
        _node().show()  # type: ignore[attr-defined]
    place = f"Node.show of {file} line 3"
    assert find_user_line(raised.value) == place
    assert describe_error(raised.value) == f"ZeroDivisionError: division by zero, in {place}"


def test_an_error_of_the_bench_under_a_user_s_line_is_told_with_that_line(file: Path) -> None:
    hand_on = importlib.import_module("lab_node").hand_on
    with pytest.raises(AttributeError) as raised:
        hand_on(lambda: locate_class(5))  # type: ignore[arg-type]
    assert find_user_line(raised.value) == f"hand_on of {file} line 10"


def test_a_line_of_the_bench_is_none_of_a_user(file: Path) -> None:
    with pytest.raises(AttributeError) as raised:
        locate_class(5)  # type: ignore[arg-type]
    assert find_user_line(raised.value) == ""


def test_a_file_that_fails_while_it_is_loaded_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "my effect ü.py"
    path.write_text("A = 1\nB = A / 0\n", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"^the effect cannot be loaded: ZeroDivisionError: division by zero, in line 2$"
    ):
        load_user_file(path, "clutch_hil_effects", "the effect")


def test_a_node_that_fails_without_a_line_of_its_own_is_told_with_its_class(file: Path) -> None:
    with (
        pytest.raises(InputError, match=f"^the node Node of {file} raises TypeError: wrong$"),
        tell_node_failure(_node()),
    ):
        raise TypeError("wrong")


def test_a_bus_that_is_gone_is_no_fault_of_a_node(file: Path) -> None:
    with pytest.raises(OSError, match="gone"), tell_node_failure(_node()):
        raise OSError("gone")
    with pytest.raises(InputError, match=r"in Node\.read of"), tell_node_failure(_node()):
        _node().read(file / "none")  # type: ignore[attr-defined]


def test_an_error_of_a_node_of_the_bench_keeps_its_traceback() -> None:
    with pytest.raises(TypeError, match="wrong"), tell_node_failure(_BenchNode()):
        raise TypeError("wrong")


def test_a_command_of_a_user_that_fails_ends_with_a_sentence(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run_main(_node().show)  # type: ignore[attr-defined]
    assert ended.value.code == 2
    assert capsys.readouterr().err == (f"error: ZeroDivisionError: division by zero, in Node.show of {file} line 3\n")


def test_an_error_of_the_bench_in_a_command_is_not_hidden() -> None:
    with pytest.raises(AttributeError):
        run_main(lambda: locate_class(5))  # type: ignore[arg-type]


def test_the_groups_of_users_files_are_those_in_use() -> None:
    used = [file.read_text(encoding="utf-8") for file in Path(user_code.__file__).parents[1].glob("*/**/*.py")]
    for group in user_code.FILE_GROUPS:
        assert any(f'load_user_file(path, "{group}"' in text for text in used), group
