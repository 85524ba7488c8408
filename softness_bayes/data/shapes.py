"""Odd shapes of tables, each made into a header with one row for each value: remarks, title rows, wide tables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import NamedTuple

from softness_bayes.data.columns import (
    DIRECTIONS,
    FORCE,
    INDENTATION,
    KNOWN_BY,
    MISSING,
    NUMBERS,
    OWNERS,
    RATING,
    SECOND_FABRIC,
    Column,
    Kind,
    looks_numeric,
    quantity_of,
    summarises,
)
from softness_bayes.data.decimals import Marks
from softness_bayes.data.faults import MOST_ASKED, guess, identity, listing
from softness_bayes.data.headers import Header
from softness_bayes.data.sheets import Sheet, SheetNumber
from softness_bayes.data.titles import LONGEST_TITLE, UNITS, analysed, bag, is_unit, key, unit_named
from softness_bayes.errors import InputError, quoted
from softness_bayes.files.json_text import parse_json


class Request(NamedTuple):
    """Instructions for reading a table: its kind, and the user's words about it."""

    kind: Kind
    renames: Mapping[str, str]
    """Name of a column here -> its name in the file; names that the file lacks are ignored."""
    decimal: Marks = None
    """Mark before decimals, or marks by table; None if the numbers tell."""
    wide: bool = False
    """True if the user called a table of ratings wide."""
    fabrics: Callable[[], Collection[str] | None] = lambda: None
    """Returns the names of the fabrics, None where they are not known."""


# rows, before it is known which of them is the header


def _used(record: Sequence[str]) -> int:
    """Return the number of cells up to the last one that is filled."""
    return max((j + 1 for j, cell in enumerate(record) if cell), default=0)


def _usual_width(sheet: Sheet) -> int:
    """Return the most frequent width of the rows, the larger one of two."""
    widths = Counter(map(_used, sheet.records))
    return max(widths, key=lambda width: (widths[width], width), default=0)


def _without(sheet: Sheet, rows: Collection[int], note: str) -> Sheet:
    """Return a sheet without some rows, by index; as it is if there are none."""
    if not rows:
        return sheet
    kept = [i for i in range(len(sheet.records)) if i not in rows]
    told = listing([quoted(" ".join(filter(None, sheet.records[i]))) for i in sorted(rows)], 3)
    records, lines = ([own[i] for i in kept] for own in (sheet.records, sheet.lines))
    return sheet.noted(f"{note}: {told}", records=records, lines=lines)


def without_comments(sheet: Sheet) -> Sheet:
    """Leave out lines that begin with #; a header that does so loses it."""
    width, records = _usual_width(sheet), sheet.records
    marked = [i for i, record in enumerate(records) if record[0].startswith("#")]
    if width < 2 or not marked:
        return sheet
    above = next(i for i in range(len(records) + 1) if i not in marked)
    alone = {i for i in marked if _used(records[i]) == 1}
    header = above - 1 if above and _used(records[above - 1]) == width else None
    if header is not None and not any(map(looks_numeric, records[header])):
        first = records[header][0].lstrip("# ")
        sheet = replace(sheet, records=[[first, *r[1:]] if i == header else r for i, r in enumerate(records)])
    return _without(sheet, {*range(above)} - {header} | alone, "lines that begin with # are left out")


def without_preamble(sheet: Sheet) -> Sheet:
    """Leave out lines of one or two cells above a header of more."""
    width = _usual_width(sheet)
    narrow = min(2, width - 1)
    for i, record in enumerate(sheet.records[:50]):
        filled = [cell for cell in record if cell]
        if i and _used(record) >= width and len({*filled}) == len(filled) and not any(map(looks_numeric, filled)):
            return _without(sheet, {*range(i)}, f"lines above the header in row {sheet.lines[i]} are left out")
        if _used(record) > narrow:
            break
    return sheet


_REMARK = re.compile(r"[*†‡§].*|(?:notes?|source|remark|comment|legend|anmerkung|quelle)\b.*|.{12,}\s.*", re.IGNORECASE)


def without_repeated_headers(sheet: Sheet) -> Sheet:
    """Leave out the header where it is repeated, with a line of one cell above it, and lines of dashes."""
    header = [cell.casefold() for cell in sheet.records[0]] if sheet.records else []
    again = {i for i, row in enumerate(sheet.records) if i and [cell.casefold() for cell in row] == header}
    above = {i - 1 for i in again if i > 1 and _used(sheet.records[i - 1]) == 1}
    dashes = {i for i, row in enumerate(sheet.records) if all(re.fullmatch(":?-{2,}:?|", cell) for cell in row)}
    return _without(sheet, again | above | dashes, "repeated headers and lines of dashes are left out")


def without_remarks(sheet: Sheet) -> Sheet:
    """Leave out lines of text below the table."""
    records = sheet.records
    last = len(records)
    while _usual_width(sheet) > 2 < last and _used(records[last - 1]) == 1 and _REMARK.fullmatch(records[last - 1][0]):
        last -= 1
    return _without(sheet, {*range(last, len(records))}, "lines below the table are left out")


def without_survey_rows(sheet: Sheet) -> Sheet:
    """Leave out the rows of questions and of import codes that Qualtrics writes below the header."""
    records = sheet.records
    codes = next((i for i in (1, 2) if sum('"ImportId"' in cell for cell in [*records, [], [], []][i]) > 1), None)
    questions = records[1] if codes != 1 and len(records) > 1 else []
    stems = Counter(text.rpartition(" - ")[0] for text in questions if " - " in text)
    if codes is None and max(stems.values(), default=0) < 2:
        return sheet
    titles, codes = list(records[0]), codes or 1
    for j, text in enumerate(questions[: len(titles)]):
        stem, _, option = text.rpartition(" - ")
        if option and stems[stem] > 1 and re.fullmatch(r"Q?[0-9]+(?:[._#][0-9A-Za-z]+)*", titles[j]):
            titles[j] = option
    left = {*range(1, codes + 1)}
    sheet = _without(sheet, left, "rows of questions and import codes below the header are left out")
    return replace(sheet, records=[titles, *sheet.body])


def with_one_row_of_titles(sheet: Sheet) -> Sheet:
    """Join the rows of titles: groups above the titles, units or loads below them."""
    for joined in (_with_groups, _with_units, _with_loads):
        if len(sheet.records) < 3:
            return sheet
        width = max(len(sheet.records[0]), len(sheet.records[1]))
        titles, second = ([*row, *[""] * (width - len(row))] for row in sheet.records[:2])
        if joined is not _with_groups:
            # a title that is merged over both rows stands in each
            second = ["" if b and key(a) == key(b) else b for a, b in zip(titles, second, strict=True)]
        if found := joined(titles, second, sheet.records[2:8]):
            records, lines = [found[0], *sheet.records[2:]], [sheet.lines[0], *sheet.lines[2:]]
            sheet = sheet.noted(found[1], records=records, lines=lines)
    return sheet


_NAMES = KNOWN_BY["participant"] | KNOWN_BY["fabric"] | KNOWN_BY["list"]
_NO_UNIT = frozenset({"-", "–", "1"})
_LIKE_A_UNIT = re.compile(
    r"(?=.{1,16}$)(?:(?=.*[/·⋅.*^²³%°])[^\W\d][\w/·⋅.*^²³%°-]*|[%°]C?|m?s|min|h|Hz|deg|rad|[ck]?m\^?[23²³])"
)
_LOAD = re.compile(r"[0-9]+(?:[.,][0-9]+)?\s*(?P<unit>[^\s0-9].*)")

Joined = tuple[list[str], str] | None
Rows = Sequence[Sequence[str]]


def _numeric(rows: Rows, j: int) -> bool:
    """Return whether a column has numbers, and nothing else but missing cells."""
    cells = [row[j] for row in rows if j < len(row)]
    return any(map(looks_numeric, cells)) and all(looks_numeric(c) or c.casefold() in MISSING for c in cells)


def _with_groups(groups: list[str], titles: list[str], below: Rows) -> Joined:
    """Return the titles below a row of groups of columns."""
    filled = [j for j, text in enumerate(titles) if text]
    without = [j for j in filled if not groups[j]]
    if len(without) < 2 or any(looks_numeric(titles[j]) or _is_load(titles[j]) for j in filled):
        return None
    if len({titles[j].casefold() for j in filled}) < len(filled) or all(
        is_unit(titles[j].strip("[]()")) for j in filled
    ):
        return None
    # numbers follow, here or below a row of units
    if not any(sum(_numeric(below[k:], j) for j in filled) * 2 > len(filled) for k in (0, 1)):
        return None
    found = [title or group for title, group in zip(titles, groups, strict=True)]
    return found, f"the first row contains groups of columns: {listing([quoted(text) for text in groups if text])}"


def _with_units(titles: list[str], units: list[str], below: Rows) -> Joined:
    """Return titles with the units below them, judged as a whole; no column of names has one."""
    filled = [j for j, text in enumerate(units) if text]
    bare = {j: units[j].strip("[]() ") for j in filled}
    named = [j for j in filled if bare[j] not in _NO_UNIT]
    if not any(is_unit(bare[j]) for j in named):
        return None
    for j in filled:
        like = is_unit(bare[j]) or _LIKE_A_UNIT.fullmatch(bare[j])
        if not (titles[j] and bag(titles[j]) not in _NAMES and like):
            return None
    if len(filled) == len(titles) and not all(_numeric(below, j) for j in named):
        return None
    # a title that has a unit already keeps it; what is below must not be another one
    found = {j: f"{titles[j]} [{bare[j]}]" for j in named if not _has(titles[j], bare[j])}
    made = listing([quoted(text) for text in found.values()]) if found else "those of the headers"
    return [found.get(j, title) for j, title in enumerate(titles)], f"the second row contains units: {made}"


def _has(title: str, unit: str) -> bool:
    """Return whether a title ends in a unit."""
    spelt = analysed(title).unit
    return spelt is not None and any(
        (one := unit_named(unit, quantity)) is not None and one == unit_named(spelt, quantity) for quantity in UNITS
    )


def _is_load(text: str) -> bool:
    match = _LOAD.fullmatch(text)
    return match is not None and any(unit_named(match["unit"], quantity) for quantity in _LOADS)


def _with_loads(titles: list[str], second: list[str], below: Rows) -> Joined:
    """Return titles of fabrics under loads, of which the upper ones stand once before several, as in merged cells."""
    for upper in (second, titles):
        loaded = [j for j, text in enumerate(upper) if _is_load(text)]
        if len(loaded) > 1:
            break
    else:
        return None
    under = upper is titles  # fabrics below the loads
    filled = [j for j, text in enumerate(second) if text and (j >= loaded[0] if under else j in loaded)]
    measured = any(quantity_of(OWNERS.get(bag((second if under else titles)[j]), "fabric")) for j in filled)
    if measured or any(titles[j] for j, text in enumerate(second) if text and j not in filled):
        return None
    found, carried = list(titles), ""
    for j in range(len(titles)):
        if j in filled:
            carried = titles[j] or carried
            if not carried:
                return None
            found[j] = f"{second[j]} @ {carried}" if under else f"{carried} @ {second[j]}"
        else:
            found[j], carried = titles[j] or second[j], ""
    return (
        found,
        f"{'the first' if under else 'the second'} row contains loads: {listing([quoted(found[j]) for j in filled])}",
    )


# columns, where the header is known


def _column(sheet: Sheet, j: int) -> list[str]:
    return [row[j] for row in sheet.body]


def _with_column(sheet: Sheet, j: int, cells: Sequence[str], note: str) -> Sheet:
    """Return a sheet with other cells in a column."""
    body = [[*row[:j], cell, *row[j + 1 :]] for row, cell in zip(sheet.body, cells, strict=True)]
    return sheet.noted(note, records=[sheet.header, *body])


def with_json_cells(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Read cells such as {"Q0": "28.5"}, which hold the answers of a trial in jsPsych; several become columns."""
    for j, title in enumerate(sheet.header):
        cells = _column(sheet, j)
        if not any(cell.startswith("{") for cell in cells):
            continue
        objects = [_object(cell) for cell in cells]
        names = [*dict.fromkeys(name for one in objects for name in one)]
        if not names or any(cell and not one for cell, one in zip(cells, objects, strict=True)):
            continue
        texts = [["" if one.get(name) is None else str(one[name]) for name in names] for one in objects]
        note = f"column {quoted(title)}: its cells are JSON, of which {listing([repr(name) for name in names])} is read"
        if len(names) == 1:
            sheet = _with_column(sheet, j, [own[0] for own in texts], note)
        elif not {name.casefold() for name in names} & {text.casefold() for text in sheet.header}:
            body = ([*row, *own] for row, own in zip(sheet.body, texts, strict=True))
            sheet = sheet.noted(note, records=[[*sheet.header, *names], *body])
    return sheet


def _object(cell: str) -> dict[str, object]:
    """Return the JSON object in a cell, empty if it has none."""
    try:
        found = parse_json(cell) if cell.startswith("{") else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


_WITH_UNIT = re.compile(r"([+-]?[0-9]+(?:\.[0-9]+|,[0-9]{1,2})?(?:[eE][+-]?[0-9]+)?)\s*([^\s0-9.,+-].*)")


def with_units_of_cells(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Read cells such as 2 mm, or 2 beside a column of units, in the unit of the column."""
    titles = list(sheet.header)
    columns = [_column(sheet, j) for j in range(len(titles))]
    found: list[str] = []
    for j, title in enumerate(header.titles):
        name = next((OWNERS[words] for words in title.bags if words in OWNERS), "")
        quantity = quantity_of(name) if name in request.kind.columns else ""
        if quantity in ("", "ratio"):
            continue
        cells, beside = columns[j], columns[j + 1] if j + 1 < len(titles) else []
        if beside and _UNIT_WORDS & {*key(titles[j + 1]).split()} and all(unit_named(u, quantity) for u in beside):
            cells = [
                f"{cell} {unit}" if looks_numeric(cell) else cell for cell, unit in zip(cells, beside, strict=True)
            ]
        told = [_WITH_UNIT.fullmatch(cell) for cell in cells]
        units = [unit_named(match[2], quantity) if match else None for match in told]
        if not any(units) or any(not u and c.casefold() not in MISSING for u, c in zip(units, cells, strict=True)):
            continue
        own = unit_named(NUMBERS[name].unit, quantity)
        assert own is not None
        columns[j] = [
            SheetNumber(f"{Decimal(match[1].replace(',', '.')) * unit.factor / own.factor:f}") if match and unit else ""
            for match, unit in zip(told, units, strict=True)
        ]
        found.append(quoted(titles[j]))
        titles[j] = titles[j] if titles[j].casefold() == name else f"{title.stem} [{own.name}]"
    note = f"units are read in the cells of column {listing(found)}"
    return sheet.noted(note, records=[titles, *map(list, zip(*columns, strict=True))]) if found else sheet


_UNIT_WORDS = frozenset({"unit", "units", "einheit", "unité", "unidad", "単位"})

_WITH_ERROR = re.compile(
    r"([+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*\(?\s*(?:±|\+/-|\+-)\s*[0-9.,]+(?:[eE][+-]?[0-9]+)?\s*\)?"
)


def with_values_alone(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Read the value of cells such as 0.030 ± 0.003."""
    for j, title in enumerate(sheet.header):
        found = [_WITH_ERROR.fullmatch(cell) for cell in _column(sheet, j)]
        if any(found):
            texts = [match[1] if match else row[j] for match, row in zip(found, sheet.body, strict=True)]
            note = "the numbers behind ± are not used; if they are standard errors, write them in a column of their own"
            sheet = _with_column(sheet, j, texts, f"column {quoted(title)}: {note}, such as bending_rigidity_sd_n_m")
    return sheet


def with_a_title_of_names(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Take a first column of names without a title as the fabrics."""
    names = _column(sheet, 0)
    if sheet.header[0] or "fabric" in header.at or len({*names}) < len(names) or any(map(looks_numeric, names)):
        return sheet
    note = "the first column has no title and is read as fabric"
    return sheet.noted(note, records=[["fabric", *sheet.header[1:]], *sheet.body])


class _Part(NamedTuple):
    """A column of values: its index, and the cells that its rows get, by title."""

    j: int
    cells: Mapping[str, str]


def _melted(sheet: Sheet, parts: Sequence[_Part], value: str, note: str) -> Sheet:
    """Return one row for each value in some columns, in the order of the rows, then of the columns."""
    melted = {part.j for part in parts}
    kept = [j for j in range(len(sheet.header)) if j not in melted]
    names = [*dict.fromkeys(name for part in parts for name in part.cells)]
    titles = [sheet.header[part.j] for part in parts]
    body = [
        [*(row[j] for j in kept), *(part.cells.get(name, "") for name in names), row[part.j]]
        for row in sheet.body
        for part in parts
    ]
    return sheet.noted(
        f"{note}: {listing(titles)}",
        records=[[*(sheet.header[j] for j in kept), *names, value], *body],
        lines=[sheet.lines[0], *(line for line in sheet.lines[1:] for _ in parts)],
        columns=titles * len(sheet.body),
        made=(*names, value),
    )


def _apart(stem: str) -> str:
    """Return the words of a title, with the number of a direction apart from its symbol, as in B1."""
    return re.sub(r"(?<=[^\W\d])(?=[12]\b)", " ", key(stem))


def with_directions_in_rows(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Return one row for each direction of a fabric if two columns are one property along warp and weft."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    for j in header.free:
        title = header.titles[j]
        words = _apart(title.stem).split()
        told = {DIRECTIONS[word] for word in words if word in DIRECTIONS}
        rest = " ".join(word for word in words if word not in DIRECTIONS)
        if len(told) == 1 and rest:
            found.setdefault((rest, title.unit or ""), {}).setdefault(told.pop(), j)
    properties = ("bending_rigidity_n_m", "tensile_modulus_mpa", "effective_modulus_kpa")
    for (stem, unit), both in found.items():
        meant = (name for name in properties if name not in header.at and bag(stem) in KNOWN_BY[name])
        column = next(meant, None)
        if len(both) == 2 and column is not None and (unit or len(stem) > 1):
            bare = stem.upper() if len(stem) == 1 else stem
            parts = [_Part(j, {"direction": direction}) for direction, j in both.items()]
            value = f"{bare} [{unit}]" if unit else bare
            return _melted(sheet, parts, value, f"columns of two directions are read as {column}")
    return sheet


_CHOSEN = frozenset(
    {"chosen", "choice", "selected", "softer", "chosen stimulus", "answer", "response", "key resp keys"}
)
_SIDES = (("left", "right"), ("first", "second"), ("a", "b"), ("1", "2"))


def with_choices_as_pairs(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Read columns such as stim_left, stim_right and chosen as pairs of fabrics, with 1 where the first was chosen."""
    words = [key(title).split() for title in sheet.header]
    chosen = [j for j, own in enumerate(words) if " ".join(own) in _CHOSEN]
    if len(chosen) != 1 or {"rating", "fabric"} & header.at.keys():
        return sheet
    for sides in _SIDES:
        stems = [
            {" ".join(w for w in own if w != side): j for j, own in enumerate(words) if side in own} for side in sides
        ]
        for stem in stems[0].keys() & stems[1].keys():
            first, second = stems[0][stem], stems[1][stem]
            answers = [_answer(row[chosen[0]], row[first], row[second], sides) for row in sheet.body]
            if None in answers or not any(answers):
                continue
            titles = {first: "fabric", second: SECOND_FABRIC, chosen[0]: RATING.name}
            what = [quoted(sheet.header[j]) for j in titles]
            note = f"columns {what[0]}, {what[1]} are pairs of fabrics, of which {what[2]} names the softer one"
            sheet = _with_column(sheet, chosen[0], [text or "" for text in answers], note)
            return replace(sheet, records=[[titles.get(j, t) for j, t in enumerate(sheet.header)], *sheet.body])
    return sheet


def _answer(cell: str, first: str, second: str, sides: tuple[str, str]) -> str | None:
    """Return 1 for a choice of the first fabric, 0 for one of the second, nothing if missing; None if it is neither."""
    if cell.casefold() in MISSING:
        return ""
    texts = ((first, "1"), (second, "0"), (sides[0], "1"), (sides[1], "0"))
    return next((answer for text, answer in texts if cell.casefold() == text.casefold()), None)


_PERSON = re.compile(r"(?:p|s|vp|pp|subj|sub|ppt|ss|judge|panelist|assessor|rater|person|participant|subject|観察者)")


def with_people_in_rows(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Return one row for each rating of a table with one column for each participant, such as P01 or judge 2."""
    if "fabric" not in header.at or {"participant", "rating"} & header.at.keys():
        return sheet
    named, numbered = [], []
    for j in header.free:
        title, cells = sheet.header[j], [cell for cell in _column(sheet, j) if cell.casefold() not in MISSING]
        if 2 * sum(map(looks_numeric, cells)) <= len(cells):
            continue  # a cell that is no number is a fault of its person
        stem = re.fullmatch(r"(.*?)[\s_.#-]*[0-9]{1,4}(?:\.0+)?", title)
        if looks_numeric(title):
            numbered.append(j)
        elif stem and (_PERSON.fullmatch(stem[1].casefold()) or bag(stem[1]) in KNOWN_BY["participant"]):
            named.append(j)
    people = [_Part(j, {"participant": sheet.header[j]}) for j in sorted(named + numbered)] if named else []
    return _melted(sheet, people, RATING.name, "one column per participant") if len(people) > 1 else sheet


_LOADED = re.compile(
    r"(?P<fabric>.*?\S)[\s@_,;/|([-]+(?P<number>[0-9]+(?:\.[0-9]+|,[0-9]{1,2})?)[\s_]*"
    r"(?P<unit>mm|[uµμ]m|cm|N|mN|cN|gf)\s*[)\]]?",
    re.IGNORECASE,
)
_LOADS = {"length": INDENTATION, "force": FORCE}
_ASKED = re.compile(r".*(?:\[(?P<in>[^\[\]]+)\]|\s[-–—:>]+\s(?P<behind>.+))")


class _Rated(NamedTuple):
    """A column of ratings: its index, fabric, and load in its title, if there is one."""

    j: int
    fabric: str
    load: tuple[Column, str] | None


def with_fabrics_in_rows(sheet: Sheet, header: Header, request: Request) -> Sheet:
    """Return a wide sheet with one row for each rating, any other as it is.

    A table is wide if the user says so, or if it has no column of ratings or fabrics and at least two titles are
    fabrics, as in `cotton`, fabrics under loads, as in `cotton @ 2 mm`, `cotton_2mm` or `cotton_1N`, or end in a known
    fabric, as in `How soft is it? [cotton]`.

    Raises
    ------
    InputError
        If a table that is called wide is none, or a title may be a misspelt fabric.
    """
    if long := [name for name in ("fabric", RATING.name) if name in header.at]:
        if request.wide:
            raise InputError(
                f"{sheet.titled}: --wide expects a table with one column per fabric; this one has a column "
                f"{quoted(sheet.header[header.at[long[0]]])} for the {long[0]} of each row"
            )
        return sheet
    rated = _rated(sheet, header.free, request)
    loaded = [sheet.header[one.j] for one in rated if one.load is not None]
    for column in _LOADS.values():
        if loaded and column.name in header.at:
            filed = quoted(sheet.header[header.at[column.name]])
            raise InputError(
                f"{sheet.titled}: loads are in headers ({quoted(loaded[0])}) and in {filed}, expected only one of these"
            )
    parts = []
    for one in rated:
        load = {one.load[0].name: SheetNumber(one.load[1])} if one.load else {}
        parts.append(_Part(one.j, {"fabric": one.fabric, **load}))
    what = f"one column per fabric{' and load' if loaded else ''}"
    return _melted(sheet, parts, RATING.name, what) if parts else sheet


def _rated(sheet: Sheet, free: Sequence[int], request: Request) -> list[_Rated]:
    """Return the columns of ratings, none if the table is not wide."""
    known = request.fabrics()
    spelt = {identity(name): name for name in known or ()}
    found: list[_Rated] = []
    strange: list[tuple[str, str]] = []
    for j in free:
        title = sheet.header[j]
        name, load = _fabric_and_load(title)
        asked = _ASKED.fullmatch(title)
        option = (asked["in"] or asked["behind"]).strip() if asked else ""
        if identity(title) in spelt:
            found.append(_Rated(j, spelt[identity(title)], None))
        elif load is not None and (known is None or identity(name) in spelt):
            found.append(_Rated(j, spelt.get(identity(name), name), load))
        elif option and identity(option) in spelt:
            found.append(_Rated(j, spelt[identity(option)], None))
        elif summarises(name):
            continue
        elif known is None and request.wide:
            found.append(_Rated(j, title, None))
        elif known is not None:
            strange.append((title, name))
    if not request.wide and len(found) < 2:
        return []
    twice: dict[tuple[str, object], int] = {}
    for column in found:
        first = twice.setdefault((column.fabric, column.load), column.j)
        if first != column.j:
            both = " and ".join(quoted(sheet.header[j]) for j in (first, column.j))
            raise InputError(f"{sheet.titled}: columns {both} are both fabric {quoted(column.fabric)}, expected one")
    absent = sorted({*(known or ())} - {column.fabric for column in found})
    for k, (title, name) in enumerate(strange):
        near = guess(name, absent) if k < MOST_ASKED else ""
        if near or name != title:
            raise InputError(f"{sheet.titled}, column {quoted(title)}: {quoted(name)} is not a known fabric{near}")
    if not found:
        raise InputError(f"{sheet.titled}: no column has the name of a fabric, such as {listing(absent, 3)}")
    return found


def _fabric_and_load(title: str) -> tuple[str, tuple[Column, str] | None]:
    """Return the fabric in a title, and the column and text of its load, if there is one."""
    match = _LOADED.fullmatch(title) if len(title) <= LONGEST_TITLE else None
    for quantity, column in _LOADS.items() if match else ():
        if match and (unit := unit_named(match["unit"], quantity)):
            try:
                value = column.parse(match["number"].replace(",", "."), unit)
            except ValueError:
                break
            return match["fabric"], (column, column.write(value))
    return title, None
