# SPDX-License-Identifier: MIT
"""A worker takes one run of a plan after another, here or in a process of its own.

There is no master: what is over stands in the run folders, what is at work is locked by who does it, so any number of workers, under
mpiexec, in processes and in array jobs, share a plan, and a run is the same whoever does it.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from mpi4py import MPI

from ..analysis.tables import DONE
from ..core.errors import InputError, SolveError
from ..core.parallel import on_rank_zero
from ..runs.run import Run
from ..scenario.build import Workbench, activation_of, inputs_of
from ..scenario.schema import Scenario
from ..simulation.stepping import Progress
from .plan import FAILED, LOGS, Case, Outcome, Plan
from .run_table import RunTable

PATIENCE = 0.5
"""Seconds between looks at runs that are at work elsewhere."""


@dataclass(frozen=True)
class News:
    """What a worker tells of a run.

    Attributes
    ----------
    name : str
        Of the case.
    share : float
        How much of it is done, 0…1.
    outcome : Outcome, optional
        How it ended.
    """

    name: str
    share: float
    outcome: Outcome | None = None


Tell = Callable[[News], object]


class Worker:
    """Does the runs of a plan that nobody else does, until all are over.

    Parameters
    ----------
    plan : Plan
        It has been written.
    cases : sequence of Case
        Those of its cases that this worker may take.
    name : str
        Of its log.
    comm : MPI.Comm
        The ranks of each run.
    tell : callable
        Takes news, on rank 0.
    figures : bool
        Whether to draw the pictures of each run.
    """

    def __init__(self, plan: Plan, cases: Sequence[Case], name: str, comm: MPI.Comm, tell: Tell, figures: bool = False) -> None:
        self._plan, self._pending, self._comm, self._tell, self._figures = plan, list(cases), comm, tell, figures
        self._table, self._bench = RunTable(plan), Workbench(comm)
        self._who = f"{name} {socket.gethostname()} {os.getpid()}"
        self._log = logging.getLogger(f"{__name__}.{name}")
        self._log.propagate = False
        self._log.setLevel(logging.INFO)
        if comm.rank == 0:
            handler = logging.FileHandler(plan.folder / LOGS / f"{name}.log", delay=True, encoding="utf-8")
            handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
            self._log.handlers = [handler]

    def go(self) -> None:
        """Work."""
        try:
            while on_rank_zero(self._comm, self._next):
                self._do()
        finally:
            self._bench.clear()

    def _next(self) -> bool:
        """Claim a run on rank 0; wait for those of others. Whether there is one."""
        while (found := self._plan.claim(self._pending)) is None and self._pending:
            time.sleep(PATIENCE)
        self._claimed = found
        return found is not None

    def _do(self) -> None:
        case = on_rank_zero(self._comm, lambda: self._claimed and self._claimed[0])
        start = time.perf_counter()
        self._say(f"{case.name} begins")
        self._report(News(case.name, 0.0))
        status, reason = DONE, ""
        try:
            run = self._run(case)
            if self._figures:
                on_rank_zero(self._comm, run.plot)
        except (SolveError, InputError) as error:
            status, reason = FAILED, " ".join(str(error).split()).replace(str(self._plan.folder / case.name), case.name)
            self._bench.clear()
        outcome = Outcome(status, reason, time.perf_counter() - start, self._who)

        def conclude() -> None:
            assert self._claimed is not None
            self._plan.conclude(case, outcome)
            self._table.append(case, outcome)
            self._claimed[1].release()
            self._report(News(case.name, 1.0, outcome))

        on_rank_zero(self._comm, conclude)
        self._say(f"{case.name} {status}{reason and ': '}{reason}, {outcome.seconds:.2f} s")

    def _run(self, case: Case) -> Run:
        """Do a run, or go on with it where it was left."""
        scenario, folder = Scenario.model_validate(case.scenario), self._plan.folder / case.name
        simulation = self._bench.simulation(scenario)

        def go(resume: bool) -> Run:
            activation = activation_of(scenario)
            inputs = inputs_of(scenario, simulation.model.tongue, link=True)
            return simulation.run(
                activation, scenario.time.end, folder, resume=resume, overwrite=not resume, report=report, inputs=inputs, seed=scenario.seed
            )

        def report(progress: Progress) -> None:
            self._report(News(case.name, progress.t / progress.t_end))

        if on_rank_zero(self._comm, lambda: (folder / "checkpoint.h5").is_file()):
            try:
                return go(resume=True)
            except InputError as error:
                self._say(f"{case.name} cannot go on and begins anew: {error}")
        return go(resume=False)

    def _report(self, news: News) -> None:
        if self._comm.rank == 0:
            self._tell(news)

    def _say(self, line: str) -> None:
        self._log.info(line)


def main() -> None:
    """Work on the plan in a folder and tell news through a pipe: its folder, the worker's name, the pipe's handle, whether to draw."""
    folder, name, handle, figures = sys.argv[1:]
    pipe = Connection(int(handle), readable=False)

    def tell(news: News) -> None:
        try:
            pipe.send(news)
        except OSError:  # who began it is gone: end after this step, as at Ctrl-C
            os.kill(os.getpid(), signal.SIGTERM)

    plan = Plan.read(Path(folder))
    try:
        Worker(plan, plan.cases, name, MPI.COMM_WORLD, tell, figures == "figures").go()
    except KeyboardInterrupt:
        sys.exit(130)


def command(folder: Path, name: str, handle: int, figures: bool) -> list[str]:
    """The command that begins a worker in a process of its own."""
    return [sys.executable, "-c", f"from {__name__} import main; main()", str(folder), name, str(handle), "figures" if figures else ""]
