"""Headers of tables: which column is which, and its unit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.data.columns import (
    ANCHOR,
    KNOWN_BY,
    LESS_CLEAR,
    NAMES,
    NUMBERS,
    OF_CELLS,
    WORDS_FOR_RATINGS,
    Kind,
    holds_cells,
    is_reversed,
    quantity_of,
    reversed_remark,
)
from softness_bayes.data.tables import Table
from softness_bayes.data.texts import is_missing, listing, looks_numeric, mostly_numeric
from softness_bayes.data.titles import UNITS, Title, Unit, analysed, bag, is_unit, key, unit_named


class Header:
    """The columns of a table: known by standard names, by those of the user, and by other names, in this order.

    Parameters
    ----------
    table
        The table; nonempty titles are distinct ignoring case.
    kind
        The kind of table.
    renames
        Titles by standard name; those missing in the file are ignored.

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

    def __init__(self, table: Table, kind: Kind, renames: Mapping[str, str]) -> None:
        self.place, self.cells = table.header, table.cells
        # where rows held several values, a participant may have one row only
        self.melted = bool(table.made)
        self.titles = {text: analysed(text) for text in table.cells if text}
        self.at: dict[str, str] = {}
        self.units: dict[str, Unit] = {}
        self.notes: list[str] = []
        self.perhaps: dict[str, tuple[str, str]] = {}
        self._take_named(renames)
        if "rating" in kind.columns:
            self._take_means()
        sought = [name for name in kind.sought(self.at) if not (name == "rating" and holds_cells(self.at))]
        for name in sought:
            self._take_meant(name, self._called(KNOWN_BY[name]), sure=True)
        for name in sought:
            if name not in self.at:
                words = LESS_CLEAR.get(kind.sheet, {}).get(name, "").split(", ")
                near = [text for one in map(bag, filter(None, words)) for text in self._called({one})]
                self._take_meant(name, near, sure=False)
        if is_reversed(self.at.get("rating", "")):
            self.notes.append(f"looks wrong: {reversed_remark(self.at['rating'])}")
        elif "rating" in sought and "rating" not in self.at:
            for text in self.free:
                if is_reversed(text):
                    self.perhaps[text] = ("rating", reversed_remark(text))
                elif WORDS_FOR_RATINGS & {*key(text).split()}:
                    self.perhaps.setdefault(text, ("rating", ""))
        for name in [
            name for name in ("rating", "indentation_mm", "force_n") if name in self.at and name not in renames
        ]:
            # programs number columns of one name: rating, rating.1
            if again := [text for text in self.free if re.fullmatch(rf"{re.escape(self.at[name])}\.[0-9]+", text)]:
                raise InputError(
                    f"{self.place}: columns {listing([*map(quoted, (self.at[name], *again))])} may each be {name!r}; "
                    f"put them below each other, or choose one with --column {name}={quoted(self.at[name])}"
                )
        self.notes += [
            f"column {quoted(text)} may contain loads but is not read: the given load is used for all ratings"
            for name in sorted(kind.given - self.at.keys())
            for text in self._called(KNOWN_BY[name])
            if len(key(text)) > 2
        ]

    @property
    def free(self) -> list[str]:
        """Titles of the columns that are not known."""
        taken = {*self.at.values()}
        return [text for text in self.titles if text not in taken]

    def _called(self, names: Set[str]) -> list[str]:
        """Return the titles of unknown columns that have one of some names."""
        return [text for text in self.free if self.titles[text].bags & names]

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
                self._take(name, self.titles[at[name]], f"column {quoted(at[name])}: ")

    def _take(self, name: str, title: Title, lead: str) -> bool:
        """Record that a column is the one of a name, and its unit; return whether there was something to say of it.

        Raises
        ------
        InputError
            If the unit is of another quantity, or there is a power of ten beside the words, which some multiply by and
            others divide by.
        """
        self.at[name] = title.text
        self.perhaps.pop(title.text, None)
        quantity, said = quantity_of(name), f"{self.place}, column {quoted(title.text)}: "
        if not quantity:
            return False
        column, unit = NUMBERS[name], title.unit
        if title.power:
            stem, power = title.stem.strip(" ,;([x×*·/"), re.sub(r"^[\W]*[xX]?\s*|\W+$", "", title.power)
            unit = column.unit if unit is None else unit
            raise InputError(
                f"{said}are its numbers to be multiplied by {power}, or divided? Write the power of ten with the "
                f"unit: under '{stem} (10^-2 {unit})', 3 means 0.03 {unit}".rstrip()
            )
        found, own = unit_named(unit or "", quantity), unit_named(column.unit or "1", quantity)
        if title.text.casefold() == name or not unit or not own or (found and found.factor == own.factor):
            return False
        if found:
            self.units[name] = found
            ratio = float(found.factor / own.factor)
            self.notes.append(f"{lead}converted, 1 {found.name} = {ratio:.9g} {column.unit}".rstrip())
        elif title.bracketed or len(unit) > 1:  # a one-letter word may not be a unit
            if is_unit(unit) or not unit.replace(" ", "").isalpha() or "[" in title.text:
                raise InputError(
                    f"{said}{name} has the unit {quoted(unit)} in the header, expected one of "
                    f"{', '.join(texts[0] for texts in UNITS[quantity].values())}"
                )
            self.notes.append(f"{lead}{quoted(unit)} is not a unit, so the numbers are read in the unit of {name}")
        return True

    # columns with other names

    def _take_means(self) -> None:
        """Take columns of cell means under other names, if there are means and numbers of raters.

        Single ratings, under any name, take precedence; columns that look like means are then reported.
        """
        stems = {text: bag(self.titles[text].stem) for text in self.free}
        at: dict[str, str] = {}
        for name in OF_CELLS:
            if own := [text for text, words in stems.items() if words in KNOWN_BY[name]]:
                at[name] = next((text for text in own if text.casefold() == name), own[0])
        single = "rating" in self.at or any(words in KNOWN_BY["rating"] for words in stems.values())
        spread = at.keys() & {"sd", "se", "geometric_sd"} if "n" in at else set()
        if not single and holds_cells({**self.at, **at}):
            self.at |= at
            others = [(name, text) for name, text in at.items() if text.casefold() != name]
            self.notes += [f"column {quoted(text)} is read as {name}" for name, text in others]
        elif spread if single else at.keys() & {"mean", "geometric_mean"}:
            self.notes.append(
                f"columns {', '.join(quoted(text) for text in stems if text in at.values())} look like means of "
                "several raters, which are read from a column n (how many raters) and geometric_mean, or mean with sd "
                "or se, and --ratings aggregated"
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
        near = [*dict.fromkeys(meant)]
        fitting = self._apart([text for text in near if (_fits if sure else self._may_be)(name, self.titles[text])])
        if len(fitting) > 1 and (sure or name == "participant"):
            ways = " or ".join(f"--column {name}={quoted(text)}" for text in fitting[:4])
            what = repr(name) if sure else f"the {name}"
            note = f"columns {listing([*map(quoted, fitting)])} may each be {what}; choose one with {ways}"
            if name != "trial":
                raise InputError(f"{self.place}: {note}")
            self.notes.append(note)  # the results do not depend on it
        elif fitting:
            lead = f"column {quoted(fitting[0])} is read as {name}"
            if not self._take(name, self.titles[fitting[0]], f"{lead}, "):
                self.notes.append(lead)
        elif sure or quantity_of(name):
            for text in near:
                remark = ""
                if quantity_of(name):
                    stem, unit = self.titles[text].stem, self.titles[text].unit
                    example = quoted("B (gf·cm²/cm)" if stem == "B" else f"{stem} ({NUMBERS[name].unit})")
                    remark = f"column {quoted(text)} is not read: "
                    if unit and is_unit(unit):
                        remark += f"its unit {unit} does not fit {name}; write the unit that its numbers have, "
                        remark += f"or convert them, as to {example}"
                    elif unit:
                        remark += f"{quoted(unit)} is no unit known here; convert its numbers, as to {example}"
                    else:
                        remark += f"it has no unit known here; write one, as in {example}"
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
            return mostly_numeric(texts) and bool(filled) and _fits(name, title)
        if name != "participant" or self.melted:
            return bool(filled)
        others = [self.cells[self.at[other]] for other in ("fabric", "trial") if other in self.at]
        determined = any(len({*zip(own, texts, strict=True)}) == len({*own}) for own in others)
        counts_rows = "fabric" in self.at and len({*texts}) == len(texts)
        return len({*filled}) > 1 and not determined and not counts_rows


def _fits(name: str, title: Title) -> bool:
    """Return whether a title with a name of a column has an allowed unit, or the extent of a scale, such as 1-10."""
    quantity = quantity_of(name)
    if title.unit is None:
        return quantity in ("", "ratio", "frequency")
    if quantity:
        return unit_named(title.unit, quantity) is not None
    scale = re.fullmatch(r"[0-9]+\s*(?:-|–|…|\.\.\.?|to)\s*[0-9]+", title.unit)
    ends = ANCHOR.search(title.unit) and not is_reversed(title.text)
    return bag(title.text) in KNOWN_BY[name] or bool(scale or ends)
