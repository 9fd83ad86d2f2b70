# SPDX-License-Identifier: MIT
"""Kernels of the stress terms that are faster than FFCx's: stresses and point tangents made of UFL, and a contraction written in C.

FFCx evaluates the tangent of vector-valued forms entry by entry, without use of its symmetry. Here UFL gives the 45 numbers of the
tangent ∂P/∂F of each point, for four points at once, and the contraction with the shape functions' gradients is the same for all laws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path

import basix
import numpy as np
import ufl
from dolfinx import cpp, fem
from numpy.typing import NDArray
from ufl.algorithms.analysis import extract_coefficients, extract_constants
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

from ..core.types import Expr, Floats
from . import jit, quadrature
from .lanes import Statements

LANES = 4
UPPER = [(r, s) for r in range(9) for s in range(r, 9)]
"""Rows and columns of a symmetric tangent that are computed; 3i + J is the row of P_iJ."""


@dataclass(frozen=True)
class Term:
    """Stresses that are one function of the deformation and, in each of several instances, of other coefficients.

    Attributes
    ----------
    stress : Expr
        First Piola–Kirchhoff stress in Pa of the first instance, derivable from a potential, but for what is frozen.
    instances : sequence of mapping
        Of each, coefficients of `stress` to those in their place.
    switches : sequence of fem.Function
        Without one of these in a cell there is no stress; always, if there are none.
    """

    stress: Expr
    instances: Sequence[Mapping[fem.Function, fem.Function]] = field(default_factory=lambda: [{}])
    switches: Sequence[fem.Function] = ()


class CellKernels:
    """The stress terms of a displacement as forms over all cells.

    Parameters
    ----------
    u, frozen : fem.Function
        Quadratic displacement, and its stand-in that is not differentiated.
    terms : sequence of Term
        Of functions of gradients of `u` and other displacements, of values at the quadrature points or in the cells, and of constants.
    inertia : Expr
        A multiple of `u` beside what does not depend on it: force density in N/m³, of which the tangent has the derivative.
    degree : int
        Of the quadrature.

    Attributes
    ----------
    spare : int
        Numbers of each cell that the packed coefficients must have room for, at the end.
    linear : fem.FunctionSpace
        Linear displacements.

    Raises
    ------
    NotImplementedError
        If a stress has an operation that C lacks, or depends on something else.
    """

    def __init__(self, u: fem.Function, frozen: fem.Function, terms: Sequence[Term], inertia: Expr, degree: int) -> None:
        self._u, self._frozen, self._terms, self._inertia = u, frozen, terms, inertia
        self._points, self._weights = quadrature.points_and_weights(degree)
        mesh = u.function_space.mesh
        whole = [ufl.replace(term.stress, {frozen: u}) for term in terms]
        found = [f for value in whole for f in extract_coefficients(value)]
        found += [f for term in terms for instance in _own(term) for f in instance.values()]
        nodal = dict.fromkeys(f for f in found if f.function_space == u.function_space)
        self._gradients = [u, *(f for f in nodal if f is not u)]
        self._coefficients = [*self._gradients, *(f for f in dict.fromkeys(found) if f not in nodal)]
        widths = [f.function_space.dofmap.dof_layout.num_dofs * f.function_space.dofmap.bs for f in self._coefficients]
        self._offsets = dict(zip(self._coefficients, accumulate([0, *widths]), strict=False))
        self._width, self.spare = sum(widths), len(UPPER) + 1
        self._constants = list(dict.fromkeys(c for value in (*whole, inertia) for c in extract_constants(value)))
        self._constant_offsets = dict(zip(self._constants, accumulate([0, *(c.value.size for c in self._constants)]), strict=False))
        template = Path(__file__).with_suffix(".c").read_text()
        told = ufl.as_vector([value[i] for value in (*(term.stress for term in terms), inertia) for i in np.ndindex(value.ufl_shape)])
        order = [*extract_coefficients(told), *extract_constants(told)]
        places = [(order.index(item) if item in order else None) for item in (u, frozen, *self._coefficients, *self._constants)]
        layout = degree, places, [len(term.instances) for term in terms], list(self._offsets.values()), template
        form = ufl.inner(told, told) * ufl.dx(mesh)  # its signature knows all that the kernels are made of
        self._module = jit.compile_kernels(form, str(layout), lambda: self._source() + template, DECLARATIONS, mesh.comm)
        self.linear = fem.functionspace(mesh, ("P", 1, (3,)))

    def form(self, name: str, cells: NDArray[np.int32] | None = None) -> fem.Form:
        """A form over some of this rank's cells, or all; packed coefficients are those of these cells.

        ``forces`` is the virtual work of the stresses, ``tangent`` its derivative with that of the inertia, ``coarse_tangent`` the same in
        linear displacements, to be assembled after the tangent with the same packed coefficients.
        """
        ffi, lib = self._module.ffi, self._module.lib
        kernel = int(ffi.cast("uintptr_t", ffi.addressof(lib, name)))
        mesh = self._u.function_space.mesh
        if cells is None:
            cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        V = self.space(name)
        spaces = [V] if name == "forces" else [V, V]
        used = np.arange(len(self._coefficients), dtype=np.int8)
        parts = {fem.IntegralType.cell: [(0, kernel, cells, used)]}
        coefficients = [f._cpp_object for f in self._coefficients]
        constants = [c._cpp_object for c in self._constants]
        on = [V._cpp_object for V in spaces]
        return fem.Form(cpp.fem.Form_float64(on, parts, coefficients, constants, False, [], mesh._cpp_object), module=self._module)

    def space(self, name: str) -> fem.FunctionSpace:
        """Displacements of a form."""
        return self.linear if name == "coarse_tangent" else self._u.function_space

    def add(
        self,
        name: str,
        cells: NDArray[np.int32],
        packed: tuple[Floats, Floats],
        fixed: NDArray[np.uint32],
        places: NDArray[np.int32],
        values: Floats,
    ) -> None:
        """Add ``tangent`` or ``coarse_tangent`` of cells to the values of a matrix.

        Parameters
        ----------
        name : str
            Which.
        cells : (n,) int array
            Of this rank.
        packed : constants, (n_cells, width) array
            As of the form, of all cells.
        fixed : (n,) uint32 array
            A bit for each unknown of a cell whose row and column are left out.
        places : (n, nodes, nodes, rows) int32 array
            See `Placement`.
        values : (n_values,) array
            Changed in place.
        """
        ffi, lib, geometry = self._module.ffi, self._module.lib, self._u.function_space.mesh.geometry
        constants, w = packed
        buffers = {"numbers": cells, "vertices": geometry.dofmaps[0], "points": geometry.x, "fixed": fixed, "w": w, "constants": constants}
        kinds = {np.dtype(np.int32): "int", np.dtype(np.uint32): "uint32_t", np.dtype(np.float64): "double"}
        view = {key: ffi.from_buffer(f"{kinds[array.dtype]}[]", array) for key, array in buffers.items()}
        told = ffi.new("struct cells*", {"n": len(cells), "width": w.shape[1], **view})
        getattr(lib, f"add_{name}")(told, places.shape[-1], ffi.from_buffer("int[]", places), ffi.from_buffer("double[]", values))

    def _source(self) -> str:
        """Sizes, tables, and the stresses and point tangents in C."""
        n = len(self._points)
        packs = -(-n // LANES)
        padded = np.minimum(np.arange(packs * LANES), n - 1)
        element = basix.create_element(basix.ElementFamily.P, basix.CellType.tetrahedron, 2, basix.LagrangeVariant.gll_warped)
        slopes = element.tabulate(1, self._points)[1:, :, :, 0]  # (3, q, 10)
        exact, shares = basix.make_quadrature(basix.CellType.tetrahedron, 4)
        shape = element.tabulate(0, exact)[0, :, :, 0]
        rows = np.pad(np.moveaxis(slopes, 0, 1), ((0, 0), (0, 0), (0, 2)))
        mass = np.pad(np.einsum("q,qa,qb->ab", shares, shape, shape), ((0, 0), (0, 2)))
        weights = np.where(np.arange(len(padded)) < n, self._weights[padded], 0.0)
        names = ("LANES", LANES), ("UPPER", len(UPPER)), ("N_POINTS", n), ("N_PACKS", packs), ("N_GRADIENTS", len(self._gradients))
        sizes = ", ".join(f"{name} = {value}" for name, value in (*names, ("MEANS", self._width)))
        tables = {
            "NODE_SLOPES[10][3]": np.moveaxis(slopes[:, padded], (2, 0), (0, 1)),
            "POINT_SLOPES[N_POINTS][3]": rows,
            "WEIGHTS": weights,
            "MASS[10]": mass,
        }
        return "\n".join(
            [
                HEAD,
                CELLS,
                f"enum {{ {sizes} }};",
                *(f"static const vector {name}[{values.shape[-1] // LANES}] = {_literal(values)};" for name, values in tables.items()),
                self._function("void", "stresses", tangent=False),
                self._function("double", "tangents", tangent=True),
            ]
        )

    def _function(self, result: str, name: str, tangent: bool) -> str:
        """`stresses` or `tangents` of the sum of all terms at all points; the latter returns that of the inertia."""
        size = len(UPPER) if tangent else 9
        lines = [
            f"static {result} {name}(const double* w, const double* c, vector H[N_GRADIENTS][9][N_PACKS], vector out[{size}][N_PACKS])",
            "{",
        ]
        for number, term in enumerate(self._terms):
            lines += self._evaluate(number, term, tangent)
        if tangent:
            statements = Statements(lambda symbol, component: self._in_c(symbols.origin.get(symbol, symbol), component, {}))
            symbols = _Symbols(self._u, self._frozen)
            inertia = symbols.replace(self._inertia)
            (value,) = statements.compute([ufl.diff(inertia, symbols.at(self._u))[0, 0]])
            lines += [*statements.lines, f"return {value}[0];"]
        return "\n".join([*lines, "}"])

    def _evaluate(self, number: int, term: Term, tangent: bool) -> list[str]:
        """Statements that add a term to ``out``, or begin it with the first."""
        symbols = _Symbols(self._u, self._frozen)
        P = symbols.replace(term.stress)
        if tangent:
            D = ufl.diff(P, symbols.gradient(self._u))
            values = [D[r // 3, r % 3, s // 3, s % 3] for r, s in UPPER]
        else:
            values = [P[r // 3, r % 3] for r in range(9)]
        instances = _own(term)
        own = {f: f"at[{i}]" for i, f in enumerate(instances[0])}
        places = ", ".join(f"{{{', '.join(str(self._offsets[f]) for f in instance.values())}}}" for instance in instances)
        statements = Statements(lambda symbol, component: self._in_c(symbols.origin.get(symbol, symbol), component, own))
        outputs = statements.compute(values)
        switched = " && ".join(f"is_nil(w + {own[f]}, N_POINTS)" for f in term.switches if f in own)
        table = f"static const int places_{number}[{len(instances)}][{len(own)}] = {{{places}}};" if own else ""
        return [
            table,
            f"for (int instance = 0; instance < {len(instances)}; ++instance)",
            "{",
            f"const int* at = places_{number}[instance];" if own else "",
            f"if ({switched}) continue;" if switched else "",
            "for (int p = 0; p < N_PACKS; ++p)",
            "{",
            *statements.lines,
            *(f"out[{i}][p] {'+=' if number else '='} {value};" for i, value in enumerate(outputs)),
            "}",
            "}",
        ]

    def _in_c(self, symbol: Expr, component: tuple[int, ...], own: Mapping[fem.Function, str]) -> tuple[str, bool]:
        """A symbol's component in C, and whether it differs from point to point."""
        index = int(np.ravel_multi_index(component, symbol.ufl_shape)) if component else 0
        if isinstance(symbol, ufl.classes.Grad) and symbol.ufl_operands[0] in self._gradients:
            return f"H[{self._gradients.index(symbol.ufl_operands[0])}][{index}][p]", True
        if isinstance(symbol, fem.Constant):
            return f"c[{self._constant_offsets[symbol] + index}]", False
        if not isinstance(symbol, fem.Function):
            raise NotImplementedError(f"{symbol}")
        size, layout = symbol.function_space.dofmap.bs, symbol.function_space.dofmap.dof_layout
        place = own.get(symbol, str(self._offsets[symbol]))
        if layout.num_dofs == 1:
            return f"w[{place} + {index}]", False
        if not symbol.function_space.ufl_element().has_custom_quadrature or layout.num_dofs != len(self._points):
            raise NotImplementedError(f"{symbol}")
        points = (f"{size} * POINT(p, {lane}) + {index}" for lane in range(LANES))
        return f"(vector){{{', '.join(f'w[{place} + {point}]' for point in points)}}}", True


def _own(term: Term) -> list[dict[fem.Function, fem.Function]]:
    """The coefficients of each instance that the stress depends on."""
    used = set(extract_coefficients(term.stress))
    return [{f: other for f, other in instance.items() if f in used} for instance in term.instances]


class _Symbols(MultiFunction):  # type: ignore[misc]
    """Stands constants in for coefficients and their gradients, by which one can differentiate."""

    expr = MultiFunction.reuse_if_untouched

    def __init__(self, u: fem.Function, frozen: fem.Function) -> None:
        super().__init__()
        self._u, self._frozen = u, frozen
        self._symbols: dict[Expr, Expr] = {}
        self.origin: dict[Expr, Expr] = {}

    def replace(self, value: Expr) -> Expr:
        """A value in symbols, without derivatives by coefficients."""
        return map_expr_dag(self, apply_derivatives(apply_algebra_lowering(value)))

    def at(self, value: Expr) -> Expr:
        """The symbol of a coefficient or a gradient."""
        if value not in self._symbols:
            constant = ufl.Constant(self._u.function_space.mesh, shape=value.ufl_shape)
            self._symbols[value] = ufl.variable(constant)
            self.origin[constant] = ufl.replace(value, {self._frozen: self._u}) if isinstance(value, ufl.classes.Grad) else value
        return self._symbols[value]

    def gradient(self, function: fem.Function) -> Expr:
        """The symbol of a function's gradient."""
        return self.at(ufl.grad(function))

    def grad(self, value: Expr) -> Expr:
        """Of a gradient."""
        return self.at(value)

    def coefficient(self, value: Expr) -> Expr:
        """Of a value at the point."""
        return self.at(value)


CELLS = """
struct cells
{
  int n, width;
  const int *numbers, *vertices;
  const double *points, *constants;
  const uint32_t* fixed;
  double* w;
};"""
DECLARATIONS = f"""{CELLS}
void forces(double*, double*, const double*, const double*, const int*, const uint8_t*, void*);
void tangent(double*, double*, const double*, const double*, const int*, const uint8_t*, void*);
void coarse_tangent(double*, double*, const double*, const double*, const int*, const uint8_t*, void*);
void add_tangent(const struct cells*, int, const int*, double*);
void add_coarse_tangent(const struct cells*, int, const int*, double*);"""
HEAD = """#include <math.h>
#include <stdint.h>
#include <string.h>
typedef double vector __attribute__((vector_size(32)));
typedef long long mask __attribute__((vector_size(32)));
#define LANEWISE1(f, x) ({ const vector x_ = x; vector r_; for (int l_ = 0; l_ < LANES; ++l_) r_[l_] = f(x_[l_]); r_; })
#define LANEWISE2(f, x, y) ({ const vector x_ = x, y_ = y; vector r_; for (int l_ = 0; l_ < LANES; ++l_) r_[l_] = f(x_[l_], y_[l_]); r_; })
#define CHOOSE(a, b, c, name, ...) name
#define LANEWISE(...) CHOOSE(__VA_ARGS__, LANEWISE2, LANEWISE1)(__VA_ARGS__)
#define POINT(p, lane) (LANES * p + lane < N_POINTS ? LANES * p + lane : N_POINTS - 1)
static inline vector pick(mask m, vector a, vector b) { return (vector)((m & (mask)a) | (~m & (mask)b)); }
static inline double inverse_cube_root(double x) { return pow(x, -1.0 / 3.0); }
static inline int is_nil(const double* values, int n)
{
  for (int i = 0; i < n; ++i)
    if (values[i] != 0.0)
      return 0;
  return 1;
}"""


def _literal(values: Floats) -> str:
    """A table in C, its rows as vectors."""
    if values.ndim > 1:
        return f"{{{', '.join(_literal(row) for row in values)}}}"
    packs = values.reshape(-1, LANES)
    return f"{{{', '.join('{' + ', '.join(repr(float(x)) for x in pack) + '}' for pack in packs)}}}"
