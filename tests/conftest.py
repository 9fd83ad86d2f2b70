# SPDX-License-Identifier: MIT
"""Shared meshes: a block, and the parametric tongue at 8 mm, each built once and read on every rank."""

from __future__ import annotations

import gc
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from filelock import FileLock

import tongue_fenicsx as tf  # before mpi4py
from tongue_fenicsx.core.parallel import on_rank_zero
from tongue_fenicsx.forms import jit
from tongue_fenicsx.meshing import build as meshing
from tongue_fenicsx.studies import single_muscle as solo

from mpi4py import MPI  # isort: skip

EXAMPLE = Path(__file__).parents[1] / "demos" / "example_subject"
SUBJECT = Path(__file__).parents[2] / "shared" / "data" / "subject_pb"

jit.FLAGS[0] = "-O1"
"""Compiled in half the time to kernels a tenth slower; what tests start as a command has the flags of the package."""

needs_subject = pytest.mark.skipif(not SUBJECT.is_dir(), reason="the data of subject PB are not beside the project")


LIVING = """
[mesh]
file = "tongue.msh"
[tissue]
preset = "buchaillard"
[time]
end = 0.12
step = 0.01
[output]
every = 0.06
[activation.MH]
pieces = [[0.1, 0.0, 0.8]]
[activation.GGP]
pieces = [[0.1, 0.0, 0.8]]
[activation.SL]
pieces = [[0.1, 0.0, 0.3]]
[contact.palate]
tolerance = 5e-5
"""
"""The tongue rises to the palate; beside `tongue_file`."""


def write_block(path: Path, lengths: tuple[float, float, float], divisions: tuple[int, int, int]) -> None:
    """A box of tetrahedra in m with surfaces ``left`` (x = 0), ``right`` and ``free``, volume ``passive``."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        model = gmsh.model
        box = model.occ.addBox(0, 0, 0, *lengths)
        model.occ.synchronize()
        for dim, curve in model.getEntities(1):
            ends = np.ptp(np.reshape(model.getBoundingBox(dim, curve), (2, 3)), axis=0)
            model.mesh.setTransfiniteCurve(curve, divisions[int(np.argmax(ends))] + 1)
        for _, surface in model.getEntities(2):
            model.mesh.setTransfiniteSurface(surface)
        model.mesh.setTransfiniteVolume(box)
        groups: dict[str, list[int]] = {"left": [], "right": [], "free": []}
        for _, surface in model.getEntities(2):
            x = model.occ.getCenterOfMass(2, surface)[0]
            groups["left" if x < 1e-9 else "right" if x > lengths[0] - 1e-9 else "free"].append(surface)
        for name, members in groups.items():
            model.addPhysicalGroup(2, members, name=name)
        model.addPhysicalGroup(3, [box], name="passive")
        model.mesh.generate(3)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


@contextmanager
def opened(path: Path) -> Iterator[None]:
    """A mesh file open in Gmsh."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        yield
    finally:
        gmsh.finalize()


@pytest.fixture(scope="session")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One scratch folder for all ranks."""
    folder = tmp_path_factory.mktemp("work") if MPI.COMM_WORLD.rank == 0 else None
    return Path(MPI.COMM_WORLD.bcast(folder))


@pytest.fixture
def scratch(workspace: Path, request: pytest.FixtureRequest) -> Path:
    """A fresh folder for one test, the same on all ranks."""
    folder = workspace / str(request.node.name).replace("/", "_").replace("[", "_").replace("]", "")
    on_rank_zero(MPI.COMM_WORLD, lambda: os.makedirs(folder, exist_ok=True))
    return folder


@pytest.fixture(scope="session")
def block(workspace: Path) -> tf.TongueMesh:
    """20 × 10 × 10 mm."""
    path = workspace / "block.msh"
    on_rank_zero(MPI.COMM_WORLD, lambda: write_block(path, (0.02, 0.01, 0.01), (4, 2, 2)))
    return tf.TongueMesh.read(path)


@pytest.fixture(scope="session")
def tongue_file(workspace: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The parametric tongue at 8 mm, some 1 700 tetrahedra; built by one of pytest's workers and copied by the others."""
    path = workspace / "tongue.msh"

    def take() -> None:
        base = tmp_path_factory.getbasetemp()
        built = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "built" / path.name
        with FileLock(f"{built.parent}.lock"):
            if not built.parent.is_dir():
                built.parent.mkdir()
                meshing.build(tf.parametric_tongue(), built, 8e-3)
        for file in built.parent.iterdir():
            shutil.copy(file, workspace)

    on_rank_zero(MPI.COMM_WORLD, take)
    return path


@pytest.fixture(scope="session")
def tongue(tongue_file: Path) -> tf.TongueMesh:
    """The same, read."""
    return tf.TongueMesh.read(tongue_file)


@pytest.fixture
def _quick_protocol(monkeypatch: pytest.MonkeyPatch) -> None:
    """A muscle alone is held for 50 ms, and among the bones only the palate is in its way."""
    monkeypatch.setattr(solo, "HOLD", 0.05)
    monkeypatch.setattr(solo, "walls_in", lambda mesh: ["palate"])


@pytest.fixture(autouse=True)
def _collect_together() -> Iterator[None]:
    """Let destructors that talk to other ranks run on all of them at once."""
    yield
    if MPI.COMM_WORLD.size > 1:
        gc.collect()
        MPI.COMM_WORLD.barrier()


Browser = Callable[..., Any]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Opens a page in Chromium without a window; each set of options is one browser."""
    selenium = pytest.importorskip("selenium.webdriver")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("Chromium and its driver are not installed")
    opened: dict[tuple[str, ...], Any] = {}

    def browse(page: Path | str, *flags: str) -> Any:
        if flags not in opened:
            options = selenium.ChromeOptions()
            options.binary_location = chromium
            software = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
            for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1000,1000", *(flags or software)):
                options.add_argument(flag)
            options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
            opened[flags] = selenium.Chrome(options=options, service=selenium.ChromeService(driver))
        opened[flags].get(page if isinstance(page, str) else page.as_uri())
        return opened[flags]

    yield browse
    for window in opened.values():
        window.quit()
