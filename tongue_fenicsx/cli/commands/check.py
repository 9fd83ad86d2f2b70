# SPDX-License-Identifier: MIT
"""``tongue check``: what a scenario would run."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..options import Changes, ScenarioFile
from ..terminal import console

if TYPE_CHECKING:
    from ...mechanics.activation import Course

BLOCKS, WIDTH = " ▁▂▃▄▅▆▇█", 60


def check(scenario: ScenarioFile, changes: Changes = None) -> None:
    """Validate a scenario and say what would run, without running."""
    from ...scenario.files import load

    loaded = load(scenario, changes)

    from ...anatomy.catalogue import peak_stress, resolve
    from ...core.errors import within
    from ...forms.weak_form import WeakForm
    from ...mechanics.hyperelasticity import numbers
    from ...scenario import build as assemble
    from ...scenario import effort
    from ...scenario.remarks import remarks

    with tempfile.TemporaryDirectory() as folder, within(scenario):
        simulation = assemble.simulation_of(loaded, Path(folder))
        courses = assemble.activation_of(loaded)
        model, tongue = simulation.model, simulation.model.tongue
        stresses = {name: peak_stress(resolve(name, tongue.muscles, name), model.tissue.peak_stress) for name in courses}
        space = WeakForm(model, []).V  # and is the tongue at rest outside the obstacles?
    n_cells = tongue.mesh.topology.index_map(3).size_global
    console.print(f"{scenario} is fine: {tongue.name}, {n_cells} tetrahedra, surfaces {', '.join(sorted(tongue.surfaces))}")
    tissue = model.tissue
    law = ", ".join(f"{name} {value:g} Pa" for name, value in numbers(tissue.law).items())
    console.print(f"tissue {loaded.tissue.preset}: {law}, nu {tissue.law.nu:g}, density {tissue.density:g} kg/m³")
    for name, course in courses.items():
        ends = ", ".join(f"{1e3 * t:g} ms: {course(t):.2g}" for t in [0.0, *course.kinks])
        console.print(f"{name}: {ends}, at most {max(stresses[name].values()) / 1e3:g} kPa")
        console.print(f"  {_drawn(course, loaded.time.end)}", highlight=False)
    for name, motion in model.moving.items():
        console.print(f"{name} moves until {1e3 * max(motion.kinks):g} ms")
    for name, contact in model.contacts.items():
        console.print(f"contact with {name}: {contact.form}")
    for remark in remarks(simulation, courses, loaded.time.end):
        console.print(f"note: {remark}")
    longest, n = simulation.stepping.longest, 3 * space.dofmap.index_map.size_global
    console.print(f"to t = {loaded.time.end:g} s in steps of at most {1e3 * longest:g} ms")
    seconds = effort.seconds(n, loaded.time.end, simulation.stepping.output_every, longest, bool(model.contacts))
    time = f"{seconds:.2g} s" if seconds < 100 else f"{seconds / 60:.2g} min"
    console.print(f"{n} unknowns: some {time} on one core, give or take a factor of two, and {effort.memory(n):.1f} GiB")


def _drawn(course: Course, t_end: float) -> str:
    """A course of activation over the time of the run, in blocks of an eighth."""
    times = np.concatenate([np.linspace(0.0, t_end, 8 * WIDTH + 1)[:-1], [t for t in course.kinks if t < t_end]])
    highest = np.zeros(WIDTH)
    np.maximum.at(highest, (WIDTH * times / t_end).astype(int), [course(t) for t in times])
    return "0 ms │" + "".join(BLOCKS[i] for i in np.ceil(8 * highest.clip(0, 1)).astype(int)) + f"│ {1e3 * t_end:g} ms"
