"""The documentation's Python runs as printed, its links lead somewhere, and every file that prose names exists."""

import ast
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer

from clutch_hil.bench.effect_sheets.effect_page import rewrite_page
from clutch_hil.bench.effect_sheets.effect_text import sort_effects
from clutch_hil.command import make_application
from plant_sim.effects.catalogue import load_effects
from protocols.telemetry import keys

ROOT = Path(__file__).parents[1]
NOTES = ROOT / "docs" / "battery" / "notes.md"  # a part of docs/battery.md, from where its links lead
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "SECURITY.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if page != NOTES),
]
FOLDERS = ("protocols", "plant_sim", "rt_controller", "clutch_hil", "benchmarks", "tests", "deploy", "docs")
PATH = re.compile(r"(?<![\w./~<>*-])(?:[\w.][\w.-]*/)*\w[\w.-]*\.(?:py|md|toml|dbc|csv|png)(?![\w/])")
LINES_OF_TWO_SCREENS = 63
MADE_BY_THE_READER = {"valve_dither.py"}  # of docs/effects.md


def test_the_code_of_the_friction_page_runs() -> None:
    page = (ROOT / "docs" / "friction.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 5
    for block in blocks:
        exec(compile(block, "docs/friction.md", "exec"), names)
    assert names["trace"].force.max() > 0.0  # type: ignore[attr-defined]
    assert names["motion"].friction.min() >= 0.0  # type: ignore[attr-defined]
    sliding, small = names["sliding"], names["small"]
    told = f"{sliding.damping:.0f} Ns/m, {1e3 * sliding.lag:.1f} ms: "  # type: ignore[attr-defined]
    told += f"|{sliding.needed_damping(30.0):.0f} Ns/m: a resonance"  # type: ignore[attr-defined]
    told += "|" + ", ".join(f"{value:.2g}" for value in small.stiffness).replace("e+0", "e") + " N/m"  # type: ignore[attr-defined]
    told += "| and " + ", ".join(f"{value:.0f}" for value in small.damping) + " Ns/m"  # type: ignore[attr-defined]
    for words in told.split("|"):
        assert words in page


def test_the_telemetry_page_has_the_keys() -> None:
    table = [line for line in str(keys.__doc__).splitlines() if line.startswith("|")]
    assert len(table) == len(keys.LEAVES) + 2
    assert "\n".join(table) in (ROOT / "docs" / "telemetry.md").read_text(encoding="utf-8")


def test_the_effects_page_is_what_the_command_writes() -> None:
    page = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    assert rewrite_page(page, sort_effects(load_effects().values())) == page, (
        "clutch-hil effects --write docs/effects.md"
    )


def test_the_readme_is_two_screens_and_shows_as_many_columns_as_a_run_has() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(readme.splitlines()) <= LINES_OF_TWO_SCREENS
    tables = (ROOT / "docs" / "columns.md").read_text(encoding="utf-8").split("\n## ")
    rows = {table.partition("\n")[0]: len(re.findall(r"^\| `", table, re.MULTILINE)) for table in tables}
    demand = 1  # torque_demand_nm
    columns = rows["Plant with one clutch"] + demand + rows["Controller"] + 2 * rows["Timing"]
    assert f"(12000 samples, {columns} columns)" in readme


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_command_and_option_that_a_page_shows_exists(page: Path) -> None:
    if page.name == "CHANGELOG.md":  # it also names what is gone
        return
    commands: Any = typer.main.get_command(make_application())
    options = {
        name: {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        for name, command in commands.commands.items()
    }
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    names = "|".join(options)
    shown = re.findall(rf"clutch-hil +([a-z][a-z-]*)([^`\n#]*)|`({names}) ([^`\n#]*)`", text)
    wrong = []
    for name, rest in [(one or other, first or second) for one, first, other, second in shown]:
        known = options.get(name, set()) | {"--help"}
        wrong += [name] if name not in options else []
        wrong += [f"{name} {option}" for option in re.findall(r"(?<!\S)(--[a-z-]+)", rest) if option not in known]
    assert not wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files_and_headings(page: Path) -> None:
    missing = []
    for link, heading in re.findall(r"\]\(([^)#]*)(?:#([^)]*))?\)", page.read_text(encoding="utf-8")):
        target = page.parent / link if link else page
        if "://" not in link and (not target.exists() or (heading and heading not in list_headings(target))):
            missing.append(f"{link}#{heading}")
    assert not missing


@cache
def list_headings(page: Path) -> set[str]:
    """The headings of a page as links name them."""
    lines = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", line.lower()).replace(" ", "-") for line in lines}


@pytest.mark.parametrize("folder", FOLDERS)
def test_sources_name_pages_that_a_clone_has(folder: str) -> None:
    """Also in strings of the code, such as the source of a parameter."""
    pages = {page.name for page in PAGES} | {NOTES.name}
    missing = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in list_sources(folder)
        for name in re.findall(r"[\w./-]*\b\w+\.md\b", path.read_text(encoding="utf-8"))
        if Path(name).name not in pages or Path(name).parent.name == "design"
    }
    assert not missing


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_file_that_prose_names_exists(folder: str) -> None:
    assert list(list_sources(folder))
    missing = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in list_sources(folder)
        for name in PATH.findall(read_prose(path))
        if not exists(name, path)
    }
    assert not missing


def test_a_file_that_is_missing_is_seen() -> None:
    page = ROOT / "docs" / "rig.md"
    names = PATH.findall("`plant_sim/blocks/nothing.py`, (nowhere.py), blocks/nothing.toml; plant_sim/blocks/oil.py.")
    assert [exists(name, page) for name in names] == [False, False, False, True]


def list_sources(folder: str) -> Iterator[Path]:
    """The files below a folder of the repository that have prose."""
    for path in (ROOT / folder).rglob("*.*"):
        if path.suffix in (".py", ".toml", ".md", ".dbc", ".sh") and "__pycache__" not in path.parts:
            yield path


def read_prose(path: Path) -> str:
    """The docstrings and comments of a Python file; the whole text of any other."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return text
    with tokenize.open(path) as file:
        comments = [token.string for token in tokenize.generate_tokens(file.readline) if token.type == tokenize.COMMENT]
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    docstrings = [ast.get_docstring(node) or "" for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]
    return "\n".join(comments + docstrings)


def exists(name: str, path: Path) -> bool:
    """Whether the file that prose of `path` calls `name` is there, by its path from the root or from the folder of `path`, or
    by the end of its path.

    A path that begins with no folder of the repository, a capital placeholder, and what has another suffix than .py or .md
    and no folder, such as `model.toml`, is the reader's own.
    """
    first, last = name.partition("/")[0], Path(name)
    if last.stem.isupper() or name in MADE_BY_THE_READER:
        return True
    if "/" not in name and last.suffix not in (".py", ".md"):
        return True
    if "/" in name and first not in list_folders():
        return True
    return (
        (ROOT / name).exists()
        or (path.parent / name).exists()
        or any(f"/{one}".endswith(f"/{name}") for one in list_files())
    )


@cache
def list_files() -> tuple[str, ...]:
    """Paths of the files in the folders of the repository, from its root."""
    result = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if "__pycache__" not in path.parts]
    return tuple(path.relative_to(ROOT).as_posix() for path in result if path.is_file())


@cache
def list_folders() -> set[str]:
    """Names of the folders of the repository."""
    return {part for file in list_files() for part in Path(file).parts[:-1]}
