"""Diagram of the package's folders ("rooms"): ``python -m softness_bayes.tools.rooms``.

A room is a folder of the package, with the folders in it. The diagram has one row per floor: a room is one
floor above the highest room that it imports. Lines implied by other lines are omitted.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path

import softness_bayes

PACKAGE = Path(softness_bayes.__file__).parent
FILE = PACKAGE / "docs" / "architecture.svg"
START = "__main__"
"""The module that starts the program, which is not a room."""
BOX, GAP, ROW = 146, 16, 56
"""Width of a box, space beside it, and distance of floors [px]."""
Imports = Mapping[str, frozenset[str]]


def imports() -> Imports:
    """Return the rooms that each room imports."""
    rooms: dict[str, str] = {}
    paths: dict[str, Path] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(part for part in path.relative_to(PACKAGE).with_suffix("").parts if part != "__init__")
        if name and name != START:
            rooms[name] = name.partition(".")[0]
            paths[name] = path
    imported: dict[str, set[str]] = {room: set() for room in rooms.values()}
    own = f"{softness_bayes.__name__}."
    for name, path in paths.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    full, module = f"{node.module}.{alias.name}".removeprefix(own), node.module.removeprefix(own)
                    imported[rooms[name]].add(rooms.get(full, rooms.get(module, rooms[name])))
    return {room: frozenset(others - {room}) for room, others in imported.items()}


def below(imported: Imports) -> dict[str, frozenset[str]]:
    """Return all rooms that each room reaches through imports."""
    reached: dict[str, frozenset[str]] = {}
    for name in TopologicalSorter(imported).static_order():
        reached[name] = imported[name].union(*(reached[other] for other in imported[name]))
    return reached


def floors(imported: Imports) -> list[list[str]]:
    """Return the rooms floor by floor, the highest first."""
    heights: dict[str, int] = {}
    for name in TopologicalSorter(imported).static_order():
        heights[name] = 1 + max((heights[other] for other in imported[name]), default=-1)
    return [[n for n in sorted(imported) if heights[n] == floor] for floor in range(max(heights.values()), -1, -1)]


def needed(imported: Imports) -> dict[str, list[str]]:
    """Return the direct imports that are not implied by a path through other rooms."""
    every = below(imported)
    return {
        name: sorted(other for other in others if not any(other in every[way] for way in others))
        for name, others in imported.items()
    }


def _places(rows: Sequence[Sequence[str]], lines: Sequence[Sequence[str]]) -> dict[str, float]:
    """Return the centre of every item in a row [px], rows ordered by the mean position of connected items above."""
    widest = max(map(len, rows))
    places: dict[str, float] = {}
    above: dict[str, list[str]] = {}
    for line in lines:
        for upper, lower in pairwise(line):
            above.setdefault(lower, []).append(upper)
    for row in rows:
        begin = (widest - len(row)) / 2

        def wanted(name: str) -> float:
            leading = above.get(name, [])
            return sum(places[upper] for upper in leading) / len(leading) if leading else 0.0

        for k, name in enumerate(sorted(row, key=wanted)):
            places[name] = (begin + k + 0.5) * (BOX + GAP)
    return places


def drawing(imported: Imports) -> str:
    """Return the drawing as SVG."""
    rows = [list(row) for row in floors(imported)]
    floor = {name: k for k, row in enumerate(rows) for name in row}
    lines = []
    for upper, others in needed(imported).items():
        for lower in others:  # a line that crosses a floor gets a slot there, between the boxes
            bends = [f"{upper}>{lower}>{k}" for k in range(floor[upper] + 1, floor[lower])]
            for k, bend in enumerate(bends, floor[upper] + 1):
                rows[k].append(bend)
            lines.append([upper, *bends, lower])
    places, width = _places(rows, lines), max(map(len, rows)) * (BOX + GAP)
    heights = {name: 30 + ROW * k for k, row in enumerate(rows) for name in row}
    height = ROW * len(rows) + 4
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="sans-serif" font-size="13" text-anchor="middle">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for line in lines:
        points = [(places[line[0]], heights[line[0]] + 15)]
        for bend in line[1:-1]:
            points += [(places[bend], heights[bend] - 15), (places[bend], heights[bend] + 15)]
        points.append((places[line[-1]], heights[line[-1]] - 15))
        drawn = " ".join(f"{x:.0f},{y:.0f}" for x, y in points)
        parts.append(f'<polyline points="{drawn}" fill="none" stroke="#7a8793"/>')
    for name in imported:
        x, y = places[name], heights[name]
        parts.append(
            f'<rect x="{x - BOX / 2:.0f}" y="{y - 15:.0f}" width="{BOX}" height="30" rx="5" fill="#e8eef4" '
            f'stroke="#4a6078"/><text x="{x:.0f}" y="{y + 5:.0f}">{name}</text>'
        )
    return "\n".join([*parts, "</svg>"]) + "\n"


def main() -> None:
    """Write the drawing into the guide."""
    FILE.write_text(drawing(imports()), encoding="utf-8")
    print(f"{FILE}: written")


if __name__ == "__main__":
    main()
