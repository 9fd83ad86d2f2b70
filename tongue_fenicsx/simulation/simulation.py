# SPDX-License-Identifier: MIT
"""A simulation: a model driven through time by activations, with output, roll-back and restart."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from mpi4py import MPI

from ..anatomy.catalogue import peak_stress, resolve
from ..core.errors import InputError, SolveError, check_outputs
from ..core.fingerprint import fingerprint
from ..core.interruption import interruptible
from ..core.memory import peak_memory
from ..core.parallel import on_rank_zero
from ..core.types import Floats
from ..core.versions import versions
from ..forms.contact_terms import AUGMENTATIONS
from ..forms.weak_form import WeakForm
from ..mechanics.activation import Course, FunctionOfTime
from ..mechanics.contact import touches_summary
from ..mechanics.hyperelasticity import numbers
from ..mechanics.model import Model
from ..runs.run import Run
from ..runs.writer import RUN_FILES, RunWriter
from ..solvers.newton import Newton, Outcome
from ..solvers.time_integration import GeneralizedAlpha, QuasiStatic, State
from ..solvers.tolerances import Tolerances
from .energy import ENERGIES, Measures
from .fields import ExtraFields
from .probes import Probes
from .stepping import Progress, Report, Stepping

SMALL = 1e-4
"""Displacement in m below which the error of a step is not judged more sharply: motion from rest would need endless steps."""


class Simulation:
    """A model and the activations that move it.

    Parameters
    ----------
    model : Model
        What is simulated.
    activation : mapping
        Muscle (``GGP``) or muscle and side (``GGP_L``) to `Activation`, `Excited`, or a function of time in s.
    probes : mapping, optional
        Name to landmark name or to a point (3,) in m of the rest shape; by default all landmarks.
    stepping : Stepping
        Time steps and output.
    tolerances : Tolerances
        Accuracy of each solve.

    Raises
    ------
    InputError
        If a muscle or landmark is not in the mesh, or a probe lies outside it.
    """

    def __init__(
        self,
        model: Model,
        activation: Mapping[str, Course | Callable[[float], float]] | None = None,
        probes: Mapping[str, str | Any] | None = None,
        stepping: Stepping | None = None,
        tolerances: Tolerances | None = None,
    ) -> None:
        self.model, self.stepping = model, stepping or Stepping()
        self.tolerances = tolerances or Tolerances()
        tongue = model.tongue
        self.activation: dict[str, Course] = {}
        for key, course in (activation or {}).items():
            for name in resolve(key, tongue.muscles, f"activation.{key}"):
                if name in self.activation:
                    raise InputError(f"activation.{key}: {name} is activated twice; name the muscle or its sides, not both.")
                self.activation[name] = course if isinstance(course, Course) else FunctionOfTime(course)
        self.probes = Probes(tongue, probes if probes is not None else {name: name for name in tongue.landmarks})

    def run(self, t_end: float, output: str | Path, resume: bool = False, report: Report | None = None, scenario: str | None = None) -> Run:
        """Simulate from rest to `t_end` seconds and write the run folder.

        Parameters
        ----------
        t_end : float
            End of the simulated time in s.
        output : path
            The run folder.
        resume : bool
            Go on from the folder's checkpoint.
        report : callable, optional
            Called after each step, on rank 0.
        scenario : str, optional
            Text of the folder's ``scenario.toml``.

        Raises
        ------
        InputError
            If `t_end` is not positive, the folder cannot be written, or there is nothing to resume.
        SolveError
            If the solve fails at the smallest step; everything up to the last good state is on disk.
        """
        if not (np.isfinite(t_end) and t_end > 0):
            raise InputError(f"t_end: {t_end}; a positive number of seconds is expected.")
        comm = self.model.tongue.comm
        folder = Path(output)
        on_rank_zero(comm, lambda: check_outputs(folder / "figures"))
        on_rank_zero(comm, lambda: check_outputs(folder, RUN_FILES))
        loop = _Loop(self, folder, t_end, resume, report)
        try:
            loop.prepare(scenario)
            loop.go()
        finally:
            loop.close()
        comm.barrier()
        return Run(folder)


class _Loop:
    """One run in progress: forms, solver, state, files."""

    def __init__(self, simulation: Simulation, folder: Path, t_end: float, resume: bool, report: Report | None) -> None:
        self.simulation, self.folder, self.t_end, self.resume, self.report = simulation, folder, t_end, resume, report
        self.model, self.stepping = simulation.model, simulation.stepping
        self.comm = self.model.tongue.comm
        self._log: TextIO | None = None
        self._solver: Newton | None = None
        self._clock = time.perf_counter()
        self.counters: dict[str, Any] = {
            "n_steps": 0, "n_rejected": 0, "newton_iterations": 0, "krylov_iterations": 0, "fallbacks": {},
            "wall_seconds": 0.0, "setup_seconds": 0.0, "volume_change_max": 0.0, "min_jacobian": 1.0,
            "hencky_von_mises_max": 0.0, "hencky_von_mises_raw_max": 0.0, "peak_speed_m_s": 0.0,
        }  # fmt: skip

    def say(self, line: str) -> None:
        """Add a line to the log."""
        if self._log is not None:
            self._log.write(line + "\n")
            self._log.flush()

    def close(self) -> None:
        """Close the log and free the solver."""
        if self._log is not None:
            self._log.close()
        if self._solver is not None:
            self._solver.destroy()

    # -- before the first step

    def prepare(self, scenario: str | None) -> None:
        """Compile the forms, and begin at rest or at the checkpoint; nothing is written before all has been read."""
        self.weak = WeakForm(self.model, list(self.simulation.activation))
        weak = self.weak
        self.scheme = (
            QuasiStatic(weak.u, weak.pressure)
            if self.stepping.quasi_static
            else GeneralizedAlpha(weak.u, self.stepping.spectral_radius, weak.pressure)
        )
        self._solver = Newton(weak, self.scheme, self.simulation.tolerances, self.say)
        self.measures = Measures(weak, self.scheme, self._solver.forces)
        self.extra = ExtraFields(weak, self.scheme.v, self.measures, self.stepping.fields)
        self.writer = RunWriter(self.folder, weak.V, self.simulation.probes.rest)
        checkpoint = self.writer.read_checkpoint(self._identity()) if self.resume else None
        if self.comm.rank == 0:
            self._log = open(self.folder / "log.txt", "a" if self.resume else "w", encoding="utf-8")  # noqa: SIM115
            if scenario is not None:
                (self.folder / "scenario.toml").write_text(scenario, encoding="utf-8")
        self.say(f"{self.model.tongue.name}: {self._solver.n_unknowns} unknowns on {self.comm.size} rank(s)")
        if checkpoint is not None:
            state, balance, counters = checkpoint
            self.counters |= counters
            self.scheme.restore(state)
            self._set_time(state.t)
            self.weak.contacts.gammas = self.counters["gammas"]
            self._load_state()
            self.measures.resume(balance)
            self.say(f"resumed at t = {state.t:.6f} s")
        else:
            obstacles = {name: contact.obstacle.surface for name, contact in self.model.contacts.items()}
            on_rank_zero(self.comm, lambda: self.writer.start(obstacles))
            self._set_time(0.0)
            if not self.stepping.quasi_static:
                self._solver.forces.repack()
                initial = self._solver.acceleration(self._solver.forces.unbalanced())
                self.scheme.restore(replace(self.scheme.state, acceleration=initial, auxiliary=initial))
            self._load_state()
            self.measures.start()
            self._record()
            self._output()
        self.counters["setup_seconds"] += time.perf_counter() - self._clock

    def _identity(self) -> str:
        """A fingerprint of everything that makes the motion, but not of where it is written or when it ends."""
        model = self.model
        points = self.writer.numbering.points
        parts: list[Any] = [fingerprint(model.tissue), fingerprint(model.contraction)]
        parts += [list(model.fixed), list(model.gravity), model.gravity_rise, model.mixed]
        parts += [fingerprint(bones) for bones in (model.moving, model.suspended)]
        parts += [{name: fingerprint(contact) for name, contact in model.contacts.items()}]
        parts += [model.quadrature_degree, asdict(self.stepping), asdict(self.simulation.tolerances), self.simulation.probes.names]
        parts += [{name: course.description(self.t_end) for name, course in self.simulation.activation.items()}]
        digest = hashlib.sha256(json.dumps(parts, sort_keys=True).encode())
        digest.update(b"" if points is None else np.ascontiguousarray(points).tobytes())
        return str(self.comm.bcast(digest.hexdigest()))

    # -- the time loop

    def go(self) -> None:
        """Step to the end, cutting steps that fail and growing them again."""
        step = self.counters.get("next_step", self.stepping.step_max)
        milestones = self._milestones()
        with interruptible() as interrupted:
            self._clock = time.perf_counter()
            while self.scheme.state.t < self.t_end * (1 - 1e-12):
                t = self.scheme.state.t
                target = next(m for m in milestones if m > t + 1e-9)
                h = (target - t) / math.ceil((target - t) / step * (1 - 1e-9))
                if self._step(h, target):
                    self.counters["n_steps"] += 1
                    step = self._next(step, h)
                    self.counters["next_step"] = step
                    self._after_step(target)
                else:
                    self.counters["n_rejected"] += 1
                    step = self._next(h, h) if self._outcome.converged else h / 2
                    self.say(f"step rejected at t = {t:.6f} s, h = {1e3 * h:.4f} ms ({self._outcome.reason}); cut to {1e3 * step:.4f} ms")
                    if step < self.stepping.step_min:
                        self._give_up()
                if self.comm.allreduce(int(interrupted()), op=MPI.MAX):
                    self._stop("interrupted")
                    raise KeyboardInterrupt
        self._stop("done")

    def _milestones(self) -> list[float]:
        """Times that a step must end on: kinks of the activations, outputs, the end of gravity's rise, the end."""
        every = self.stepping.output_every
        times = [every * i for i in range(1, int(self.t_end / every) + 1)] + [self.t_end]
        times += [kink for course in self.simulation.activation.values() for kink in course.kinks]
        moving = [contact.motion for contact in self.model.contacts.values() if contact.motion is not None]
        times += [kink for motion in (*self.model.moving.values(), *moving) for kink in motion.kinks]
        times += [self.model.gravity_rise] if any(self.model.gravity) else []
        return sorted({round(time, 12) for time in times if 0 < time <= self.t_end})

    def _set_time(self, t: float) -> None:
        self.weak.set_time(t, {name: course(t) for name, course in self.simulation.activation.items()})

    def _step(self, h: float, target: float) -> bool:
        before = self.scheme.state
        t = before.t + h if before.t + 1.5 * h < target else target
        self._set_time(t)
        assert self._solver is not None
        self._outcome = self._solve(h)
        self.counters["newton_iterations"] += self._outcome.newton
        self.counters["krylov_iterations"] += self._outcome.krylov
        good = self._outcome.converged
        if good:
            self.scheme.accept(t)
            good = self._accurate(before)
        if good:
            self._load_state()
            self.measures.advance()
            if self._outcome.rung != self._solver.ladder[0]:
                self.counters["fallbacks"][self._outcome.rung] = self.counters["fallbacks"].get(self._outcome.rung, 0) + 1
        else:
            self.scheme.restore(before)
        return good

    def _solve(self, h: float) -> Outcome:
        """Solve a step of `h`: if that fails in contact, from where softer obstacles stop the tongue; and again with augmented
        contact where it is too deep in one."""
        assert self._solver is not None
        contacts = self.weak.contacts
        self._begin(h)
        outcome = self._solver.solve()
        if contacts.terms and not outcome.converged:
            self._begin(h)
            with contacts.softened():
                outcome = outcome.then(self._solver.solve())
            if outcome.converged:
                outcome = outcome.then(self._solver.solve())
        for _ in range(AUGMENTATIONS):
            if not (outcome.converged and contacts.augment()):
                break
            outcome = outcome.then(self._solver.solve())
        return outcome

    def _begin(self, h: float) -> None:
        """Make `u` the first guess of a step of `h`."""
        self.scheme.begin(h)
        self.weak.hold()

    def _accurate(self, before: State) -> bool:
        """Whether the step meets the tolerance, nearly; steps of the least length always do."""
        tolerance = self.stepping.tolerance
        if tolerance is None:
            return True
        owned = 3 * self.weak.V.dofmap.index_map.size_local

        def size(values: Floats) -> float:
            n, squares = self.comm.allreduce(np.array([owned / 3, float((values[:owned] ** 2).sum())]))
            return math.sqrt(squares / n)

        largest = max(self.counters.get("largest", SMALL), size(self.scheme.state.u))
        error = size(self.scheme.error(before)) / largest
        self._excess = error / tolerance
        if self._excess > 2 and self.scheme.state.h > 2 * self.stepping.step_min:
            self._outcome = replace(self._outcome, reason=f"time error {error:.1e} of the displacement")
            return False
        self.counters["largest"] = largest
        return True

    def _next(self, step: float, h: float) -> float:
        """The step to try next, after one of `h` where `step` was wanted."""
        if self.stepping.tolerance is not None:
            step = h * float(np.clip(0.8 * max(self._excess, 1e-9) ** (-1 / 3), 0.2, 1.5))
            return min(max(step, self.stepping.step_min), self.stepping.step_max)
        return min(step * (1.5 if self._outcome.newton <= 6 else 1.0), self.stepping.step_max)

    def _load_state(self) -> None:
        self.weak.u.x.array[:] = self.scheme.state.u
        self.weak.refresh()

    def _after_step(self, target: float) -> None:
        state, outcome, c = self.scheme.state, self._outcome, self.counters
        ratio, least = self.measures.volume_ratio, self.measures.min_jacobian
        c["volume_change_max"] = max(c["volume_change_max"], abs(ratio - 1))
        c["min_jacobian"] = min(c["min_jacobian"], least)
        pace = state.v if self.stepping.quasi_static else state.average  # v itself jitters where a surface meets an obstacle
        speed = np.linalg.norm(pace.reshape(-1, 3), axis=1).max(initial=0.0)
        c["peak_speed_m_s"] = max(c["peak_speed_m_s"], float(self.comm.allreduce(float(speed), op=MPI.MAX)))
        self._record()
        self.say(
            f"t = {state.t:.6f} s  h = {1e3 * state.h:.3f} ms  newton {outcome.newton}  krylov {outcome.krylov}  {outcome.rung}  "
            f"min J {least:.3f}  volume {100 * (ratio - 1):+.3f} %"
        )
        if self.report is not None and self.comm.rank == 0:
            self.report(Progress(state.t, self.t_end, c["n_steps"], state.h, outcome.newton, outcome.krylov, outcome.rung))
        if state.t >= target:
            every = self.stepping.output_every
            if abs(state.t / every - round(state.t / every)) < 1e-6 or target >= self.t_end * (1 - 1e-12):
                self._output()
                self._checkpoint()

    def _record(self) -> None:
        balance = asdict(self.measures.balance)
        self.writer.record(
            {
                "t": self.scheme.state.t,
                "probes": self.simulation.probes.values(self.weak.u),
                "support": self.measures.support_forces,
                "contact": {name: touch.numbers for name, touch in self.measures.contact.touches.items()},
                "volume_ratio": self.measures.volume_ratio,
            }
            | {name: balance[name] for name in ENERGIES}
        )

    def _output(self) -> None:
        strain, percentile, largest = self.measures.hencky()
        c = self.counters
        c["hencky_von_mises_max"] = max(c["hencky_von_mises_max"], percentile)
        c["hencky_von_mises_raw_max"] = max(c["hencky_von_mises_raw_max"], largest)
        state = self.scheme.state
        self.writer.write_fields(
            state.t,
            {"displacement": state.u, "velocity": state.v},
            {"hencky_von_mises": strain, "jacobian": self.measures.jacobian_per_cell()}
            | ({"contact_pressure": self.measures.contact.pressure} if self.weak.contacts.terms else {})
            | self.extra.evaluate(),
        )

    def _checkpoint(self) -> None:
        now = time.perf_counter()
        self.counters["wall_seconds"] += now - self._clock
        self._clock = now
        self.counters["gammas"] = self.weak.contacts.gammas
        self.writer.write_checkpoint(self.scheme.state, self.measures.balance, self.counters, self._identity())

    # -- the end

    def _give_up(self) -> None:
        last = self.scheme.state.t
        self.measures.evaluate()  # of the iterate that did not converge
        where = self.measures.extremes()
        self._load_state()
        self._stop("failed")
        raise SolveError(
            f"the solve failed at t = {last:.6f} s even with the smallest step, {self.stepping.step_min:g} s ({self._outcome.reason}); "
            f"{where}. The last good state is saved in {self.folder}. Less activation, a slower rise, a longer tendon or "
            "another element size may help."
        )

    def _stop(self, status: str) -> None:
        self._checkpoint()
        self.writer.finish(self.summary(status))
        self.say(f"{status} at t = {self.scheme.state.t:.6f} s after {self.counters['wall_seconds']:.1f} s")

    def summary(self, status: str) -> dict[str, Any]:
        """What ``summary.json`` holds; the memory is that of the rank that took most."""
        model, c = self.model, {name: value for name, value in self.counters.items() if name not in ("next_step", "largest", "gammas")}
        numbering = self.writer.numbering
        probes = self.simulation.probes
        contact = {name: touches_summary([row["contact"][name] for row in self.writer.rows]) for name in model.contacts}
        assert self._solver is not None
        return {
            "status": status,
            "name": model.tongue.name,
            "n_nodes": 0 if numbering.points is None else len(numbering.points),
            "n_cells": 0 if numbering.cells is None else len(numbering.cells),
            "n_dofs": self._solver.n_unknowns,
            "ranks": self.comm.size,
            "t_end": self.scheme.state.t,
            **c,
            "peak_memory_gib": self.comm.allreduce(peak_memory(), op=MPI.MAX),
            "energy_balance_error": self.measures.balance.error,
            "contact_force_max_N": max((of["force_max_N"] for of in contact.values()), default=0.0),
            "contact": contact,
            "probes": {name: list(map(float, u)) for name, u in zip(probes.names, self.writer.rows[-1]["probes"], strict=True)},
            "model": {
                "law": type(model.tissue.law).__name__.lower(),
                **numbers(model.tissue.law),
                "nu": model.tissue.law.nu,
                "volumetric": model.tissue.law.volumetric,
                "formulation": "mixed" if model.mixed else "displacement",
                "density": model.tissue.density,
                "rayleigh_alpha": model.tissue.damping.alpha,
                "rayleigh_beta": model.tissue.damping.beta,
                "force_velocity": model.contraction.force_velocity,
                "tendon_length_m": model.contraction.tendon_length,
                "sigma_max": peak_stress(self.simulation.activation, model.tissue.peak_stress),
            },
            "versions": versions(),
        }
