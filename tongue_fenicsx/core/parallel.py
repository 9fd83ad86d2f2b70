# SPDX-License-Identifier: MIT
"""What all ranks do together, also when one of them fails."""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable, Collection
from types import TracebackType
from typing import Any

from mpi4py import MPI

PATIENCE = 2.0
"""Seconds in which the other ranks must end as well before all of them are aborted."""
FAREWELL = 30_001
"""Tag of the messages by which ranks tell each other why they end."""


def on_rank_zero(comm: MPI.Intracomm, action: Callable[..., Any]) -> Any:
    """Do something on rank 0 and give every rank its value, or raise on every rank what it raised."""
    if comm.rank == 0:
        try:
            value = action()
            packed = pickle.dumps((value, None))
        except BaseException as caught:
            comm.bcast(pickle.dumps((None, _portable(caught))))
            raise
        comm.bcast(packed)
        return value
    value, error = pickle.loads(comm.bcast(None))
    if error is not None:
        raise error
    return value


def _portable(error: BaseException) -> BaseException:
    """An exception that other ranks can raise: itself, or one that says the same where it cannot travel."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever the constructor of a foreign exception raises
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def end_together(reason: str, code: int, say: Callable[[], None]) -> None:
    """Say why this rank ends, unless a lower one says the same, and end all ranks with it.

    Where the others end too, each returns and leaves by itself. Where one does not within `PATIENCE`, because it waits for this rank in
    a collective call, all are aborted.

    Parameters
    ----------
    reason : str
        Why, in a line.
    code : int
        Exit code of all ranks if they must be aborted.
    say : callable
        Prints it.
    """
    comm = MPI.COMM_WORLD
    reason = reason[:2000]
    sent = {rank: comm.isend(reason, rank, FAREWELL) for rank in range(comm.size) if rank != comm.rank}
    reasons: dict[int, str] = {}

    def hear(ranks: Collection[int], seconds: float) -> bool:
        """Receive the reasons of these ranks, for so long; whether all have come."""
        deadline = time.monotonic() + seconds
        while not (whole := reasons.keys() >= set(ranks)) and time.monotonic() < deadline:
            reasons.update({rank: comm.recv(source=rank, tag=FAREWELL) for rank in ranks if comm.iprobe(source=rank, tag=FAREWELL)})
            time.sleep(0.01)
        return whole

    lower = range(comm.rank)
    hear(lower, PATIENCE / 2)
    if reason not in [reasons.get(rank) for rank in lower]:
        say()
        sys.stdout.flush()
        sys.stderr.flush()
    if not hear(sent, PATIENCE):  # long after what was said, which mpiexec would lose otherwise
        comm.Abort(code)
    MPI.Request.waitall(list(sent.values()))


def _end_script(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """What Python does with an exception that a script lets pass, on several ranks."""
    end_together(f"{kind.__name__}: {error}", 1, lambda: sys.__excepthook__(kind, error, trace))


if MPI.COMM_WORLD.size > 1:
    sys.excepthook = _end_script
