"""Nothing that is read runs code: no module of the project loads pickles, or anything that is one in disguise."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("protocols", "plant_sim", "rt_controller", "clutch_hil", "benchmarks", "deploy", "docs")
# modules that load objects by running what a file says
MODULES = {"pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "marshal", "shelve", "jsonpickle"}
CALLS = {"eval", "exec", "compile", "__import__"}  # builtins that run text
READERS = {"read_pickle", "to_pickle", "load_module", "unsafe_load", "full_load"}  # of pandas, imp, yaml
ALLOWED = {
    # functions that are written as text are compiled: the text is the project's own, no file's or message's
    "protocols/can/frames.py": {"exec", "compile"},
}


def list_dangers(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """What a module uses that loads objects or runs text: its name, and the line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names if alias.name.split(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").split(".")[0] in MODULES:
            yield str(node.module), node.lineno
        elif isinstance(node, ast.Call):
            called = node.func
            if isinstance(called, ast.Name) and called.id in CALLS:
                yield called.id, node.lineno
            if isinstance(called, ast.Attribute) and called.attr in READERS:
                yield called.attr, node.lineno
            if isinstance(called, ast.Attribute) and called.attr == "import_module" and node.args:
                name = node.args[0]
                if isinstance(name, ast.Constant) and str(name.value).split(".")[0] in MODULES:
                    yield str(name.value), node.lineno
            for keyword in node.keywords:
                value = keyword.value
                if keyword.arg == "allow_pickle" and not (isinstance(value, ast.Constant) and value.value is False):
                    yield "allow_pickle", node.lineno


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_module_loads_pickles_or_runs_text(folder: str) -> None:
    files = list((ROOT / folder).rglob("*.py"))
    assert files
    result = {
        f"{path.relative_to(ROOT)}:{line} {name}"
        for path in files
        for name, line in list_dangers(ast.parse(path.read_text(encoding="utf-8")))
        if name not in ALLOWED.get(path.relative_to(ROOT).as_posix(), ())
    }
    assert not result


@pytest.mark.parametrize(
    "text",
    [
        "import pickle", "import pickle as p", "from pickle import loads", "from joblib import load", "import os, dill",
        "def f():\n    import shelve", "import marshal", "np.load(f, allow_pickle=True)", "np.load(f, allow_pickle=flag)",
        "pd.read_pickle(f)", "eval(text)", "exec(text)", "importlib.import_module('pickle')", "import cloudpickle.compat",
        "yaml.unsafe_load(f)",
    ],
)  # fmt: skip
def test_the_search_finds_them(text: str) -> None:
    assert list(list_dangers(ast.parse(text)))


@pytest.mark.parametrize(
    "text", ["np.load(f, allow_pickle=False)", "import json", "from .pickle import x", "re.compile(x)"]
)
def test_the_search_finds_nothing_else(text: str) -> None:
    assert not list(list_dangers(ast.parse(text)))


def test_what_is_allowed_is_still_there() -> None:
    for name, allowed in ALLOWED.items():
        used = {danger for danger, _ in list_dangers(ast.parse((ROOT / name).read_text(encoding="utf-8")))}
        assert allowed <= used
