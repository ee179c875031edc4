"""Straight-line arithmetic, written down once and run on floats or on lanes.

The formulas of one chain are recorded as a list of elementary operations in which the
chain's zeros and ones have vanished. The list is compiled to a Python function of
floats, many times faster for one posture than small arrays are, or to one of array
operations in preallocated memory, for thousands of postures side by side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import CodeType
from typing import Any

import numpy as np

__all__ = ["FloatCode", "LaneCode", "LaneKernel", "Number", "Program", "Value"]

_FLOAT_CODE = {
    "add": "({0} + {1})",
    "subtract": "({0} - {1})",
    "multiply": "({0} * {1})",
    "divide": "({0} / {1})",
    "sin": "sin({0})",
    "cos": "cos({0})",
    "sqrt": "sqrt({0})",
    "maximum": "({0} if {0} > {1} else {1})",
    "minimum": "({0} if {0} < {1} else {1})",
    "is_free": (
        "(0.0 if ({0} <= {1} and {3} < 0.0) or ({0} >= {2} and {3} > 0.0) else 1.0)"
    ),
}
_REPEATS_OPERANDS = ("maximum", "minimum", "is_free")
"""Code that names an operand twice, so that no expression may stand in its place."""
_LONGEST = 400
"""Characters of an expression beyond which it gets a name of its own."""


@dataclass(frozen=True, slots=True)
class Value:
    """Result of one operation of a program, or its negative, which costs nothing."""

    program: Program
    index: int
    is_negative: bool = False

    def __neg__(self) -> Value:
        return Value(self.program, self.index, not self.is_negative)

    def __add__(self, other: Number) -> Number:
        return self.program.sum_of(self, other)

    def __sub__(self, other: Number) -> Number:
        return self.program.sum_of(self, -other)

    def __mul__(self, other: Number) -> Number:
        return self.program.product_of(self, other)

    def __rsub__(self, other: float) -> Number:
        return self.program.sum_of(-self, other)

    __radd__ = __add__
    __rmul__ = __mul__


FloatCode = Callable[..., tuple[float, ...]]
"""A program compiled for floats."""
Number = Value | float
"""What programs calculate with: constants fold away while they are recorded."""


class Program:
    """Operations recorded so far.

    Parameters
    ----------
    n_inputs
        How many numbers the compiled function takes.
    """

    def __init__(self, n_inputs: int) -> None:
        self._n_inputs = n_inputs
        self._steps: list[tuple[str, tuple[int, ...]]] = [("input", ())] * n_inputs
        self._constants: dict[int, float] = {}
        self._index: dict[object, int] = {}
        self.outputs: Sequence[Number] = ()
        """What the compiled function returns."""

    def inputs(self) -> list[Value]:
        """Return what the function will be given, in order."""
        return [Value(self, i) for i in range(self._n_inputs)]

    def sum_of(self, a: Value, b: Number) -> Number:
        """Record ``a + b``."""
        if isinstance(b, Value):
            if a.is_negative and not b.is_negative:
                a, b = b, a
            if a.is_negative == b.is_negative:
                total = self._step("add", *sorted((a.index, b.index)))
                return -total if a.is_negative else total
            return self._step("subtract", a.index, b.index)
        if b == 0.0:
            return a
        if a.is_negative:
            return self._step("subtract", self._constant(b), a.index)
        return self._step("add", a.index, self._constant(b))

    def product_of(self, a: Value, b: Number) -> Number:
        """Record ``a * b``."""
        if isinstance(b, Value):
            product = self._step("multiply", *sorted((a.index, b.index)))
            return -product if a.is_negative != b.is_negative else product
        if b == 0.0:
            return 0.0
        if abs(b) == 1.0:
            return a if b > 0.0 else -a
        product = self._step("multiply", a.index, self._constant(abs(b)))
        return -product if a.is_negative != (b < 0.0) else product

    def call(self, name: str, *operands: Number) -> Value:
        """Record divide, sin, cos, sqrt, maximum, minimum or is_free.

        ``is_free(q, lower, upper, pull)`` is 0 where a joint stands at a limit and is
        pulled outwards, else 1.
        """
        return self._step(name, *map(self._plain, operands))

    def _plain(self, value: Number) -> int:
        if not isinstance(value, Value):
            return self._constant(value)
        if value.is_negative:
            return self._step("multiply", value.index, self._constant(-1.0)).index
        return value.index

    def _constant(self, value: float) -> int:
        index = self._step("constant", key=float(value)).index
        self._constants[index] = float(value)
        return index

    def _step(self, name: str, *operands: int, key: object = None) -> Value:
        known = (name, operands, key)
        if known not in self._index:
            self._index[known] = len(self._steps)
            self._steps.append((name, operands))
        return Value(self, self._index[known])

    def _uses(self, results: Sequence[int]) -> list[int]:
        """How often each step's value is wanted, 0 if never."""
        uses = [0] * len(self._steps)
        for index in results:
            uses[index] += 1
        for index in reversed(range(len(self._steps))):
            for operand in self._steps[index][1] if uses[index] else ():
                uses[operand] += 1
        return uses

    def for_floats(self) -> FloatCode:
        """Compile to a function that takes and returns floats."""
        results = [self._plain(value) for value in self.outputs]
        uses = self._uses(results)
        text: dict[int, str] = {}
        lines = []
        repeated = {
            operand
            for i, (name, operands) in enumerate(self._steps)
            if uses[i] and name in _REPEATS_OPERANDS
            for operand in operands
        }
        for i, (name, operands) in enumerate(self._steps):
            if name == "input":
                text[i] = f"v{i}"
            elif name == "constant":
                text[i] = repr(self._constants[i])
            elif uses[i]:
                code = _FLOAT_CODE[name].format(*(text[k] for k in operands))
                # What is used once stands inside the expression that uses it.
                if uses[i] > 1 or i in repeated or len(code) > _LONGEST:
                    lines.append(f"    v{i} = {code}")
                    code = f"v{i}"
                text[i] = code
        arguments = ", ".join(f"v{i}" for i in range(self._n_inputs))
        shown = "".join(f"{text[index]}, " for index in results)
        source = [f"def run({arguments}):", *lines, f"    return ({shown})"]
        functions = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}
        return _compiled(source, functions)

    def for_lanes(self) -> LaneCode:
        """Compile to a function of rows of lanes, memory for every step given to it."""
        results = [self._plain(value) for value in self.outputs]
        uses = self._uses(results)
        place = {index: f"o{k}" for k, index in enumerate(results)}
        text: dict[int, str] = {}
        spare: list[str] = []
        lines = []
        n_rows = 0
        for i, (name, operands) in enumerate(self._steps):
            if name == "input":
                text[i] = f"v{i}"
            elif name == "constant":
                text[i] = f"k{i}"
            elif uses[i]:
                words = [text[k] for k in operands]
                # The memory of an operand that is needed no more takes the result.
                for k in operands:
                    uses[k] -= 1
                    if not uses[k] and text[k].startswith("r"):
                        spare.append(text[k])
                if i in place:
                    text[i] = place[i]
                elif spare:
                    text[i] = spare.pop()
                else:
                    text[i] = f"r{n_rows}"
                    n_rows += 1
                lines.append(f"    {name}({', '.join(words)}, out={text[i]})")
        for k, index in enumerate(results):
            if text[index] != f"o{k}":
                lines.append(f"    positive({text[index]}, out=o{k})")
        rows = "".join(f"r{k}, " for k in range(n_rows))
        heads = [
            "".join(f"v{i}, " for i in range(self._n_inputs)),
            "".join(f"o{k}, " for k in range(len(results))),
            "".join(f"k{i}, " for i in self._constants),
        ]
        source = ["def run(inputs, outputs, constants, rows):"]
        for names, given in zip(
            (*heads, rows), ("inputs", "outputs", "constants", "rows"), strict=True
        ):
            if names:
                source.append(f"    ({names}) = {given}")
        used = {line.split("(")[0].strip() for line in lines} - {"is_free"}
        functions = {name: getattr(np, name) for name in used}
        return LaneCode(
            run=_compiled([*source, *lines], {**functions, "is_free": _is_free}),
            constants=tuple(self._constants.values()),
            n_rows=n_rows,
            n_outputs=len(results),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LaneCode:
    """A program compiled for lanes."""

    run: Callable[..., Any]
    constants: tuple[float, ...]
    n_rows: int
    """Rows of memory that the steps need."""
    n_outputs: int


class LaneKernel:
    """Compiled code with memory for it, for one thread to call many times."""

    def __init__(self, code: LaneCode, dtype: Any) -> None:
        self._code, self._dtype = code, dtype
        # Arrays of no axes: Python floats would be converted at every operation.
        self._constants = [np.array(value, dtype=dtype) for value in code.constants]
        self._memory = np.empty((code.n_rows + code.n_outputs, 0), dtype=dtype)
        self._shape(0)

    def _shape(self, n: int) -> None:
        if n > self._memory.shape[1]:
            self._memory = np.empty((len(self._memory), n), dtype=self._dtype)
        self._width = n
        rows = list(self._memory[:, :n])
        self._rows, self._outputs = rows[: self._code.n_rows], rows[self._code.n_rows :]

    def __call__(self, *inputs: Any) -> Any:
        """Rows (n_outputs, lanes) of results; overwritten by the next call."""
        n = len(inputs[0])
        if n != self._width:
            self._shape(n)
        self._code.run(inputs, self._outputs, self._constants, self._rows)
        return self._memory[self._code.n_rows :, :n]


def _is_free(q: Any, lower: Any, upper: Any, pull: Any, out: Any) -> None:
    is_held = (q <= lower) & (pull < 0)
    is_held |= (q >= upper) & (pull > 0)
    np.logical_not(is_held, out=out)


def _compiled(source: Sequence[str], names: dict[str, Any]) -> Callable[..., Any]:
    # The source consists of the operations above and of numbers, nothing from outside.
    exec(_code("\n".join(source)), names)
    run: Callable[..., Any] = names["run"]
    return run


@lru_cache(maxsize=64)
def _code(source: str) -> CodeType:
    """Compile a source; equal chains have equal ones."""
    return compile(source, "<program>", "exec")
