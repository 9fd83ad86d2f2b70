# SPDX-License-Identifier: MIT
"""What a long computation shows while it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from ..simulation.stepping import Progress as StepReport
    from ..studies.pool import Standing


class ProgressBar:
    """Progress with time, step, Newton iterations and the time that is left; plain lines where no terminal is."""

    def __init__(self, console: Console, active: bool) -> None:
        self._console, self._tenth = console, -1
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
        if not self._console.is_terminal and tenth > self._tenth:
            self._console.print(text)
            self._tenth = tenth


class RunsBar:
    """Progress of many runs on one line, with the time that is left; where no terminal is, a line for each tenth. Failures stay."""

    def __init__(self, console: Console, active: bool) -> None:
        self._console, self._active, self._tenth = console, active, 0
        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not (active and console.is_terminal),
            speed_estimate_period=3600.0,
        )
        self._task: TaskID | None = None

    def __enter__(self) -> RunsBar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def __call__(self, now: Standing) -> None:
        """Show how far the runs are."""
        if self._task is None:  # what is there already says nothing of the speed
            self._task = self._bar.add_task("", total=now.total, completed=now.over)
            self._tenth = 10 * now.over // now.total
            if now.over:
                self.say(f"{now.over} of {now.total} runs are already there")
        at_work = ", ".join(f"{name.rpartition('/')[2]} {share:.0%}" for name, share in sorted(now.shares.items())[:4])
        self._bar.update(
            self._task,
            total=now.total,
            description=f"{now.over} of {now.total} runs; {at_work or 'none at work'}",
            completed=now.over + sum(now.shares.values()),
        )
        if now.ended is not None and now.ended.outcome is not None and now.ended.outcome.reason:
            self.say(f"{now.ended.name} {now.ended.outcome.status}: {now.ended.outcome.reason}")
        if not self._console.is_terminal and 10 * now.over // now.total > self._tenth:
            self._tenth = 10 * now.over // now.total
            self.say(f"{now.over} of {now.total} runs are over")

    def say(self, line: str) -> None:
        """Print a line that stays."""
        if self._active:
            self._console.print(line)
