# SPDX-License-Identifier: MIT
"""Fields that a run stores for looking at: strain and stress tensors, and stretch, rate and stress of each muscle's fibres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem

from ..core.errors import InputError
from ..core.types import Expr, Floats
from ..forms import jit, quadrature
from ..forms.weak_form import WeakForm
from .energy import Measures

TENSORS = ("hencky", "cauchy")
FIBRES = ("fibre_stretch", "fibre_rate", "active_stress")
EXTRA_FIELDS = (*TENSORS, *FIBRES)
"""What `Stepping.fields` may name: the Hencky strain and the Cauchy stress (Pa) as tensors; the fibre stretch λ̄, its rate in
1/s and the active Cauchy stress along the fibre in Pa, one field per muscle. Each is the mean over a cell."""


class ExtraFields:
    """Evaluates the extra fields of a state.

    Parameters
    ----------
    weak : WeakForm
        The weak form, whose `u` is the state.
    v : Expr
        Its velocity.
    measures : Measures
        Evaluated at the same state.
    names : sequence of str
        Some of `EXTRA_FIELDS`.

    Raises
    ------
    InputError
        If a name is not known.
    """

    def __init__(self, weak: WeakForm, v: Expr, measures: Measures, names: Sequence[str]) -> None:
        for name in names:
            if name not in EXTRA_FIELDS:
                raise InputError(f"output.fields: {name!r} is not one of {', '.join(EXTRA_FIELDS)}.")
        self._weak, self._measures, self._names = weak, measures, names
        points, _ = quadrature.points_and_weights(weak.model.quadrature_degree)
        self._expressions = {}
        if "cauchy" in names:
            self._expressions["cauchy"] = fem.Expression(weak.cauchy_stress(weak.u, v), points, jit_options=jit.options())
        if set(names) & set(FIBRES) and weak.slots.directions:
            state = ufl.as_vector(weak.fibre_state(weak.u, v))
            self._expressions["fibres"] = fem.Expression(state, points, jit_options=jit.options())

    def evaluate(self) -> dict[str, Floats]:
        """Name to values on the owned cells, (n,) or (n, 3, 3)."""
        fields: dict[str, Floats] = {}
        weights = self._measures.weights / self._measures.weights.sum(axis=1, keepdims=True)
        if "hencky" in self._names:
            F = self._measures.F
            stretches, axes = np.linalg.eigh(np.swapaxes(F, -1, -2) @ F)
            h = (axes * (0.5 * np.log(stretches))[..., None, :]) @ np.swapaxes(axes, -1, -2)
            fields["hencky"] = np.einsum("cq,cqij->cij", weights, h)
        values = {name: self._values(name) for name in self._expressions}
        if "cauchy" in values:
            fields["cauchy"] = np.einsum("cq,cqk->ck", weights, values["cauchy"]).reshape(-1, 3, 3)
        if "fibres" in values:
            mean = np.einsum("cq,cqk->ck", weights, values["fibres"]).reshape(len(weights), -1, 3)
            slots = self._weak.slots
            for index, muscle in enumerate(slots.names):
                for column, (name, elsewhere) in enumerate(zip(FIBRES, (1.0, 0.0, 0.0), strict=True)):
                    if name in self._names:
                        field = np.full(len(weights), elsewhere)
                        for slot, owner in enumerate(slots.owners[:, : len(weights)]):
                            field[owner == index] = mean[owner == index, slot, column]
                        fields[f"{name}_{muscle}"] = field
        return fields

    def _values(self, name: str) -> Floats:
        cells = np.arange(len(self._measures.weights), dtype=np.int32)
        values = np.asarray(self._expressions[name].eval(self._weak.V.mesh, cells))
        return values.reshape(*self._measures.weights.shape, -1)
