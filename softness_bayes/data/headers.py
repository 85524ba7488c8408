"""Headers of tables: which column is which, and its unit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence

from softness_bayes.data.columns import (
    ANCHOR,
    KNOWN_BY,
    LESS_CLEAR,
    NAMES,
    NUMBERS,
    OF_CELLS,
    OWNERS,
    WORDS_FOR_RATINGS,
    Kind,
    holds_cells,
    is_reversed,
    quantity_of,
    reversed_remark,
)
from softness_bayes.data.decimals import is_missing, looks_numeric, mostly_numeric
from softness_bayes.data.faults import MOST_GUESSED, listing
from softness_bayes.data.titles import LONGEST_TITLE, UNITS, Title, Unit, analysed, bag, is_unit, key, unit_named
from softness_bayes.errors import InputError, quoted


class Header:
    """The columns of a table: known by standard names, by those of the user, and by other names, in this order.

    Parameters
    ----------
    place
        The row of the header in words, for errors.
    cells
        Cells by title; nonempty titles are distinct ignoring case.
    renames
        Titles by standard name; those missing in the file are ignored.
    kind
        The kind of table.
    melted
        Whether rows held several values, so that a participant may have one row only.

    Attributes
    ----------
    at
        Title of each known column, by standard name.
    units
        Units of columns by standard name, where they differ from the standard unit.
    notes
        What was understood.
    perhaps
        Title of a column that is not read -> the name that it may have, and a remark (empty if there is none).

    Raises
    ------
    InputError
        If two columns match the same name, a unit does not fit the quantity of its column, or a title has a power of
        ten of unclear meaning.
    """

    def __init__(
        self, place: str, cells: Mapping[str, Sequence[str]], renames: Mapping[str, str], kind: Kind, melted: bool
    ) -> None:
        self.place, self.cells, self.kind, self.melted = place, cells, kind, melted
        self.titles = {text: analysed(text) for text in cells if text}
        self.at: dict[str, str] = {}
        self.units: dict[str, Unit] = {}
        self.notes: list[str] = []
        self.perhaps: dict[str, tuple[str, str]] = {}
        self._take_named(renames)
        if "rating" in kind.columns:
            self._take_means()
        sought = [name for name in kind.sought(self.at) if not (name == "rating" and holds_cells(self.at))]
        less_clear = LESS_CLEAR.get(kind.sheet, {})
        meant: dict[str, list[str]] = {}
        for text in self.free:
            for name in {OWNERS[words] for words in self.titles[text].bags if words in OWNERS}:
                meant.setdefault(name, []).append(text)
        for name in sought:
            self._take_meant(name, meant.get(name, ()), sure=True)
        for name in sought:
            words = map(bag, less_clear.get(name, "").split(", ")) if name not in self.at else ()
            self._take_meant(
                name, [text for one in words for text in self.free if one in self.titles[text].bags], False
            )
        self._guess([name for name in sought if name in kind.needed(self.at)])
        self.notes += [
            f"column {quoted(text)} may contain loads but is not read: the given load is used for all ratings"
            for name in sorted(kind.given - self.at.keys())
            for text in self.free
            if name in map(OWNERS.get, self.titles[text].bags) and len(key(text)) > 2
        ]

    @property
    def free(self) -> list[str]:
        """Titles of the columns that are not known."""
        taken = {*self.at.values()}
        return [text for text in self.titles if text not in taken]

    def _take_named(self, renames: Mapping[str, str]) -> None:
        """Take the columns of standard names or those of the user, which take precedence; no column has two roles."""
        where = {text.casefold(): text for text in self.titles}
        at: dict[str, str] = {}
        for names in (renames, {name: name for name in NAMES}):
            for name in NAMES:
                text = where.get(names.get(name, "").casefold())
                if text is not None and text not in at.values():
                    at.setdefault(name, text)
        means = holds_cells(at)
        for name in NAMES:
            if name in at and (means or name not in OF_CELLS):
                self.at[name] = at[name]
                self._take_unit(name, self.titles[at[name]])

    def _take_unit(self, name: str, title: Title) -> None:
        """Record the unit in a title that the user named; raise an error for a unit of another quantity."""
        quantity, unit = quantity_of(name), title.unit
        self._require_no_power(name, title)
        if not quantity or not unit or title.text.casefold() == name:
            return
        if unit_named(unit, quantity):
            self._convert(name, title, f"column {quoted(title.text)}: ")
        elif title.bracketed or len(unit) > 1:  # a one-letter word may not be a unit
            if is_unit(unit) or not unit.replace(" ", "").isalpha() or "[" in title.text:
                raise InputError(
                    f"{self.place}, column {quoted(title.text)}: {name} has the unit {quoted(unit)} in the header, "
                    f"expected one of {', '.join(texts[0] for texts in UNITS[quantity].values())}"
                )
            self.notes.append(
                f"column {quoted(title.text)}: {quoted(unit)} is not a unit, so the numbers are read in the unit of "
                f"{name}"
            )

    def _require_no_power(self, name: str, title: Title) -> None:
        """Raise an error for a power of ten in a title, which some multiply by and others divide by."""
        if title.power and quantity_of(name):
            unit = NUMBERS[name].unit if title.unit is None else title.unit
            stem, power = title.stem.strip(" ,;([x×*·/"), re.sub(r"^[\W]*[xX]?\s*|\W+$", "", title.power)
            raise InputError(
                f"{self.place}, column {quoted(title.text)}: are its numbers to be multiplied by {power}, or "
                f"divided? Write the power of ten with the unit: under '{stem} (10^-2 {unit})', 3 means 0.03 "
                f"{unit}".rstrip()
            )

    def _convert(self, name: str, title: Title, lead: str) -> bool:
        """Record the unit in a title if it is another one than that of the column; return whether it is."""
        column = NUMBERS[name]
        unit = unit_named(title.unit or "", column.quantity) if column.quantity else None
        own = unit_named(column.unit or "1", column.quantity) if unit else None
        if unit is None or own is None or unit.factor == own.factor:
            return False
        self.units[name] = unit
        self.notes.append(
            f"{lead}converted, 1 {unit.name} = {float(unit.factor / own.factor):.9g} {column.unit}".rstrip()
        )
        return True

    # columns with other names

    def _take_means(self) -> None:
        """Take columns of cell means under other names, if there are means and numbers of raters.

        Single ratings, under any name, take precedence; columns that look like means are then reported.
        """
        stems = {text: bag(self.titles[text].stem) for text in self.free}
        at: dict[str, str] = {}
        for name in OF_CELLS:
            exact = [text for text in stems if text.casefold() == name]
            own = exact or [text for text, words in stems.items() if words in KNOWN_BY[name]]
            if own and own[0] not in at.values():
                at[name] = own[0]
        seen = ", ".join(quoted(text) for text in stems if text in at.values())
        if "rating" in self.at or any(words in KNOWN_BY["rating"] for words in stems.values()):
            if "n" in at and at.keys() & {"sd", "se", "geometric_sd"}:
                self.notes.append(
                    f"columns {seen} belong to means of several raters, and are not used; if the ratings are "
                    f"means, name them with --column mean=... and use --ratings aggregated"
                )
        elif holds_cells({**self.at, **at}):
            self.at |= at
            self.notes += [
                f"column {quoted(text)} is read as {name}" for name, text in at.items() if text.casefold() != name
            ]
        elif "mean" in at or "geometric_mean" in at:
            self.notes.append(
                f"columns {seen} look like means of several raters, which are read from a column n (how many "
                f"raters) and geometric_mean, or mean with sd or se, and --ratings aggregated"
            )

    def _take_meant(self, name: str, meant: Sequence[str], sure: bool) -> None:
        """Take the column whose title means a name, if its unit fits.

        Parameters
        ----------
        name
            The name.
        meant
            Titles that mean it, the clearest first.
        sure
            False if they mean it in tables of this kind only; the cells must then be possible ones.

        Raises
        ------
        InputError
            If several columns are meant.
        """
        near = [*dict.fromkeys(text for text in meant if text not in self.at.values())]
        fitting = self._apart([text for text in near if (_fits if sure else self._may_be)(name, self.titles[text])])
        if len(fitting) > 1 and (sure or name == "participant"):
            ways = " or ".join(f"--column {name}={quoted(text)}" for text in fitting[:4])
            what = repr(name) if sure else f"the {name}"
            note = f"columns {listing([*map(quoted, fitting)])} may each be {what}; choose one with {ways}"
            if name != "trial":
                raise InputError(f"{self.place}: {note}")
            self.notes.append(note)  # the results do not depend on it
        elif fitting:
            title = self.titles[fitting[0]]
            self._require_no_power(name, title)
            self.at[name] = title.text
            self.perhaps.pop(title.text, None)
            lead = f"column {quoted(title.text)} is read as {name}"
            if name not in NUMBERS or not self._convert(name, title, f"{lead}, "):
                self.notes.append(lead)
        elif sure or quantity_of(name):
            for text in near:
                remark = ""
                if quantity_of(name):
                    stem = self.titles[text].stem
                    example = "B (gf·cm²/cm)" if stem == "B" else f"{stem} ({NUMBERS[name].unit})"
                    remark = (
                        f"column {quoted(text)} is not read: it has no unit known here; write one, as in "
                        f"{quoted(example)}"
                    )
                self.perhaps.setdefault(text, (name, remark))

    def _apart(self, candidates: list[str]) -> list[str]:
        """Return the candidates for a column without constant ones, and one of those that tell the same rows apart."""
        if len(candidates) < 2:
            return candidates
        varying = [text for text in candidates if len({*self.cells[text]}) > 1] or candidates
        first = self.cells[varying[0]]
        alike = all(
            len({*zip(first, self.cells[text], strict=True)}) == len({*first}) == len({*self.cells[text]})
            for text in varying
        )
        return varying[:1] if alike and not any(map(looks_numeric, first)) else varying

    def _may_be(self, name: str, title: Title) -> bool:
        """Return whether the cells of a column may be those of the column of a name."""
        texts = self.cells[title.text]
        filled = [text for text in texts if not is_missing(text)]
        if name in NUMBERS:
            return mostly_numeric(texts) and bool(filled) and (not quantity_of(name) or _fits(name, title))
        if name != "participant" or self.melted:
            return bool(filled)
        others = [self.cells[self.at[other]] for other in ("fabric", "trial") if other in self.at]
        determined = any(len({*zip(own, texts, strict=True)}) == len({*own}) for own in others)
        counts_rows = "fabric" in self.at and len({*texts}) == len(texts)
        return len({*filled}) > 1 and not determined and not counts_rows

    def _guess(self, needed: Sequence[str]) -> None:
        """Find the titles that may be misspelt names of columns that are needed, or words for ratings."""
        for text in self.free if "rating" in needed else ():
            if is_reversed(text):
                self.perhaps[text] = ("rating", reversed_remark(text))
        for name in needed:
            left = [text for text in self.free if text not in self.perhaps][:MOST_GUESSED]
            stems = {bag(self.titles[text].stem): text for text in left if len(text) <= LONGEST_TITLE}
            near = (
                title
                for words in sorted(KNOWN_BY[name])
                if len(words) > 4  # short ones resemble many
                for title in difflib.get_close_matches(words, stems, 1, 0.8)
                # more words mean a logarithm of it, or its error
                if not any({*words.split()} < {*title.split()} for words in KNOWN_BY[name])
            )
            if (close := next(near, None)) is not None:
                self.perhaps[stems[close]] = (name, f"is column {quoted(stems[close])} a misspelt {name}?")
        for text in self.free if "rating" in needed else ():
            if WORDS_FOR_RATINGS & {*key(text).split()}:
                self.perhaps.setdefault(text, ("rating", ""))


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
