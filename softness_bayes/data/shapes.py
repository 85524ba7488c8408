"""Odd shapes of tables, each made into a header with one row for each value: remarks, title rows, wide tables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from softness_bayes.data.columns import (
    DIRECTIONS,
    FORCE,
    INDENTATION,
    LONGEST_TITLE,
    MISSING,
    RATING,
    SECOND_FABRIC,
    UNITS,
    Column,
    bag,
    is_unit,
    key,
    looks_numeric,
    summarises,
    title_and_unit,
    unit_named,
)
from softness_bayes.data.faults import Guesses, identity, listing
from softness_bayes.data.headers import Sought, keys_of, understood
from softness_bayes.data.sheets import Grid, Sheet, SheetNumber
from softness_bayes.errors import InputError, quoted
from softness_bayes.files.json_text import parse_json

# rows, before it is known which of them is the header


def _used(record: Sequence[str]) -> int:
    """Return the number of cells up to the last one that is filled."""
    return max((j + 1 for j, cell in enumerate(record) if cell), default=0)


def _usual_width(grid: Grid) -> int:
    """Return the most frequent width of the rows, the larger one of two."""
    widths = Counter(map(_used, grid.records))
    return max(widths, key=lambda width: (widths[width], width), default=0)


def _without(grid: Grid, rows: Collection[int], note: str) -> Grid:
    """Return a grid without some rows, by index."""
    kept = [i for i in range(len(grid.records)) if i not in rows]
    told = listing([quoted(" ".join(filter(None, grid.records[i]))) for i in sorted(rows)], 3)
    return replace(
        grid,
        records=[grid.records[i] for i in kept],
        lines=[grid.lines[i] for i in kept],
        notes=(*grid.notes, f"{note}: {told}"),
    )


def without_comments(grid: Grid) -> Grid:
    """Leave out lines that begin with #; a header that does so loses it."""
    width, records = _usual_width(grid), grid.records
    marked = [i for i, record in enumerate(records) if record[0].startswith("#")]
    if width < 2 or not marked:
        return grid
    above = next(i for i in range(len(records) + 1) if i not in marked)
    alone = {i for i in marked if _used(records[i]) == 1}
    header = above - 1 if above and _used(records[above - 1]) == width else None
    left = {*range(above)} - {header} | alone
    if header is not None and not any(map(looks_numeric, records[header])):
        first = records[header][0].lstrip("# ")
        grid = replace(grid, records=[[first, *r[1:]] if i == header else r for i, r in enumerate(records)])
    return _without(grid, left, "lines that begin with # are left out") if left else grid


def without_preamble(grid: Grid) -> Grid:
    """Leave out lines of one or two cells above a header of more."""
    width = _usual_width(grid)
    narrow = min(2, width - 1)
    if not grid.records or _used(grid.records[0]) > narrow:
        return grid
    for i, record in enumerate(grid.records[:50]):
        filled = [cell for cell in record if cell]
        if _used(record) >= width and len({*filled}) == len(filled) and not any(map(looks_numeric, filled)):
            return _without(grid, {*range(i)}, f"lines above the header in row {grid.lines[i]} are left out")
        if _used(record) > narrow:
            break
    return grid


_REMARK = re.compile(r"[*†‡§].*|(?:notes?|source|remark|comment|legend|anmerkung|quelle)\b.*|.{12,}\s.*", re.IGNORECASE)


def without_remarks(grid: Grid) -> Grid:
    """Leave out lines of text below the table."""
    last = len(grid.records)
    wide = _usual_width(grid) > 2
    while wide and last > 2 and _used(grid.records[last - 1]) == 1 and _REMARK.fullmatch(grid.records[last - 1][0]):
        last -= 1
    below = {*range(last, len(grid.records))}
    return _without(grid, below, "lines below the table are left out") if below else grid


def without_survey_rows(grid: Grid) -> Grid:
    """Leave out the rows of questions and of import codes that Qualtrics writes below the header."""
    codes = next((i for i in (1, 2) if sum('"ImportId"' in cell for cell in [*grid.records, [], [], []][i]) > 1), None)
    if codes is None:
        return grid
    titles = list(grid.records[0])
    questions = grid.records[1] if codes == 2 else []
    stems = Counter(text.rpartition(" - ")[0] for text in questions)
    for j, text in enumerate(questions[: len(titles)]):
        stem, _, option = text.rpartition(" - ")
        if option and stems[stem] > 1 and re.fullmatch(r"Q?[0-9]+(?:[._#][0-9A-Za-z]+)*", titles[j]):
            titles[j] = option
    grid = replace(grid, records=[titles, *grid.records[1:]])
    return _without(grid, {*range(1, codes + 1)}, "rows of questions and import codes below the header are left out")


def with_one_row_of_titles(grid: Grid) -> Grid:
    """Join the rows of titles: groups above the titles, units or loads below them."""
    for joined in (_with_groups, _with_units, _with_loads):
        if len(grid.records) < 3:
            return grid
        width = max(len(grid.records[0]), len(grid.records[1]))
        titles, second = ([*row, *[""] * (width - len(row))] for row in grid.records[:2])
        if joined is not _with_groups:
            # a title that is merged over both rows stands in each
            second = ["" if b and key(a) == key(b) else b for a, b in zip(titles, second, strict=True)]
        if found := joined(titles, second, grid.records[2:8]):
            records, lines = [found[0], *grid.records[2:]], [grid.lines[0], *grid.lines[2:]]
            notes = (*grid.notes, found[1])
            grid = replace(grid, records=records, lines=lines, notes=notes)
    return grid


_LABELS = keys_of("participant") | keys_of("fabric") | keys_of("list")
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
        if not (titles[j] and bag(titles[j]) not in _LABELS and like):
            return None
    if len(filled) == len(titles) and not all(_numeric(below, j) for j in named):
        return None
    # a title that has a unit already keeps it; what is below must not be another one
    found = {j: f"{titles[j]} [{bare[j]}]" for j in named if not _has(titles[j], bare[j])}
    made = listing([quoted(text) for text in found.values()]) if found else "those of the headers"
    return [found.get(j, title) for j, title in enumerate(titles)], f"the second row contains units: {made}"


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


def _with_loads(titles: list[str], second: list[str], below: Rows) -> Joined:
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
    return found, f"the second row contains loads: {listing([quoted(found[j]) for j in loaded])}"


# columns, where the header is known


class Form(NamedTuple):
    """The form of a table of ratings, as far as it is known."""

    wide: bool = False
    """True if the user called it wide."""
    fabrics: Callable[[], Collection[str] | None] = lambda: None
    """Returns the names of the fabrics, None where they are not known."""


class Request(NamedTuple):
    """The columns sought in a table, their names in the file, and its form."""

    sought: Sought
    renames: Mapping[str, str]
    form: Form = Form()


def _column(sheet: Sheet, j: int) -> list[str]:
    return [row[j] for row in sheet.body]


def _with_column(sheet: Sheet, j: int, cells: Sequence[str], note: str) -> Sheet:
    """Return a sheet with other cells in a column."""
    body = [[*row[:j], cell, *row[j + 1 :]] for row, cell in zip(sheet.body, cells, strict=True)]
    return replace(sheet, body=body, notes=(*sheet.notes, note))


def with_json_cells(sheet: Sheet, request: Request) -> Sheet:
    """Read cells such as {"Q0": "28.5"}, which hold the answers of a trial in jsPsych."""
    for j, title in enumerate(sheet.header):
        cells = _column(sheet, j)
        objects = [_object(cell) for cell in cells]
        found = [one for one in objects if one]
        if not found or any(cell and not one for cell, one in zip(cells, objects, strict=True)):
            continue
        if len({key for one in found for key in one}) > 1:
            continue
        name = next(iter(found[0]))
        texts = ["" if not one or one[name] is None else str(one[name]) for one in objects]
        sheet = _with_column(sheet, j, texts, f"column {quoted(title)}: its cells are JSON, of which {name!r} is read")
    return sheet


def _object(cell: str) -> dict[str, object]:
    """Return the JSON object in a cell, empty if it has none."""
    if not (cell.startswith("{") and cell.endswith("}")):
        return {}
    try:
        found = parse_json(cell)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


_WITH_ERROR = re.compile(
    r"([+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*\(?\s*(?:±|\+/-|\+-)\s*[0-9.,]+(?:[eE][+-]?[0-9]+)?\s*\)?"
)


def with_values_alone(sheet: Sheet, request: Request) -> Sheet:
    """Read the value of cells such as 0.030 ± 0.003."""
    for j, title in enumerate(sheet.header):
        found = [_WITH_ERROR.fullmatch(cell) for cell in _column(sheet, j)]
        if any(found):
            texts = [match[1] if match else row[j] for match, row in zip(found, sheet.body, strict=True)]
            note = "the numbers behind ± are not used; if they are standard errors, write them in a column of their own"
            sheet = _with_column(sheet, j, texts, f"column {quoted(title)}: {note}, such as bending_rigidity_sd_n_m")
    return sheet


def with_a_title_of_names(sheet: Sheet, request: Request) -> Sheet:
    """Take a first column of names without a title as the fabrics."""
    titled = sheet.header[0] or "fabric" in understood(sheet, request.renames, request.sought).at
    names = _column(sheet, 0)
    if titled or len({*names}) < len(names) or any(map(looks_numeric, names)):
        return sheet
    note = "the first column has no title and is read as fabric"
    return replace(sheet, header=["fabric", *sheet.header[1:]], notes=(*sheet.notes, note))


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
    places = {j: k for k, j in enumerate(kept)}
    padded = {(places[j], text): len(parts) * n for (j, text), n in sheet.padded.items() if j in places}
    return replace(
        sheet,
        header=[*(sheet.header[j] for j in kept), *names, value],
        body=body,
        rows=[line for line in sheet.rows for _ in parts],
        columns=[title for _ in sheet.rows for title in titles],
        made=(*names, value),
        padded=Counter(padded),
        notes=(*sheet.notes, f"{note}: {listing(titles)}"),
    )


def with_directions_in_rows(sheet: Sheet, request: Request) -> Sheet:
    """Return one row for each direction of a fabric if two columns are one property along warp and weft."""
    at = understood(sheet, request.renames, request.sought).at
    found: dict[tuple[str, str], dict[str, int]] = {}
    for j, title in enumerate(sheet.header):
        stem, spelt = title_and_unit(title)
        words = key(stem).split()
        told = [DIRECTIONS[word] for word in words if word in DIRECTIONS]
        rest = " ".join(word for word in words if word not in DIRECTIONS)
        if j not in at.values() and len({*told}) == 1 and rest:
            found.setdefault((rest, "" if spelt is None else spelt.text), {}).setdefault(told[0], j)
    for (stem, unit), both in found.items():
        words = re.split(r"[\s_.-]+", title_and_unit(sheet.header[min(both.values())])[0])
        bare = " ".join(word for word in words if key(word) not in DIRECTIONS)
        title = f"{bare} [{unit}]" if unit else bare
        names = [n for n in ("bending_rigidity_n_m", "tensile_modulus_mpa", "effective_modulus_kpa") if n not in at]
        column = next((name for name in names if bag(stem) in keys_of(name) and (unit or len(stem) > 1)), None)
        if len(both) == 2 and column is not None:
            parts = [_Part(j, {"direction": direction}) for direction, j in both.items()]
            return _melted(sheet, parts, title, f"columns of two directions are read as {column}")
    return sheet


_CHOSEN = frozenset(
    {"chosen", "choice", "selected", "softer", "chosen stimulus", "answer", "response", "key resp keys"}
)
_SIDES = (("left", "right"), ("first", "second"), ("a", "b"), ("1", "2"))


def with_choices_as_pairs(sheet: Sheet, request: Request) -> Sheet:
    """Read columns such as stim_left, stim_right and chosen as pairs of fabrics, with 1 where the first was chosen."""
    if {"rating", "fabric"} & understood(sheet, request.renames, request.sought).at.keys():
        return sheet
    words = {j: key(title).split() for j, title in enumerate(sheet.header)}
    chosen = [j for j, own in words.items() if " ".join(own) in _CHOSEN]
    for sides in _SIDES if len(chosen) == 1 else ():
        stems = [
            {" ".join(w for w in own if w != side): j for j, own in words.items() if side in own} for side in sides
        ]
        for stem in stems[0].keys() & stems[1].keys():
            first, second = stems[0][stem], stems[1][stem]
            answers = [_answer(row[chosen[0]], row[first], row[second], sides) for row in sheet.body]
            if None in answers or not any(answers):
                continue
            titles = {first: "fabric", second: SECOND_FABRIC, chosen[0]: RATING.name}
            what = [quoted(sheet.header[j]) for j in titles]
            note = f"columns {what[0]}, {what[1]} are pairs of fabrics, of which {what[2]} names the softer one"
            header = [titles.get(j, title) for j, title in enumerate(sheet.header)]
            return replace(_with_column(sheet, chosen[0], [text or "" for text in answers], note), header=header)
    return sheet


def _answer(cell: str, first: str, second: str, sides: tuple[str, str]) -> str | None:
    """Return 1 for a choice of the first fabric, 0 for one of the second, nothing if missing; None if it is neither."""
    if cell.casefold() in MISSING:
        return ""
    texts = ((first, "1"), (second, "0"), (sides[0], "1"), (sides[1], "0"))
    return next((answer for text, answer in texts if cell.casefold() == text.casefold()), None)


_PERSON = re.compile(r"(?:p|s|vp|pp|subj|sub|ppt|ss|judge|panelist|assessor|rater|person|participant|subject|観察者)")


def with_people_in_rows(sheet: Sheet, request: Request) -> Sheet:
    """Return one row for each rating of a table with one column for each participant, such as P01 or judge 2."""
    at = understood(sheet, request.renames, request.sought).at
    if "fabric" not in at or {"participant", "rating"} & at.keys():
        return sheet
    named, numbered = [], []
    for j, title in enumerate(sheet.header):
        if j in at.values() or not _numeric(sheet.body, j):
            continue
        stem = re.fullmatch(r"(.*?)[\s_.#-]*[0-9]{1,4}(?:\.0+)?", title)
        if looks_numeric(title):
            numbered.append(j)
        elif stem and (_PERSON.fullmatch(stem[1].casefold()) or bag(stem[1]) in keys_of("participant")):
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


def with_fabrics_in_rows(sheet: Sheet, request: Request) -> Sheet:
    """Return a wide sheet with one row for each rating, any other as it is.

    A table is wide if the user says so, or if it has no column of ratings or fabrics and at least two titles are
    fabrics, as in `cotton`, fabrics under loads, as in `cotton @ 2 mm`, `cotton_2mm` or `cotton_1N`, or end in a known
    fabric, as in `How soft is it? [cotton]`.

    Raises
    ------
    InputError
        If a table that is called wide is none, or a title may be a misspelt fabric.
    """
    form = request.form
    at = understood(sheet, request.renames, request.sought).at
    if long := [name for name in ("fabric", RATING.name) if name in at]:
        if form.wide:
            raise InputError(
                f"{sheet.titled}: --wide expects a table with one column per fabric; this one has a column "
                f"{quoted(sheet.header[at[long[0]]])} for the {long[0]} of each row"
            )
        return sheet
    others = {j: title for j, title in enumerate(sheet.header) if title and j not in at.values()}
    rated = _rated(sheet, others, form)
    if not rated:
        return sheet
    titles = [sheet.header[column.j] for column in rated]
    loaded = next((title for title, column in zip(titles, rated, strict=True) if column.load is not None), None)
    for column in _LOADS.values():
        if loaded is not None and column.name in at:
            filed = quoted(sheet.header[at[column.name]])
            raise InputError(
                f"{sheet.titled}: loads are in headers ({quoted(loaded)}) and in {filed}, expected only one of these"
            )
    parts = []
    for one in rated:
        load = {one.load[0].name: SheetNumber(one.load[1])} if one.load else {}
        parts.append(_Part(one.j, {"fabric": one.fabric, **load}))
    return _melted(sheet, parts, RATING.name, f"one column per fabric{' and load' if loaded else ''}")


def _rated(sheet: Sheet, titles: Mapping[int, str], form: Form) -> list[_Rated]:
    """Return the columns of ratings, none if the table is not wide."""
    known = form.fabrics()
    spelt = {identity(name): name for name in known or ()}
    found: list[_Rated] = []
    strange: list[tuple[str, str]] = []
    for j, title in titles.items():
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
        elif known is None and form.wide:
            found.append(_Rated(j, title, None))
        elif known is not None:
            strange.append((title, name))
    if not form.wide and len(found) < 2:
        return []
    twice: dict[tuple[str, object], int] = {}
    for column in found:
        first = twice.setdefault((column.fabric, column.load), column.j)
        if first != column.j:
            both = " and ".join(quoted(sheet.header[j]) for j in (first, column.j))
            raise InputError(f"{sheet.titled}: columns {both} are both fabric {quoted(column.fabric)}, expected one")
    absent = set(known or ()) - {column.fabric for column in found}
    guesses = Guesses(sorted(absent))
    for title, name in strange:
        near = guesses.of(name)
        if near or name != title:
            raise InputError(f"{sheet.titled}, column {quoted(title)}: {quoted(name)} is not a known fabric{near}")
    if not found:
        raise InputError(f"{sheet.titled}: no column has the name of a fabric, such as {listing(sorted(absent), 3)}")
    return found


def _fabric_and_load(title: str) -> tuple[str, tuple[Column, str] | None]:
    """Return the fabric in a title, and the column and text of its load, if there is one."""
    match = _LOADED.fullmatch(title) if len(title) <= LONGEST_TITLE else None
    if match is None:
        return title, None
    for quantity, column in _LOADS.items():
        if unit := unit_named(match["unit"], quantity):
            try:
                value = column.parse(match["number"].replace(",", "."), match["number"], unit)
            except ValueError:
                return title, None
            return match["fabric"], (column, column.write(value))
    return title, None
