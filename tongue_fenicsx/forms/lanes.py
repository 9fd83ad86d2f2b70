# SPDX-License-Identifier: MIT
"""UFL values at a point as C statements on vectors, whose lanes are points."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import ufl
from ffcx.ir.analysis.graph import build_scalar_graph
from ufl import classes as node
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.algorithms.remove_complex_nodes import remove_complex_nodes

from ..core.types import Expr


class Statements:
    """C statements that compute scalar values, each kept in a constant; what was computed before is used again.

    Parameters
    ----------
    terminal : callable
        Takes a symbol and its component, returns its text in C and whether that is a vector (of lanes) or a number.

    Attributes
    ----------
    lines : list of str
        The statements. They use ``pick`` of a mask and two vectors, and ``LANEWISE`` of a function and vectors.
    """

    def __init__(self, terminal: Callable[[Expr, tuple[int, ...]], tuple[str, bool]]) -> None:
        self.lines: list[str] = []
        self._terminal = terminal
        self._names: dict[str, str] = {}
        self._wide: set[str] = set()

    def compute(self, values: Iterable[Expr]) -> list[str]:
        """Append what computes scalar values of symbols alone, and return the vector of each.

        Raises
        ------
        NotImplementedError
            If there is an operation that C does not have.
        """
        vector = remove_complex_nodes(apply_derivatives(apply_algebra_lowering(ufl.as_vector(list(values)))))
        graph = build_scalar_graph(vector)
        names: dict[int, str] = {}
        targets: dict[int, str] = {}
        for number, attributes in graph.nodes.items():
            names[number] = self._name(attributes["expression"], [names[i] for i in graph.out_edges[number]])
            targets |= dict.fromkeys(attributes.get("component", ()), self._widen(names[number]) if attributes.get("target") else "")
        return [targets[i] for i in range(len(targets))]

    def _let(self, text: str, wide: bool) -> str:
        if text not in self._names:
            name = self._names[text] = f"t{len(self.lines)}"
            self.lines.append(f"const {'vector' if wide else 'double'} {name} = {text};")
            if wide:
                self._wide.add(name)
        return self._names[text]

    def _widen(self, name: str) -> str:
        return name if name in self._wide else self._let(f"{name} + (vector){{0}}", True)

    def _call(self, function: str, *operands: str) -> str:
        if any(operand in self._wide for operand in operands):
            return self._let(f"LANEWISE({function}, {', '.join(self._widen(operand) for operand in operands)})", True)
        return self._let(f"{function}({', '.join(operands)})", False)

    def _product(self, *operands: str) -> str:
        return self._let(" * ".join(sorted(operands)), any(operand in self._wide for operand in operands))

    def _power(self, base: str, exponent: float) -> str:
        """Of multiples of 1/3, such as those of J, by one root."""
        if exponent < 0 or exponent % 1 == 0:
            thirds = round(3 * exponent)
            if exponent % 1 != 0 and abs(3 * exponent - thirds) < 1e-12:
                return self._whole_power(self._call("inverse_cube_root", base), -thirds)
            if exponent % 1 == 0:
                return self._whole_power(base if exponent > 0 else self._inverse(base), abs(round(exponent)))
        return self._call("pow", base, repr(exponent))

    def _whole_power(self, base: str, exponent: int) -> str:
        if exponent == 0:
            return "1.0"
        if exponent == 1:
            return base
        half = self._whole_power(base, exponent // 2)
        return self._product(half, half) if exponent % 2 == 0 else self._product(half, half, base)

    def _inverse(self, name: str) -> str:
        return self._let(f"1.0 / {name}", name in self._wide)

    def _name(self, value: Expr, of: list[str]) -> str:
        """Of a node of the graph with the names of its operands."""
        match value:
            case node.Zero() | node.ScalarValue():
                return f"({float(value)!r})"
            case node.Indexed():
                symbol, index = value.ufl_operands
                return self._symbol(symbol, tuple(int(i) for i in index))
            case node.Terminal():
                return self._symbol(value, ())
            case node.Sum():
                return self._let(" + ".join(sorted(of)), any(name in self._wide for name in of))
            case node.Product():
                return self._product(*of)
            case node.Division():
                return self._product(of[0], self._inverse(of[1]))
            case node.Power() if isinstance(value.ufl_operands[1], node.ScalarValue):
                return self._power(of[0], float(value.ufl_operands[1]))
            case node.Power():
                return self._call("pow", *of)
            case node.Abs():
                return self._call("fabs", *of)
            case node.MathFunction():
                return self._call({"ln": "log"}.get(value._name, value._name), *of)
            case node.MinValue() | node.MaxValue():
                a, b = map(self._widen, of)
                return self._let(f"pick({a} {'<' if isinstance(value, node.MinValue) else '>'} {b}, {a}, {b})", True)
            case node.Conditional():
                return self._let(f"pick({of[0]}, {self._widen(of[1])}, {self._widen(of[2])})", True)
            case node.AndCondition() | node.OrCondition():
                return f"({of[0]} {'&' if isinstance(value, node.AndCondition) else '|'} {of[1]})"
            case node.NotCondition():
                return f"(~{of[0]})"
            case node.BinaryCondition():
                return f"({self._widen(of[0])} {value._name} {self._widen(of[1])})"
        raise NotImplementedError(type(value).__name__)

    def _symbol(self, symbol: Expr, component: tuple[int, ...]) -> str:
        text, wide = self._terminal(symbol, component)
        return self._let(text, wide)
