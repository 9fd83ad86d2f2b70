# SPDX-License-Identifier: MIT
"""One run: an engine driven through time, with output, roll-back and restart."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from mpi4py import MPI

from ..core.errors import SolveError
from ..core.interruption import Paused, interruptible
from ..mechanics.model import Model
from ..runs.checkpoint import Checkpoint
from ..runs.writer import RunWriter
from ..solvers.newton import Outcome
from ..solvers.time_integration import State
from .energy import Balance, warn
from .engine import Engine
from .quantities import FIELDS, HISTORY
from .snapshot import Snapshot
from .step_control import StepControl
from .stepping import Progress, Report, Stepping
from .summary import Ending, summarise
from .totals import Totals

NUMBERS = ("t", "h", "gammas")
"""What of a `State` are numbers and not nodal arrays."""


@dataclass(frozen=True)
class Task:
    """What a run is to do.

    Attributes
    ----------
    model, stepping : Model, Stepping
        What is simulated, and how.
    levels : callable
        Level of each muscle, with its side, at a time (s) from the last state.
    t_end : float
        In s.
    kinks : list of float
        Times in s that steps must end on.
    report, after_step, seed : optional
        See `Simulation.run`.
    """

    model: Model
    stepping: Stepping
    levels: Callable[[float, Snapshot], Mapping[str, float]]
    t_end: float
    kinks: list[float]
    report: Report | None = None
    after_step: Callable[[Snapshot], object] | None = None
    seed: int | None = None


class Loop:
    """A run in progress.

    Parameters
    ----------
    engine : Engine
        Solves the steps.
    task : Task
        What is to be done.
    writer : RunWriter
        Takes the results.
    where : str
        Where the results are, for messages.
    """

    def __init__(self, engine: Engine, task: Task, writer: RunWriter, where: str) -> None:
        self._engine, self._task, self._writer, self._where = engine, task, writer, where
        self._comm = task.model.tongue.comm
        self._totals, self._calm = Totals(), False

    def begin(self, replace_old: Callable[[], object], clock: float) -> None:
        """Begin with the engine's first state; `replace_old` makes way where the results go, `clock` is when setting up began."""
        self._steps = StepControl(self._task.stepping, self._task.t_end, self._task.kinks)
        obstacles = {name: contact.obstacle.surface for name, contact in self._task.model.contacts.items()}
        self._writer.begin(self._steps.outputs, obstacles, replace_old)
        self._now = self._engine.start(self._task.levels(0.0, self._engine.first()))
        self._record()
        self._output()
        self._set_clock(clock)
        self._checkpoint()

    def resume(self, saved: Checkpoint, clock: float) -> None:
        """Go on from a checkpoint."""
        state = State(**{**saved.numbers, **saved.arrays, "gammas": tuple(saved.numbers["gammas"])})
        balance, self._totals = Balance(**saved.progress["balance"]), Totals(**saved.progress["totals"])
        self._steps = StepControl(self._task.stepping, self._task.t_end, self._task.kinks, **saved.progress["steps"])
        self._writer.go_on(self._steps.outputs)
        self._now = self._engine.resume(state, saved.progress["levels"], balance)
        self._engine.log(f"resumed at t = {state.t:.6f} s")
        self._set_clock(clock)

    def _set_clock(self, clock: float) -> None:
        self._clock, self._cpu = time.perf_counter(), time.process_time()
        self._totals.setup_seconds += self._clock - clock

    def go(self) -> None:
        """Step to the end, cutting steps that fail and growing them again.

        Raises
        ------
        SolveError
            If the solve fails at the smallest step.
        Paused
            If Ctrl-C or SIGTERM came; everything up to the last step is saved.
        """
        with interruptible() as interrupted:
            while self._now.t < self._task.t_end * (1 - 1e-12):
                self._step()
                if number := self._comm.allreduce(interrupted(), op=MPI.MAX):
                    self._finish("interrupted")
                    raise Paused(number, f"interrupted at t = {self._now.t:.6f} s; everything so far is in {self._where}")
        self._finish("done")

    def _step(self) -> None:
        engine, before = self._engine, self._engine.equations.state
        t, target = self._steps.next_time(before.t)
        levels = self._task.levels(t, self._now)
        outcome = engine.solve(t, levels)
        self._totals.count(outcome)
        if before.t == 0.0 and not outcome.converged and not self._calm and any(self._now.levels.values()):
            self._calm = True
            self._engine.log(
                f"the first step failed ({outcome.reason}); again from the acceleration of muscles at rest, as their levels jump"
            )
            self._now = engine.start_calmly(self._now.levels)
            return
        fault: str | None = outcome.reason
        if outcome.converged:
            engine.equations.accept(t)
            fault = self._steps.find_fault(engine.equations, before)
        h = t - before.t
        if fault is None:
            self._steps.grow(h, outcome)
            self._now = engine.measure(levels)
            self._totals.step(self._now, outcome, engine.first_choice)
            self._after(outcome, target)
        else:
            where = "" if outcome.converged else engine.describe_iterate()
            engine.equations.restore(before)
            self._reject(h, fault, where, outcome.converged, levels)

    def _reject(self, h: float, fault: str, where: str, converged: bool, levels: Mapping[str, float]) -> None:
        self._totals.n_rejected += 1
        allowed = self._steps.cut(h, converged)
        t = self._now.t
        self._engine.log(f"step rejected at t = {t:.6f} s, h = {1e3 * h:.4f} ms ({fault}); cut to {1e3 * self._steps.step:.4f} ms")
        if not allowed:
            self._engine.equations.at(t, self._now.levels)
            reason = f"the solve failed at t = {t:.6f} s even with the smallest step, {self._task.stepping.step_min:g} s ({fault}); {where}"
            self._finish("failed", reason)
            raise SolveError(f"{reason}. The last good state is saved in {self._where}. {self._engine.advise(self._now, levels)}.")

    def _after(self, outcome: Outcome, target: float) -> None:
        now = self._now
        self._record()
        self._engine.log(
            f"t = {now.t:.6f} s  h = {1e3 * now.h:.3f} ms  newton {outcome.newton}  krylov {outcome.krylov}  {outcome.rung}  "
            f"min J {now.min_jacobian:.3f}  volume {100 * (now.volume_ratio - 1):+.3f} %"
        )
        if self._task.after_step is not None:
            self._task.after_step(now)
        if self._task.report is not None and self._comm.rank == 0:
            self._task.report(Progress(now.t, self._task.t_end, self._totals.n_steps, now.h, outcome.newton, outcome.krylov, outcome.rung))
        if now.t >= target and self._steps.stores(target):
            self._output()
            self._checkpoint()

    def _record(self) -> None:
        row: dict[str, Any] = {}
        for quantity in HISTORY.values():
            row |= quantity.values(self._now)
        self._writer.record(row)

    def _output(self) -> None:
        self._totals.output(self._now)
        nodal: dict[str, Any] = {}
        cellwise: dict[str, Any] = {}
        for quantity in FIELDS.values():
            if quantity.default or quantity.name in self._task.stepping.fields:
                (nodal if quantity.centre == "Node" else cellwise).update(quantity.values(self._now))
        self._writer.write_fields(self._now.t, nodal, cellwise)

    def _checkpoint(self) -> None:
        now, cpu = time.perf_counter(), time.process_time()
        self._totals.wall_seconds += now - self._clock
        self._totals.cpu_seconds += self._comm.allreduce(cpu - self._cpu)
        self._clock, self._cpu = now, cpu
        state = self._engine.equations.state
        numbers = {name: getattr(state, name) for name in NUMBERS}
        arrays = {item.name: getattr(state, item.name) for item in fields(state) if item.name not in NUMBERS}
        progress = {
            "balance": asdict(self._now.balance),
            "totals": asdict(self._totals),
            "steps": {"step": self._steps.step, "largest": self._steps.largest},
            "levels": dict(self._now.levels),
        }
        self._writer.write_checkpoint(numbers, arrays, progress)

    def _finish(self, status: str, reason: str = "") -> None:
        self._checkpoint()
        writer = self._writer
        numbers = (self._now, self._totals, writer.history, writer.numbering, self._engine.n_unknowns)
        writer.finish(summarise(Ending(status, self._task.model, *numbers, reason=reason, seed=self._task.seed)))
        for line in warn(self._now.balance.error):
            self._engine.log(line)
        self._engine.log(f"{status} at t = {self._now.t:.6f} s after {self._totals.wall_seconds:.1f} s")
