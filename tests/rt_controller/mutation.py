"""Mutation testing: a change of a comparison, an operator, a condition or a constant of a module must be noticed by its tests.

A test that takes the module as its one argument is a check: a mutant can be put in the module's place.
"""

import ast
import copy
import importlib.util
import inspect
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import pytest

NAME = "rt_controller_mutant"

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
}


class Mutant(NamedTuple):
    """A changed syntax tree, and a label of the change."""

    label: str
    tree: ast.Module


def list_constants(value: object) -> list[object]:
    """Return the values with which a mutant replaces a constant."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1, value - 1]
    if isinstance(value, float):
        return [value * 1.01, value * 0.99] if value else [1.0, -1.0]
    if isinstance(value, bytes):
        return [value[:-1] + b"\x01"]
    return []  # docstrings, formats, annotations


def list_changes(node: ast.AST) -> Iterator[tuple[str, Callable[[ast.AST], ast.AST]]]:
    """Yield all mutations of one node: a description, and a function that returns the changed node."""

    def assign(**fields: object) -> Callable[[ast.AST], ast.AST]:
        def apply(target: ast.AST) -> ast.AST:
            for name, value in fields.items():
                setattr(target, name, value)
            return target

        return apply

    if isinstance(node, ast.Compare):
        for other in COMPARISONS.get(type(node.ops[0]), ()):
            yield f"{type(node.ops[0]).__name__} to {other.__name__}", assign(ops=[other(), *node.ops[1:]])
    elif isinstance(node, ast.BoolOp):
        other_bool = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield f"{type(node.op).__name__} to {other_bool.__name__}", assign(op=other_bool())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "Not dropped", lambda target: target.operand  # type: ignore[attr-defined]
    elif isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in OPERATORS:
        other_op = OPERATORS[type(node.op)]
        yield f"{type(node.op).__name__} to {other_op.__name__}", assign(op=other_op())
    elif isinstance(node, (ast.If, ast.IfExp)):
        for value in (True, False):
            yield f"condition to {value}", assign(test=ast.Constant(value))
    elif isinstance(node, ast.Constant):
        for value in list_constants(node.value):
            yield f"{node.value!r} to {value!r}", assign(value=value)


def make_plain_source(module: ModuleType) -> str:
    """Return the source of a module without compilation of its functions, so that a mutant needs no compiler."""
    return Path(str(module.__file__)).read_text().replace("@njit\n", "")


def make_mutants(source: str) -> Iterator[Mutant]:
    """Yield all mutants of a module, each with one change."""
    original = ast.parse(source)
    lines = source.splitlines()
    annotations = {
        id(part) for node in ast.walk(original) if isinstance(node, ast.AnnAssign) for part in ast.walk(node.annotation)
    }
    for index, node in enumerate(ast.walk(original)):
        if id(node) in annotations:
            continue
        for what, apply in list_changes(node):
            tree = copy.deepcopy(original)
            target = list(ast.walk(tree))[index]
            replacement = apply(target)
            if replacement is not target:
                _replace(tree, target, replacement)
            line = lines[node.lineno - 1].split("#")[0].strip()  # type: ignore[attr-defined]
            yield Mutant(f"{line}: column {node.col_offset}: {what}", ast.fix_missing_locations(tree))  # type: ignore[attr-defined]


def _replace(tree: ast.AST, target: ast.AST, replacement: ast.AST) -> None:
    for parent in ast.walk(tree):
        for field, value in ast.iter_fields(parent):
            if value is target:
                setattr(parent, field, replacement)
            elif isinstance(value, list) and target in value:
                value[value.index(target)] = replacement


def load_mutant(tree: ast.Module) -> ModuleType:
    """Return the mutant as a module. All exceptions of its source are raised."""
    module = ModuleType(NAME)
    sys.modules[NAME] = module  # dataclasses look their module up
    try:
        exec(compile(tree, f"<{NAME}>", "exec"), module.__dict__)
    finally:
        del sys.modules[NAME]
    return module


def load_checks(files: Sequence[str], argument: str) -> list[Callable[[ModuleType], None]]:
    """Return the tests of files in this folder that have the module as their only `argument`."""
    return [check for file in files for check in _load_checks(file, argument)]


def _load_checks(file: str, argument: str) -> list[Callable[[ModuleType], None]]:
    spec = importlib.util.spec_from_file_location(f"{argument}_checks", Path(__file__).with_name(file))
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)  # plain asserts: quicker than those pytest rewrites
    spec.loader.exec_module(module)
    functions = [function for name, function in vars(module).items() if name.startswith("test_")]
    return [function for function in functions if list(inspect.signature(function).parameters) == [argument]]


def is_killed(tree: ast.Module, by: list[Callable[[ModuleType], None]]) -> bool:
    """Whether a check fails, or the mutant cannot even be loaded."""
    try:
        module = load_mutant(tree)
        for check in by:
            check(module)
    except (Exception, pytest.fail.Exception):
        return True
    return False


def find_survivors(module: ModuleType, files: Sequence[str], argument: str) -> tuple[int, list[str]]:
    """Return the number of mutants of a module, and the labels of those that no test of `files` kills."""
    population, by = list(make_mutants(make_plain_source(module))), load_checks(files, argument)
    return len(population), [mutant.label for mutant in population if not is_killed(mutant.tree, by)]
