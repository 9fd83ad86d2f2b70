# SPDX-License-Identifier: MIT
"""What is compiled depends on the kind of model, not on its numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import create_unit_interval
from mpi4py import MPI

import tongue_fenicsx as tf
from tongue_fenicsx.forms import jit
from tongue_fenicsx.testing import with_fibres


def test_other_numbers_compile_nothing(block: tf.TongueMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run with another tissue, damping, stress, fibre law, load, contact stiffness and step finds everything compiled."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(jit, "FLAGS", ["-O0"])

    def simulate(scale: float) -> set[str]:
        model = tf.Model(
            with_fibres(block),
            tf.Tissue(
                tf.Yeoh(192.0 * scale, 90.0 * scale, 0.49 - 0.01 * scale),
                1000.0 * scale,
                tf.Rayleigh(20.0 * scale, 0.01 * scale),
                {"GGP": 3e3 * scale},
            ),
            tf.Contraction(optimal_stretch=scale, tendon_length=1e-3 * scale),
            fixed=["left"],
            contacts={"floor": tf.Contact(tf.Plane((0.0, 0.0, -1e-3 * scale), (0.0, 0.0, 1.0)), "penalty")},
            gravity=(0.0, 0.0, -9.81 * scale),
        )
        stepping = tf.Stepping(step_max=2e-3 * scale, output_every=4e-3)
        tf.Simulation(model, stepping=stepping).run({"GGP_L": tf.ramp(0.01 * scale, 0.1, scale / 2)}, 4e-3)
        return {path.name for path in (tmp_path / "cache").rglob("*.so")}

    compiled = simulate(1.0)
    assert compiled
    assert simulate(1.1) == compiled


def test_a_damaged_form_is_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A truncated shared object, which would end the process with a bus error, is not loaded."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    mesh = create_unit_interval(MPI.COMM_SELF, 2)
    area = fem.Constant(mesh, 1.0) * ufl.dx
    assert fem.assemble_scalar(jit.compile_form(area, mesh.comm)) == pytest.approx(1.0)
    (module,) = tmp_path.rglob("*.so")
    start = module.read_bytes()[:4096]
    module.unlink()  # what is loaded stays whole
    module.write_bytes(start)
    assert fem.assemble_scalar(jit.compile_form(area, mesh.comm)) == pytest.approx(1.0)


def test_kernels_stay_what_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of one form do not become those of another that is loaded later."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    mesh = create_unit_interval(MPI.COMM_SELF, 2)

    def load(number: int) -> Any:
        source = f"int number(void) {{ return {number}; }}"
        return jit.compile_kernels(fem.Constant(mesh, 1.0) * ufl.dx, str(number), lambda: source, "int number(void);", mesh.comm)

    kernels = [load(number) for number in (1, 2, 1, 2)]
    assert [module.lib.number() for module in kernels] == [1, 2, 1, 2]


@pytest.mark.parametrize("compiler", ["false", "no-such-compiler"])
def test_no_compiler(compiler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One sentence with the mend, and the cache is as it was."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", compiler)
    mesh = create_unit_interval(MPI.COMM_SELF, 2)
    with pytest.raises(tf.InputError, match=f"{compiler}.*a C compiler, Python's headers and room in .* are needed, tongue doctor says"):
        jit.compile_form(fem.Constant(mesh, 1.0) * ufl.dx, mesh.comm)
    assert [path.suffix for path in tmp_path.rglob("*") if path.is_file()] == [".lock"]
