# SPDX-License-Identifier: MIT
"""What the commands of all studies do: check, run, print, write."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from rich.table import Table

from ..core.errors import check_outputs
from .progress import RunsBar
from .terminal import console


def conduct[Found](
    folder: Path | None,
    files: Sequence[str],
    run: Callable[[Path, RunsBar], Found],
    show: Callable[[Found], Iterable[Table | str]],
    write: Callable[[Found, Path], None],
) -> Found:
    """Run a study on all ranks; then, on rank 0, print what was found and write it.

    Parameters
    ----------
    folder : Path, optional
        Where its files go; none are written without it.
    files : sequence of str
        Their names, checked before anything runs.
    run : callable
        Of a scratch folder and the progress bar, to what is found.
    show : callable
        Of what was found, to what is printed.
    write : callable
        Writes and draws what was found into the folder.

    Raises
    ------
    InputError
        If the files cannot be written.
    """
    from mpi4py import MPI

    from ..core.parallel import on_rank_zero

    comm = MPI.COMM_WORLD
    if folder is not None:
        on_rank_zero(comm, lambda: check_outputs(folder, files))
    with tempfile.TemporaryDirectory() as scratch, RunsBar(console, comm.rank == 0) as bar:
        found = run(Path(comm.bcast(scratch)), bar)
    if comm.rank == 0:
        for part in show(found):
            console.print(part)
        if folder is not None:
            write(found, folder)
            console.print("wrote " + ", ".join(str(folder / name) for name in files))
    return found
