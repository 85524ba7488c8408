"""Odd contents of tables: rows of statistics, one name in several spellings, copies, forces on the way back."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from softness_bayes.data.columns import (
    FORCE,
    INDENTATION,
    LOAD_CV,
    MISSING,
    PERHAPS_SUMMARIES,
    RATING,
    RESOLUTION,
    SECOND_FABRIC,
    is_reversed,
    looks_numeric,
    reversed_remark,
    summarises,
)
from softness_bayes.data.faults import DIFFERENCE, identity, listing, natural, shown_names
from softness_bayes.data.headers import holds_cells
from softness_bayes.data.sheets import SheetNumber
from softness_bayes.data.tables import FloatArray, Table
from softness_bayes.data.titles import key
from softness_bayes.errors import quoted
from softness_bayes.readable import counted

_DESIGN = ("fabric", SECOND_FABRIC, INDENTATION.name, FORCE.name, "session", "trial", "list")
"""Columns that say what was touched."""


def without_namesakes(table: Table) -> Table:
    """Pass over a column `resolution` without numbers; say if one with numbers, or a column `load_cv`, is used.

    `load_cv` is a name of this program's own, so that cells without numbers are errors of its values.
    """
    for column in (RESOLUTION, LOAD_CV):
        name = column.name
        if name not in table:
            continue
        title = table.titles[name]
        filled = [text for text in table.cells[name] if text.casefold() not in MISSING]
        if column is RESOLUTION and filled and not any(looks_numeric(text.rstrip("% ")) for text in filled):
            cells = {other: texts for other, texts in table.cells.items() if other != name}
            titles = {other: text for other, text in table.titles.items() if other != name}
            others = {**table.others, title: table.cells[name]}
            note = f"column {quoted(title)} is not used: its cells, such as {quoted(filled[0])}, are not numbers"
            table = table.noted(note, cells=cells, titles=titles, others=others)
        elif filled:
            table = table.noted(f"column {quoted(title)} is used: {column.label}")
    return table


def with_percentages(table: Table) -> Table:
    """Read ratings that are all percentages as the numbers before the sign."""
    texts = table.cells.get(RATING.name, ())
    filled = [text for text in texts if text.casefold() not in MISSING]
    if len(filled) < 2 or not all(text.endswith("%") for text in filled):
        return table
    cells = [type(text)(text[:-1].rstrip()) if text.endswith("%") else text for text in texts]
    note = f"column {quoted(table.titles[RATING.name])}: ratings are percentages, so {filled[0]} is read as {cells[0]}"
    return table.with_cells(RATING.name, cells, note)


_PRACTICE = re.compile("practi[cs]e( trials?)?|training|warm ?up|übung(sdurchgang)?|entraînement|練習")


def without_practice(table: Table) -> Table:
    """Leave out rows that a column of sessions or trials, or an unused one, calls practice."""
    numbered = {table.titles[name]: table.cells[name] for name in ("session", "trial") if name in table}
    for title, texts in {**numbered, **table.others}.items():
        left = [i for i, text in enumerate(texts) if _PRACTICE.fullmatch(key(text))]
        if 0 < len(left) < len(table):
            return table.without(left, f"practice by column {quoted(title)}, left out")
    return table


def with_reversed_scales_named(table: Table) -> Table:
    """Say that ratings look like those of hardness: higher ones must mean softer."""
    title = table.titles.get(RATING.name, "")
    return table.noted(f"looks wrong: {reversed_remark(title)}") if is_reversed(title) else table


# rows of statistics


_STATISTICS: Mapping[str, Callable[[FloatArray], float]] = {
    "mean": lambda x: float(np.mean(x)),
    "standard deviation": lambda x: float(np.std(x, ddof=1)) if x.size > 1 else np.nan,
    "sum": lambda x: float(np.sum(x)),
    "geometric mean": lambda x: float(np.exp(np.mean(np.log(x)))) if (x > 0).all() else np.nan,
    "standard error": lambda x: float(np.std(x, ddof=1) / np.sqrt(x.size)) if x.size > 1 else np.nan,
    "standard deviation of all": lambda x: float(np.std(x)),
    "median": lambda x: float(np.median(x)),
    "smallest": lambda x: float(np.min(x)),
    "largest": lambda x: float(np.max(x)),
    "number": lambda x: float(x.size),
}
_TELLING = 5
"""Number of the first statistics that no person's numbers are by chance."""
_CHANCE = 1e-5
"""Largest probability at which numbers are those of a statistic by chance."""


def without_statistics(table: Table) -> Table:
    """Leave out rows that are statistics of other rows: by their names, or by all of their numbers."""
    for name in ("participant", "fabric"):
        left = [i for i, text in enumerate(table.cells.get(name, ())) if summarises(text)]
        if 0 < len(left) < len(table):
            told = listing([quoted(text) for text in dict.fromkeys(table.cells[name][i] for i in left)])
            table = table.without(left, f"statistics of other rows ({name} {told}), left out")
    if not {"participant", RATING.name} <= table.cells.keys():
        return table
    names, values = np.array(table.cells["participant"]), table.plainly(RATING.name)
    keys, people = table.keys(*_DESIGN), [*dict.fromkeys(names.tolist())]
    unlikely = {RATING.name, "participant", SECOND_FABRIC} <= table.cells.keys() or len(people) < 4
    found: dict[str, str] = {}
    for who in [] if unlikely else reversed(people):
        others = ~np.isin(names, [who, *found])
        what = _statistic(names == who, others, keys, values, table.cells[RATING.name])
        perhaps = key(who) in PERHAPS_SUMMARIES
        if what and (not who or perhaps):
            found[who] = what
        elif what in [*_STATISTICS][:_TELLING]:
            table.faults.add_general(
                f"all ratings of participant {quoted(who)} are the {what} of those of the others: remove these rows, "
                "or name them 'mean', if they are statistics"
            )
    if not found:
        return table
    told = listing([f"{quoted(who)} is the {what}" for who, what in found.items()])
    rows = np.flatnonzero(np.isin(names, [*found])).tolist()
    return table.without(rows, f"statistics of the other participants' ratings ({told}), left out")


def _statistic(
    own: np.ndarray, others: np.ndarray, keys: Sequence[tuple[str, ...]], values: FloatArray, texts: Sequence[str]
) -> str:
    """Return the statistic of the others' numbers that a participant's numbers are, empty if they are none."""
    by_key: dict[tuple[str, ...], list[float]] = {}
    for i in np.flatnonzero(others & ~np.isnan(values)).tolist():
        by_key.setdefault(keys[i], []).append(values[i])
    mine = [i for i in np.flatnonzero(own & ~np.isnan(values)).tolist() if len(by_key.get(keys[i], ())) > 1]
    if len(mine) < 3:
        return ""
    pools = {keys[i]: np.array(by_key[keys[i]]) for i in mine}
    decimals = [len(re.split(r"[.,]", re.split("[eE]", texts[i])[0] + ".")[1]) for i in mine]
    error = np.array([max(0.51 * 10.0**-k, 1e-9 * abs(values[i])) for i, k in zip(mine, decimals, strict=True)])
    spread = np.array([np.ptp(pools[keys[i]]) for i in mine])
    if (spread == 0).any() or np.prod(np.minimum(1.0, 4.0 * error / spread)) > _CHANCE:
        return ""
    for name, statistic in _STATISTICS.items():
        if all(abs(values[i] - statistic(pools[keys[i]])) <= e for i, e in zip(mine, error.tolist(), strict=True)):
            return name
    return ""


# names


def with_one_spelling(table: Table) -> Table:
    """Join names that differ in case, zeros in front, format of numbers or punctuation only, unless they may be two.

    They may be two if both have a row of the same fabric, load and trial, and differ in more than the format of a
    number.
    """
    for columns in (("participant",), ("fabric", SECOND_FABRIC)):
        present = [name for name in columns if name in table]
        count = Counter(text for name in present for text in table.cells[name] if text)
        groups: dict[tuple[str, ...], list[str]] = {}
        for text in natural(count):
            groups.setdefault(identity(text), []).append(text)
        several = [group for group in groups.values() if len(group) > 1]
        if not several:
            continue
        kept = {text: _chosen(group, count) for group in several for text in group}
        cells = {name: [kept.get(text, text) for text in table.cells[name]] for name in present}
        joined = replace(table, cells={**table.cells, **cells})
        told = [shown_names(group) for group in several]
        if apart := _may_be_two(table, joined, present[0], several):
            table.faults.add_general(
                f"column {table.titles[present[0]]!r}: {shown_names(apart)} differ only in {DIFFERENCE}, and have rows "
                "of their own for the same touch: write them alike, or give them names that differ in more"
            )
            continue
        table = joined.noted(f"column {table.titles[present[0]]!r}: {listing(told)} are read as the same")
    return table


def _chosen(group: Sequence[str], count: Mapping[str, int]) -> str:
    """Return the spelling of a name that is kept: the most frequent one, the shortest of several."""
    return min(group, key=lambda text: (-count[text], len(text)) if not looks_numeric(text) else (0, len(text)))


def _may_be_two(table: Table, joined: Table, name: str, groups: Sequence[Sequence[str]]) -> Sequence[str]:
    """Return the spellings of a name that may belong to two people or fabrics, empty if there are none."""
    names = ("participant", *_DESIGN) if RATING.name in table else ("participant", "indentor", *_DESIGN, "direction")
    keys, rows = joined.keys(*names), table.cells[name]
    told: dict[tuple[str, ...], set[str]] = {}
    for text, one in zip(rows, keys, strict=True):
        told.setdefault(one, set()).add(text)
    both = [spellings for spellings in told.values() if len(spellings) > 1]
    for group in groups:
        formats = {text.lstrip("0") or "0" for text in group}
        same = all(looks_numeric(text) for text in group) and len(formats) == len(group)
        if not same and any(len(spellings & {*group}) > 1 for spellings in both):
            return group
    return ()


_DAY = re.compile(r"[12][0-9]{3}-[01][0-9]-[0-3][0-9]")


def with_dates_named(table: Table) -> Table:
    """Say that names are dates, which a spreadsheet program may have made of them."""
    for name in ("participant", "fabric"):
        days = [text for text in dict.fromkeys(table.cells.get(name, ())) if _DAY.fullmatch(text)]
        if days:
            table = table.noted(
                f"column {table.titles[name]!r}: {listing(days, 3)} are dates: did a spreadsheet program turn names "
                "into dates?",
            )
    return table


def with_people_known(table: Table) -> Table:
    """Refuse rows of one fabric and load that repeat, where an unused column tells them apart as people would."""
    people = {*table.cells.get("participant", ())}
    measured = {RATING.name, FORCE.name} & table.cells.keys()
    if len(people) > 1 or holds_cells(table.cells) or len(table) < 2 or not measured:
        return table
    keys = table.keys(*_DESIGN)
    repeats = len(keys) - len({*keys})
    ranked = []
    for title, texts in table.others.items() if repeats else ():
        each, pairs = Counter(texts), {*zip(keys, texts, strict=True)}
        telling = len(keys) - len(pairs) <= repeats / 20
        crossed = len(pairs) >= 0.8 * len(each) * len({*keys})  # every value with nearly every touch
        if 1 < len(each) <= len(keys) / 2 and len(each.keys() - {""}) > 1 and (telling or crossed):
            ranked.append((-len(pairs), title))
    if apart := [title for _, title in sorted(ranked)]:
        what = "no column 'participant'" if not people else f"one participant, {quoted(next(iter(people)))}"
        said = ", ".join(quoted(title) for title in apart[:3])
        table.faults.add_general(
            f"{what}, but {counted(repeats, 'row repeats', 'rows repeat')} a fabric and load, and column {said} tells "
            f"them apart: is it the participant? If it numbers repeats of one person, add --column "
            f"trial={quoted(apart[0])}",
            [{"participant": title} for title in apart[:3]],
        )
        table.check()
    return table


# copies

BY_CHANCE = 1e-4
"""Largest probability at which equal rows are repeats of a rater by chance, not copies."""


def without_copies(table: Table) -> Table:
    """Leave out rows that are equal to another one, trial included; refuse copied blocks that no trial tells apart.

    People repeat themselves on coarse scales. So without trials rows count as copies only if a block of consecutive
    rows, or every row, is there again, and the numbers would hardly be equal by chance.
    """
    if RATING.name not in table or holds_cells(table.cells) or SECOND_FABRIC in table:
        return table
    others = [texts for title, texts in table.others.items() if title != "sheet"]  # sheets may be copies of each other
    every = [*zip(*table.cells.values(), *others, strict=True)]
    first: dict[tuple[str, ...], int] = {}
    copies = [i for i, row in enumerate(every) if first.setdefault(row, i) != i and table.cells[RATING.name][i]]
    if not copies or len(first) < 2:
        return table
    touches = table.keys("participant", *_DESIGN)
    complete = len(copies) == len(touches) - len({*touches}) or min(Counter(every).values()) > 1
    trials = {*table.cells.get("trial", ())}
    if len(trials) > 1 or (trials and complete):
        return table.without(copies, "copies of other rows, with the same trial, left out")
    chances = dict(zip(copies, _chances_of_equal(table, copies, [*first.values()]), strict=True))
    blocks, last = [1.0], -2
    for i in copies:
        follows = last == i - 1 and first[every[i]] == first[every[i - 1]] + 1
        blocks.append((blocks[-1] if follows else 1.0) * chances[i])
        last = i
    equal = table.lines(copies)
    if min(blocks) > BY_CHANCE and not (complete and np.prod([*chances.values()]) < BY_CHANCE):
        return table.noted(f"{equal}: equal to another row in all columns: are rows copied?")
    table.faults.add_general(
        f"{counted(len(copies), 'row is a copy', 'rows are copies')} of other rows ({equal}): remove them; or, if they "
        "are further trials, number these in a column 'trial'"
    )
    table.check()
    return table


def _chances_of_equal(table: Table, rows: Sequence[int], distinct: Sequence[int]) -> FloatArray:
    """Return the probability, roughly, that a rating is given again for the same touch.

    It is that of an error of 30 % that rounding hides, or four times that of two equal ratings of different touches,
    if this is larger; and at most 0.6, as on a scale of a few categories.
    """
    people = table.cells.get("participant", [""] * len(table))
    texts = [text.replace(",", ".") for text in table.cells[RATING.name]]
    values = np.nan_to_num(np.abs(table.plainly(RATING.name)))
    by: dict[str, Counter[str]] = {}
    for k in distinct:
        by.setdefault(people[k], Counter())[texts[k]] += 1
    alike = {}
    for who, own in by.items():
        pairs = own.total() * (own.total() - 1)
        alike[who] = sum(n * (n - 1) for n in own.values()) / pairs if pairs else 0.0
    found = []
    for i in rows:
        decimals = len((re.split("[eE]", texts[i])[0] + ".").split(".")[1])
        rounding = 10.0**-decimals / (0.75 * values[i]) if values[i] else 1.0
        found.append(min(0.6, max(rounding, 1e-3 if decimals else 0.1, 4.0 * alike[people[i]])))
    return np.array(found)


def with_true_steps(table: Table) -> Table:
    """Refuse a column `resolution` of which ratings are no multiples: it has another meaning."""
    steps, values = table.plainly(RESOLUTION.name), table.plainly(RATING.name)
    with np.errstate(all="ignore"):
        ratio = values / steps
        off = np.flatnonzero((steps > 0) & (np.abs(ratio - np.round(ratio)) > 1e-6 * np.maximum(1.0, np.abs(ratio))))
    if off.size:
        i, title = int(off[0]), table.titles[RESOLUTION.name]
        rating, step = (table.cells[name][i] for name in (RATING.name, RESOLUTION.name))
        table.faults.add_general(
            f"column {quoted(title)}, read as the {RESOLUTION.label}: the rating {rating} in row {table.rows[i]} is no "
            f"multiple of {step}; rename the column if it is something else, such as that of a screen"
        )
    return table


# forces of a plate


def with_signs_of_pressing(table: Table) -> Table:
    """Reverse forces or indentations that are negative throughout, but for noise."""
    for column in (INDENTATION, FORCE):
        values = table.plainly(column.name)
        known = values[~np.isnan(values)]
        if known.size > 2 and known.max() <= 0.02 * -known.min():
            cells = [_reversed(text) for text in table.cells[column.name]]
            note = f"column {quoted(table.titles[column.name])}: values are negative, and read with the sign reversed"
            table = table.with_cells(column.name, cells, note)
    return table


def _reversed(text: str) -> str:
    other = text[1:] if text.startswith("-") else f"-{text}" if looks_numeric(text) else text
    return SheetNumber(other) if isinstance(text, SheetNumber) else other


def without_noise(table: Table) -> Table:
    """Leave out forces just below zero, before the plate touches the finger."""
    force = table.plainly(FORCE.name)
    if np.isnan(force).all():
        return table
    noise = np.flatnonzero((force < 0) & (force >= -0.02 * np.nanmax(force))).tolist()
    return table.without(noise, "forces just below 0, noise before contact, left out") if noise else table


def without_unloading(table: Table) -> Table:
    """Leave out the rows on which a plate moves back after it was pressed in: forces are those of loading."""
    depth = table.plainly(INDENTATION.name)
    left: list[int] = []
    presses: dict[tuple[str, ...], list[int]] = {}
    for i, own in enumerate(table.keys("participant", "indentor")):
        if not np.isnan(depth[i]):
            presses.setdefault(own, []).append(i)
    for rows in presses.values():
        step = np.diff(depth[rows])
        usual = float(np.median(np.abs(step[step != 0]))) if (step != 0).any() else 0.0
        down = 0
        for k in range(len(step)):
            small = step[k] < 0 and -step[k] <= 5.0 * usual
            pressed = down or (k >= 3 and (step[k - 3 : k] >= 0).all())
            down = down + 1 if small and pressed else 0
            if down == 3:
                left += rows[k - 1 : k + 2]
            elif down > 3:
                left.append(rows[k + 1])
    if not left:
        return table
    return table.without(sorted(left), "the plate moves back there; only forces of pressing in are used")
