# SPDX-License-Identifier: MIT
"""Vectors assembled from forms, also without packing again what is the same every time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem, la

from ..core.types import Floats

type Coefficients = dict[Any, Floats]
"""Packed, of each part of a form: numbers of each cell in a row."""


class Packed:
    """Coefficients and constants of a form over cells, of which only some change from one assembly to the next.

    Parameters
    ----------
    form : fem.Form
        Compiled; integrals over all cells only.
    changing : sequence of fem.Function
        Coefficients that change; the others are read by `repack`.
    spare : int
        Columns beyond those of the coefficients, for kernels to leave something in.

    Attributes
    ----------
    constants, coefficients
        As DOLFINx's assemblers take them.
    """

    def __init__(self, form: fem.Form, changing: Sequence[fem.Function], spare: int = 0) -> None:
        self.form, self._spare = form, spare
        self._columns: list[tuple[fem.Function, int, np.ndarray]] = []
        at = 0
        for coefficient in form._cpp_object.coefficients:
            width = coefficient.function_space.element.space_dimension
            for function in changing:
                if function._cpp_object is coefficient:
                    size, nodes = function.function_space.dofmap.index_map_bs, function.function_space.dofmap.list
                    self._columns.append((function, at, (size * nodes[:, :, None] + np.arange(size)).reshape(len(nodes), -1)))
            at += width
        self.repack()

    def repack(self) -> None:
        """Read all coefficients and constants."""
        packed = fem.pack_coefficients(self.form)
        self.constants = fem.pack_constants(self.form)
        self.coefficients: Coefficients = {
            part: np.pad(values, ((0, 0), (0, self._spare))) if self._spare else values for part, values in packed.items()
        }

    def refresh(self) -> None:
        """Read the changing coefficients."""
        for values in self.coefficients.values():
            for function, at, places in self._columns:
                values[:, at : at + places.shape[1]] = function.x.array[places[: len(values)]]


class PackedForm(Packed):
    """A vector form over cells, assembled without packing again what is the same every time."""

    def __init__(self, form: fem.Form, changing: Sequence[fem.Function], spare: int = 0) -> None:
        super().__init__(form, changing, spare)
        self._vector = fem.create_vector(form.function_spaces[0])

    def assemble(self) -> Floats:
        """The form at the present values of the changing coefficients, on the nodes that this rank owns, flat."""
        self.refresh()
        self._vector.array[:] = 0.0
        fem.assemble_vector(self._vector.array, self.form, self.constants, self.coefficients)
        return sum_over_ranks(self._vector)


def assemble(*forms: fem.Form) -> Floats:
    """The sum of vector forms on the nodes that this rank owns, flat."""
    vector = fem.create_vector(forms[0].function_spaces[0])
    for form in forms:
        fem.assemble_vector(vector.array, form)
    return sum_over_ranks(vector)


def sum_over_ranks(vector: la.Vector) -> Floats:
    """A vector's values that this rank owns, with what other ranks add to them, flat."""
    vector.scatter_reverse(la.InsertMode.add)
    return np.array(vector.array[: vector.index_map.size_local * vector.block_size])
