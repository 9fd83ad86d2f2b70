# SPDX-License-Identifier: MIT
"""Many runs: in this process, in others, on the ranks of mpiexec, or a share of them."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from filelock import FileLock
from mpi4py import MPI

from ..analysis.tables import DONE
from ..analysis.tables import FILE as TABLE
from ..core.errors import InputError, SolveError, check_outputs
from ..core.fingerprint import fingerprint
from ..core.interruption import Interrupted, interruptible
from ..core.parallel import on_rank_zero
from ..meshing import build as meshing
from ..runs.run import Run
from ..scenario.build import Workbench, anatomy_of, size_of
from ..scenario.schema import MeshSection, Scenario
from . import worker
from .plan import KILLED, LOGS, PLAN, Case, Outcome, Plan
from .run_table import TIMING, RunTable
from .worker import News, Worker

LAUNCHER = ("PMI", "MPI", "OMPI", "HYDRA")
"""What variables begin with by which a launcher of MPI speaks to its processes; those that they begin are none of its."""


@dataclass
class Standing:
    """How far many runs are.

    Attributes
    ----------
    total, over : int
        How many there are, and how many of them are over.
    shares : dict
        Name of each that is at work to how much of it is done, 0…1.
    ended : News, optional
        Of the one that has just ended.
    """

    total: int
    over: int
    shares: dict[str, float] = field(default_factory=dict)
    ended: News | None = None

    def hear(self, news: News) -> None:
        """Take news of a run."""
        self.ended = news if news.outcome is not None else None
        if self.ended is None:
            self.shares[news.name] = news.share
        else:
            self.over += 1
            self.shares.pop(news.name, None)


@dataclass(frozen=True)
class Workers:
    """Who does the runs, and how.

    Attributes
    ----------
    jobs : int
        Processes on this machine.
    ranks_per_run : int
        Of the ranks of mpiexec.
    shard : (int, int)
        Which share of the runs, counted from 1, of how many; the others are left alone.
    figures : bool
        Whether to draw the pictures of each run.
    overwrite : bool
        Whether runs of other scenarios in the folder may be replaced.
    report : callable
        Is told how far the runs are, on rank 0.

    Raises
    ------
    InputError
        If numbers are out of range, or do not go together.
    """

    jobs: int = 1
    ranks_per_run: int = 1
    shard: tuple[int, int] = (1, 1)
    figures: bool = False
    overwrite: bool = False
    report: Callable[[Standing], object] = lambda standing: None

    def __post_init__(self) -> None:
        ranks = MPI.COMM_WORLD.size
        (part, of) = self.shard
        if not 1 <= part <= of:
            raise InputError(f"--shard {part}/{of}: one of the shares 1/{of} to {of}/{of} is expected.")
        if self.jobs < 1:
            raise InputError(f"--jobs {self.jobs}: a positive number is expected.")
        if self.jobs > 1 and (ranks > 1 or of > 1):
            raise InputError(f"--jobs {self.jobs}: not with mpiexec or --shard, which share the runs already.")
        if self.ranks_per_run < 1 or ranks % self.ranks_per_run:
            raise InputError(f"--ranks-per-run {self.ranks_per_run}: a divisor of the number of ranks, {ranks}, is expected.")


def perform(folder: Path, runs: Mapping[str, tuple[Scenario, Mapping[str, Any]]], workers: Workers) -> Plan:
    """Do runs, each in a folder of its name; those that are there are taken as they are. One that fails stops no other.

    Parameters
    ----------
    folder : Path
        Where the run folders go, with a table of them, a log for each worker, and meshes that are built for them.
    runs : mapping
        Name to the scenario, and to what is told of it in the table.
    workers : Workers
        Who does them.

    Raises
    ------
    InputError
        Before any run: if a scenario does not fit its mesh, or the folder holds others.
    Interrupted
        If interrupted; what is done is kept, and the same call goes on.
    """
    comm = MPI.COMM_WORLD
    plan: Plan = on_rank_zero(comm, lambda: _prepare(folder, runs, workers))
    standing = Standing(len(plan.cases), sum(1 for _ in plan.over()))
    if comm.rank == 0:
        workers.report(standing)
    try:
        if workers.jobs > 1:
            _Processes(plan, workers, standing).go()
        else:
            _work_here(plan, workers, standing)
    finally:
        if comm.rank == 0:
            RunTable(plan).write()
    return plan


def results(plan: Plan) -> dict[str, Run | SolveError]:
    """The runs of a plan by name, and for those that failed why."""

    def result(case: Case, outcome: Outcome) -> Run | SolveError:
        return Run(plan.folder / case.name) if outcome.status == DONE else SolveError(f"{case.name}: {outcome.reason}")

    return {case.name: result(case, outcome) for case, outcome in plan.over()}


def all_done(plan: Plan) -> dict[str, Run]:
    """The runs of a plan by name.

    Raises
    ------
    SolveError
        If one failed.
    """
    runs = {}
    for name, run in results(plan).items():
        if isinstance(run, SolveError):
            raise run
        runs[name] = run
    return runs


def shared_mesh(source: MeshSection, folder: Path, name: str | None = None) -> MeshSection:
    """The section of a mesh file: the given one, or one that is built in `folder`, once for all runs; for one rank alone."""
    if source.file is not None:
        return source.model_copy(update={"file": str(Path(source.file).resolve())})
    path = folder.resolve() / (name or f"mesh-{fingerprint(source.model_dump())[:8]}.msh")
    check_outputs(folder)
    with FileLock(path.with_suffix(".lock")):
        if not path.is_file():
            meshing.build(anatomy_of(source), path, size_of(source))
    return MeshSection(file=str(path))


def _prepare(folder: Path, runs: Mapping[str, tuple[Scenario, Mapping[str, Any]]], workers: Workers) -> Plan:
    """Hold every scenario against its mesh, and write the plan and the table as it is."""
    check_outputs(folder, [PLAN, TABLE, TIMING])
    bench, cases = Workbench(MPI.COMM_SELF), []
    for name, (scenario, parameters) in runs.items():
        on_mesh = scenario.model_copy(update={"mesh": shared_mesh(scenario.mesh, folder)})
        try:
            probes = bench.simulation(on_mesh).probes.rest
        except InputError as error:
            given = ", ".join(f"{key} = {value}" for key, value in parameters.items())
            raise InputError(f"{name}{given and f' ({given})'}: {error}") from error
        named = on_mesh.probes if on_mesh.probes is not None else {probe: probe for probe in probes}
        cases.append(Case.of(name, on_mesh.model_copy(update={"probes": named}), parameters))
    bench.clear()
    plan = Plan(folder, cases)
    plan.write(workers.overwrite)
    RunTable(plan).write()
    return plan


def _work_here(plan: Plan, workers: Workers, standing: Standing) -> None:
    """Work on the ranks of this process's mpiexec, a group of them for each run."""
    comm, (part, of) = MPI.COMM_WORLD, workers.shard
    group = comm.rank // workers.ranks_per_run
    table = RunTable(plan)

    def tell(news: News) -> None:
        if comm.rank == 0:
            standing.hear(news)
            if standing.ended is not None:
                standing.over = table.count()  # also of other groups
            workers.report(standing)

    name = f"worker-{group}" if of == 1 else f"worker-{part}-{group}"
    Worker(plan, plan.cases[part - 1 :: of], name, comm.Split(group, comm.rank), tell, workers.figures).go()
    comm.barrier()


class _Processes:
    """Workers in processes of their own."""

    def __init__(self, plan: Plan, workers: Workers, standing: Standing) -> None:
        self._plan, self._workers, self._standing = plan, workers, standing
        self._table = RunTable(plan)
        self._at_work: dict[Connection, tuple[subprocess.Popen[bytes], str]] = {}
        self._last: dict[Connection, News] = {}

    def go(self) -> None:
        """Begin them, listen to them, and replace those that are killed, until all runs are over."""
        with interruptible() as interrupted:
            told = 0
            try:
                for number in range(min(self._workers.jobs, self._standing.total - self._standing.over)):
                    self._begin(f"worker-{number}")
                while self._at_work:
                    if not told and (told := interrupted()):
                        self._stop()
                    for pipe in wait(list(self._at_work), 0.2):
                        assert isinstance(pipe, Connection)
                        self._hear(pipe, bool(told))
            finally:
                if not told:
                    self._stop()
        if told:
            raise Interrupted(told)

    def _begin(self, name: str) -> None:
        """Begin a worker; it is in a group of its own, so that Ctrl-C reaches it through this process alone."""
        here, there = Pipe(duplex=False)
        environment = {key: value for key, value in os.environ.items() if not key.startswith(LAUNCHER)}
        with open(self._plan.folder / LOGS / f"{name}.log", "ab") as log:
            process = subprocess.Popen(
                worker.command(self._plan.folder, name, there.fileno(), self._workers.figures),
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment, pass_fds=[there.fileno()], process_group=0,
            )  # fmt: skip
        there.close()
        self._at_work[here] = process, name

    def _stop(self) -> None:
        for process, _ in self._at_work.values():
            process.send_signal(signal.SIGINT)

    def _hear(self, pipe: Connection, stopped: bool) -> None:
        try:
            self._last[pipe] = news = pipe.recv()
        except EOFError:
            self._bury(pipe, stopped)
        else:
            self._tell(news)

    def _tell(self, news: News) -> None:
        self._standing.hear(news)
        self._workers.report(self._standing)

    def _bury(self, pipe: Connection, stopped: bool) -> None:
        """A worker has ended: if not by itself, say so of its run, and begin another one."""
        process, name = self._at_work.pop(pipe)
        code, last = process.wait(), self._last.pop(pipe, None)
        pipe.close()
        if code == 0 or stopped:
            return
        reason = f"killed by signal {-code}" if code < 0 else f"its process ended with code {code}, see {LOGS}/{name}.log"
        if last is None and code > 0:
            raise RuntimeError(f"{name} did not begin: {reason}")
        case = next((case for case in self._plan.cases if last is not None and case.name == last.name), None)
        if case is not None and self._plan.outcome(case) is None:
            outcome = Outcome(KILLED, reason, worker=name)
            self._plan.conclude(case, outcome)
            self._table.append(case, outcome)
            self._tell(News(case.name, 1.0, outcome))
        self._begin(name)
