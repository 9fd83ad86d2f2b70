# SPDX-License-Identifier: MIT
"""The weak form of a model in UFL, its compilation and assembly."""

__all__ = [
    "assembly",
    "cell_kernels",
    "contact_forms",
    "contact_measures",
    "contact_terms",
    "fibre_slots",
    "jit",
    "lanes",
    "load_terms",
    "nodal_forces",
    "passive_terms",
    "quadrature",
    "supports",
    "weak_form",
]
