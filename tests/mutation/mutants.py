"""Mutants: changes of a comparison, an operator, a condition, a constant or a statement of a module.

A test that takes the module as its one argument is a check: a mutant can be put in the module's place.
"""

import ast
import importlib.util
import inspect
import signal
import sys
from collections import Counter
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from enum import EnumMeta
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest

NAME = "mutant_of_clutch_hil"
TESTS = Path(__file__).parents[1]
_BLOCKED = 10.0  # s after which a mutant that does not compute counts as blocked
LONGEST = 10.0  # s of CPU time for the checks of one mutant: one that never ends is killed

Check = Callable[[ModuleType], None]

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
DEEP_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv}
EXCHANGED = {"min": "max", "max": "min"}
_STATEMENTS = ast.Assign, ast.AugAssign, ast.Expr, ast.Return, ast.Continue, ast.Break


class Mutant(NamedTuple):
    """A change of a syntax tree: `holder`, a node or a list of nodes, gets `new` in the place `key`. label: what it is."""

    label: str
    holder: Any
    key: str | int
    new: object


class TooLongError(Exception):
    """The checks of a mutant have taken too long."""


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


def list_changes(node: Any, holder: Any, key: str | int) -> Iterator[tuple[str, Any, str | int, object]]:
    """Yield the mutations of one node, which is at `key` of `holder`: a description, and the fields of a Mutant."""
    if isinstance(node, ast.Compare):
        for other in COMPARISONS.get(type(node.ops[0]), ()):
            yield f"{type(node.ops[0]).__name__} to {other.__name__}", node.ops, 0, other()
    elif isinstance(node, ast.BoolOp):
        other_bool = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield f"{type(node.op).__name__} to {other_bool.__name__}", node, "op", other_bool()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "Not dropped", holder, key, node.operand
    elif isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in OPERATORS:
        other_op = OPERATORS[type(node.op)]
        yield f"{type(node.op).__name__} to {other_op.__name__}", node, "op", other_op()
    elif isinstance(node, (ast.If, ast.IfExp)):
        for value in (True, False):
            yield f"condition to {value}", node, "test", ast.Constant(value)
    elif isinstance(node, ast.Constant):
        for changed in list_constants(node.value):
            yield f"{node.value!r} to {changed!r}", node, "value", changed


def list_deep_changes(
    node: Any, holder: Any, key: str | int, enumerations: dict[str, EnumMeta]
) -> Iterator[tuple[str, Any, str | int, object]]:
    """Yield further mutations of one node: statements, operands and calls left out, names of `enumerations` exchanged."""
    if isinstance(node, ast.Compare):
        for place, op in enumerate(node.ops[1:], 1):
            for other in COMPARISONS.get(type(op), ()):
                yield f"{place}: {type(op).__name__} to {other.__name__}", node.ops, place, other()
    elif isinstance(node, ast.BoolOp):
        for place in range(len(node.values)):
            rest = node.values[:place] + node.values[place + 1 :]
            yield f"operand {place} dropped", holder, key, rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Invert)):
        yield f"{type(node.op).__name__} dropped", holder, key, node.operand
    elif isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in DEEP_OPERATORS:
        other_op = DEEP_OPERATORS[type(node.op)]
        yield f"{type(node.op).__name__} to {other_op.__name__}", node, "op", other_op()
    elif isinstance(node, ast.While):
        yield "condition to False", node, "test", ast.Constant(False)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id in EXCHANGED:
            yield f"{node.func.id} to {EXCHANGED[node.func.id]}", node.func, "id", EXCHANGED[node.func.id]
        elif node.func.id == "abs":
            yield "abs dropped", holder, key, node.args[0]
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in enumerations:
        names = list(enumerations[node.value.id].__members__)
        if node.attr in names:
            other_name = names[(names.index(node.attr) + 1) % len(names)]
            yield f"{node.attr} to {other_name}", node, "attr", other_name
    elif isinstance(node, ast.For) and isinstance(node.iter, ast.Call) and getattr(node.iter.func, "id", "") == "range":
        stop = 0 if len(node.iter.args) == 1 else 1
        less = ast.BinOp(node.iter.args[stop], ast.Sub(), ast.Constant(1))
        yield "one turn less", node.iter.args, stop, less
    elif isinstance(node, _STATEMENTS) and isinstance(holder, list):
        yield from _list_deletions(node, holder, key)


def _list_deletions(node: Any, holder: list[Any], key: Any) -> Iterator[tuple[str, Any, str | int, object]]:
    """Yield mutants without a statement, or without one of the targets of an assignment to several."""
    if isinstance(node, ast.Expr) and not isinstance(node.value, ast.Call):
        return  # a docstring
    if isinstance(node, ast.Return) and key == len(holder) - 1 and (node.value is None or _is_none(node.value)):
        return  # at the end of a function it does nothing
    yield "deleted", holder, key, ast.Pass()
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
        targets, values = node.targets[0].elts, node.value.elts
        for place in range(len(targets) if len(targets) == len(values) else 0):
            left = ast.Tuple(targets[:place] + targets[place + 1 :], ast.Store())
            right = ast.Tuple(values[:place] + values[place + 1 :], ast.Load())
            yield f"target {place} dropped", holder, key, ast.Assign([left], right)


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def read_source(module: ModuleType) -> str:
    return Path(str(module.__file__)).read_text()


def parse_plain(module: ModuleType, source: str | None = None) -> ast.Module:
    """Return the syntax tree of a module without compilation of its functions, so that a mutant needs no compiler.

    source: instead of the module's own.
    """
    tree = ast.parse(read_source(module) if source is None else source)
    tree.file = module.__file__  # type: ignore[attr-defined]  # modules look for files beside them
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            node.decorator_list = [one for one in node.decorator_list if not _compiles(one)]
    return tree


def _compiles(decorator: ast.expr) -> bool:
    return getattr(decorator.func if isinstance(decorator, ast.Call) else decorator, "id", "") == "njit"


def make_mutants(module: ModuleType, tree: ast.Module, only: Container[str] | None = None) -> list[Mutant]:
    """Return all mutants of a module with the syntax tree `tree`, each with one change. `only`: functions that change."""
    lines = read_source(module).splitlines()
    enumerations = {name: value for name, value in vars(module).items() if isinstance(value, EnumMeta)}
    mutants, seen = [], Counter[str]()
    for node, holder, key, function in _walk(tree):
        if only is not None and function not in only:
            continue
        changes = list(list_changes(node, holder, key))
        if isinstance(holder, ast.Subscript) and key == "slice":
            changes = [change for change in changes if change[0] != "0 to -1"]  # of one element it is the same
        changes += list_deep_changes(node, holder, key, enumerations)
        for what, *change in changes:
            if what == "deleted" and not function:
                continue  # a definition
            line = lines[node.lineno - 1].split("#")[0].strip()
            label = f"{line}: column {node.col_offset}: {what}"
            seen[label] += 1
            mutants.append(Mutant(f"{label} ({seen[label]})" if seen[label] > 1 else label, *change))
    return mutants


def _walk(tree: ast.Module) -> Iterator[tuple[Any, Any, str | int, str]]:
    """Yield the nodes of a tree but annotations, with their places, and the function or `Class.method` they are in."""

    def visit(parent: ast.AST, function: str, owner: str = "") -> Iterator[tuple[Any, Any, str | int, str]]:
        for field, value in ast.iter_fields(parent):
            if field in ("annotation", "returns", "decorator_list"):
                continue
            places: list[tuple[Any, Any, str | int]] = []
            if isinstance(value, list):
                places = [(node, value, place) for place, node in enumerate(value)]
            elif isinstance(value, ast.AST):
                places = [(value, parent, field)]
            for node, holder, key in places:
                if isinstance(node, ast.AST):
                    inner = function or (owner + node.name if isinstance(node, ast.FunctionDef) else "")
                    if hasattr(node, "lineno"):
                        yield node, holder, key, inner
                    yield from visit(node, inner, f"{node.name}." if isinstance(node, ast.ClassDef) else owner)

    yield from visit(tree, "")


@contextmanager
def mutated(tree: ast.Module, mutant: Mutant) -> Iterator[ast.Module]:
    """The tree with the change of a mutant, for as long as the context lasts."""
    holder, key = mutant.holder, mutant.key
    old = holder[key] if isinstance(holder, list) else getattr(holder, str(key))
    _put(holder, key, mutant.new)
    if isinstance(mutant.new, (ast.expr, ast.stmt)):
        ast.fix_missing_locations(mutant.new)
    try:
        yield tree
    finally:
        _put(holder, key, old)


def _put(holder: Any, key: Any, value: object) -> None:
    if isinstance(holder, list):
        holder[key] = value
    else:
        setattr(holder, key, value)


def load_mutant(tree: ast.Module) -> ModuleType:
    """Return the mutant as a module. All exceptions of its source are raised."""
    module = ModuleType(NAME)
    module.__file__ = getattr(tree, "file", None)
    sys.modules[NAME] = module  # dataclasses look their module up
    try:
        exec(compile(tree, f"<{NAME}>", "exec"), module.__dict__)
    finally:
        del sys.modules[NAME]
    return module


def load_checks(files: Sequence[str], argument: str) -> list[Check]:
    """Return the tests of files, named from the folder of all tests, that have the module as their only `argument`."""
    return [check for file in files for check in _load_checks(file, argument)]


def _load_checks(file: str, argument: str) -> list[Check]:
    spec = importlib.util.spec_from_file_location(f"{argument}_checks", TESTS / file)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)  # plain asserts: quicker than those pytest rewrites
    spec.loader.exec_module(module)
    functions = [function for name, function in vars(module).items() if name.startswith("test_")]
    return [function for function in functions if list(inspect.signature(function).parameters) == [argument]]


@contextmanager
def _bounded(seconds: float) -> Iterator[None]:
    """Raise TooLongError in what takes longer than `seconds` of CPU time, or is blocked."""

    def end(*_: object) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGPROF, end), signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, _BLOCKED + 20.0 * seconds)  # the machine may be busy
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGPROF, before[0])
        signal.signal(signal.SIGALRM, before[1])


def run_checks(module: ModuleType, checks: Sequence[Check]) -> Iterator[int]:
    """Run the checks, one at a time, and yield the place of each before it runs; what fails is raised.

    What a check has put in the place of the module's own functions is taken back: the next one finds the module as it was.
    """
    own = dict(vars(module))
    for place, check in enumerate(checks):
        yield place
        vars(module).update(own)
        check(module)


def is_killed(tree: ast.Module, by: list[Check], longest: float = LONGEST) -> bool:
    """Whether a check fails or takes more than `longest` [s of CPU time], or the mutant cannot even be loaded.

    The check that fails is the first of `by` afterwards: it is likely to kill the next mutant, too.
    """
    place = 0
    try:
        with _bounded(longest):
            for place in run_checks(load_mutant(tree), by):  # noqa: B007  # used after an exception
                pass
    except (Exception, pytest.fail.Exception):
        by.insert(0, by.pop(place))
        return True
    return False
