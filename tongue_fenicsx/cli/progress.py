# SPDX-License-Identifier: MIT
"""What a long computation shows while it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from ..simulation.stepping import Progress as StepReport


class ProgressBar:
    """Progress with time, step, Newton iterations and the time that is left; plain lines, if wanted, where no terminal is."""

    def __init__(self, console: Console, active: bool, lines: bool = True) -> None:
        self._console, self._active, self._lines, self._tenth = console, active, lines, -1
        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not (active and console.is_terminal),
        )
        self._task = self._bar.add_task("compiling the forms", total=None)

    def __enter__(self) -> ProgressBar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def __call__(self, p: StepReport) -> None:
        """Show where a run is."""
        text = f"t {1e3 * p.t:.1f} of {1e3 * p.t_end:.0f} ms, step {p.step} ({1e3 * p.h:.2g} ms), {p.newton} Newton, {p.krylov} {p.rung}"
        self._bar.update(self._task, description=text, completed=p.t, total=p.t_end)
        tenth = int(10 * p.t / p.t_end + 1e-9)
        if self._lines and not self._console.is_terminal and tenth > self._tenth:
            self._console.print(text)
            self._tenth = tenth

    def say(self, line: str) -> None:
        """Print a line that stays."""
        if self._active:
            self._console.print(line)
