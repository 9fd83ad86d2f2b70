# SPDX-License-Identifier: MIT
"""From an anatomy to a mesh that DOLFINx computes on; when this room is loaded, `Anatomy.mesh` works."""

from ..anatomy.anatomy import Anatomy
from .tongue_mesh import TongueMesh

__all__ = ["TongueMesh"]

Anatomy.mesh = lambda self, size=4e-3: TongueMesh.from_anatomy(self, size)  # type: ignore[method-assign]
