# SPDX-License-Identifier: MIT
"""``tongue cache``: the compiled forms that runs share."""

from __future__ import annotations

from typing import Annotated

import typer

from ...core.errors import InputError
from ..terminal import console


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove what is compiled; the next runs compile again.")] = False,
    old: Annotated[bool, typer.Option("--old", help="With --clear: only what another DOLFINx or processor left.")] = False,
) -> None:
    """Show, or clear, the compiled forms: how many, and how large."""
    from ...core import cache as store

    if old and not clear:
        raise InputError("--old: it goes with --clear.")
    generation = None
    if old:
        from ...forms.jit import generation as present

        generation = present()
    console.print(f"compiled forms are in {store.place()}")
    for folder in store.generations():
        n_forms, size = store.measure(folder)
        line = f"DOLFINx {folder.name.replace('-', ', processor ')}: {n_forms} forms, {size / 1e6:.1f} MB"
        if clear and folder.name != generation:
            try:
                busy = store.clear(folder)
            except OSError as error:
                raise InputError(f"{error.filename}: cannot be removed ({error.strerror}).") from error
            line += f", removed{f' but for {busy}, which are being compiled' if busy else ''}"
        console.print(line)
