# SPDX-License-Identifier: MIT
"""Draw which room imports which into ``architecture.md``, from the code: ``python docs/draw_rooms.py``, or ``make rooms``."""

from __future__ import annotations

import re
from pathlib import Path

import grimp

PAGE = Path(__file__).with_name("architecture.md")


def arrows() -> list[tuple[str, str]]:
    """From a room to the rooms that it imports, without those that it also reaches through others."""
    graph = grimp.build_graph("tongue_fenicsx", cache_dir=None)
    rooms = sorted(room for room in graph.find_children("tongue_fenicsx") if room.rpartition(".")[2][0] != "_")
    for room in rooms:
        graph.squash_module(room)
    imports = {room: graph.find_modules_directly_imported_by(room) & set(rooms) - {room} for room in rooms}

    def reached(room: str) -> set[str]:
        return imports[room].union(*map(reached, imports[room]))

    return [(room, other) for room in rooms for other in sorted(imports[room] - set().union(*map(reached, imports[room])))]


def picture() -> str:
    """The arrows in Mermaid."""
    names = [[room.rpartition(".")[2] for room in arrow] for arrow in arrows()]
    return "\n".join(["```mermaid", "flowchart TD", *(f"    {room} --> {other}" for room, other in names), "```"])


def page() -> str:
    """The page with the picture of today's code."""
    return re.sub(r"```mermaid\n.*?```", picture(), PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
