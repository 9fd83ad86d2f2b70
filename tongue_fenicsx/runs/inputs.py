# SPDX-License-Identifier: MIT
"""What made a run, kept beside what it left: its scenario, and the files that it names."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

SCENARIO = "scenario.toml"
MESH = "mesh.msh"
KEPT = (SCENARIO, MESH, "mesh.h5", "mesh.json", "mesh.fibres.json")
"""Names that these files may have in a run folder, beside those of surfaces."""


@dataclass(frozen=True)
class Inputs:
    """What makes a run again, from any folder.

    Attributes
    ----------
    scenario : str
        The scenario as TOML.
    files : mapping
        Names of the files beside it to what writes each to a path.
    """

    scenario: str
    files: Mapping[str, Callable[[Path], object]] = field(default_factory=dict)

    def install(self, folder: Path) -> None:
        """Write all into a folder, each at once."""
        for name, write in {**self.files, SCENARIO: lambda path: path.write_text(self.scenario, encoding="utf-8")}.items():
            temporary = folder / f"partial-{name}"
            write(temporary)
            os.replace(temporary, folder / name)


def mesh_files(path: Path) -> dict[str, Callable[[Path], object]]:
    """The files of a mesh, as `Inputs` takes them."""
    beside = {suffix: path.with_suffix(suffix) for suffix in (".msh", ".h5", ".json", ".fibres.json")}
    return {f"mesh{suffix}": _copy(source) for suffix, source in beside.items() if source.is_file()}


def _copy(source: Path) -> Callable[[Path], object]:
    return lambda target: shutil.copyfile(source, target)
