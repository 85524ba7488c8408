"""Odd contents of tables: rows of statistics, one name in several spellings, copies, forces on the way back."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from softness_bayes.base.errors import quoted
from softness_bayes.base.readable import counted
from softness_bayes.data.columns import NUMBERS, PERHAPS_SUMMARIES, SOFTNESS, holds_cells, quantity_of, summarises
from softness_bayes.data.tables import FloatArray, Table, grouped
from softness_bayes.data.texts import SheetNumber, identity, is_missing, listing, looks_numeric, natural, short
from softness_bayes.data.titles import bag, key

_DESIGN = ("fabric", "fabric_2", "indentation_mm", "force_n", "session", "trial", "list")
"""Columns that say what was touched."""


def with_percentages(table: Table) -> Table:
    """Read ratings that are all percentages as the numbers before the sign."""
    texts = table.texts("rating")
    filled = [text for text in texts if not is_missing(text)]
    if len(filled) < 2 or not all(text.endswith("%") for text in filled):
        return table
    cells = [type(text)(text[:-1].rstrip()) if text.endswith("%") else text for text in texts]
    note = f"column {quoted(table.title('rating'))}: ratings are percentages, so {filled[0]} is read as {cells[0]}"
    return table.with_texts("rating", cells, note)


_PRACTICE = re.compile(
    "((practi[cs]e|training)( trials?)?|warm ?up|(survey )?preview|survey test|übung(sdurchgang)?|entraînement|練習)"
    " ?[0-9]*"
)
_OF_PRACTICE = re.compile("(is )?(practi[cs]e|warm ?up)( trial)?")
"""Titles of columns that say of each row whether it is practice; `training` may be that of a person."""
_YES = frozenset({"1", "yes", "true", "x", "ja", "oui"})


def without_practice(table: Table) -> Table:
    """Leave out rows that a column of sessions or trials, or an unused one, calls practice, or a loop of it made."""
    for title in [*(table.titles[name] for name in ("session", "trial") if name in table), *table.others]:
        loop = _PRACTICE.match(title.casefold()) and ".this" in title  # PsychoPy's practice.thisN
        told = _YES if _OF_PRACTICE.fullmatch(key(title)) else ()
        cells = [*map(key, table.cells[title])]
        left = [i for i, text in enumerate(cells) if (loop and text) or text in told or _PRACTICE.fullmatch(text)]
        if 0 < len(left) < len(table):
            return table.without(left, f"practice by column {quoted(title)}, left out")
    return table


_MARKED = (
    (
        re.compile("excluded?|exclusion|outliers?|invalid|(is )?catch( trial)?|ausgeschlossen|exclue?|除外"),
        _YES,
    ),
    (re.compile("included?|valid|keep|finished|completed?"), {"0", "no", "false", "nein", "non"}),
)
"""Titles of columns that mark rows which may not be meant, and the texts that do so."""


def with_marked_rows_named(table: Table) -> Table:
    """Say that rows are read although an unused column marks them as excluded, invalid or unfinished."""
    for title, cells in table.others.items():
        marks = {text for named, texts in _MARKED if named.fullmatch(key(title)) for text in texts}
        if marked := [i for i, text in enumerate(cells) if text.casefold() in marks]:
            note = f"looks wrong: column {quoted(title)} marks {table.lines(marked)}, which are read all the same"
            table = table.noted(note)
    return table


_ATTRIBUTES = re.compile(
    "(attribute|question|item|scale|dimension|descriptor|property|adjective|quality|merkmal|eigenschaft|frage|attribut"
    "|skala|attributo|atributo|属性|項目)s?( name| text| label)?"
)
_PERSONAL = re.compile(
    "group|site|lab|laboratory|cent(re|er)|country|gender|sex|age|class|school|cohort|study|experiment|gruppe|labor"
    "|studie|geschlecht|alter|groupe|étude|sexe|grupo|estudio|gruppo|studio|性別|年齢|実験|性别|年龄|实验"
)
"""Titles of columns in which a person has one text."""


def of_one_attribute_and_person(table: Table) -> Table:
    """Keep the ratings of softness among those of several attributes; refuse ids that start anew in each group.

    Both show in an unused column that has several texts for one touch of one participant.
    """
    touches = table.grouped("participant", *_DESIGN)
    for title, cells in table.others.items():
        if not 1 < len({*cells}) <= 50:
            continue
        told = {touch: sorted({cells[i] for i in rows}) for touch, rows in touches.items()}
        apart = [(touch[0], texts) for touch, texts in told.items() if len(texts) > 1]
        if 4 * len(apart) < len(told):
            continue
        other = [i for i, text in enumerate(cells) if bag(text) not in SOFTNESS]
        if 0 < len(other) < len(table):
            return table.without(other, f"column {quoted(title)} names another attribute than softness, left out")
        who, texts = apart[0]
        named = listing([*map(quoted, texts)], 4)
        if _ATTRIBUTES.fullmatch(key(title)):
            table.refuse(
                f"column {quoted(title)} has {named} for one touch of one participant: keep only the rows that rate "
                "softness, or give the column another name if all of them do"
            )
        elif _PERSONAL.fullmatch(key(title)) and "participant" in table:
            table.refuse(
                f"participant {quoted(who)} has {named} in column {quoted(title)}: give each person a name of their "
                f"own, such as {quoted(f'{texts[0]}-{who}')}, or the column another name if it is one person"
            )
    table.check()
    return table


# rows of statistics


_STATISTICS: Mapping[str, Callable[[FloatArray], float]] = {
    "mean": lambda x: float(np.mean(x)),
    "standard deviation": lambda x: float(np.std(x, ddof=1)),
    "sum": lambda x: float(np.sum(x)),
    "geometric mean": lambda x: float(np.exp(np.mean(np.log(x)))) if (x > 0).all() else np.nan,
    "standard error": lambda x: float(np.std(x, ddof=1) / np.sqrt(x.size)),
    "variance": lambda x: float(np.var(x, ddof=1)),
    "standard deviation of all": lambda x: float(np.std(x)),
    "median": lambda x: float(np.median(x)),
    "smallest": lambda x: float(np.min(x)),
    "largest": lambda x: float(np.max(x)),
    "range": lambda x: float(np.ptp(x)),
    "lower quartile": lambda x: float(np.quantile(x, 0.25)),
    "upper quartile": lambda x: float(np.quantile(x, 0.75)),
    "number": lambda x: float(x.size),
}
_TELLING = 6
"""Number of the first statistics that no person's numbers are by chance."""
_CHANCE = 1e-5
"""Largest probability at which numbers are those of a statistic by chance."""


def without_statistics(table: Table) -> Table:
    """Leave out rows that are statistics of other rows: by their names, or by all of their numbers."""
    for name in ("participant", "fabric", "afferent"):
        texts = table.texts(name)
        left = [i for i, text in enumerate(texts) if summarises(text)]
        if 0 < len(left) < len(table):
            told = listing([quoted(text) for text in dict.fromkeys(texts[i] for i in left)])
            table = table.without(left, f"statistics of other rows ({name} {told}), left out")
    names = table.texts("participant")
    people = [*dict.fromkeys(names)]
    if not {"participant", "rating"} <= table.titles.keys() or "fabric_2" in table or len(people) < 4:
        return table
    values, touches = table.plainly("rating"), table.keys(*_DESIGN)
    known, decimals = ~np.isnan(values), np.array([_decimals(text) for text in table.texts("rating")])
    error = np.maximum(0.51 * 10.0**-decimals, 1e-9 * np.abs(values))
    who = np.array([*map({name: k for k, name in enumerate(people)}.get, names)])
    alike = {touch: np.array(rows)[known[rows]] for touch, rows in grouped(touches).items()}
    found: dict[str, str] = {}
    gone = np.zeros(len(people), bool)
    for k, name in reversed([*enumerate(people)]):
        mine = np.flatnonzero((who == k) & known).tolist()
        # one statistic is no number of another: those of the people above or below are tried, too
        for others in (who != k, who < k, who > k):
            others &= ~gone[who]
            pools = {i: values[rows[others[rows]]] for i in mine for rows in (alike[touches[i]],)}
            some = [i for i, pool in pools.items() if pool.size > 1]
            if what := _statistic(values[some], error[some], [pools[i] for i in some]):
                break
        if what and (not name or key(name) in PERHAPS_SUMMARIES):
            found[name], gone[k] = what, True
        elif what in [*_STATISTICS][:_TELLING]:
            table.refuse(
                f"all ratings of participant {quoted(name)} are the {what} of those of the others: remove these rows, "
                "or name them 'mean', if they are statistics"
            )
    if not found:
        return table
    said = listing([f"{quoted(name)} is the {what}" for name, what in found.items()])
    note = f"statistics of the other participants' ratings ({said}), left out"
    return table.without(np.flatnonzero(gone[who]).tolist(), note)


def _decimals(text: str) -> int:
    """Return the number of digits behind the decimal mark of a number."""
    return len(re.split(r"[.,]", re.split("[eE]", text)[0] + ".")[1])


def _statistic(values: FloatArray, error: FloatArray, pools: Sequence[FloatArray]) -> str:
    """Return the statistic of pools of numbers that values are but for an error, empty if they are none."""
    for name, statistic in _STATISTICS.items() if len(pools) > 2 else ():
        if all(abs(value - statistic(pool)) <= e for value, e, pool in zip(values, error, pools, strict=True)):
            spread = np.array([np.ptp(pool) for pool in pools])
            chance = 1.0 if (spread == 0).any() else np.prod(np.minimum(1.0, 4.0 * error / spread))
            return name if chance <= _CHANCE else ""
    return ""


# names


def _shown(names: Iterable[str]) -> str:
    """Return names that differ in little, in quotes, with escapes for non-ASCII characters, which show how."""
    return " and ".join(ascii(short(name)) for name in names)


def with_one_spelling(table: Table) -> Table:
    """Join names that differ in case, zeros in front, format of numbers or punctuation only, unless they may be two.

    They may be two if both have a row of the same fabric, load and trial, and differ in more than the format of a
    number.
    """
    for columns in (("participant",), ("fabric", "fabric_2")):
        present = [name for name in columns if name in table]
        count = Counter(text for name in present for text in table.texts(name) if text)
        names = natural(count)
        groups = grouped(map(identity, names)).values()
        several = [[names[i] for i in group] for group in groups if len(group) > 1]
        if not several:
            continue
        # the most frequent spelling is kept, the shortest of several
        usual = [min(own, key=lambda t: (0 if looks_numeric(t) else -count[t], len(t))) for own in several]
        kept = {text: one for one, group in zip(usual, several, strict=True) for text in group}
        joined = table
        for name in present:
            joined = joined.with_texts(name, [kept.get(text, text) for text in table.texts(name)])
        title = repr(table.titles[present[0]])
        if apart := _may_be_two(table, joined, present[0], several):
            table.refuse(
                f"column {title}: {_shown(apart)} differ only in case, zeros in front, the format of numbers, "
                "punctuation or invisible characters, and have rows of their own for the same touch: write them alike, "
                "or give them names that differ in more"
            )
        else:
            told = listing([_shown(group) for group in several])
            table = joined.noted(f"column {title}: {told} are read as the same")
    return table


def _may_be_two(table: Table, joined: Table, name: str, groups: Sequence[Sequence[str]]) -> Sequence[str]:
    """Return the spellings of a name that may belong to two people or fabrics, empty if there are none."""
    names = ("participant", *_DESIGN, *(() if "rating" in table else ("indentor", "direction")))
    texts = table.texts(name)
    told = [own for rows in joined.grouped(*names).values() if len(own := {texts[i] for i in rows}) > 1]
    for group in groups:
        formats = {text.lstrip("0") or "0" for text in group}
        same = all(looks_numeric(text) for text in group) and len(formats) == len(group)
        if not same and any(len(spellings & {*group}) > 1 for spellings in told):
            return group
    return ()


def with_people_known(table: Table) -> Table:
    """Refuse rows of one fabric and load that repeat, where an unused column tells them apart as people would."""
    people = {*table.texts("participant")}
    if len(people) > 1 or holds_cells(table.titles) or not {"rating", "force_n"} & table.titles.keys():
        return table
    keys = table.keys(*_DESIGN)
    repeats = len(keys) - len({*keys})
    ranked = []
    for title, cells in table.others.items() if repeats else ():
        own = {text: identity(text) for text in {*cells}}
        texts = [own[text] for text in cells]
        each, pairs = Counter(texts), {*zip(keys, texts, strict=True)}
        telling = len(keys) - len(pairs) <= repeats / 20
        crossed = len(pairs) >= 0.8 * len(each) * len({*keys})  # every value with nearly every touch
        if 1 < len(each) <= len(keys) / 2 and len(each.keys() - {identity("")}) > 1 and (telling or crossed):
            ranked.append((-len(pairs), title))
    if apart := [title for _, title in sorted(ranked)[:3]]:
        what = f"one participant, {quoted(people.pop())}" if "participant" in table else "no column 'participant'"
        said = ", ".join(map(quoted, apart))
        table.refuse(
            f"{what}, but {counted(repeats, 'row repeats', 'rows repeat')} a fabric and load, and column {said} tells "
            f"them apart: is it the participant? If it numbers repeats of one person, add --column "
            f"trial={quoted(apart[0])}",
            *({"participant": title} for title in apart),
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
    ratings = table.texts("rating")
    if "rating" not in table or holds_cells(table.titles) or "fabric_2" in table:
        return table
    # sheets may be copies of each other
    columns = [texts for title, texts in table.cells.items() if title not in ("sheet", "")]
    every = [*zip(*columns, strict=True)]
    alike = grouped(every)
    copies = sorted(i for rows in alike.values() for i in rows[1:] if ratings[i])
    if not copies or len(alike) < 2:
        return table
    touches = table.grouped("participant", *_DESIGN)
    complete = len(copies) == len(table) - len(touches) or min(map(len, alike.values())) > 1
    trials = {*table.texts("trial")}
    if len(trials) > 1 or ("trial" in table and complete):
        return table.without(copies, "copies of other rows, with the same trial, left out")
    equal, chances = table.lines(copies), _chances_of_equal(table, copies, [rows[0] for rows in alike.values()])
    blocks, last = [1.0], -2
    for i, chance in zip(copies, chances, strict=True):
        follows = last == i - 1 and alike[every[i]][0] == alike[every[i - 1]][0] + 1
        blocks.append((blocks[-1] if follows else 1.0) * chance)
        last = i
    if min(blocks) > BY_CHANCE and not (complete and np.prod(chances) < BY_CHANCE):
        return table.noted(f"{equal}: equal to another row in all columns: are rows copied?")
    table.refuse(
        f"{counted(len(copies), 'row is a copy', 'rows are copies')} of other rows ({equal}): remove them; or, if they "
        "are further trials, number these in a column 'trial'"
    )
    table.check()
    return table


def with_equal_people_named(table: Table) -> Table:
    """Say that a participant, or a trial of all, has throughout the ratings of another one, as copied rows do."""
    ratings = table.texts("rating")
    for name in ("participant", "trial") if "rating" in table and "fabric_2" not in table else ():
        rest = table.keys(*(one for one in ("participant", *_DESIGN) if one != name), "rating")
        first: dict[tuple[tuple[str, ...], ...], str] = {}
        for (own,), rows in table.grouped(name).items():
            other = first.setdefault(tuple(sorted(rest[i] for i in rows)), own)
            some = [i for i in rows if ratings[i]]
            if other != own and np.prod(_chances_of_equal(table, some, some)) < BY_CHANCE:
                note = f"looks wrong: {name} {quoted(own)} has the ratings of {name} {quoted(other)}: are rows copied?"
                table = table.noted(note)
    return table


def with_copied_measurements_named(table: Table) -> Table:
    """Say that every measurement of a finger or an afferent is there again, as in a file that was added twice."""
    rows = [*zip(*(texts for title, texts in table.cells.items() if title not in ("sheet", "")), strict=True)]
    count = Counter(rows)
    groups = table.grouped("participant", "afferent").values()
    again = [i for own in groups if len(own) > 2 and all(count[rows[i]] > 1 for i in own) for i in own]
    note = "every one is there again, equal in all columns: are rows copied?"
    return table.noted(f"looks wrong: {table.lines(again)}: {note}") if again else table


MISSING_CODE = re.compile(r"-?([789])\1{1,4}|-9")
"""Numbers commonly used as codes for missing ones."""
FAR = 9.0
"""Ratio of the absolute value of such a number to the largest other one above which it is a code, as for 99 among
ratings up to 10."""


def with_codes_named(table: Table) -> Table:
    """Say that a measured number may be a code for a missing one, because no other is near it."""
    for name in (name for name in table.titles if quantity_of(name) not in ("", "ratio")):
        values, texts = np.abs(table.plainly(name)), table.texts(name)
        code = np.array([MISSING_CODE.fullmatch(text) is not None for text in texts])
        largest = np.max(values, initial=0.0, where=~code & ~np.isnan(values))
        if codes := np.flatnonzero(code & (values / FAR >= largest)).tolist() if largest else []:
            place = f"{table.lines(codes)}, column {quoted(table.title(name))}"
            note = f"{texts[codes[0]]} looks like a code for a missing number, because no other is near it"
            table = table.noted(f"looks wrong: {place}: {note}; leave such cells empty")
    return table


def _chances_of_equal(table: Table, rows: Sequence[int], distinct: Sequence[int]) -> list[float]:
    """Return the probability, roughly, that a rating is given again for the same touch.

    It is that of an error of 30 % that rounding hides, or four times that of two equal ratings of different touches,
    if this is larger; and at most 0.6, as on a scale of a few categories.
    """
    people, texts = table.texts("participant"), table.texts("rating")
    step = np.array([10.0 ** -_decimals(text) for text in texts])
    error = 0.75 * np.abs(np.nan_to_num(table.plainly("rating")))
    chance = np.maximum(step / np.maximum(error, step), np.where(step < 1, 1e-3, 0.1))
    for who in {people[i] for i in rows}:
        count = Counter(texts[k] for k in distinct if people[k] == who)
        alike = sum(n * (n - 1) for n in count.values()) / max(1, count.total() * (count.total() - 1))
        own = np.array([name == who for name in people])
        chance[own] = np.maximum(chance[own], 4.0 * alike)
    return np.minimum(chance, 0.6)[[*rows]].tolist()


def with_errors_and_steps_named(table: Table) -> Table:
    """Say that columns `load_cv` and `resolution` are used; the latter only if the ratings are multiples of it.

    `load_cv` is a name of this program's own, so that cells without numbers are errors of its values; a column
    `resolution` without numbers, or with other ones, is that of a screen.
    """
    for name in ("load_cv", "resolution"):
        filled = [text for text in table.texts(name) if not is_missing(text)]
        if not filled:
            continue
        title = quoted(table.titles[name])
        if name == "resolution" and not any(looks_numeric(text.rstrip("% ")) for text in filled):
            note = f"column {title} is not used: its cells, such as {quoted(filled[0])}, are not numbers"
            return table.noted(note, titles={n: text for n, text in table.titles.items() if n != name})
        table = table.noted(f"column {title} is used: {NUMBERS[name].label}")
    steps = table.plainly("resolution")
    with np.errstate(all="ignore"):
        ratio = table.plainly("rating") / steps
        off = np.flatnonzero((steps > 0) & (np.abs(ratio - np.round(ratio)) > 1e-6 * np.maximum(1.0, np.abs(ratio))))
    for i in off[:1].tolist():
        table.refuse(
            f"column {title}, read as the {NUMBERS['resolution'].label}: the rating {table.texts('rating')[i]} in row "
            f"{table.rows[i]} is no multiple of {table.texts('resolution')[i]}; rename the column if it is something "
            "else, such as that of a screen"
        )
    return table


# forces of a plate


def with_signs_of_pressing(table: Table) -> Table:
    """Reverse forces or indentations that are negative throughout, but for noise."""
    for name in ("indentation_mm", "force_n"):
        values = table.plainly(name)
        known = values[~np.isnan(values)]
        if known.size > 2 and known.max() <= 0.02 * -known.min():
            note = f"column {quoted(table.titles[name])}: values are negative, and read with the sign reversed"
            table = table.with_texts(name, [*map(_reversed, table.texts(name))], note)
    return table


def _reversed(text: str) -> str:
    other = text[1:] if text.startswith("-") else f"-{text}" if looks_numeric(text) else text
    return SheetNumber(other) if isinstance(text, SheetNumber) else other


def without_noise(table: Table) -> Table:
    """Leave out forces just below zero, before the plate touches the finger."""
    force = table.plainly("force_n")
    noise = np.flatnonzero((force < 0) & (force >= -0.02 * np.max(force, initial=0.0, where=~np.isnan(force))))
    note = "forces just below 0, noise before contact, left out"
    return table.without(noise.tolist(), note) if noise.size else table


_UNLOADING = re.compile("unload(ing)?|(re)?traction|retract(ing)?|withdrawal|backward|entlastung|décharge|除荷")


def without_unloading(table: Table) -> Table:
    """Leave out the rows on which a plate moves back after it was pressed in: forces are those of loading.

    A column says so, such as `phase`, or the indentations show it.
    """
    for title, cells in table.others.items():
        named = [i for i, text in enumerate(cells) if _UNLOADING.fullmatch(key(text))]
        if 0 < len(named) < len(table):
            return table.without(named, f"the plate moves back there by column {quoted(title)}, left out")
    depth = table.plainly("indentation_mm")
    left: list[int] = []
    for press in table.grouped("participant", "indentor").values():
        rows = [i for i in press if not np.isnan(depth[i])]
        step = np.diff(depth[rows])
        usual = float(np.median(np.abs(step[step != 0]))) if (step != 0).any() else 0.0
        back = (step < 0) & (-step <= 5.0 * usual)  # larger ones begin another press
        for run in np.split(np.arange(step.size), np.flatnonzero(np.diff(back)) + 1):
            # that of pressing in before it has three steps, too
            if run.size >= 3 and back[run[0]] and run[0] >= 3 and (step[run[0] - 3 : run[0]] >= 0).all():
                left += [rows[k + 1] for k in run]
    if not left:
        return table
    return table.without(sorted(left), "the plate moves back there; only forces of pressing in are used")
