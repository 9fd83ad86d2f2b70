# SPDX-License-Identifier: MIT
"""Forms of contact, assembled only where an obstacle is near."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from . import jit
from .contact_terms import ContactSet


class ContactForms:
    """A form of each obstacle over the facets that are near it, which change with the displacement; to be asked for at each assembly.

    Parameters
    ----------
    contacts : ContactSet
        The obstacles.
    forms : mapping
        Obstacle to its form, over all facets that may touch.
    """

    def __init__(self, contacts: ContactSet, forms: Mapping[str, ufl.Form]) -> None:
        self._contacts = contacts
        self._compiled = {name: jit.compile_without_data(form, contacts.mesh.comm) for name, form in forms.items()}
        self._present: dict[str, tuple[NDArray[np.int32], fem.Form]] = {}

    def __iter__(self) -> Iterator[fem.Form]:
        """Those of all obstacles."""
        return map(self.__getitem__, self._compiled)

    def __getitem__(self, name: str) -> fem.Form:
        """That of an obstacle."""
        near = self._contacts.terms[name].near
        if name not in self._present or self._present[name][0] is not near:
            self._present[name] = near, self._over(self._compiled[name], near)
        return self._present[name][1]

    def _over(self, compiled: fem.CompiledForm, near: NDArray[np.int32]) -> fem.Form:
        form = compiled.ufl_form
        (place,) = (integral.subdomain_id() for integral in form.integrals())
        parts = {fem.IntegralType.exterior_facet: [(place, self._contacts.integrals[near].ravel())]}
        spaces = [argument.ufl_function_space() for argument in form.arguments()]
        coefficients, constants = ({item: item for item in items} for items in (form.coefficients(), form.constants()))
        return fem.create_form(compiled, spaces, self._contacts.mesh, parts, coefficients, constants, self._contacts.entity_maps)
