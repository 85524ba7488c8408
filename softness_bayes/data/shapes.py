"""Odd shapes of tables, each made into a header with one row for each value: remarks, title rows, wide tables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from decimal import Decimal

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.files.records import parse_json
from softness_bayes.data.columns import DIRECTIONS, KNOWN_BY, NUMBERS, OWNERS, Request, quantity_of, summarises
from softness_bayes.data.sheets import Sheet
from softness_bayes.data.tables import Table
from softness_bayes.data.texts import SheetNumber, guess, identity, is_missing, listing, looks_numeric, mostly_numeric
from softness_bayes.data.titles import LONGEST_TITLE, UNITS, analysed, bag, is_unit, key, measured, unit_named

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


def with_header_first(sheet: Sheet) -> Sheet:
    """Leave out comments, and lines of one or two cells, above a header of more, which loses a # before its titles."""
    width = _usual_width(sheet)
    for i, record in enumerate(sheet.records[:50] if width > 1 else ()):
        bare = [record[0].lstrip("# ") or record[0], *record[1:]]
        filled = [cell for cell in bare if cell]
        full = _used(record) == width or (i > 0 and _used(record) > width)
        if full and (i or bare != record) and len({*filled}) == len(filled) and not any(map(looks_numeric, filled)):
            told = replace(sheet, records=[*sheet.records[:i], bare, *sheet.records[i + 1 :]])
            return _without(told, {*range(i)}, f"lines above the header in row {sheet.lines[i]} are left out")
        if _used(record) > min(2, width - 1) and not record[0].startswith("#"):
            break
    return sheet


def without_repeated_headers(sheet: Sheet) -> Sheet:
    """Leave out the header where it is repeated, with a line of one cell above it, lines of dashes, and comments."""
    rows, width = [[cell.casefold() for cell in row] for row in sheet.records], _usual_width(sheet)
    again = {i for i, row in enumerate(rows) if i and row == rows[0]}
    above = {i - 1 for i in again if i > 1 and _used(rows[i - 1]) == 1}
    dashes = {i for i, row in enumerate(rows) if all(re.fullmatch(":?-{2,}:?|", cell) for cell in row)}
    comments = {i for i, row in enumerate(rows) if row[0].startswith("#") and _used(row) == 1 < width}
    return _without(sheet, again | above | dashes | comments, "repeated headers, dashes and comments are left out")


_REMARK = re.compile(r"[*†‡§].*|(?:notes?|source|remark|comment|legend|anmerkung|quelle)\b.*|.{12,}\s.*", re.IGNORECASE)


def without_remarks(sheet: Sheet) -> Sheet:
    """Leave out lines of text below the table."""
    records, width = sheet.records, _usual_width(sheet)
    last = len(records)
    while width > 2 < last and _used(records[last - 1]) == 1 and _REMARK.fullmatch(records[last - 1][0]):
        last -= 1
    return _without(sheet, range(last, len(records)), "lines below the table are left out")


def without_survey_rows(sheet: Sheet) -> Sheet:
    """Leave out the rows of questions and of import codes that Qualtrics writes below the header."""
    records = [*sheet.records[:3], [], [], []]
    codes = next((i for i in (1, 2) if sum('"ImportId"' in cell for cell in records[i]) > 1), 0)
    titles, questions = list(records[0]), records[1] if codes != 1 else []
    stems = Counter(text.rpartition(" - ")[0] for text in questions if " - " in text)
    if not codes and max(stems.values(), default=0) < 2:
        return sheet
    for j, text in enumerate(questions[: len(titles)]):
        stem, _, option = text.rpartition(" - ")
        if option and stems[stem] > 1 and re.fullmatch(r"Q?[0-9]+(?:[._#][0-9A-Za-z]+)*", titles[j]):
            titles[j] = option
    note = "rows of questions and import codes below the header are left out"
    sheet = _without(sheet, range(1, 1 + (codes or 1)), note)
    return replace(sheet, records=[titles, *sheet.records[1:]])


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


_NO_UNIT = ("-", "–", "1")
_LIKE_A_UNIT = re.compile(
    r"(?=.{1,16}$)(?:(?=.*[/·⋅.*^²³%°])[^\W\d][\w/·⋅.*^²³%°-]*|[%°]C?|[0-9]+ ?[-–] ?[0-9]+|#"
    r"|m?s|min|h|Hz|deg|rad|[ck]?m\^?[23²³])"
)

Joined = tuple[list[str], str] | None
Rows = Sequence[Sequence[str]]


def _numeric(rows: Rows, j: int) -> bool:
    """Return whether a column has numbers, and nothing else but missing cells."""
    cells = [row[j] for row in rows if j < len(row)]
    return any(map(looks_numeric, cells)) and all(looks_numeric(cell) or is_missing(cell) for cell in cells)


def _with_groups(groups: list[str], titles: list[str], below: Rows) -> Joined:
    """Return the titles below a row of groups of columns."""
    filled = [j for j, text in enumerate(titles) if text]
    if sum(not groups[j] for j in filled) < 2 or any(looks_numeric(titles[j]) or _is_load(titles[j]) for j in filled):
        return None
    distinct = len({titles[j].casefold() for j in filled}) == len(filled)
    if not distinct or all(is_unit(titles[j].strip("[]()")) for j in filled):
        return None
    # numbers follow, here or below a row of units
    if not any(sum(_numeric(below[k:], j) for j in filled) * 2 > len(filled) for k in (0, 1)):
        return None
    found = [title or group for title, group in zip(titles, groups, strict=True)]
    return found, f"the first row contains groups of columns: {listing([quoted(text) for text in groups if text])}"


def _with_units(titles: list[str], units: list[str], below: Rows) -> Joined:
    """Return titles with the units below them, judged as a whole; no column of names has one."""
    bare = {j: text.strip("[]() ") for j, text in enumerate(units) if text}
    named = [j for j, text in bare.items() if text not in _NO_UNIT]
    names = KNOWN_BY["participant"] | KNOWN_BY["fabric"] | KNOWN_BY["list"]
    if not any(is_unit(bare[j]) for j in named) or not all(
        titles[j] and bag(titles[j]) not in names and (is_unit(text) or _LIKE_A_UNIT.fullmatch(text))
        for j, text in bare.items()
    ):
        return None
    if len(bare) == len(titles) and not all(_numeric(below, j) for j in named):
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


_LOADS = {"length": NUMBERS["indentation_mm"], "force": NUMBERS["force_n"]}


def _is_load(text: str) -> bool:
    return any(measured(text, quantity) for quantity in _LOADS)


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
    which = "the first" if under else "the second"
    return found, f"{which} row contains loads: {listing([quoted(found[j]) for j in filled])}"


# columns, of which some are known


def with_json_cells(table: Table, request: Request) -> Table:
    """Read cells such as {"Q0": "28.5"}, which hold the answers of a trial in jsPsych; several become columns."""
    for title, cells in table.cells.items():
        if not any(cell.startswith("{") for cell in cells):
            continue
        objects = [_object(cell) for cell in cells]
        names = [*dict.fromkeys(name for one in objects for name in one)]
        if not names or any(cell and not one for cell, one in zip(cells, objects, strict=True)):
            continue
        told = listing([repr(name) for name in names])
        table = table.noted(f"column {quoted(title)}: its cells are JSON, of which {told} is read")
        taken = {other.casefold() for other in table.cells}
        for name in names:
            texts = ["" if one.get(name) is None else str(one[name]) for one in objects]
            if len(names) == 1 or name.casefold() not in taken:
                table = table.with_column(title if len(names) == 1 else name, texts)
    return table


def _object(cell: str) -> dict[str, object]:
    """Return the JSON object in a cell, empty if it has none."""
    try:
        found = parse_json(cell) if cell.startswith("{") else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def with_units_of_cells(table: Table, request: Request) -> Table:
    """Read cells such as 2 mm, or 2 beside a column of units, in the unit of the column."""
    found: dict[str, str] = {}
    titles = [*table.cells]
    for title, after in zip(titles, [*titles[1:], ""], strict=True):
        name = next((OWNERS[words] for words in analysed(title).bags if words in OWNERS), "")
        quantity = quantity_of(name) if name in request.kind.columns else ""
        if quantity in ("", "ratio"):
            continue
        cells, beside = table.cells[title], table.cells[after] if after else []
        words = {"unit", "units", "einheit", "unité", "unidad", "単位"} & {*key(after).split()}
        if words and all(unit_named(unit, quantity) for unit in beside):
            pairs = zip(cells, beside, strict=True)
            cells = [f"{cell} {unit}" if looks_numeric(cell) else cell for cell, unit in pairs]
        told = [measured(cell, quantity) for cell in cells]
        own = unit_named(NUMBERS[name].unit, quantity)
        unclear = any(not one and not is_missing(cell) for one, cell in zip(told, cells, strict=True))
        if own is None or unclear or not any(told):
            continue
        texts = [SheetNumber(f"{Decimal(one[0]) * one[1].factor / own.factor:f}") if one else "" for one in told]
        table = table.with_column(title, texts)
        found[title] = title if title.casefold() == name else f"{analysed(title).stem} [{own.name}]"
    note = f"units are read in the cells of column {listing([*map(quoted, found)])}"
    return table.noted(note).retitled(found) if found else table


_ERROR = re.compile(r"([+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*\(?\s*(?:±|\+/-|\+-)\s*[0-9.,]+(?:[eE][+-]?[0-9]+)?\s*\)?")


def with_values_alone(table: Table, request: Request) -> Table:
    """Read the value of cells such as 0.030 ± 0.003."""
    for title, cells in table.cells.items():
        texts = [_ERROR.sub(r"\1", cell) if _ERROR.fullmatch(cell) else cell for cell in cells]
        if texts != [*cells]:
            table = table.with_column(
                title,
                texts,
                f"column {quoted(title)}: the numbers behind ± are not used; if they are standard errors, write "
                "them in a column of their own, such as bending_rigidity_sd_n_m",
            )
    return table


def with_a_title_of_names(table: Table, request: Request) -> Table:
    """Take a first column of names without a title as the fabrics, and in ratings of known fabrics as the people."""
    names, name = table.cells.get("", ()), "participant" if "rating" in request.kind.columns else "fabric"
    if not names or name in table or any(map(looks_numeric, names)):
        return table
    fabrics = table.texts("fabric") if "fabric" in table else names
    apart = len({*zip(names, fabrics, strict=True)}) > len({*fabrics}) and len({*names}) > 1
    if apart if name == "participant" else len({*names}) == len(names):
        return table.noted(f"the first column has no title and is read as {name}").retitled({"": name})
    return table


def with_directions_in_rows(table: Table, request: Request) -> Table:
    """Return one row for each direction of a fabric if two columns are one property along warp and weft."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for text in table.others:
        # the number of a direction may stand beside its symbol, as in B1
        words = re.sub(r"(?<=[^\W\d])(?=[12]\b)", " ", key(analysed(text).stem)).split()
        told = {DIRECTIONS[word] for word in words if word in DIRECTIONS}
        rest = " ".join(word for word in words if word not in DIRECTIONS)
        if len(told) == 1 and rest:
            found.setdefault((rest, analysed(text).unit or ""), {}).setdefault(told.pop(), text)
    properties = ("bending_rigidity_n_m", "tensile_modulus_mpa", "effective_modulus_kpa")
    for (stem, unit), both in found.items():
        column = next((name for name in properties if name not in table and bag(stem) in KNOWN_BY[name]), None)
        if len(both) == 2 and column is not None and (unit or len(stem) > 1):
            bare = stem.upper() if len(stem) == 1 else stem
            parts = [(text, {"direction": direction}) for direction, text in both.items()]
            value = f"{bare} [{unit}]" if unit else bare
            return table.melted(parts, value, f"columns of two directions are read as {column}")
    return table


_CHOSEN = frozenset(
    {"chosen", "choice", "selected", "softer", "chosen stimulus", "answer", "response", "key resp keys"}
)


def with_choices_as_pairs(table: Table, request: Request) -> Table:
    """Read columns such as stim_left, stim_right and chosen as pairs of fabrics, with 1 where the first was chosen."""
    words = {title: key(title).split() for title in table.cells if title}
    chosen = [title for title, own in words.items() if " ".join(own) in _CHOSEN]
    if len(chosen) != 1 or {"rating", "fabric"} & table.titles.keys():
        return table
    for sides in (("left", "right"), ("first", "second"), ("a", "b"), ("1", "2")):
        firsts, seconds = (
            {" ".join(w for w in own if w != side): title for title, own in words.items() if side in own}
            for side in sides
        )
        for stem in firsts.keys() & seconds.keys():
            titles = [firsts[stem], seconds[stem], chosen[0]]
            answers = []
            for first, second, cell in zip(*(table.cells[title] for title in titles), strict=True):
                meant = {sides[1]: "0", sides[0]: "1", second.casefold(): "0", first.casefold(): "1"}
                answers.append("" if is_missing(cell) else meant.get(cell.casefold()))
            if None in answers or not any(answers):
                continue
            a, b, c = map(quoted, titles)
            note = f"columns {a}, {b} are pairs of fabrics, of which {c} names the softer one"
            table = table.with_column(chosen[0], [text or "" for text in answers], note)
            return table.retitled(dict(zip(titles, ("fabric", "fabric_2", "rating"), strict=True)))
    return table


_PERSON = re.compile(r"p|s|vp|pp|subj|sub|ppt|ss|judge|panelist|assessor|rater|person|participant|subject|観察者")


def with_people_in_rows(table: Table, request: Request) -> Table:
    """Return one row for each rating of a table with one column for each participant, such as P01 or judge 2."""
    if "fabric" not in table or {"participant", "rating"} & table.titles.keys():
        return table
    # a cell that is no number is a fault of its person
    free = [title for title, cells in table.others.items() if mostly_numeric(cells)]
    stems = {title: re.fullmatch(r"(.*?)[\s_.#-]*[0-9]{1,4}(?:\.0+)?", title) for title in free}
    named = [
        title
        for title, stem in stems.items()
        if stem and (_PERSON.fullmatch(stem[1].casefold()) or bag(stem[1]) in KNOWN_BY["participant"])
    ]
    people = [(title, {"participant": title}) for title in free if title in named or looks_numeric(title)]
    return table.melted(people, "rating", "one column per participant") if named and len(people) > 1 else table


def with_fabrics_in_rows(table: Table, request: Request) -> Table:
    """Return a wide table with one row for each rating, any other as it is.

    A table is wide if the user says so, or if it has no column of ratings or fabrics and at least two titles are
    fabrics, as in `cotton`, fabrics under loads, as in `cotton @ 2 mm`, `cotton_2mm` or `cotton_1N`, or end in a known
    fabric, as in `How soft is it? [cotton]`.

    Raises
    ------
    InputError
        If two titles are one fabric under one load, or one may be a misspelt fabric.
    """
    if long := [table.titles[name] for name in ("fabric", "rating") if name in table]:
        if request.wide:
            raise InputError(
                f"{table.header}: --wide expects a table with one column per fabric; this one has a column "
                f"{quoted(long[0])}"
            )
        return table
    known = request.fabrics
    spelt = {identity(name): name for name in known or ()}
    parts: list[tuple[str, dict[str, str]]] = []
    strange: list[tuple[str, str]] = []
    for title in table.others:
        name, load = _fabric_and_load(title)
        asked = re.fullmatch(r".*(?:\[(?P<in>[^\[\]]+)\]|\s[-–—:>]+\s(?P<behind>.+))", title)
        option = (asked["in"] or asked["behind"]).strip() if asked else title
        whole = spelt.get(identity(title)) or spelt.get(identity(option))
        if whole:
            parts.append((title, {"fabric": whole}))
        elif load and (known is None or identity(name) in spelt):
            parts.append((title, {"fabric": spelt.get(identity(name), name), **load}))
        elif known is not None and not summarises(name):
            strange.append((title, name))
        elif request.wide and not summarises(name):
            parts.append((title, {"fabric": title}))
    if len(parts) < (1 if request.wide else 2):
        return table
    # programs number columns of one name: felt, felt.1
    of_fabrics = {title for title, _ in parts}
    stems = {re.sub(r"[\s_.(]+[0-9]{1,3}\)?$", "", title): title for title in table.others if title not in of_fabrics}
    for title in sorted(of_fabrics & stems.keys()):
        raise InputError(
            f"{table.header}: columns {quoted(title)} and {quoted(stems[title])} may both be of one fabric; "
            "write each rating in a row of its own, or rename the column that is something else"
        )
    first: dict[tuple[object, ...], str] = {}
    for title, own in parts:
        other = first.setdefault((*own.items(),), title)
        if other != title:
            both = f"{quoted(other)} and {quoted(title)}"
            raise InputError(f"{table.header}: columns {both} are both fabric {quoted(own['fabric'])}, expected one")
    absent = sorted({*(known or ())} - {own["fabric"] for _, own in parts})
    for k, (title, name) in enumerate(strange):
        near = guess(name, absent, k)
        if near or name != title:
            raise InputError(f"{table.header}, column {quoted(title)}: {quoted(name)} is not a known fabric{near}")
    loaded = any(len(own) > 1 for _, own in parts)
    return table.melted(parts, "rating", f"one column per fabric{' and load' if loaded else ''}")


_FABRIC_AND_LOAD = re.compile(
    r"(?P<fabric>.*?\S)[\s@_,;/|([-]+(?P<number>[0-9]+(?:\.[0-9]+|,[0-9]{1,2})?)[\s_]*"
    r"(?P<unit>mm|[uµμ]m|cm|N|mN|cN|gf)\s*[)\]]?",
    re.IGNORECASE,
)


def _fabric_and_load(title: str) -> tuple[str, dict[str, str]]:
    """Return the fabric in a title, and the number of its load by its column, if there is one."""
    match = _FABRIC_AND_LOAD.fullmatch(title) if len(title) <= LONGEST_TITLE else None
    for quantity, column in _LOADS.items() if match else ():
        if match and (unit := unit_named(match["unit"], quantity)):
            try:
                value = column.parse(match["number"].replace(",", "."), unit)
            except ValueError:
                break
            return match["fabric"], {column.name: SheetNumber(column.write(value))}
    return title, {}
