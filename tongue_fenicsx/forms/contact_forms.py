# SPDX-License-Identifier: MIT
"""Forms of contact, assembled only where an obstacle is near."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

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
    form : callable
        Takes the name of an obstacle, returns its form over all facets that may touch; asked for one of each kind of obstacle, in whose
        place the others can stand.
    """

    def __init__(self, contacts: ContactSet, form: Callable[[str], ufl.Form]) -> None:
        self._contacts = contacts
        kinds: dict[Any, tuple[str, fem.CompiledForm]] = {}
        for name, term in contacts.terms.items():
            if term.kind not in kinds:
                kinds[term.kind] = name, jit.compile_without_data(form(name), contacts.mesh.comm)
        self._compiled = {name: kinds[term.kind] for name, term in contacts.terms.items()}
        self._present: dict[str, tuple[NDArray[np.int32], fem.Form]] = {}

    def __iter__(self) -> Iterator[fem.Form]:
        """Those of all obstacles."""
        return map(self.__getitem__, self._compiled)

    def __getitem__(self, name: str) -> fem.Form:
        """That of an obstacle."""
        near = self._contacts.terms[name].near
        if name not in self._present or self._present[name][0] is not near:
            self._present[name] = near, self._over(name, near)
        return self._present[name][1]

    def _over(self, name: str, near: NDArray[np.int32]) -> fem.Form:
        other, compiled = self._compiled[name]
        terms = self._contacts.terms
        stands = dict(zip(terms[other].data, terms[name].data, strict=True))
        form = compiled.ufl_form
        (place,) = {integral.subdomain_id() for integral in form.integrals()}
        parts = {fem.IntegralType.exterior_facet: [(place, self._contacts.integrals[near].ravel())]}
        spaces = [argument.ufl_function_space() for argument in form.arguments()]
        coefficients, constants = ({item: stands.get(item, item) for item in items} for items in (form.coefficients(), form.constants()))
        return fem.create_form(compiled, spaces, self._contacts.mesh, parts, coefficients, constants, self._contacts.entity_maps)
