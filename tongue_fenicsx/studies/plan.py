# SPDX-License-Identifier: MIT
"""What many runs are to be, and what became of each: files beside the run folders, by which any number of workers agree.

``plan.json`` holds the cases; ``outcome.json`` in a run folder says that the run is over and how. Everything else is made of them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ..core.errors import InputError
from ..core.files import at_once
from ..core.fingerprint import digest, fingerprint
from ..scenario.schema import Scenario

PLAN, OUTCOME, CLAIMS, LOGS = "plan.json", "outcome.json", "claims", "logs"
FAILED, KILLED = "failed", "killed"


@dataclass(frozen=True)
class Case:
    """One run of many.

    Attributes
    ----------
    name : str
        Its folder, relative to that of all.
    scenario : dict
        Tables of its scenario; the mesh is a file.
    identity : str
        Hash of the scenario and of what its mesh holds, wherever that lies.
    parameters : dict
        What is told of it in tables.
    """

    name: str
    scenario: Mapping[str, Any]
    identity: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, scenario: Scenario, parameters: Mapping[str, Any] | None = None) -> Case:
        """The case of a scenario."""
        tables = scenario.model_dump(exclude_none=True)
        mesh = Path(str(scenario.mesh.file))
        return cls(name, tables, fingerprint({**tables, "mesh": _held(mesh, mesh.stat().st_mtime_ns)}), parameters or {})


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    status : str
        ``done``; ``failed`` where it cannot be solved; ``killed`` where its process ended, which is tried again at the next start.
    reason : str
        Why it is not done.
    seconds : float
        From its claim to its end, on the clock.
    worker : str
        Who did it.
    """

    status: str
    reason: str = ""
    seconds: float = 0.0
    worker: str = ""


class Plan:
    """Cases and their folders.

    Parameters
    ----------
    folder : Path
        Of all.
    cases : sequence of Case
        In the order in which they are begun.
    """

    def __init__(self, folder: Path, cases: Sequence[Case]) -> None:
        self.folder, self.cases = folder, list(cases)

    @classmethod
    def read(cls, folder: Path) -> Plan:
        """The plan that was written into a folder."""
        return cls(folder, [Case(**case) for case in json.loads((folder / PLAN).read_text(encoding="utf-8"))])

    def write(self, overwrite: bool = False) -> None:
        """Write the plan; runs whose process was killed will be tried again.

        Raises
        ------
        InputError
            If a folder holds the end of another run than planned, unless it may be overwritten.
        """
        before = {case.name: case.identity for case in Plan.read(self.folder).cases} if (self.folder / PLAN).is_file() else {}
        for case in self.cases:
            outcome = self.outcome(case)
            if outcome is None:
                continue
            if before.get(case.name) != case.identity:
                if not overwrite:
                    raise InputError(f"{self.folder / case.name}: holds the run of another scenario; give another folder, or --overwrite.")
                forget(self.folder / case.name)
            elif outcome.status == KILLED:
                (self.folder / case.name / OUTCOME).unlink(missing_ok=True)
        for name in (CLAIMS, LOGS):
            (self.folder / name).mkdir(exist_ok=True)
        with at_once(self.folder / PLAN) as path:
            path.write_text(json.dumps([asdict(case) for case in self.cases], default=float), encoding="utf-8")

    def outcome(self, case: Case) -> Outcome | None:
        """How a run ended; None if it did not."""
        path = self.folder / case.name / OUTCOME
        return Outcome(**json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None

    def conclude(self, case: Case, outcome: Outcome) -> None:
        """Write how a run ended."""
        (self.folder / case.name).mkdir(parents=True, exist_ok=True)
        with at_once(self.folder / case.name / OUTCOME) as path:
            path.write_text(json.dumps(asdict(outcome)), encoding="utf-8")

    def claim(self, pending: list[Case]) -> tuple[Case, FileLock] | None:
        """The first of these cases that is neither over nor at work elsewhere, and the lock that keeps others from it, which dies with
        its process; those that are over leave the list."""
        for case in list(pending):
            if self.outcome(case) is None:
                lock = FileLock(self.folder / CLAIMS / case.name.replace("/", "-"), timeout=0)
                try:
                    lock.acquire()
                except Timeout:
                    continue
                if self.outcome(case) is None:
                    return case, lock
                lock.release()
            pending.remove(case)
        return None

    def over(self) -> Iterator[tuple[Case, Outcome]]:
        """The cases that are over, in order."""
        for case in self.cases:
            outcome = self.outcome(case)
            if outcome is not None:
                yield case, outcome


@cache
def _held(mesh: Path, written: int) -> str:
    """Hash of the files of a mesh that was `written` then."""
    return digest([mesh, mesh.with_suffix(".h5"), mesh.with_suffix(".fibres.json")])


def forget(folder: Path) -> None:
    """Let a run begin anew."""
    for name in (OUTCOME, "checkpoint.h5"):
        (folder / name).unlink(missing_ok=True)
