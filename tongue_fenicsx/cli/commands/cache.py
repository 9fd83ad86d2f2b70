# SPDX-License-Identifier: MIT
"""``tongue cache``: the compiled forms and distances from obstacles that runs share."""

from __future__ import annotations

from typing import Annotated

import typer

from ...core.errors import InputError
from ..terminal import console


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove it; the next runs make it again.")] = False,
    old: Annotated[bool, typer.Option("--old", help="With --clear: only what another DOLFINx or processor left.")] = False,
) -> None:
    """Show, or clear, what runs share, compiled forms and distances from obstacles: how many, and how large."""
    from ...core import cache as store

    if old and not clear:
        raise InputError("--old: it goes with --clear.")
    generation = None
    if old:
        from ...forms.jit import generation as present

        generation = present()
    console.print(f"what runs share is in {store.place()}")
    for folder in store.generations():
        n, size = store.measure(folder)
        what = (
            f"obstacles: {n} distances"
            if folder.name == store.DISTANCES
            else f"DOLFINx {folder.name.replace('-', ', processor ')}: {n} forms"
        )
        line = f"{what}, {size / 1e6:.1f} MB"
        if clear and not (old and folder.name in (generation, store.DISTANCES)):
            try:
                busy = store.clear(folder)
            except OSError as error:
                raise InputError(f"{error.filename}: cannot be removed ({error.strerror}).") from error
            line += f", removed{f' but for {busy}, which are being made' if busy else ''}"
        console.print(line)
