"""Commands of other packages: one that cannot be used is told in a line, and the others go on working."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from clutch_hil.command import make_application

GOOD = "def register(app):\n    app.command()(greet)\n\ndef greet():\n    print('hello')\n"
BROKEN = {
    "raises": ("raise RuntimeError('boom\\nbang')", "cannot be loaded from {}: RuntimeError: boom bang"),
    "ends": ("import sys; sys.exit(3)", "cannot be loaded from {}: SystemExit: 3"),
    "lacking": ("import nowhere_to_be_found", "cannot be loaded from {}: ModuleNotFoundError: No module named 'nowhere_"),
    "syntax": ("def", r"cannot be loaded from {}: SyntaxError: invalid syntax"),
    "empty": ("", r"of {} has no function register\(app\)"),
    "number": ("register = 5", r"of {} has no function register\(app\)"),
    "late": ("def register(app): raise ValueError('x')", "of {} cannot be registered: ValueError: x"),
    "typed": (
        GOOD.replace("greet", "shout").replace("():", "(one: int | str):"),
        "of {} cannot be registered: AssertionError: Typer currently doesn't support Union types",
    ),
    "taken": (
        GOOD.replace("greet", "effects"),
        "of {} registers 'effects', which the package clutch-hil has as well, by clutch_hil.commands.effects; allowed",
    ),
}  # fmt: skip


def install(site: Path, package: str, points: dict[str, str], group: str = "clutch_hil.commands") -> None:
    """Make what pip would: the metadata of a package with entry points, places by name."""
    metadata = site / f"{package}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Name: {package}\nVersion: 1.0\n", encoding="utf-8")
    lines = [f"[{group}]", *(f"{name} = {place}" for name, place in points.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize("kind", BROKEN)
def test_a_command_that_cannot_be_used_is_left_out_and_told(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text, reason = BROKEN[kind]
    (tmp_path / f"lab_{kind}.py").write_text(text, encoding="utf-8")
    (tmp_path / "lab_good.py").write_text(GOOD, encoding="utf-8")
    install(tmp_path, "lab_tools", {"aaa": f"lab_{kind}", "zzz": "lab_good"})
    monkeypatch.syspath_prepend(str(tmp_path))
    app = make_application()
    (line,) = capsys.readouterr().err.splitlines()
    place = f"lab_{kind} of the package lab_tools"
    assert re.fullmatch(f"warning: command aaa {reason.format(place)}.*; it is left out", line), line
    shown = CliRunner().invoke(app, ["--help"])
    assert shown.exit_code == 0
    assert "simulate" in shown.output
    assert CliRunner().invoke(app, ["greet"]).output == "hello\n"
    listed = CliRunner().invoke(app, ["effects", "--json"])
    assert listed.exit_code == 0
    assert listed.output.startswith("["), "the bench's own command stays"


def test_of_two_packages_with_one_name_of_a_command_both_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one", "two"):
        (tmp_path / f"lab_{name}.py").write_text(GOOD, encoding="utf-8")
        install(tmp_path, f"lab_{name}", {f"greet_{name}": f"lab_{name}"})
    monkeypatch.syspath_prepend(str(tmp_path))
    app = make_application()
    (line,) = capsys.readouterr().err.splitlines()
    assert "lab_two of the package lab_two registers 'greet', which the package lab_one has as well" in line
    assert CliRunner().invoke(app, ["greet"]).output == "hello\n"
