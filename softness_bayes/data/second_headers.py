"""Second rows of headers: units below the titles, or loads below the fabrics of a wide table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from softness_bayes.data.names import listing
from softness_bayes.data.synonyms import SYNONYMS, key
from softness_bayes.data.units import UNITS, is_unit, title_and_unit, unit_named
from softness_bayes.errors import quoted

_LABELS = frozenset(
    key(title) for name in ("participant", "fabric", "list") for title in (name, *SYNONYMS.get(name, ()))
)
_NO_UNIT = frozenset({"-", "–", "1"})
_LOAD = re.compile(r"[0-9]+(?:[.,][0-9]+)?\s*(?P<unit>[^\s0-9].*)")


class Joined(NamedTuple):
    """Titles of two rows as one."""

    titles: list[str]
    note: str
    """Interpretation of the second row, as a note."""


def joined(header: Sequence[str], below: Sequence[str]) -> Joined | None:
    """Return the titles of a header of two rows; None if the second row holds data.

    Parameters
    ----------
    header, below
        Cells of the first two rows that are not blank, without spaces at their ends.
    """
    width = max(len(header), len(below))
    titles, second = ([*row, *[""] * (width - len(row))] for row in (header, below))
    # a title that is merged over both rows stands in each
    second = ["" if text and key(text) == key(title) else text for title, text in zip(titles, second, strict=True)]
    return _with_units(titles, second) or _with_loads(titles, second)


def _with_units(titles: Sequence[str], units: Sequence[str]) -> Joined | None:
    """Return titles with the units below them; no column of names has one."""
    filled = [j for j, text in enumerate(units) if text]
    bare = {j: units[j].strip("[]() ") for j in filled}
    if not all(titles[j] and key(titles[j]) not in _LABELS and is_unit(bare[j]) for j in filled):
        return None
    named = [j for j in filled if bare[j] not in _NO_UNIT]
    if not named or len(filled) == len(titles):
        return None
    # a title that has a unit already keeps it; what is below must not be another one
    found = {j: f"{titles[j]} [{bare[j]}]" for j in named if not _has(titles[j], bare[j])}
    made = listing([quoted(text) for text in found.values()]) if found else "those of the headers"
    return Joined([found.get(j, title) for j, title in enumerate(titles)], f"the second row contains units: {made}")


def _has(title: str, unit: str) -> bool:
    """Return whether a title ends in a unit."""
    spelt = title_and_unit(title)[1]
    return spelt is not None and any(
        (one := unit_named(unit, quantity)) is not None and one == unit_named(spelt.text, quantity)
        for quantity in UNITS
    )


def _is_load(text: str) -> bool:
    match = _LOAD.fullmatch(text)
    return match is not None and any(unit_named(match["unit"], quantity) for quantity in ("length", "force"))


def _with_loads(titles: Sequence[str], second: Sequence[str]) -> Joined | None:
    """Return titles of fabrics with the loads below them; a fabric stands once before several, as in merged cells."""
    loaded = [j for j, text in enumerate(second) if _is_load(text)]
    others = [j for j, text in enumerate(second) if text and j not in loaded]
    if len(loaded) < 2 or any(titles[j] for j in others):
        return None
    found, fabric = list(titles), ""
    for j in range(len(titles)):
        if j in loaded:
            fabric = titles[j] or fabric
            if not fabric:
                return None
            found[j] = f"{fabric} @ {second[j]}"
        else:
            found[j], fabric = titles[j] or second[j], ""
    return Joined(found, f"the second row contains loads: {listing([quoted(found[j]) for j in loaded])}")
