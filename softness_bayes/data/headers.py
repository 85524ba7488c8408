"""Headers of tables: which column is which, and its unit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Container, Mapping, Sequence

from softness_bayes.data.columns import (
    ANCHOR,
    KNOWN_BY,
    LESS_CLEAR,
    MISSING,
    NAMES,
    NUMBERS,
    OF_CELLS,
    OWNERS,
    WORDS_FOR_RATINGS,
    Kind,
    is_reversed,
    looks_numeric,
    quantity_of,
    reversed_remark,
)
from softness_bayes.data.faults import MOST_GUESSED, listing
from softness_bayes.data.sheets import Sheet
from softness_bayes.data.titles import LONGEST_TITLE, UNITS, Title, Unit, analysed, bag, is_unit, key, unit_named
from softness_bayes.errors import InputError, quoted


def holds_cells(at: Container[str]) -> bool:
    """Return whether a table with these columns has cell means instead of ratings."""
    return "rating" not in at and ("geometric_mean" in at or ("mean" in at and "n" in at))


class Header:
    """The columns of a sheet: known by standard names, by those of the user, and by `columns.SYNONYMS`, in this order.

    Parameters
    ----------
    sheet
        Its header, whose nonempty titles are distinct ignoring case, and its cells.
    renames
        Names in the file by standard name; names missing in the file are ignored.
    kind
        The kind of table.

    Attributes
    ----------
    at
        Index of each known column, by standard name.
    units
        Units of columns by standard name, where they differ from the standard unit.
    notes
        What was understood.
    perhaps
        Index of a column that is not read -> the name that it may have, and a remark (empty if there is none).

    Raises
    ------
    InputError
        If two columns match the same name, a unit does not fit the quantity of its column, or a title has a power of
        ten of unclear meaning.
    """

    def __init__(self, sheet: Sheet, renames: Mapping[str, str], kind: Kind) -> None:
        self.sheet, self.kind = sheet, kind
        self.titles = [analysed(text) for text in sheet.header]
        self.at: dict[str, int] = {}
        self.units: dict[str, Unit] = {}
        self.notes: list[str] = []
        self.perhaps: dict[int, tuple[str, str]] = {}
        self._take_named(renames)
        if "rating" in kind.columns:
            self._take_means()
        sought = [name for name in kind.sought(self.at) if not (name == "rating" and holds_cells(self.at))]
        claims = self._claims()
        for take in (self._take_synonym, self._take_less_clear):
            for name in sought:
                if name not in self.at:
                    take(name, claims.get(name, []))
        self._guess(sought)
        self.notes += [
            f"column {quoted(self.titles[j].text)} may contain loads but is not read: the given load is used for all "
            "ratings"
            for name in sorted(kind.given - self.at.keys())
            for j in self.free
            if name in map(OWNERS.get, self.titles[j].bags) and len(key(self.titles[j].text)) > 2
        ]

    @property
    def free(self) -> list[int]:
        """Indices of the columns with a title that are not known."""
        taken = {*self.at.values()}
        return [j for j, title in enumerate(self.titles) if title.text and j not in taken]

    def _take_named(self, renames: Mapping[str, str]) -> None:
        """Take the columns of standard names or those of the user, which take precedence; no column has two roles."""
        where = {title.text.casefold(): j for j, title in enumerate(self.titles) if title.text}
        at: dict[str, int] = {}
        for names in (renames, {name: name for name in NAMES}):
            for name in NAMES:
                j = where.get(names.get(name, "").casefold())
                if j is not None and j not in at.values():
                    at.setdefault(name, j)
        means = holds_cells(at)
        for name in NAMES:
            if name in at and (means or name not in OF_CELLS):
                self.at[name] = at[name]
                title = self.titles[at[name]]
                self._require_no_power(name, title)
                if title.text.casefold() != name and title.unit is not None:
                    self._take_unit(name, title)

    def _claims(self) -> dict[str, list[int]]:
        """Return the unknown columns whose titles mean a column, by its name."""
        claims: dict[str, list[int]] = {}
        for j in self.free:
            for name in {OWNERS[words] for words in self.titles[j].bags if words in OWNERS}:
                claims.setdefault(name, []).append(j)
        return claims

    def _take(self, name: str, j: int) -> None:
        """Record that a column is the one of a name, and its unit."""
        title = self.titles[j]
        self._require_no_power(name, title)
        self.at[name] = j
        self.perhaps.pop(j, None)
        lead = f"column {quoted(title.text)} is read as {name}"
        before = len(self.notes)
        if quantity_of(name) and title.unit is not None and (unit := unit_named(title.unit, quantity_of(name))):
            self._convert(name, unit, f"{lead}, ")
        if len(self.notes) == before:
            self.notes.append(lead)

    def _require_no_power(self, name: str, title: Title) -> None:
        """Raise an error for a power of ten in a title, which some multiply by and others divide by."""
        if not (title.power and quantity_of(name)):
            return
        unit = NUMBERS[name].unit if title.unit is None else title.unit
        stem, power = title.stem.strip(" ,;([x×*·/"), re.sub(r"^[\W]*[xX]?\s*|\W+$", "", title.power)
        raise InputError(
            f"{self.sheet.titled}, column {quoted(title.text)}: are its numbers to be multiplied by {power}, or "
            f"divided? Write the power of ten with the unit: under '{stem} (10^-2 {unit})', 3 means 0.03 "
            f"{unit}".rstrip()
        )

    def _take_unit(self, name: str, title: Title) -> None:
        """Record the unit of a column named by the user; raise an error for a unit of another quantity."""
        quantity, text = quantity_of(name), title.unit
        if not quantity or not text:
            return
        if unit := unit_named(text, quantity):
            self._convert(name, unit, f"column {quoted(title.text)}: ")
        elif not title.bracketed and len(text) < 2:
            return  # a one-letter word may not be a unit
        elif is_unit(text) or not text.replace(" ", "").isalpha() or "[" in title.text:
            raise InputError(
                f"{self.sheet.titled}, column {quoted(title.text)}: {name} has the unit {quoted(text)} in the header, "
                f"expected one of {', '.join(texts[0] for texts in UNITS[quantity].values())}"
            )
        else:
            self.notes.append(
                f"column {quoted(title.text)}: {quoted(text)} is not a unit, so the numbers are read in the unit of "
                f"{name}"
            )

    def _convert(self, name: str, unit: Unit, lead: str) -> None:
        """Record that a column is in another unit."""
        column = NUMBERS[name]
        own = unit_named(column.unit or "1", column.quantity)
        assert own is not None
        if unit.factor != own.factor:
            self.units[name] = unit
            ratio = float(unit.factor / own.factor)
            self.notes.append(f"{lead}converted, 1 {unit.name} = {ratio:.9g} {column.unit}".rstrip())

    # columns with other names

    def _take_means(self) -> None:
        """Take columns of cell means under other names, if there are means and numbers of raters.

        Single ratings, under any name, take precedence; columns that belong to means are then reported.
        """
        stems = {j: bag(self.titles[j].stem) for j in self.free}
        ratings = "rating" in self.at or any(words in KNOWN_BY["rating"] for words in stems.values())
        at: dict[str, int] = {}
        for name in (name for name in NUMBERS if name in OF_CELLS):
            own = [j for j in stems if self.titles[j].text.casefold() == name]
            own = own or [j for j, words in stems.items() if words in KNOWN_BY[name]]
            if own and own[0] not in at.values():
                at[name] = own[0]
        seen = ", ".join(quoted(self.titles[j].text) for j in sorted({*at.values()}))
        if ratings:
            if "n" in at and at.keys() & {"sd", "se", "geometric_sd"}:
                self.notes.append(
                    f"columns {seen} belong to means of several raters, and are not used; if the ratings are "
                    f"means, name them with --column mean=... and use --ratings aggregated"
                )
        elif holds_cells({**self.at, **at}):
            self.at |= at
            other = {name: self.titles[j].text for name, j in at.items() if self.titles[j].text.casefold() != name}
            self.notes += [f"column {quoted(title)} is read as {name}" for name, title in other.items()]
        elif "mean" in at or "geometric_mean" in at:
            self.notes.append(
                f"columns {seen} look like means of several raters, which are read from a column n (how many "
                f"raters) and geometric_mean, or mean with sd or se, and --ratings aggregated"
            )

    def _take_synonym(self, name: str, claimed: Sequence[int]) -> None:
        """Take the column with another name of a column, if its unit fits.

        Raises
        ------
        InputError
            If there are several.
        """
        near = [j for j in claimed if j not in self.at.values()]
        fitting = self._apart([j for j in near if _fits(name, self.titles[j])])
        if len(fitting) > 1:
            ways = " or ".join(f"--column {name}={quoted(self.titles[j].text)}" for j in fitting[:4])
            several = listing([quoted(self.titles[j].text) for j in fitting])
            note = f"columns {several} may each be {name!r}; choose one with {ways}"
            if name != "trial":
                raise InputError(f"{self.sheet.titled}: {note}")
            self.notes.append(note)  # the results do not depend on it
        elif fitting:
            self._take(name, fitting[0])
        else:
            for j in near:
                self.perhaps.setdefault(j, (name, _unread(name, self.titles[j])))

    def _take_less_clear(self, name: str, _: Sequence[int]) -> None:
        """Take the column that means a column in tables of this kind only, if its cells may be those of the column.

        Raises
        ------
        InputError
            If several of them tell rows apart in different ways.
        """
        words = [*map(bag, LESS_CLEAR.get(self.kind.sheet, {}).get(name, ()))]
        if not words:
            return
        near = [*dict.fromkeys(j for word in words for j in self.free if word in self.titles[j].bags)]
        likely = self._apart([j for j in near if self._may_be(name, j)])
        if len(likely) > 1 and name == "participant":
            ways = " or ".join(f"--column {name}={quoted(self.titles[j].text)}" for j in likely[:4])
            raise InputError(
                f"{self.sheet.titled}: columns {listing([quoted(self.titles[j].text) for j in likely])} may each be "
                f"the {name}; choose one with {ways}"
            )
        if likely:
            self._take(name, likely[0])
        elif quantity_of(name):
            for j in near:
                self.perhaps.setdefault(j, (name, _unread(name, self.titles[j])))

    def _cells(self, j: int) -> list[str]:
        return [row[j] for row in self.sheet.body]

    def _apart(self, candidates: list[int]) -> list[int]:
        """Return the candidates for a column without constant ones, and one of those that tell the same rows apart."""
        if len(candidates) < 2:
            return candidates
        cells = {j: self._cells(j) for j in candidates}
        varying = [j for j in candidates if len({*cells[j]}) > 1] or candidates
        first = cells[varying[0]]
        alike = (len({*zip(first, cells[j], strict=True)}) == len({*first}) == len({*cells[j]}) for j in varying)
        return varying[:1] if all(alike) and not any(looks_numeric(text) for text in first) else varying

    def _may_be(self, name: str, j: int) -> bool:
        """Return whether the cells of a column may be those of the column of a name."""
        texts = self._cells(j)
        filled = [text for text in texts if text.casefold() not in MISSING]
        if quantity_of(name) and not _fits(name, self.titles[j]):
            return False
        if name in NUMBERS:
            return 2 * sum(map(looks_numeric, filled)) > len(filled) > 0
        if name != "participant" or self.sheet.made:
            return bool(filled)
        others = [self._cells(self.at[other]) for other in ("fabric", "trial") if other in self.at]
        determined = any(len({*zip(own, texts, strict=True)}) == len({*own}) for own in others)
        counts_rows = "fabric" in self.at and len({*texts}) == len(texts)
        return len({*filled}) > 1 and not determined and not counts_rows

    def _guess(self, sought: Sequence[str]) -> None:
        """Find the titles that may be misspelt names of columns that are needed."""
        needed = self.kind.needed(self.at)
        for j in self.free if "rating" in needed else ():
            if is_reversed(self.titles[j].text):
                self.perhaps[j] = ("rating", reversed_remark(self.titles[j].text))
        for name in (name for name in sought if name in needed):
            left = [j for j in self.free if j not in self.perhaps][:MOST_GUESSED]
            stems = {bag(self.titles[j].stem): j for j in left if len(self.titles[j].stem) <= LONGEST_TITLE}
            near = (
                title
                for words in sorted(KNOWN_BY[name])
                if len(words) > 4  # short ones resemble many
                for title in difflib.get_close_matches(words, stems, 1, 0.8)
                # more words mean a logarithm of it, or its error
                if not any({*words.split()} < {*title.split()} for words in KNOWN_BY[name])
            )
            if (close := next(near, None)) is not None:
                j = stems[close]
                self.perhaps[j] = (name, f"is column {quoted(self.titles[j].text)} a misspelt {name}?")
        for j in self.free if "rating" in needed else ():
            if WORDS_FOR_RATINGS & {*key(self.titles[j].text).split()}:
                self.perhaps.setdefault(j, ("rating", ""))


def _unread(name: str, title: Title) -> str:
    """Return the remark on a column that has the name of another one but not its unit."""
    if not quantity_of(name):
        return ""
    example = "B (gf·cm²/cm)" if title.stem == "B" else f"{title.stem} ({NUMBERS[name].unit})"
    return f"column {quoted(title.text)} is not read: it has no unit known here; write one, as in {quoted(example)}"


def _fits(name: str, title: Title) -> bool:
    """Return whether a title with a name of a column has an allowed unit, or the extent of a scale, such as 1-10."""
    quantity = quantity_of(name)
    if title.unit is None:
        return quantity in ("", "ratio")
    if quantity:
        return unit_named(title.unit, quantity) is not None
    scale = re.fullmatch(r"[0-9]+\s*(?:-|–|…|\.\.\.?|to)\s*[0-9]+", title.unit)
    ends = ANCHOR.search(title.unit) and not is_reversed(title.text)
    return bag(title.text) in KNOWN_BY[name] or bool(scale or ends)
