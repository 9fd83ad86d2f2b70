# SPDX-License-Identifier: MIT
"""A simulation: a model that is built once and moved by any number of activations."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from ..anatomy.catalogue import resolve
from ..core.errors import InputError, within
from ..core.fingerprint import fingerprint
from ..core.parallel import on_rank_zero
from ..mechanics.activation import Course, FunctionOfTime
from ..mechanics.control import Control, OpenLoop
from ..mechanics.model import Model
from ..mechanics.support import check_held
from ..mechanics.tissue import number_of
from ..runs.claim import claim
from ..runs.figures import figure_files
from ..runs.inputs import KEPT, Inputs
from ..runs.log import Log
from ..runs.run import Run
from ..runs.store import Folder, Memory
from ..runs.writer import LEFT_BEFORE, LOG, RunWriter
from ..solvers.tolerances import Tolerances
from . import fields, records, summary  # noqa: F401  the standard quantities register themselves
from .as_scenario import as_scenario
from .engine import Engine
from .gradient import Gradient, Objective, Recorder, go_back
from .initial import Initial
from .loop import Loop, Task
from .probes import Probes
from .quantities import FIELDS
from .snapshot import Snapshot
from .stepping import Report, Stepping

Activation = Mapping[str, Course | Callable[[float], float]] | Control
"""Muscle (``GGP``) or muscle and side (``GGP_L``) to `Activation`, `Excited`, or a function of time in s; or a `Control`."""


class Simulation:
    """A model, ready to run. Forms, solver and sensors are made for the first run; later ones use them again as far as they serve.

    Parameters
    ----------
    model : Model
        What is simulated. It may be replaced by another one between runs; where only numbers differ, nothing is built again.
    probes : mapping, optional
        Name to landmark name or to a point (3,) in m of the rest shape; by default all landmarks.
    stepping : Stepping
        Time steps and output.
    tolerances : Tolerances
        Accuracy of each solve, with the step and the penetration that `stepping` and the contacts leave open; such as
        ``Tolerances.of("tight")``.

    Raises
    ------
    InputError
        If a landmark is not in the mesh, a probe lies outside it, a field to be stored is not registered, or nothing holds a quasi-static
        tongue.
    """

    def __init__(
        self,
        model: Model,
        probes: Mapping[str, str | Any] | None = None,
        stepping: Stepping | None = None,
        tolerances: Tolerances | None = None,
    ) -> None:
        self.model, self.tolerances = model, tolerances or Tolerances()
        self.stepping = (stepping or Stepping()).within(self.tolerances)
        self._tongue = tongue = model.tongue
        for name in self.stepping.fields:
            if name not in FIELDS:
                raise InputError(f"output.fields: {name!r} is not one of {', '.join(FIELDS)}.")
        if self.stepping.quasi_static:
            check_held(model)
        self.probes = Probes(tongue, probes if probes is not None else {name: name for name in tongue.landmarks})
        self._engine: Engine | None = None

    def close(self) -> None:
        """Free the solver, on all ranks at once; the next run makes another one."""
        if self._engine is not None:
            self._engine.destroy()
            self._engine = None

    def run(
        self,
        activation: Activation,
        t_end: float,
        output: str | Path | None = None,
        *,
        resume: bool = False,
        overwrite: bool = False,
        report: Report | None = None,
        after_step: Callable[[Snapshot], object] | None = None,
        inputs: Inputs | None = None,
        seed: int | None = None,
        initial: Initial | None = None,
    ) -> Run:
        """Simulate from rest, or what is given instead, to `t_end` seconds.

        Parameters
        ----------
        activation : mapping or Control
            What moves the muscles; an empty mapping leaves them at rest.
        t_end : float
            End of the simulated time in s.
        output : path, optional
            The run folder; without one the result stays in memory.
        resume : bool
            Go on from the folder's checkpoint.
        overwrite : bool
            Replace the run that the folder holds.
        report : callable, optional
            Called with the `Progress` after each step, on rank 0.
        after_step : callable, optional
            Called with the `Snapshot` after each step, on all ranks.
        inputs : Inputs, optional
            What the folder keeps to make the run again; by default the values of the simulation, told as a scenario.
        seed : int, optional
            Of the design that the run is part of, for its record.
        initial : Initial, optional
            Displacement and velocity with which it begins, of a run in memory.

        Raises
        ------
        InputError
            If a muscle is not in the mesh, `t_end` is not positive, `initial` has another shape than the mesh or an output beside it, the
            folder cannot be written, belongs to another process or holds a run that is neither to go on nor to be replaced, or there is
            nothing to resume.
        SolveError
            If the solve fails at the smallest step; everything up to the last good state is saved.
        """
        clock = time.perf_counter()
        if not (np.isfinite(t_end) and t_end > 0):
            raise InputError(f"t_end: {t_end}; a positive number of seconds is expected.")
        if resume and output is None:
            raise InputError("resume: a run goes on from its folder; give output.")
        if initial is not None and output is not None:
            raise InputError("initial: a run in a folder begins at rest, as its scenario says; leave output out.")
        model, comm = self.model, self.model.tongue.comm
        if model.tongue is not self._tongue:
            raise InputError("model: it has another mesh than the simulation was made for; make another simulation.")
        control = _control(activation)
        sides = resolve_sides(control, model)
        store = Memory() if output is None else Folder(Path(output))
        with ExitStack() as stack:
            log = Log(None)
            if isinstance(store, Folder):
                taken = claim(store.path, figure_files(), resume=resume, overwrite=overwrite)
                on_rank_zero(comm, lambda: stack.enter_context(taken))
                log = Log(store.path / LOG if comm.rank == 0 else None)
            engine = self._prepare([name for names in sides.values() for name in names])
            engine.log = log.say
            engine.set_out(*(initial or Initial()).on(engine.weak.V))

            def levels(t: float, now: Snapshot) -> dict[str, float]:
                return {name: level for key, level in control.levels(t, now).items() for name in sides[key]}

            def replace_old() -> None:
                """Take what an earlier run left out of the folder, and put in what makes this one."""
                if isinstance(store, Folder):
                    for name in (*LEFT_BEFORE, *KEPT, *figure_files()):
                        store.remove(name)
                    (inputs or self._told(control, t_end)).install(store.path)
                log.open(anew=True)

            identity = self._identify(control) if isinstance(store, Folder) else None
            writer = RunWriter(store, engine.weak.V, self.probes.rest, identity)
            task = Task(model, self.stepping, levels, t_end, [*model.kinks, *control.kinks], report, after_step, seed)
            loop = Loop(engine, task, writer, str(output or "memory"))
            log.say(f"{model.tongue.name}: {engine.n_unknowns} unknowns on {comm.size} rank(s)")
            if resume:
                with within(output):
                    saved = writer.read_checkpoint()
                log.open(anew=False)
                loop.resume(saved, clock)
            else:
                loop.begin(replace_old, clock)
            loop.go()
            comm.barrier()
        return Run(store.path) if isinstance(store, Folder) else Run(Memory(comm.bcast(store.files)))

    def gradient(
        self,
        objective: Objective,
        activation: Mapping[str, Course | Callable[[float], float]],
        t_end: float,
        tissue: Sequence[str] = (),
        initial: Initial | None = None,
    ) -> Gradient:
        """An objective of a run, and its derivatives by the activation of each muscle at each step: the discrete adjoint of the scheme in
        time, or of equilibria, with contact, force–length and force–velocity exact. The steps and how soft obstacles are count as given;
        solve to tight tolerances.

        Parameters
        ----------
        objective : callable
            See `Objective`.
        activation : mapping
            As of `run`, without feedback.
        t_end : float
            In s.
        tissue : sequence of str
            Numbers of the tissue by which derivatives are wanted too: of its law (``c10``, ``c20``, ``nu``), ``density``, ``alpha``,
            ``beta``, or the name of a muscle for its peak stress; each costs two evaluations of the balance a step.
        initial : Initial, optional
            As of `run`.

        Raises
        ------
        InputError
            As of `run`; for the mixed form and suspended bones; if the tissue has no such number.
        SolveError
            As of `run`.
        """
        for name in tissue:
            number_of(self.model.tissue, name)
        recorder, sides = Recorder(objective), resolve_sides(_control(activation), self.model)
        engine = self._prepare([name for names in sides.values() for name in names])
        adjoint = engine.adjoint  # where there is none, this says so before the run
        self.run(activation, t_end, after_step=recorder.step, initial=initial)
        return go_back(engine, adjoint, recorder, tissue)

    def _told(self, control: Control, t_end: float) -> Inputs:
        return as_scenario(self.model, self.stepping, self.tolerances, self.probes.rest, control, t_end)

    def _prepare(self, muscles: list[str]) -> Engine:
        """The engine for these muscles: the last one, if it serves."""
        if self._engine is None or not self._engine.renew(self.model, muscles):
            self.close()
            self._engine = Engine(self.model, muscles, self.probes, self.stepping, self.tolerances)
        return self._engine

    def _identify(self, control: Control) -> Callable[[float], dict[str, str]]:
        """Of a time in s: fingerprint of each part of what makes the motion up to there, but not of where it is written or when it ends."""
        parts = {"time and output": self.stepping, "solver": self.tolerances, "probes": self.probes.rest}
        fixed = self.model.fingerprint() | {name: fingerprint(value) for name, value in parts.items()}
        return lambda t: fixed | {"activation": fingerprint(control, t)}


def _control(activation: Activation) -> Control:
    """The control that courses or functions of time are, or the given one."""
    if not isinstance(activation, Mapping):
        if not isinstance(activation, Control):
            raise InputError(f"activation: {activation!r}; a mapping of muscles to courses or functions of time, or a control is expected.")
        return activation
    for key, course in activation.items():
        if not callable(course):
            raise InputError(
                f"activation.{key}: {course!r}; a course such as ramp(rise=0.1, hold=0.25), or a function of time is expected."
            )
    return OpenLoop({key: course if isinstance(course, Course) else FunctionOfTime(course) for key, course in activation.items()})


def resolve_sides(control: Control, model: Model) -> dict[str, list[str]]:
    """The muscles of a model's mesh that each name of a control stands for.

    Raises
    ------
    InputError
        If the mesh has no such muscle, or one is named twice.
    """
    found: dict[str, list[str]] = {}
    for key in control.muscles:
        found[key] = resolve(key, model.tongue.muscles, f"activation.{key}")
        for other, names in found.items():
            twice = sorted(set(names) & set(found[key]))
            if other != key and twice:
                raise InputError(f"activation.{key}: {twice[0]} is activated twice; name the muscle or its sides, not both.")
    return found
