# SPDX-License-Identifier: MIT
"""What made a run, kept beside what it left: its scenario, and the files that it names."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..core.files import at_once

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

        def write_scenario(path: Path) -> None:
            path.write_text(self.scenario, encoding="utf-8")

        for name, write in {**self.files, SCENARIO: write_scenario}.items():
            with at_once(folder / name) as path:
                write(path)


def mesh_files(path: Path, link: bool = False) -> dict[str, Callable[[Path], object]]:
    """The files of a mesh, as `Inputs` takes them; hard links to them, if that is wanted and can be."""
    beside = {suffix: path.with_suffix(suffix) for suffix in (".msh", ".h5", ".json", ".fibres.json")}
    return {f"mesh{suffix}": copy_of(source, link) for suffix, source in beside.items() if source.is_file()}


def copy_of(source: Path, link: bool = False) -> Callable[[Path], object]:
    """What writes a copy of a file, or a hard link to it if that can be."""

    def write(target: Path) -> None:
        if link and source.stat().st_dev == target.parent.stat().st_dev:
            os.link(source, target)
        else:
            shutil.copyfile(source, target)

    return write
