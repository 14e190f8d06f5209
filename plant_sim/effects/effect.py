"""Effect: one physical effect as a plug-in of the rig. A file defines one effect, EFFECT, and gives it its name.

A law is a plain function `law(s, c, p, x, h)` that Numba can compile. It reads and changes the signals `s` (signals.py). It
reads the rig's parameters `c` and the effect's own parameters `p`. It integrates the effect's states `x` over the step `h` [s];
with h = 0 it must leave them as they are. All values are in SI and have names.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numba import cfunc, from_dtype, types

from plant_sim.effects.display import Display
from plant_sim.effects.signals import HOOKS, SIGNALS_TYPE
from plant_sim.effects.start import Start, TypicalValues
from protocols.errors import InputError, suggest_closest
from protocols.files.parameters import Parameter
from protocols.files.units import to_si

Law = Callable[[Any, Any, Any, Any, float], None]
SECTIONS = ("Equation", "Assumptions", "Valid range", "Not modelled", "References")  # of an effect's docstring
MOST_VALUES = 100_000  # of a state: 5 s in the shortest steps of a bench
BLOCKS = ("valve", "hydraulics", "piston", "friction", "drive", "sensors", "fault")


@dataclass(frozen=True)
class Strength:
    """A parameter that switches the effect on: there is no effect at its value `off`.

    typical: a value often met in practice. off, typical and bounds are in `unit`.
    """

    name: str
    unit: str
    off: float
    typical: float
    bounds: tuple[float, float]
    source: str


@dataclass(frozen=True)
class Shape:
    """A parameter that shapes the effect but does not switch it on. typical and bounds are in `unit`."""

    name: str
    unit: str
    typical: float
    bounds: tuple[float, float]
    source: str

    @property
    def off(self) -> float:
        """Its value while the effect is off: the typical one."""
        return self.typical


@dataclass(frozen=True)
class State:
    """A state of an effect in `unit`: a scalar, or an array where `size` is above 1. It is 0 when the effect is switched on."""

    name: str
    unit: str
    size: int = 1


@dataclass(frozen=True, eq=False)
class Effect:
    """An effect: its block, its laws by hook, its parameters and states.

    rank: effects at a hook are called in this order, low first; 0 unless the law needs the results of other laws.
    excludes: names of effects that model the same part in a different way.
    rate: amount that it adds to the fastest rate of piston and cylinder [1/s], from the SI values of its own parameters and of
    those of the rig (by field of `c`); None adds nothing.
    candidate: whether the discrepancy workflow may name it.
    display: how it is shown.
    start: where a fit of its parameters begins.
    """

    block: str
    laws: Mapping[int, Law]
    parameters: tuple[Strength | Shape, ...]
    states: tuple[State, ...] = ()
    rank: int = 0
    excludes: tuple[str, ...] = ()
    rate: Callable[[Mapping[str, float], Mapping[str, float]], float] | None = None
    candidate: bool = True
    display: Display = field(default_factory=Display)
    start: Start = field(default_factory=TypicalValues)
    _laws: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)  # compiled ones, by hook and rig
    checked: set[Any] = field(default_factory=set, init=False, repr=False)  # rigs for which its laws were called dry

    def __post_init__(self) -> None:
        """Check the effect. Raises InputError."""
        if not self.laws or not all(hook in range(len(HOOKS)) for hook in self.laws):
            raise InputError(
                f"effect {self.block}: laws must be a table of one or more hooks (plant_sim/effects/signals.py)"
            )
        if not self.name.isidentifier():
            raise InputError(
                f"effect file {self.path}: {self.name!r} is not a valid name of an effect; allowed are letters, digits and _"
            )
        if self.block not in BLOCKS:
            raise InputError(f"effect {self.name}: block {self.block!r} is unknown; allowed are {', '.join(BLOCKS)}")
        if not any(isinstance(p, Strength) for p in self.parameters):
            raise InputError(f"effect {self.name} has no Strength, so it cannot be switched on")
        for p in self.parameters:
            if isinstance(p, Strength) and p.typical == p.off:
                raise InputError(f"effect {self.name}: {p.name} is off at its typical value {p.typical:g} {p.unit}")
            for value in (p.off, p.typical):
                try:
                    Parameter(f"{self.name}.{p.name}", value, p.unit, 0.0, p.bounds, p.source)
                except InputError as error:
                    raise InputError(f"effect {self.name}, parameter {p.name}: {error}") from None
        self._check_fields()
        for section in SECTIONS:
            if f"\n{section} " not in self.text:
                raise InputError(f"effect {self.name}: its file's docstring lacks {section!r}")
        if not isinstance(self.display, Display):
            raise InputError(f"effect {self.name}: display is {self.display!r}; a Display(...) is needed")
        if not isinstance(self.start, Start):
            raise InputError(
                f"effect {self.name}: start is {self.start!r}; a Start (plant_sim/effects/start.py) is needed"
            )
        names = [p.name for p in self.parameters]
        for name in self.start.parameters:
            if name not in names:
                raise InputError(
                    f"effect {self.name}: start sets {name!r}, which is not a parameter; {suggest_closest(name, names)}"
                )

    def _check_fields(self) -> None:
        """Raise InputError for invalid fields, for two fields of one name, and in a user's effect for the unit of a state."""
        if not isinstance(self.rank, int):
            raise InputError(f"effect {self.name}: rank is {self.rank!r}; a whole number is needed")
        if self.rate is not None and not callable(self.rate):
            raise InputError(f"effect {self.name}: rate is {self.rate!r}; a function rate(p, c) is needed")
        for kind, fields in (("parameters", self.parameters), ("states", self.states)):
            names = [one.name for one in fields]
            if odd := [name for name in names if not name.isidentifier()]:
                raise InputError(
                    f"effect {self.name}: {odd[0]!r} is not a valid name for its {kind}; allowed are letters, digits and _"
                )
            if twice := [name for name in names if names.count(name) > 1]:
                raise InputError(f"effect {self.name} has {names.count(twice[0])} {kind} {twice[0]!r}; allowed is one")
        for state in self.states:
            if not isinstance(state.size, int) or not 1 <= state.size <= MOST_VALUES:
                raise InputError(
                    f"effect {self.name}, state {state.name} has the size {state.size!r}; allowed are 1 to {MOST_VALUES}"
                )
        for state in () if self.comes_with_bench else self.states:  # some units would load pint, which takes long
            try:
                to_si(0.0, state.unit)
            except InputError as error:
                raise InputError(f"effect {self.name}, state {state.name}: {error}") from None

    @cached_property
    def name(self) -> str:
        """Name of the effect: that of its file, without `.py`."""
        return self.path.stem

    @cached_property
    def path(self) -> Path:
        """File that defines the effect."""
        return Path(inspect.getfile(next(iter(self.laws.values()))))

    @cached_property
    def comes_with_bench(self) -> bool:
        """Whether it is an effect of this package, not of a user."""
        return all((law.__module__ or "").startswith("plant_sim.") for law in self.laws.values())

    @cached_property
    def text(self) -> str:
        """Docstring of the file, with the sections of SECTIONS."""
        module = inspect.getmodule(next(iter(self.laws.values())))
        return inspect.getdoc(module) or ""

    @property
    def title(self) -> str:
        """First line of the docstring, without its full stop."""
        return self.text.partition("\n")[0].rstrip(".")

    @cached_property
    def strengths(self) -> tuple[Strength, ...]:
        """The parameters that switch the effect on."""
        return tuple(p for p in self.parameters if isinstance(p, Strength))

    @cached_property
    def switches(self) -> tuple[tuple[str, float], ...]:
        """Dotted name of each strength, and its value at which the effect is off, in its unit."""
        return tuple((f"{self.name}.{s.name}", s.off) for s in self.strengths)

    @cached_property
    def parameter_type(self) -> np.dtype:
        """Record type of the parameters, a double each."""
        return np.dtype([(p.name, np.float64) for p in self.parameters])

    @cached_property
    def state_type(self) -> np.dtype:
        """Record type of the states; one unused double where there is none, since Numba has no empty records."""
        fields = [(s.name, np.float64, (s.size,)) if s.size > 1 else (s.name, np.float64) for s in self.states]
        return np.dtype(fields or [("none", np.float64)])

    def declare_parameters(self) -> dict[str, Parameter]:
        """Parameters by dotted name, at the values at which the effect is off."""
        by_name = {f"{self.name}.{p.name}": p for p in self.parameters}
        return {name: Parameter(name, p.off, p.unit, 0.0, p.bounds, p.source) for name, p in by_name.items()}

    def list_typical_values(self) -> dict[str, float]:
        """Typical values by dotted name, each in its unit."""
        return {f"{self.name}.{p.name}": p.typical for p in self.parameters}

    def list_off_values(self) -> dict[str, float]:
        """Values of the strengths at which the effect is off, by dotted name, each in its unit."""
        return dict(self.switches)

    def find_address(self, hook: int, rig: Any) -> int:
        """Address of the compiled law of `hook` for a rig whose parameter record has the Numba type `rig`.

        Compiled laws of this package are kept on disk; those of a user's effect are compiled in each process. Raises InputError
        for a law that Numba cannot compile.
        """
        if (hook, rig) not in self._laws:
            records = SIGNALS_TYPE, rig, from_dtype(self.parameter_type), from_dtype(self.state_type)
            try:
                law = cfunc(types.void(*records, types.float64), cache=self.comes_with_bench, error_model="numpy")(
                    self.laws[hook]
                )
            except Exception as error:  # Numba raises many kinds
                lines = [line for line in str(error).splitlines() if line.strip() and "pipeline (step:" not in line]
                reason = self._find_unknown_field(hook, records) or (lines[0] if lines else type(error).__name__)
                raise InputError(f"effect {self.name} ({self.path}) cannot be compiled: {reason}") from None
            self._laws[hook, rig] = law
        return int(self._laws[hook, rig].address)  # valid as long as the compiled law is kept

    def _find_unknown_field(self, hook: int, records: tuple[Any, ...]) -> str | None:
        """A sentence about the first field that the law reads and its records lack; None where there is no such field."""
        tree = ast.parse(textwrap.dedent(inspect.getsource(self.laws[hook])))
        arguments = zip(inspect.signature(self.laws[hook]).parameters, records, strict=False)
        fields = {argument: list(record.fields) for argument, record in arguments}
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in fields:
                record, name = node.value.id, node.attr
                if name not in fields[record]:
                    return f"{record}.{name} is unknown; {suggest_closest(name, fields[record])}"
        return None
