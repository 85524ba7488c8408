"""Texts in tables: names of people and fabrics, and numbers, with what those of a table say about their marks."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from itertools import islice
from typing import NamedTuple, TypeAlias

from softness_bayes.base.errors import InputError

# names

LONGEST = 100
"""Largest number of characters of a name that is compared with others, and that is shown."""

MOST_GUESSED, MOST_ASKED = 500, 100
"""Largest numbers of names among which, and for which, similar ones are sought in a table."""


def natural(names: Iterable[str]) -> list[str]:
    """Return distinct names, sorted with numbers in numerical order: P2 before P10."""
    return sorted(set(names), key=lambda name: (re.sub("[0-9]+", lambda digits: digits[0].zfill(20), name), name))


def short(name: str) -> str:
    """Return a name for a message, cut if it is long."""
    return name if len(name) <= LONGEST else f"{name[:LONGEST]}…"


def listing(names: Sequence[str], most: int = 8) -> str:
    """Return names for a message, limited to the first few."""
    return ", ".join(map(short, names[:most])) + (f", … ({len(names)} in all)" if len(names) > most else "")


def guess(name: str, known: Iterable[str], asked: int = 0) -> str:
    """Return ' (did you mean ...?)' if one of the first `MOST_GUESSED` known names is similar, otherwise nothing.

    Nothing either if so many names as `MOST_ASKED` of a table have been `asked` for before.
    """
    if len(name) > LONGEST or asked >= MOST_ASKED:
        return ""
    near = difflib.get_close_matches(name, [*islice(known, MOST_GUESSED)], 1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def identity(name: str) -> tuple[str, ...]:
    """Return a key that is equal for names that differ in case, zeros in front, format of numbers or punctuation only.

    Examples
    --------
    >>> identity("P01") == identity("p-1"), identity("1.0") == identity("01"), identity("A 12") == identity("A 1/2")
    (True, True, False)
    """
    folded = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    seen = "".join(c for c in folded if c.isspace() or unicodedata.category(c) not in ("Cf", "Cc"))
    text = " ".join(seen.split())
    if re.fullmatch(r"[+-]?[0-9]{1,30}(?:[.,][0-9]{1,30})?", text):
        return (f"{Decimal(text.replace(',', '.')).normalize():f}",)
    text = re.sub(r"(?<=[0-9])[.,]0+$", "", text)
    apart = "".join(" " if c in _BETWEEN or unicodedata.category(c) in ("Pd", "Zs") else c for c in text)
    # a space counts between two numbers only
    joined = re.sub(r"(?<!\d) | (?!\d)", "", " ".join(apart.split()))
    parts = re.findall(r"\d+|[^\d\s]+", joined)
    return tuple(part.lstrip("0") or "0" if part.isdigit() else part for part in parts) or (text,)


_BETWEEN = frozenset('_.,;:/\\()[]{}"#')


# numbers

_MISSING = "na|n/a|n.a.|#n/a|nan|null|none|-|–|—|.|--|<na>|n.d.|missing|k.a."
MISSING = frozenset(("", *_MISSING.split("|")))
"""Texts for a missing number, in any case. Only an empty name is missing: NA may be initials."""

MARKS = (",", ".")
"""The possible decimal marks."""

MARKED = ("ratings", "fabrics", "compression", "afferents")
"""Tables that may have different marks."""

Marks: TypeAlias = str | Mapping[str, str] | None
"""The mark of all tables, or marks by table; None, or a missing table, to infer it from the numbers."""


class SheetNumber(str):
    """A number that the file holds as one, not as text: its decimal mark is a point.

    Attributes
    ----------
    shown
        The text that the program of the file shows for it, such as P01 or a label of a value.
    """

    shown: str

    def __new__(cls, value: object, shown: str = "") -> SheetNumber:
        """Make the text of a number."""
        made = super().__new__(cls, value)
        made.shown = shown or str(made)
        return made


def mark_of(marks: Marks, table: str) -> str | None:
    """Return the mark given for a table; None if there is none.

    Raises
    ------
    InputError
        If there is no such mark or table.
    """
    given = dict.fromkeys(MARKED, marks) if isinstance(marks, str) else marks or {}
    for name, mark in given.items():
        if name not in MARKED or mark not in MARKS:
            raise InputError(
                f"decimal is {marks!r}, expected one of {', '.join(map(repr, MARKS))}, or a mark for each of "
                f"some of the tables {', '.join(MARKED)}"
            )
    return given.get(table)


def is_missing(text: str) -> bool:
    """Return whether a text stands for a missing number."""
    return text.casefold() in MISSING


def looks_numeric(text: str) -> bool:
    """Return whether a text is a plain number, with any decimal mark."""
    return re.fullmatch(r"[-+]?[0-9]+(?:[.,][0-9]+)?(?:[eE][-+]?[0-9]+)?", text.strip()) is not None


def mostly_numeric(texts: Sequence[str]) -> bool:
    """Return whether more than half of the texts that are not missing are numbers."""
    filled = [text for text in texts if not is_missing(text)]
    return 2 * sum(map(looks_numeric, filled)) > len(filled)


_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")


def plain_text(text: str) -> str:
    """Return a text in its Unicode normal form, with `^` before raised digits and one sign for minus."""
    raised = re.sub("[⁰¹²³⁴-⁹⁺⁻]{2,}|(?<=10)[⁰¹²³⁴-⁹]", lambda match: f"^{match[0].translate(_RAISED)}", text)
    return unicodedata.normalize("NFKC", raised).replace("\u2212", "-").strip()


def plain_digits(text: str) -> str:
    """Return a number in full-width digits or with a sign of its own for minus in plain characters."""
    if text.isascii() or isinstance(text, SheetNumber) or any(unicodedata.category(c) == "No" for c in text):
        return text  # a raised digit may be that of a footnote
    wide = all(unicodedata.east_asian_width(c) in "FWNaA" or c.isascii() for c in text)
    plain = plain_text(text) if wide or "\u2212" in text else text
    return plain if re.fullmatch("[0-9+.,eE%-]*[0-9][0-9+.,eE%-]*", plain) else text


class Cell(NamedTuple):
    """A number as written in a file, and its row and column in words."""

    text: str
    place: str


class Reading(NamedTuple):
    """Decimal mark and grouping of the numbers of a table."""

    mark: str
    grouped: bool = False
    """True if the other mark groups thousands: the user named the decimal mark, or a number shows it."""
    note: str = ""
    """Assumption about an ambiguous number."""

    def plain(self, text: str) -> str:
        """Return a number with a decimal point and no grouped thousands.

        No-break or thin spaces and apostrophes always group thousands.

        Raises
        ------
        ValueError
            If the number is not written with this mark; the message says what was expected.
        """
        if isinstance(text, SheetNumber):
            return text
        other, text = _other(self.mark), _unspaced(text)
        if other in text:
            groups = rf"([+-]?[0-9]{{1,3}}(?:\{other}[0-9]{{3}})+)(\{self.mark}[0-9]*)?"
            if self.grouped and re.fullmatch(groups, text):
                text = text.replace(other, "")
            elif self.mark == "," and text.strip("+-0123456789.,eE") == "":
                raise ValueError("expected a decimal comma, as elsewhere in this file")
        return text.replace(self.mark, ".")


POINT = Reading(".")
"""Numbers with a decimal point."""


def reading_of(place: str, columns: Sequence[Sequence[Cell]], between_commas: bool = False) -> Reading:
    """Find the decimal mark of a table, and whether the other mark groups thousands.

    Three digits after a comma may be decimals or thousands, as in 1,234. A number that can only have decimals, such as
    0,82, determines the mark of the whole table, as does one that can only have grouped thousands, such as 1,234.5 or
    1,234,567. The same holds for a column in which every number has a point and three digits, as written by programs; a
    column that mixes these with whole numbers is ambiguous.

    Parameters
    ----------
    place
        The file, for the message.
    columns
        The columns of numbers, without their missing cells.
    between_commas
        Whether commas separate the cells, so that the decimal mark is a point.

    Raises
    ------
    InputError
        If a number has two meanings and no other number decides.
    """
    columns = [[cell._replace(text=_unspaced(cell.text)) for cell in cells] for cells in columns]

    def first(mark: str, what: str) -> Cell | None:
        pattern = _PATTERNS[mark][what]
        return next((cell for cells in columns for cell in cells if pattern.fullmatch(cell.text)), None)

    def assumed(unclear: Cell | None, mark: str, shows: Cell, what: str) -> str:
        if unclear is None:
            return ""
        other = _other(mark)
        read = unclear.text.replace(other, "").replace(mark, ".")
        return (
            f"{unclear.place}: {unclear.text} is read as {read}, because {shows.text} in {shows.place} has {what}; "
            f"--decimal {other} reads it otherwise"
        )

    for mark in (".",) if between_commas else MARKS:
        other = _other(mark)
        shows = first(mark, "thousands")
        if shows and not first(other, "thousands") and not first(other, "decimals"):
            return Reading(mark, True, assumed(first(other, "either"), mark, shows, "thousands separators"))
    if between_commas:
        return Reading(".")
    unclear = first(",", "either")
    if shows := first(",", "decimals"):
        return Reading(",", note=assumed(unclear, ",", shows, "a decimal comma"))
    marked = [[cell for cell in cells if "." in cell.text] for cells in columns]
    if not unclear and all(_PATTERNS["."]["either"].fullmatch(cell.text) for cells in marked for cell in cells):
        unclear = next(
            (some[0] for some, cells in zip(marked, columns, strict=True) if 0 < len(some) < len(cells)), None
        )
    if unclear is None:
        return Reading(".")
    point, whole = unclear.text.replace(",", "."), unclear.text.replace(",", "").replace(".", "")
    raise InputError(
        f"{place}: {unclear.place}: {unclear.text!r} may be {point} or {whole}, and no other number of this table "
        "decides which; give the decimal mark with --decimal . or --decimal ,"
    )


def _other(mark: str) -> str:
    return MARKS[mark == ","]


def _patterns(mark: str) -> dict[str, re.Pattern[str]]:
    """Return patterns of numbers that can only have decimals behind a mark, decimals or thousands, only thousands."""
    either = rf"[+-]?[1-9][0-9]{{0,2}}\{mark}[0-9]{{3}}"
    groups = rf"[+-]?[1-9][0-9]{{0,2}}(?:\{_other(mark)}[0-9]{{3}})"
    return {
        "decimals": re.compile(rf"(?!{either}\Z)[+-]?[0-9]*\{mark}[0-9]+(?:[eE][+-]?[0-9]+)?"),
        "either": re.compile(either),
        "thousands": re.compile(rf"{groups}+\{mark}[0-9]+|{groups}{{2,}}"),
    }


_PATTERNS = {mark: _patterns(mark) for mark in MARKS}
_SPACES = "[\u00a0\u2009\u202f'\u2019]"


def _unspaced(text: str) -> str:
    """Return a number without the spaces (other than plain ones) or apostrophes that group its thousands."""
    grouped = re.fullmatch(rf"[+-]?[0-9]{{1,3}}(?:{_SPACES}[0-9]{{3}})+(?:[.,][0-9]+)?", text)
    return re.sub(_SPACES, "", text) if grouped else text
