# SPDX-License-Identifier: MIT
"""What all ranks do together."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from .errors import InputError


def on_rank_zero(comm: MPI.Intracomm, action: Any) -> Any:
    """Do something on rank 0 and give every rank its value, or its `InputError`."""
    value, error = None, None
    if comm.rank == 0:
        try:
            value = action()
        except InputError as raised:
            error = raised
    value, error = comm.bcast((value, error))
    if error is not None:
        raise error
    return value
