"""Headers of tables: recognition of columns and their units."""

from __future__ import annotations

import difflib
import re
from collections.abc import Container, Mapping, Sequence
from functools import cache, lru_cache
from typing import NamedTuple

from softness_bayes.data.columns import (
    LABELS,
    LESS_CLEAR,
    LONGEST_TITLE,
    MISSING,
    NUMBERS,
    OF_CELLS,
    SYNONYMS,
    WORDS_FOR_RATINGS,
    Column,
    Spelt,
    Unit,
    bag,
    is_unit,
    key,
    looks_numeric,
    names_of,
    power_in,
    title_and_unit,
    unit_named,
)
from softness_bayes.data.faults import MOST_GUESSED, listing
from softness_bayes.data.sheets import Sheet
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
_OF_RATINGS = _named("participant fabric fabric_2 session trial list rating resolution load_cv")
_OF_FABRICS = (frozenset(NUMBERS) | {"direction"}) - _SCALES - _HELD - _named("load_cv")

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
    perhaps: dict[int, tuple[str, str]]
    """Index of a column that is not read -> the name that it may have, and a remark (empty if there is none)."""


class _Title(NamedTuple):
    """A title that is not yet understood: its column, its text, its parts without and with a unit, its power of ten."""

    j: int
    text: str
    stem: str
    spelt: Spelt | None
    power: str

    @classmethod
    def of(cls, j: int, text: str) -> _Title:
        stem, spelt = title_and_unit(text)
        bare, power = power_in(stem)
        if power and spelt is None:
            bare, spelt = title_and_unit(bare)
        return cls(j, text, bare, spelt, power)

    @property
    def keys(self) -> frozenset[str]:
        """The words of the title with and without its unit, and without a symbol, as in `Bending rigidity, B`."""
        return _keys(self.text, self.stem)


@lru_cache(2**16)  # each title of a wide table is looked at for every column
def _keys(text: str, stem: str) -> frozenset[str]:
    words = key(stem).split()
    without = [word for word in words if len(word) > 1 or not word.isalpha()]
    return frozenset({bag(text), bag(stem), *([bag(" ".join(without))] if len(without) > 1 else [])})


def understood(sheet: Sheet, renames: Mapping[str, str], sought: Sought) -> Header:
    """Find the columns of a table by standard names, names given by the user, and those in `columns.SYNONYMS`.

    Parameters
    ----------
    sheet
        Its header, whose nonempty titles are distinct ignoring case, the cells below, and the place of the header.
    renames
        Names in the file by standard name; names missing in the file are ignored.
    sought
        Columns to search for under other names.

    Raises
    ------
    InputError
        If two columns match the same name, a unit does not fit the quantity of its column, or a title has a power of
        ten of unclear meaning.
    """
    titles, where = sheet.header, sheet.titled
    found = Header(_places(titles, renames), {}, [], {})
    for name, j in found.at.items():
        title = _Title.of(j, titles[j])
        _require_no_power(name, title, where)
        if titles[j].casefold() != name and title.spelt is not None:
            _take_unit(found, name, titles[j], title.spelt, where)
    _seek(found, sheet, sought)
    _pass_over(found, titles, sought.given)
    return found


def _places(titles: Sequence[str], renames: Mapping[str, str]) -> dict[str, int]:
    """Return the indices of columns by standard names or those of the user, which take precedence."""
    where = {title.casefold(): j for j, title in enumerate(titles) if title}
    at: dict[str, int] = {}
    for names in (renames, {name: name for name in (*LABELS, *NUMBERS)}):
        for name in (*LABELS, *NUMBERS):
            j = where.get(names.get(name, "").casefold())
            if j is not None and j not in at.values():  # no column has two roles
                at.setdefault(name, j)
    at = {name: at[name] for name in (*LABELS, *NUMBERS) if name in at}
    return at if holds_cells(at) else {name: j for name, j in at.items() if name not in OF_CELLS}


def holds_cells(at: Container[str]) -> bool:
    """Return whether a table with these columns has cell means instead of ratings."""
    return "rating" not in at and ("geometric_mean" in at or ("mean" in at and "n" in at))


def _quantity(name: str) -> str:
    """Return the quantity of a column; empty for names and ratings, whose brackets contain remarks."""
    return "" if name in LABELS or name in _SCALES else NUMBERS[name].quantity


def _require_no_power(name: str, title: _Title, where: str) -> None:
    """Raise an error for a power of ten in a title, which some multiply by and others divide by."""
    if not (title.power and _quantity(name)):
        return
    unit = NUMBERS[name].unit if title.spelt is None else title.spelt.text
    stem, power = title.stem.strip(" ,;([x×*·/"), re.sub(r"^[\W]*[xX]?\s*|\W+$", "", title.power)
    raise InputError(
        f"{where}, column {quoted(title.text)}: are its numbers to be multiplied by {power}, or divided? Write the "
        f"power of ten with the unit: under '{stem} (10^-2 {unit})', 3 means 0.03 {unit}".rstrip()
    )


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
    return [_Title.of(j, text) for j, text in enumerate(titles) if text and j not in taken]


def _seek(found: Header, sheet: Sheet, sought: Sought) -> None:
    """Add columns with other names, one for each missing column.

    Raises
    ------
    InputError
        If there are several candidates for one column.
    """
    if "rating" in sought.names:
        _seek_cells(found, sheet.header)
    free = _free(found, sheet.header)
    cells = holds_cells(found.at)
    names = [name for name in sought.without(found.at) if not (cells and name == "rating")]
    for name in names:
        near = [title for title in free if title.keys & keys_of(name)]
        fitting = _apart(sheet, [title for title in near if _fits(name, title)])
        if len(fitting) > 1:
            ways = " or ".join(f"--column {name}={quoted(title.text)}" for title in fitting[:4])
            several = listing([quoted(title.text) for title in fitting])
            note = f"columns {several} may each be {name!r}; choose one with {ways}"
            if name != "trial":
                raise InputError(f"{sheet.titled}: {note}")
            found.notes.append(note)  # the results do not depend on it
        elif fitting:
            _take(found, name, fitting[0], sheet.titled)
        else:
            for title in near:
                found.perhaps.setdefault(title.j, (name, _unread(name, title)))
    for name in names:
        if name not in found.at and (other := _less_clear(found, sheet, sought, name, free)):
            _take(found, name, other, sheet.titled)
    taken = {*found.at.values()}
    lacking = sought.lacking(found.at) | ({"rating", "fabric", "participant"} - found.at.keys())
    for name in sorted(names, key=lambda name: name not in lacking):
        left = [title for title in free if title.j not in taken and title.j not in found.perhaps]
        if name not in found.at and (other := _misspelt(name, left)) is not None:
            found.perhaps[other.j] = (name, f"is column {quoted(other.text)} a misspelt {name}?")
    for j in taken & found.perhaps.keys():
        del found.perhaps[j]
    for title in free:
        if "rating" in lacking and title.j not in taken and WORDS_FOR_RATINGS & {*key(title.text).split()}:
            found.perhaps.setdefault(title.j, ("rating", ""))


def _unread(name: str, title: _Title) -> str:
    """Return the remark on a column that has the name of another one but not its unit."""
    if not _quantity(name):
        return ""
    example = "B (gf·cm²/cm)" if title.stem == "B" else f"{title.stem} ({NUMBERS[name].unit})"
    return f"column {quoted(title.text)} is not read: it has no unit known here; write one, as in {quoted(example)}"


def _apart(sheet: Sheet, titles: list[_Title]) -> list[_Title]:
    """Return the candidates for one column without constant ones, and one of those that tell the same rows apart."""
    if len(titles) < 2:
        return titles
    cells = {title.j: [row[title.j] for row in sheet.body] for title in titles}
    varying = [title for title in titles if len({*cells[title.j]}) > 1] or titles
    first = cells[varying[0].j]
    alike = (len({*zip(first, cells[t.j], strict=True)}) == len({*first}) == len({*cells[t.j]}) for t in varying)
    return varying[:1] if all(alike) and not any(looks_numeric(text) for text in first) else varying


def _less_clear(found: Header, sheet: Sheet, sought: Sought, name: str, free: Sequence[_Title]) -> _Title | None:
    """Return the column of a name that means it in tables of this kind only, if its cells may be those of the column.

    Raises
    ------
    InputError
        If several of them tell rows apart in different ways.
    """
    left = [title for title in free if title.j not in found.at.values()]
    words = map(bag, LESS_CLEAR.get(sought.sheet, {}).get(name, ()))
    near = dict.fromkeys(title for word in words for title in left if word in (bag(title.stem), bag(title.text)))
    likely = _apart(sheet, [title for title in near if _may_be(name, title, sheet, found.at)])
    for title in near if not likely and _quantity(name) else ():
        found.perhaps.setdefault(title.j, (name, _unread(name, title)))
    if len(likely) > 1 and name == "participant" and len({*(title.text for title in likely)}) > 1:
        ways = " or ".join(f"--column {name}={quoted(title.text)}" for title in likely[:4])
        raise InputError(
            f"{sheet.titled}: columns {listing([quoted(title.text) for title in likely])} may each be the {name}; "
            f"choose one with {ways}"
        )
    return likely[0] if likely else None


def _may_be(name: str, title: _Title, sheet: Sheet, at: Mapping[str, int]) -> bool:
    """Return whether the cells of a column may be those of the column of a name."""
    texts = [row[title.j] for row in sheet.body]
    filled = [text for text in texts if text.casefold() not in MISSING]
    if _quantity(name) and not _fits(name, title):
        return False
    if name in NUMBERS:
        return 2 * sum(map(looks_numeric, filled)) > len(filled) > 0
    if name != "participant" or sheet.made:
        return bool(filled)
    others = [[row[at[other]] for row in sheet.body] for other in ("fabric", "trial") if other in at]
    determined = any(len({*zip(own, texts, strict=True)}) == len({*own}) for own in others)
    counts_rows = "fabric" in at and len({*texts}) == len(texts)
    return len({*filled}) > 1 and not determined and not counts_rows


def _take(found: Header, name: str, title: _Title, where: str) -> None:
    """Record that a column is the one of a name, and its unit."""
    _require_no_power(name, title, where)
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
    ratings = "rating" in found.at or any(bag(title.stem) in keys_of("rating") for title in free)
    at: dict[str, int] = {}
    for name in (name for name in NUMBERS if name in OF_CELLS):
        own = [title.j for title in free if title.text.casefold() == name]
        own = own or [title.j for title in free if bag(title.stem) in keys_of(name)]
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
    """Return the words of a column's standard name, with and without its unit, and of its synonyms, each sorted."""
    return frozenset(bag(title) for title in (title_and_unit(name)[0], name, *SYNONYMS.get(name, ())))


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
    stems = {bag(title.stem): title for title in titles[:MOST_GUESSED] if len(title.stem) <= LONGEST_TITLE}
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
        return unit_named(title.spelt.text, quantity) is not None
    scale = re.fullmatch(r"[0-9]+\s*(?:-|–|…|\.\.\.?|to)\s*[0-9]+", title.spelt.text)
    return bag(title.text) in keys_of(name) or scale is not None
