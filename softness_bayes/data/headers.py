"""Headers of tables: recognition of columns and their units."""

from __future__ import annotations

import difflib
import re
from collections.abc import Container, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from softness_bayes.data.columns import (
    LABELS,
    LONGEST_TITLE,
    NUMBERS,
    OF_CELLS,
    SYNONYMS,
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
    marks: tuple[frozenset[str], ...] = (frozenset({"rating"}),)
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


def _named(names: str) -> frozenset[str]:
    """Return the columns of these names, which must be declared."""
    if unknown := {*names.split()} - {*LABELS, *NUMBERS}:
        raise KeyError(unknown)
    return frozenset(names.split())


_HELD = _named("indentation_mm force_n")
_LOADS = (_named("indentation_mm"), _named("force_n"))
_MODULI = (
    _named("effective_modulus_kpa"),
    _named("effective_modulus_low_kpa effective_modulus_high_kpa"),
    _named("bending_rigidity_n_m"),
    _named("tensile_modulus_mpa thickness_mm"),
)
_SCALES = _named("rating resolution rank") | OF_CELLS
"""Numerical columns without units."""
_OF_RATINGS = _named("participant fabric fabric_2 trial list rating resolution load_cv")
_OF_FABRICS = frozenset(NUMBERS) - _SCALES - _HELD - _named("load_cv")

_WIDE = (_named("participant"),)
LOADED = Sought(_OF_RATINGS, given=_HELD, otherwise=_WIDE)
"""Columns of ratings with a separately given load."""
RATED = Sought(_OF_RATINGS | _HELD, (Enough(_LOADS, _HELD),), otherwise=_WIDE)
"""Columns of ratings with a load in each row."""
FABRICS = Sought(
    _OF_FABRICS | _named("fabric"),
    (
        # a measured rigidity takes precedence over tensile modulus and thickness, and is compared with them
        Enough(_MODULI, frozenset().union(*_MODULI) - _MODULI[2]),
        Enough(_MODULI[:2], _MODULI[2]),
    ),
    "fabrics",
    _MODULI,
)
"""Fabrics."""
PRESSED = Sought(_named("participant indentor indentation_mm force_n"), sheet="compression", marks=(_HELD,))
"""Forces of a rigid plate."""
RANKED = Sought(_named("fabric"))
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


class _Title(NamedTuple):
    """A title that is not yet understood: its column, its text, and its parts without and with a unit."""

    j: int
    text: str
    stem: str
    spelt: Spelt | None

    @property
    def keys(self) -> set[str]:
        """The keys of the title with and without its unit."""
        return {key(self.text), key(self.stem)}

    def takes(self, name: str) -> str:
        """Return the advice that takes this column as the one of a name."""
        return f"--column {name}={quoted(self.text)} takes it as {name}"


def understood(titles: Sequence[str], renames: Mapping[str, str], sought: Sought, where: str) -> Header:
    """Find the columns of a table by standard names, names given by the user, and those in `columns.SYNONYMS`.

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
    return "rating" not in at and ("geometric_mean" in at or ("mean" in at and "n" in at))


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


def _free(found: Header, titles: Sequence[str]) -> list[_Title]:
    """Return the titles that are not yet understood."""
    taken = {*found.at.values()}
    return [_Title(j, text, *title_and_unit(text)) for j, text in enumerate(titles) if text and j not in taken]


def _seek(found: Header, titles: Sequence[str], sought: Sought, where: str) -> None:
    """Add columns with other names, one for each missing column.

    Raises
    ------
    InputError
        If there are several candidates for one column.
    """
    if "rating" in sought.names:
        _seek_cells(found, titles)
    free, letters = _free(found, titles), []
    cells = holds_cells(found.at)
    for name in sought.without(found.at):
        if cells and name == "rating":
            continue
        near = [title for title in free if title.keys & keys_of(name)]
        fitting = [title for title in near if _fits(name, title)]
        if len(fitting) > 1:
            ways = " or ".join(f"--column {name}={quoted(title.text)}" for title in fitting[:4])
            several = listing([quoted(title.text) for title in fitting])
            note = f"columns {several} may each be {name!r}; choose one with {ways}"
            if name != "trial":
                raise InputError(f"{where}: {note}")
            found.notes.append(note)  # the results do not depend on it
        elif fitting:
            _take(found, name, fitting[0])
        elif near:
            unit = ", it has no unit known here" if _quantity(name) else ""
            words = [title for title in near if len(key(title.stem)) > 2]
            letters += [(name, title) for title in near if title not in words]
            found.notes.extend(f"column {quoted(title.text)} is not read{unit}; {title.takes(name)}" for title in words)
        elif (title := _misspelt(name, free)) is not None and title.j not in found.at.values():
            found.notes.append(f"is column {quoted(title.text)} misspelt? {title.takes(name)}")

    # a letter is ambiguous: it is reported if a column that it may mean is missing
    lacking = sought.lacking(found.at)
    found.notes.extend(
        f"column {quoted(title.text)} is not read, because a single letter is ambiguous; with a unit it is read "
        f"as {name}, as in {quoted(f'{title.text} ({NUMBERS[name].unit})')}; {title.takes(name)}"
        for name, title in letters
        if name in lacking and title.j not in found.at.values() and NUMBERS[name].unit
    )


def _take(found: Header, name: str, title: _Title) -> None:
    """Record that a column is the one of a name, and its unit."""
    found.at[name] = title.j
    lead = f"column {quoted(title.text)} is read as {name}"
    before = len(found.notes)
    if _quantity(name) and title.spelt is not None and (unit := unit_named(title.spelt.text, _quantity(name))):
        _convert(found, NUMBERS[name], title.text, unit, f"{lead}, ")
    if len(found.notes) == before:
        found.notes.append(lead)


def _seek_cells(found: Header, titles: Sequence[str]) -> None:
    """Add columns of cell means under other names, if there are means and numbers of raters.

    Single ratings, under any name, take precedence; columns that belong to means are then reported.
    """
    free = _free(found, titles)
    ratings = "rating" in found.at or any(key(title.stem) in keys_of("rating") for title in free)
    at: dict[str, int] = {}
    for name in (name for name in NUMBERS if name in OF_CELLS):
        own = [title.j for title in free if title.text.casefold() == name]
        own = own or [title.j for title in free if key(title.stem) in keys_of(name)]
        if own and own[0] not in at.values():
            at[name] = own[0]
    seen = ", ".join(quoted(titles[j]) for j in sorted({*at.values()}))
    if ratings:
        if "n" in at and at.keys() & {"sd", "se", "geometric_sd"}:
            found.notes.append(
                f"columns {seen} belong to means of several raters, and are not used; if the ratings are "
                f"means, name them with --column mean=... and use --ratings aggregated"
            )
    elif holds_cells({**found.at, **at}):
        found.at.update(at)
        other = {name: titles[j] for name, j in at.items() if titles[j].casefold() != name}
        found.notes.extend(f"column {quoted(title)} is read as {name}" for name, title in other.items())
    elif "mean" in at or "geometric_mean" in at:
        found.notes.append(
            f"columns {seen} look like means of several raters, which are read from a column n (how many "
            f"raters) and geometric_mean, or mean with sd or se, and --ratings aggregated"
        )


@cache
def keys_of(name: str) -> frozenset[str]:
    """Return the keys of a column's standard name, with and without its unit, and of its synonyms."""
    return frozenset(key(title) for title in (title_and_unit(name)[0], name, *SYNONYMS.get(name, ())))


def _pass_over(found: Header, titles: Sequence[str], given: frozenset[str]) -> None:
    """Report the columns that may contain the separately given values."""
    found.notes.extend(
        f"column {quoted(title.text)} may contain loads but is not read: the given load is used for all ratings"
        for name in sorted(given - found.at.keys())
        for title in _free(found, titles)
        if title.keys & keys_of(name) and len(key(title.text)) > 2
    )


def _misspelt(name: str, titles: Sequence[_Title]) -> _Title | None:
    """Return the title, of the first ones, that is close to a name, if any; short names resemble many words."""
    stems = {key(title.stem): title for title in titles[:MOST_GUESSED] if len(title.stem) <= LONGEST_TITLE}
    for known in sorted(keys_of(name)):
        if len(known) > 4 and (close := difflib.get_close_matches(known, stems, 1, 0.8)):
            return stems[close[0]]
    return None


def _fits(name: str, title: _Title) -> bool:
    """Return whether a title with a name of a column has an allowed unit, or the extent of a scale, such as 1-10."""
    quantity = _quantity(name)
    if title.spelt is None:
        return quantity in ("", "ratio")
    if quantity:
        return key(title.stem) in keys_of(name) and unit_named(title.spelt.text, quantity) is not None
    scale = re.fullmatch(r"[0-9]+\s*(?:-|–|…|\.\.\.?|to)\s*[0-9]+", title.spelt.text)
    return key(title.text) in keys_of(name) or scale is not None
