"""Headers of tables: recognition of columns and their units."""

from __future__ import annotations

import difflib
import re
from collections.abc import Container, Mapping, Sequence
from functools import cache
from itertools import islice
from typing import NamedTuple

from softness_bayes.data.columns import (
    BENDING_RIGIDITY,
    EFFECTIVE_MODULUS,
    EFFECTIVE_MODULUS_HIGH,
    EFFECTIVE_MODULUS_LOW,
    FORCE,
    GEOMETRIC_MEAN,
    GEOMETRIC_SD,
    INDENTATION,
    LABELS,
    LOAD_CV,
    LONGEST_TITLE,
    MEAN,
    NUMBERS,
    OF_CELLS,
    RANK,
    RATERS,
    RATING,
    RESOLUTION,
    SD,
    SE,
    SECOND_FABRIC,
    SYNONYMS,
    TENSILE_MODULUS,
    THICKNESS,
    Column,
    Spelt,
    Unit,
    is_unit,
    key,
    names_of,
    title_and_unit,
    unit_named,
)
from softness_bayes.data.faults import MOST_GUESSED, listing
from softness_bayes.errors import InputError, quoted


class Enough(NamedTuple):
    """Alternative sets of columns, any one of which is sufficient."""

    sets: tuple[frozenset[str], ...]
    others: frozenset[str]
    """Columns that are then not searched for."""


class Sought(NamedTuple):
    """The columns that a table may have under other names.

    Standard names and those given by `--column` take precedence. If a table has all required columns under these names,
    other columns are ignored.
    """

    names: frozenset[str]
    either: tuple[Enough, ...] = ()
    sheet: str = "ratings"
    """Name of the sheet in a workbook with several sheets."""
    marks: tuple[frozenset[str], ...] = (frozenset({RATING.name}),)
    """Alternative sets of columns that identify the sheet if none has that name."""
    otherwise: tuple[frozenset[str], ...] = ()
    """The same for sheets not identified by these: a wide table has no column of ratings."""
    given: frozenset[str] = frozenset()
    """Columns whose values are given separately: columns that may contain them are reported but not read."""

    def without(self, present: Mapping[str, int]) -> list[str]:
        """Return the columns to search for besides those present, in the order of declaration."""
        enough = [one for one in self.either if any(names <= present.keys() for names in one.sets)]
        done = {name for one in enough for name in one.others}
        return [n for n in (*LABELS, *NUMBERS) if n in self.names and n not in present and n not in done]

    def lacking(self, present: Container[str]) -> set[str]:
        """Return the columns that are still required."""
        unmet = [one for one in self.either if not any(all(n in present for n in names) for names in one.sets)]
        return {name for one in unmet for name in one.others}


_LOADS = (frozenset({INDENTATION.name}), frozenset({FORCE.name}))
_HELD = frozenset().union(*_LOADS)
_MODULI = (
    frozenset({EFFECTIVE_MODULUS.name}),
    frozenset({EFFECTIVE_MODULUS_LOW.name, EFFECTIVE_MODULUS_HIGH.name}),
    frozenset({BENDING_RIGIDITY.name}),
    frozenset({TENSILE_MODULUS.name, THICKNESS.name}),
)
_SCALES = frozenset({RATING.name, RESOLUTION.name, RANK.name}) | OF_CELLS
"""Numerical columns without units."""
_OF_RATINGS = frozenset(
    {"participant", "fabric", SECOND_FABRIC, "trial", "list", RATING.name, RESOLUTION.name, LOAD_CV.name}
)
_OF_FABRICS = frozenset(NUMBERS) - _SCALES - {LOAD_CV.name, INDENTATION.name, FORCE.name}

_WIDE = (frozenset({"participant"}),)
LOADED = Sought(_OF_RATINGS, given=_HELD, otherwise=_WIDE)
"""Columns of ratings with a separately given load."""
RATED = Sought(_OF_RATINGS | _HELD, (Enough(_LOADS, _HELD),), otherwise=_WIDE)
"""Columns of ratings with a load in each row."""
FABRICS = Sought(
    _OF_FABRICS | {"fabric"},
    (
        # a measured rigidity takes precedence over tensile modulus and thickness, and is compared with them
        Enough(_MODULI, frozenset().union(*_MODULI) - {BENDING_RIGIDITY.name}),
        Enough(_MODULI[:2], frozenset({BENDING_RIGIDITY.name})),
    ),
    "fabrics",
    _MODULI,
)
"""Fabrics."""
PRESSED = Sought(
    frozenset({"participant", "indentor", INDENTATION.name, FORCE.name}),
    sheet="compression",
    marks=(frozenset({INDENTATION.name, FORCE.name}),),
)
"""Forces of a rigid plate."""
RANKED = Sought(frozenset({"fabric"}))
"""An observed order of fabrics."""


def either(one: Sought, other: Sought) -> Sought:
    """Return the columns of the first table, allowing also those of the second."""
    return one._replace(names=one.names | other.names, either=one.either + other.either)


class Header(NamedTuple):
    """The recognised columns of a table, and their units."""

    at: dict[str, int]
    """Indices of columns by standard name."""
    units: dict[str, Unit]
    """Units of columns by standard name, where they differ from the standard unit."""
    notes: list[str]


def understood(titles: Sequence[str], renames: Mapping[str, str], sought: Sought, where: str) -> Header:
    """Find the columns of a table by standard names, names given by the user, and those in `synonyms.SYNONYMS`.

    Parameters
    ----------
    titles
        Cells of the header; nonempty ones are distinct, ignoring case.
    renames
        Names in the file by standard name; names missing in the file are ignored.
    sought
        Columns to search for under other names.
    where
        Location of the header, for messages.

    Raises
    ------
    InputError
        If two columns match the same name, or a unit does not fit the quantity of its column.
    """
    found = Header(_places(titles, renames), {}, [])
    for name, j in found.at.items():
        if titles[j].casefold() != name and (spelt := title_and_unit(titles[j])[1]) is not None:
            _take_unit(found, name, titles[j], spelt, where)
    _seek(found, titles, sought, where)
    _pass_over(found, titles, sought.given)
    return found


def _places(titles: Sequence[str], renames: Mapping[str, str]) -> dict[str, int]:
    """Return the indices of columns by standard names or those of the user, which take precedence."""
    where = {title.casefold(): j for j, title in enumerate(titles) if title}
    at: dict[str, int] = {}
    for name in (*LABELS, *NUMBERS):
        for title in (renames.get(name, name).casefold(), name):
            if title in where:
                at.setdefault(name, where[title])
    return at if holds_cells(at) else {name: j for name, j in at.items() if name not in OF_CELLS}


def holds_cells(at: Container[str]) -> bool:
    """Return whether a table with these columns has cell means instead of ratings."""
    return RATING.name not in at and (GEOMETRIC_MEAN.name in at or (MEAN.name in at and RATERS.name in at))


def _quantity(name: str) -> str:
    """Return the quantity of a column; empty for names and ratings, whose brackets contain remarks."""
    return "" if name in LABELS or name in _SCALES else NUMBERS[name].quantity


def _take_unit(found: Header, name: str, title: str, spelt: Spelt, where: str) -> None:
    """Record the unit of a column named by the user; raise an error for a unit of another quantity."""
    quantity, text = _quantity(name), spelt.text
    if not quantity or not text:
        return
    if unit := unit_named(text, quantity):
        _convert(found, NUMBERS[name], title, unit, f"column {quoted(title)}: ")
    elif not spelt.bracketed and len(text) < 2:
        return  # a one-letter word may not be a unit
    elif is_unit(text) or not text.replace(" ", "").isalpha() or "[" in title:
        raise InputError(
            f"{where}, column {quoted(title)}: {name} has the unit {quoted(text)} in the header, expected one of "
            f"{names_of(quantity)}"
        )
    else:
        found.notes.append(
            f"column {quoted(title)}: {quoted(text)} is not a unit, so the numbers are read in the unit of {name}"
        )


def _convert(found: Header, column: Column, title: str, unit: Unit, lead: str) -> None:
    """Record that a column is in another unit."""
    own = unit_named(column.unit or "1", column.quantity)
    assert own is not None
    if unit.factor != own.factor:
        found.units[column.name] = unit
        ratio = float(unit.factor / own.factor)
        found.notes.append(f"{lead}converted, 1 {unit.name} = {ratio:.9g} {column.unit}".rstrip())


def _seek(found: Header, titles: Sequence[str], sought: Sought, where: str) -> None:
    """Add columns with other names, one for each missing column.

    Raises
    ------
    InputError
        If there are several candidates for one column.
    """
    if RATING.name in sought.names:
        _seek_cells(found, titles)
    parts = {j: title_and_unit(title) for j, title in enumerate(titles) if title and j not in found.at.values()}
    cells = holds_cells(found.at)
    letters: list[tuple[str, int]] = []
    for name in sought.without(found.at):
        if cells and name == RATING.name:
            continue
        names = _keys(name)
        near = [j for j, (stem, _) in parts.items() if key(stem) in names or key(titles[j]) in names]
        fitting = [j for j in near if _fits(name, *parts[j], title=titles[j], names=names)]
        if len(fitting) > 1:
            ways = " or ".join(f"--column {name}={quoted(titles[j])}" for j in fitting[:4])
            several = (
                f"columns {listing([quoted(titles[j]) for j in fitting])} may each be {name!r}; choose one with {ways}"
            )
            if name != "trial":
                raise InputError(f"{where}: {several}")
            found.notes.append(several)  # the results do not depend on it
            continue
        for j in fitting:
            found.at[name] = j
            lead = f"column {quoted(titles[j])} is read as {name}"
            before = len(found.notes)
            spelt = parts[j][1]
            if _quantity(name) and spelt is not None and (unit := unit_named(spelt.text, _quantity(name))):
                _convert(found, NUMBERS[name], titles[j], unit, f"{lead}, ")
            if len(found.notes) == before:
                found.notes.append(lead)
        found.notes.extend(
            f"column {quoted(titles[j])} is not read{', it has no unit known here' if _quantity(name) else ''}; "
            f"--column {name}={quoted(titles[j])} takes it as {name}"
            for j in near
            if not fitting and len(key(parts[j][0])) > 2
        )
        letters += [(name, j) for j in near if not fitting and len(key(parts[j][0])) <= 2]
        found.notes.extend(
            f"is column {quoted(titles[j])} misspelt? --column {name}={quoted(titles[j])} takes it as {name}"
            for j in ([] if near else _misspelt(names, parts))
            if j not in found.at.values()
        )

    # a letter is ambiguous: it is reported if a column that it may mean is missing
    lacking = sought.lacking(found.at)
    found.notes.extend(
        f"column {quoted(titles[j])} is not read, because a single letter is ambiguous; with a unit it is read "
        f"as {name}, as in {quoted(f'{titles[j]} ({NUMBERS[name].unit})')}; --column "
        f"{name}={quoted(titles[j])} takes it as {name}"
        for name, j in letters
        if name in lacking and j not in found.at.values() and NUMBERS[name].unit
    )


def _seek_cells(found: Header, titles: Sequence[str]) -> None:
    """Add columns of cell means under other names, if there are means and numbers of raters.

    Single ratings, under any name, take precedence; columns that belong to means are then reported.
    """
    free = {j: key(title_and_unit(title)[0]) for j, title in enumerate(titles) if title and j not in found.at.values()}
    ratings = RATING.name in found.at or any(stem in _keys(RATING.name) for stem in free.values())
    at: dict[str, int] = {}
    for name in (name for name in NUMBERS if name in OF_CELLS):
        own = [j for j in free if titles[j].casefold() == name] or [
            j for j, stem in free.items() if stem in _keys(name)
        ]
        if own and own[0] not in at.values():
            at[name] = own[0]
    seen = ", ".join(quoted(titles[j]) for j in sorted({*at.values()}))
    if ratings:
        if RATERS.name in at and at.keys() & {SD.name, SE.name, GEOMETRIC_SD.name}:
            found.notes.append(
                f"columns {seen} belong to means of several raters, and are not used; if the ratings are "
                f"means, name them with --column {MEAN.name}=... and use --ratings aggregated"
            )
    elif holds_cells({**found.at, **at}):
        found.at.update(at)
        other = {name: titles[j] for name, j in at.items() if titles[j].casefold() != name}
        found.notes.extend(f"column {quoted(title)} is read as {name}" for name, title in other.items())
    elif MEAN.name in at or GEOMETRIC_MEAN.name in at:
        found.notes.append(
            f"columns {seen} look like means of several raters, which are read from a column {RATERS.name} (how many "
            f"raters) and {GEOMETRIC_MEAN.name}, or {MEAN.name} with {SD.name} or {SE.name}, and --ratings aggregated"
        )


@cache
def _keys(name: str) -> frozenset[str]:
    """Return the keys of a column's standard name, with and without its unit, and of its synonyms."""
    return frozenset(key(title) for title in (title_and_unit(name)[0], name, *SYNONYMS.get(name, ())))


def _pass_over(found: Header, titles: Sequence[str], given: frozenset[str]) -> None:
    """Report the columns that may contain the separately given values."""
    for name in sorted(given - found.at.keys()):
        names = _keys(name)
        for j, title in enumerate(titles):
            own = {key(title), key(title_and_unit(title)[0])}
            if own & names and j not in found.at.values() and len(key(title)) > 2:
                found.notes.append(
                    f"column {quoted(title)} may contain loads but is not read: the given load is used for all ratings"
                )


def _misspelt(names: frozenset[str], parts: Mapping[int, tuple[str, Spelt | None]]) -> list[int]:
    """Return the column, of the first ones, with a title close to a name, if any; short names resemble many words."""
    stems = {key(stem): j for j, (stem, _) in islice(parts.items(), MOST_GUESSED) if len(stem) <= LONGEST_TITLE}
    close = (difflib.get_close_matches(name, stems, 1, 0.8) for name in sorted(names) if len(name) > 4)
    return list(dict.fromkeys(stems[stem] for found in close for stem in found))[:1]


def _fits(name: str, stem: str, spelt: Spelt | None, *, title: str, names: frozenset[str]) -> bool:
    """Return whether a title is a name of a column, with an allowed unit."""
    quantity = _quantity(name)
    if spelt is None and quantity in ("", "ratio"):
        return True
    if not quantity:
        return key(title) in names or _is_scale(spelt)
    if spelt is None or key(stem) not in names:
        return False
    return unit_named(spelt.text, quantity) is not None


def _is_scale(spelt: Spelt | None) -> bool:
    """Return whether a remark in brackets is the extent of a scale, such as 1-10."""
    return spelt is not None and re.fullmatch(r"[0-9]+\s*(?:-|–|…|\.\.\.?|to)\s*[0-9]+", spelt.text) is not None
