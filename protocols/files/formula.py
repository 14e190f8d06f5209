"""Formula: evaluates a text such as "2 * x - 1". A text from a file is never run as code.

Grammar         numbers, names, + - * / and ** or ^ for a power, parentheses, function calls
"""

import ast
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from protocols.errors import suggest_closest

_LONGEST = 1000  # characters: a person does not write more
_LARGEST = 1e300  # of a constant: products with it are finite or infinite, never NaN
_OPERATORS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv, ast.Pow: np.power,
    ast.USub: operator.neg, ast.UAdd: operator.pos,
}  # fmt: skip
FUNCTIONS: Mapping[str, np.ufunc] = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "sinh": np.sinh,
    "cosh": np.cosh, "tanh": np.tanh, "arcsin": np.arcsin, "arccos": np.arccos, "arctan": np.arctan, "exp": np.exp,
    "log": np.log, "ln": np.log, "log10": np.log10, "abs": np.abs, "sqrt": np.sqrt, "pow": np.power, "sign": np.sign,
    "min": np.minimum, "max": np.maximum,
}  # fmt: skip


class Formula:
    """A formula by its `text`. names: variables in it, each once."""

    def __init__(self, text: str, further: Mapping[str, int] | None = None) -> None:
        """further: functions beside `FUNCTIONS` by name, with their number of arguments. Raises ValueError, a sentence."""
        shown = text if len(text) < 60 else text[:60] + "..."
        try:
            if len(text) > _LONGEST:
                raise ValueError(f"it has {len(text)} characters; allowed are {_LONGEST}")
            body = ast.parse(text.strip().replace("^", "**"), mode="eval").body
            self._body, self._further = body, dict(further or {})
            self.names = tuple(dict.fromkeys(self._list_names(body)))
        except (SyntaxError, RecursionError, MemoryError):
            raise ValueError(
                f"{shown!r} is not a formula; allowed are numbers, names, + - * / ^ and functions"
            ) from None
        except ValueError as error:
            raise ValueError(f"formula {shown!r}: {error}") from None

    def compute(self, values: Mapping[str, Any], further: Mapping[str, Callable[..., Any]] | None = None) -> Any:
        """Return the number, or the array (n,), for the `values` of all names.

        further: implementations of the functions declared as `further` in `__init__`.
        """
        with np.errstate(all="ignore"):
            return self._evaluate(self._body, values, {**FUNCTIONS, **(further or {})})

    def _list_names(self, node: ast.expr) -> Iterator[str]:
        """Yield the names in a node. Raises ValueError for syntax that a formula must not have."""
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                if not abs(number) < _LARGEST:
                    raise ValueError(f"a number in it is not below {_LARGEST:g}")
            case ast.Name(id=name):
                yield name
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
                yield from self._list_names(operand)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                yield from self._list_names(left)
                yield from self._list_names(right)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                self._check_call(name, len(arguments))
                for argument in arguments:
                    yield from self._list_names(argument)
            case _:
                raise ValueError(f"{ast.unparse(node)!r} is not allowed in it; see docs/recordings.md")

    def _check_call(self, name: str, given: int) -> None:
        counts = {**{known: ufunc.nin for known, ufunc in FUNCTIONS.items()}, **self._further}
        if name not in counts:
            raise ValueError(f"function {name!r} is unknown; {suggest_closest(name, list(counts))}")
        if given != counts[name]:
            raise ValueError(f"{name} has {given} arguments; allowed is {counts[name]}")

    def _evaluate(self, node: ast.expr, values: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
        match node:
            case ast.Name(id=name):
                return values[name]
            case ast.UnaryOp(op=op, operand=operand):
                return _OPERATORS[type(op)](self._evaluate(operand, values, functions))
            case ast.BinOp(left=left, op=op, right=right):
                return _OPERATORS[type(op)](
                    self._evaluate(left, values, functions), self._evaluate(right, values, functions)
                )
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return functions[name](*(self._evaluate(argument, values, functions) for argument in arguments))
        return np.float64(node.value)  # type: ignore[attr-defined]  # `_list_names` allows no other node here
