# SPDX-License-Identifier: MIT
"""From an anatomy to a mesh that DOLFINx computes on; when this room is loaded, `Anatomy.mesh` works."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..anatomy.anatomy import Anatomy

if TYPE_CHECKING:
    from .tongue_mesh import TongueMesh


def _mesh(self: Anatomy, size: float = 4e-3) -> TongueMesh:
    from .tongue_mesh import TongueMesh

    return TongueMesh.from_anatomy(self, size)


Anatomy.mesh = _mesh  # type: ignore[method-assign]
