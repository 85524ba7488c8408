"""Ratings of fabrics under loads."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date, timedelta
from decimal import ROUND_HALF_EVEN, Decimal
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.ranges import LOAD_STEPS
from softness_bayes.base.readable import counted, some_of
from softness_bayes.data.columns import FORCE, INDENTATION, LOAD_CV, LOADED, RATINGS, RESOLUTION, Column, Request
from softness_bayes.data.contents import FAR, MISSING_CODE
from softness_bayes.data.fabrics import Fabrics, log_sd
from softness_bayes.data.forms import PANEL, AggregatedCells, cells_of, covariates_in, unpaired
from softness_bayes.data.reading import read_as
from softness_bayes.data.sheets import TableSource
from softness_bayes.data.tables import FloatArray, IntArray, Table, freeze, grouped
from softness_bayes.data.texts import Marks, guess, identity, is_missing, listing, natural
from softness_bayes.touch.contact import Force, FreeTouch, Indentation, Load


class LoadColumn(NamedTuple):
    """A kind of load: its column, its type, and the function that returns its value [SI]."""

    column: Column
    kind: type[Indentation] | type[Force]
    value: Callable[[Any], float]


LOAD_COLUMNS = (
    LoadColumn(INDENTATION, Indentation, attrgetter("depth")),
    LoadColumn(FORCE, Force, attrgetter("newton")),
)


FREE = "free"
"""Name of a free touch, whose force is unknown, among loads."""

FREE_TOUCH = FreeTouch()


def load_column(load: Load) -> LoadColumn:
    """Return the entry of `LOAD_COLUMNS` for a load."""
    return next(entry for entry in LOAD_COLUMNS if isinstance(load, entry.kind))


def loads_by_column(loads: Sequence[Load]) -> dict[Column, FloatArray]:
    """Return the values of loads by their column [SI], shape (loads,), NaN where a load is of another kind."""
    return {
        column: np.array([value(load) if isinstance(load, kind) and load != FREE_TOUCH else np.nan for load in loads])
        for column, kind, value in LOAD_COLUMNS
    }


def loads_of(
    indentation_mm: ArrayLike | None = (), force_n: ArrayLike | None = (), load: str | None = None
) -> tuple[Load, ...]:
    """Return the distinct loads of some indentations [mm] and forces [N]: indentations first, each in increasing order.

    Single numbers and None are accepted too; the load "free" is a free touch.

    Raises
    ------
    InputError
        If a value is not positive and finite, or the load is another text.
    """
    if load not in (None, FREE):
        raise InputError(f"load: {load!r:.60}, expected {FREE!r} for touches of unknown force")
    distinct: set[Load] = set() if load is None else {FREE_TOUCH}
    for (column, kind, _), given in zip(LOAD_COLUMNS, (indentation_mm, force_n), strict=True):
        try:
            values = [] if given is None else np.atleast_1d(np.asarray(given, dtype=float)).tolist()
            distinct |= {kind(column.parse(repr(value))) for value in values}
        except ValueError as error:
            raise InputError(f"{column.name}: {error}") from None
    return tuple(sorted(distinct, key=rank))


def rank(load: Load) -> tuple[int, float]:
    """Return the sort key of a load: indentations first, each in increasing order."""
    entry = load_column(load)
    return LOAD_COLUMNS.index(entry), entry.value(load)


def _given_load(table: Table, given: Sequence[Load]) -> Load | None:
    """Return the load given for all rows, or None if there is a column; having neither or both is a fault."""
    filed = [entry.column.name for entry in LOAD_COLUMNS if entry.column.name in table]
    if not filed and len(given) != 1:
        names, remedy = ("indentation_mm", "force_n"), ""
        if not any(name in names for name, _ in table.perhaps.values()):
            remedy = (
                "; give the load of all ratings by one of --indentation-mm and --force-n, name its column with "
                "--column, or, if people pressed as they liked, say --load free, which takes their common force as "
                "unknown"
            )
        table.lack(f"no load column (indentation_mm or force_n){remedy}", *names)
    elif filed and given:
        table.refuse(
            "--indentation-mm, --force-n and --load apply only to tables without a load column; this one has "
            f"{' and '.join(repr(table.titles[name]) for name in filed)}"
        )
    elif len(filed) > 1 and not any(is_missing(text) for name in filed for text in table.texts(name)):
        table.refuse(
            "every row has an indentation and a force, expected one load; remove the column that was measured rather "
            f"than controlled ({' or '.join(repr(table.titles[name]) for name in filed)})"
        )
        table.check()
    return given[0] if given else None


def loads_in(table: Table, given: Load | None) -> list[Load | None]:
    """Return each row's load, from its columns or the given one; rows without a load are faults."""
    filed = {entry: table.numbers(entry.column).tolist() for entry in LOAD_COLUMNS if entry.column.name in table}
    names = [entry.column.name for entry in filed]
    touches: list[Load | None] = [given] * len(table)
    for i in range(len(table) if filed else 0):
        held = [entry.kind(values[i]) for entry, values in filed.items() if values[i] == values[i]]
        if len(held) != 1 and not table.is_faulty(i, *names):
            found = " and ".join(quoted(table.texts(name)[i]) for name in names)
            expected = "a load" if len(filed) == 1 else "one load: an indentation or a force"
            table.problem(i, names[-1], f"expected {expected}, got {found}")
        touches[i] = held[0] if held else None
    return touches


SOLE_PARTICIPANT = "participant"
"""Name of the participant in a table without a column of participants."""


class Conditions(NamedTuple):
    """The distinct pairs of fabric and load that were rated, sorted by fabric and load."""

    fabric: IntArray
    """Fabric index (n_c,) of each condition."""
    load: IntArray
    """Load index (n_c,) of each condition."""
    of_rating: IntArray
    """Condition index (n,) of each rating."""


@dataclass(frozen=True, eq=False)
class Ratings:
    """Ratings in long form, without missing ones.

    Parameters
    ----------
    participants, fabrics, loads
        Names and loads that the indices refer to; loads are distinct, indentations first, each in increasing order.
    participant, fabric, load
        Indices (n,) of each rating.
    rating
        Ratings (n,) as in the file.
    rows
        Line (n,) of each rating in its file.
    n_missing
        Number of rows without a rating.
    source, rating_column, digest, notes
        File, name of the ratings' column in it, SHA-256 of its bytes, and notes for the user.
    """

    participants: tuple[str, ...]
    fabrics: tuple[str, ...]
    loads: tuple[Load, ...]
    participant: IntArray
    fabric: IntArray
    load: IntArray
    rating: FloatArray
    rows: IntArray
    n_missing: int = 0
    source: str = "ratings"
    rating_column: str = "rating"
    digest: str = ""
    notes: tuple[str, ...] = ()
    not_positive: str = ""
    """The first negative rating, as written in the file."""
    load_cv: FloatArray | None = None
    """Relative standard error (n,) of each rating's load, NaN for rows without one; None if the table has no such
    column."""
    resolution: FloatArray | None = None
    """Grid step (n,) of the rater's numbers, NaN for rows without one; None if the table has no such column."""
    lists: IntArray | None = None
    """Index (n,) of the list in which each rating is a place; None if the table has no such column."""
    order: FloatArray | None = None
    """Place (n,) of each rating among those of its rater, from 0 for the first to 1 for the last trial, by the columns
    `session` and `trial`; None if these do not number the trials."""
    session: IntArray | None = None
    """Index (n,) of the session of each rating; None if the table has no such column."""
    covariates: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Covariates by name, with one text per participant, as written; not used in any model."""
    simulated: bool = False
    """True if `simulate` made the ratings, or if they are those of the example."""
    cells: AggregatedCells | None = None
    """Numbers of raters and standard deviations, if ratings are geometric means of cells; a panel is then a
    participant."""

    def __post_init__(self) -> None:
        kinds: dict[str, type] = dict.fromkeys(("participant", "fabric", "load", "rows", "lists", "session"), int)
        kinds |= dict.fromkeys(("rating", "load_cv", "resolution", "order"), float)
        freeze(self, self.source, {name: kind for name, kind in kinds.items() if getattr(self, name) is not None})
        for name, column in (("load_cv", LOAD_CV), ("resolution", RESOLUTION)):
            values = getattr(self, name)
            for value in () if values is None else np.unique(values[~np.isnan(values)]).tolist():
                column.range.require(f"{self.source}: {name}", value)

    def __len__(self) -> int:
        return len(self.rating)

    @property
    def paired(self) -> bool:
        """True if each row of the file is a pair of fabrics."""
        return self.lists is not None and bool((np.diff(self.rows) == 0).any())

    @property
    def own_lists(self) -> IntArray:
        """Index (n,) of each rating's list, if ratings are places; by default one for each participant and load."""
        if self.lists is not None:
            return self.lists
        return np.unique(self.participant * max(len(self.loads), 1) + self.load, return_inverse=True)[1]

    def load_log_sd(self, cv: float | None = None) -> FloatArray:
        """Return the standard deviation (n,) of each rating's log load, log-normal about the stated one.

        Parameters
        ----------
        cv
            Relative standard error of loads that state none; None or 0 if these are exact.
        """
        own = np.full(len(self), np.nan) if self.load_cv is None else self.load_cv
        return log_sd(np.where(np.isnan(own), cv or 0.0, own))

    @property
    def conditions(self) -> Conditions:
        """The rated pairs of fabric and load, and the index of each rating's pair."""
        loads = max(len(self.loads), 1)
        pairs, of_rating = np.unique(self.fabric * loads + self.load, return_inverse=True)
        return Conditions(*np.divmod(pairs, loads), of_rating)

    @classmethod
    def crossed(
        cls, participants: Sequence[str], fabrics: Sequence[str], loads: Sequence[Load], rating: ArrayLike
    ) -> Ratings:
        """Return the ratings of a complete design, in which every participant rated every fabric under every load.

        Parameters
        ----------
        participants, fabrics, loads
            Participants, fabrics and loads of the axes of `rating`.
        rating
            Ratings (n_participants, n_fabrics, n_loads), NaN where missing.
        """
        filed = np.asarray(rating, dtype=float)
        participant, fabric, load = np.nonzero(~np.isnan(filed))
        return cls(
            tuple(participants),
            tuple(fabrics),
            tuple(loads),
            participant,
            fabric,
            load,
            rating=filed[participant, fabric, load],
            rows=np.arange(2, 2 + len(participant)),
            n_missing=int(np.isnan(filed).sum()),
        )

    @classmethod
    def read(
        cls,
        path: TableSource,
        fabrics: Fabrics | None = None,
        *,
        columns: Mapping[str, str] | None = None,
        indentation_mm: float | None = None,
        force_n: float | None = None,
        load: str | None = None,
        decimal: Marks = None,
        wide: bool = False,
    ) -> Ratings:
        """Read a table of ratings.

        Columns: `participant` (if missing, all rows are of one participant), `fabric`, `rating` (empty if
        missing), `indentation_mm` or `force_n` (exactly one in each row), and optionally `load_cv`, `resolution`,
        `trial` and, of places in lists, `list`. A wide table has one column for each fabric instead, or for each
        fabric under each load (`cotton @ 2 mm`).

        Parameters
        ----------
        path
            Text file, Excel workbook, Parquet file, or DataFrame.
        fabrics
            The known fabrics; by default all fabrics in the table.
        columns
            Names of columns in the file, by the names above, where they differ.
        indentation_mm, force_n
            The load of every row [mm] or [N], if the table has no column for it.
        load
            "free" if people pressed as they liked, with an unknown force.
        decimal
            Decimal mark, "," or "."; by default inferred from the file, which is rejected if ambiguous.
        wide
            Whether the table has one column per fabric; by default inferred from the titles.

        Raises
        ------
        InputError
            Naming file, row, column and value.
        """
        given = loads_of(indentation_mm, force_n, load)
        names = None if fabrics is None else fabrics.names
        request = Request(LOADED if given else RATINGS, columns or {}, decimal, wide, names)
        return read_as(lambda table: cls.from_table(table, fabrics, given), path, request)

    @classmethod
    def from_table(
        cls,
        table: Table,
        fabrics: Fabrics | None = None,
        given: Sequence[Load] = (),
        drop_zeros: bool = False,
        loads_needed: bool = True,
    ) -> Ratings:
        """Return the ratings of a table of some fabrics, optionally without those of 0.

        The load may be given for all rows. If loads are not needed, ratings without any have no `loads`.
        """
        unknown = not (loads_needed or given or any(entry.column.name in table for entry in LOAD_COLUMNS))
        load = None if unknown else _given_load(table, given)
        table, cells = cells_of(table)
        table.require("fabric", "rating")
        table = unpaired(table)
        filed = table.numbers("rating")
        whole, (rated, used, notes) = table, _rated_rows(table, filed, drop_zeros)
        table = table.take(used)
        if "participant" in table:
            by = table.labels("participant")
        else:
            by = [SOLE_PARTICIPANT if cells is None else PANEL] * len(table)
            if cells is None:
                notes.append("no column 'participant': all ratings are treated as those of one participant")
        what = _fabrics_in(table, fabrics, notes)
        loads = loads_in(table, load)
        for entry in LOAD_COLUMNS:
            whole.numbers(entry.column)  # rows without a rating may hold a unit, which would be passed over
        load_cv, resolution = (table.numbers(c) if c.name in table else None for c in (LOAD_CV, RESOLUTION))
        table.check()
        notes += _repeats(table, by, what, loads)
        if cells is not None and len(set(zip(by, what, loads, strict=True))) < len(table):
            table.refuse("a cell of one fabric and load is in several rows, expected one")
            table.check()
        wrong = np.flatnonzero(filed[rated] < 0)
        if rated.size > 2 and np.ptp(filed[rated]) == 0:
            notes.append(
                f"looks wrong: all {rated.size} ratings are {filed[rated[0]]:g}, so they contain no information"
            )
        participants = natural(by)
        covariates, noted = covariates_in(whole, participants)
        names = natural(what) if fabrics is None else [name for name in fabrics.names if name in {*what}]
        distinct = [] if unknown else sorted({load for load in loads if load is not None}, key=rank)
        # lists with equal names but different participants are different
        lists = [*zip(by, table.labels("list"), strict=True)] if "list" in table else []
        session = table.labels("session") if "session" in table else []
        return cls(
            tuple(participants),
            tuple(names),
            tuple(distinct),
            participant=_index(by, participants),
            fabric=_index(what, names),
            load=_index(loads, distinct or [None]),
            rating=filed[rated],
            rows=table.rows,
            n_missing=len(filed) - rated.size,
            rating_column=table.title("rating"),
            **table.origin((*noted, *notes)),
            not_positive=table.texts("rating")[wrong[0]] if wrong.size else "",
            load_cv=load_cv,
            resolution=resolution,
            lists=_index(lists, [*dict.fromkeys(lists)]) if lists else None,
            order=_order_in(table, by),
            session=_index(session, natural(session)) if session else None,
            covariates=covariates,
            cells=None if cells is None else cells.take(used),
        )


def _index(values: Sequence[object], distinct: Sequence[object]) -> IntArray:
    place = {value: i for i, value in enumerate(distinct)}
    return np.array([place[value] for value in values], dtype=np.intp)


def _is_day(text: str) -> bool:
    """Return whether a number is that of a day of 2000 to 2050 in spreadsheet programs."""
    return re.fullmatch("[345][0-9]{4}", text) is not None and 36526 <= int(text) < 54789


def _rated_rows(table: Table, filed: FloatArray, drop_zeros: bool) -> tuple[IntArray, IntArray, list[str]]:
    """Return the rated rows, the rated and faulty rows, and notes on the others.

    Codes for missing ratings are faults, and so are tables without ratings.
    """
    texts = table.texts("rating")
    # decimals say that a number is none, but not those that a program gave to all
    bare = [re.sub("[.,]0+$", "", text) for text in texts]
    given = any(text.isdigit() for text, value in zip(texts, filed, strict=True) if value == value)
    written = texts if given else bare
    # a code is nine times as far from 0 as every other rating, or the only negative number among positive ones
    found = [not np.isnan(filed[i]) and MISSING_CODE.fullmatch(text) for i, text in enumerate(written)]
    codes = [i for i, code in enumerate(found) if code or _is_day(texts[i])]
    others = np.delete(filed, codes)
    others = others[~np.isnan(others)]
    largest = np.abs(others).max(initial=0.0)  # it may be too large for a multiplication
    for i in codes if others.size else ():
        if abs(filed[i]) / FAR >= largest or filed[i] < 0 <= others.min():
            what = (
                "a code for a missing rating, because no other rating is near it; leave cells of missing ratings empty"
            )
            if _is_day(texts[i]):
                day = date(1899, 12, 30) + timedelta(int(texts[i]))
                what = f"the day {day}, which a spreadsheet program made of a rating such as {day.day}.{day.month}"
                what += "; write the rating that was given"
            mend = f"with decimals, as {texts[i]}.0" if texts[i] == bare[i] else f"as {float(bare[i]):.4e}"
            problem = f"{texts[i]} looks like {what}; if it is the rating, write it {mend}"
            table.problem(i, "rating", problem)
    kept = ~np.isnan(filed)
    zeros = int((filed == 0).sum()) if drop_zeros else 0
    rated = np.flatnonzero(kept & (filed != 0) if drop_zeros else kept)
    faulty = np.array([table.is_faulty(i, "rating") for i in range(len(table))])
    words = {text for text, wrong in zip(texts, faulty, strict=True) if wrong and not any(map(str.isdigit, text))}
    if not rated.size and len(words) > 1:
        table.refuse(
            "no rating is a number: write words of a scale as numbers, higher for softer, and add --ratings categories"
        )
    if not (rated.size or faulty.any()):
        table.refuse(f"column {table.title('rating')!r}: there is no rating in any row")
    notes = []
    if missing := int((~kept).sum()):
        notes.append(f"{some_of(missing, len(table), 'rating')} missing")
    if zeros:
        notes.append(
            f"{counted(zeros, 'rating of 0 is', 'ratings of 0 are')} left out, which biases the result towards "
            "higher ratings"
        )
    used = np.sort(np.concatenate([rated, np.flatnonzero(faulty & ~kept)]))  # the same rows, if there are no faults
    return rated, used, notes


def _fabrics_in(table: Table, fabrics: Fabrics | None, notes: list[str]) -> Sequence[str]:
    """Return each row's fabric, by its name in the table of fabrics; an unknown one is a fault of its first row."""
    labels = table.labels("fabric")
    if fabrics is None:
        return labels
    known = set(fabrics.names)
    rows = Counter(name for name in labels if name not in known)
    alike = grouped(map(identity, fabrics.names))
    # names in another format, such as 1.0 for 1, mean the one fabric whose name differs in nothing else
    found = {name: alike.get(identity(name), []) for name in rows}
    same = {name: fabrics.names[own[0]] for name, own in found.items() if len(own) == 1}
    unknown = [name for name in rows if name and name not in same]
    for k, name in enumerate(unknown):
        count, near = rows[name], guess(name, fabrics.names, k)
        problem = f"{quoted(name)} is not a fabric of {fabrics.source}{near}"
        more = f", as in {counted(count - 1, 'other row', 'other rows')}" if count > 1 else ""
        if k == 0 and len(unknown) > 1 and not known & {*labels}:
            more += f"; its fabrics are {listing([*map(quoted, fabrics.names)])}"
        table.problem(labels.index(name), "fabric", f"{problem}{more}")
    if same:
        told = listing([f"{name!a} as {own!a}" for name, own in same.items()])
        notes.append(f"column {table.titles['fabric']!r}: {told}, as in {fabrics.source}")
    return [same.get(name, name) for name in labels]


def _order_in(table: Table, by: Sequence[str]) -> FloatArray | None:
    """Return the place of each row among those of its rater, 0 to 1, by the numbers of sessions and trials."""
    told = [table.plainly(name) for name in ("session", "trial") if name in table]
    if not told or np.isnan(told).any():
        return None
    place, every = np.empty(len(table)), np.stack(told, axis=1)
    for rows in grouped(by).values():
        own = np.unique(every[rows], axis=0, return_inverse=True)[1].ravel()
        place[rows] = own / max(1, own.max())
    return place


def _repeats(table: Table, *keys: Sequence[object]) -> list[str]:
    """Return a note on ratings that repeat a participant, fabric and load (and trial, if there is such a column).

    It lists the unused columns that distinguish all of them.
    """
    told = [*keys, *map(table.texts, ("session", "trial", "list"))]
    repeated = len(table) - len({*zip(*told, strict=True)})
    if not repeated:
        return []
    if "trial" not in table:
        return [f"{repeated} ratings repeat a participant, fabric and load: treated as further trials"]
    apart = [
        quoted(title) for title, texts in table.others.items() if len({*zip(*told, texts, strict=True)}) == len(table)
    ]
    differ = f", and differ in {' and '.join(apart)}, which is not used" if apart else ""
    return [
        f"{repeated} ratings repeat a participant, fabric, load and trial{differ}: treated as further trials under the "
        f"same load{'' if apart else '; is the trial right?'}"
    ]


def with_few_loads(ratings: Ratings, most: int) -> Ratings:
    """Return ratings whose loads of each kind are at most so many: neighbours become their geometric mean."""
    loads: list[Load] = []
    place = np.empty(len(ratings.loads), dtype=np.intp)
    for _, kind, value in LOAD_COLUMNS:
        own = [k for k, load in enumerate(ratings.loads) if isinstance(load, kind)]
        for group in np.array_split(own, min(len(own), most)) if own else []:
            values = [value(ratings.loads[k]) for k in group]
            place[group] = len(loads)
            middle = float(f"{np.exp(np.mean(np.log(values))):.4g}")
            loads.append(ratings.loads[group[0]] if len(values) == 1 else kind(middle))
    return replace(ratings, loads=tuple(loads), load=place[ratings.load])


PARTS = 4
"""Number of equal parts of a rater's trials whose scales may differ if the table names no sessions."""


def with_drift(ratings: Ratings) -> Ratings:
    """Return ratings in which each session of a rater, or each quarter of the trials, is a rater of its own.

    The scale of a rater may then drift from one to the next, and only ratings of one of them are compared directly.

    Raises
    ------
    InputError
        If the table has neither sessions nor numbers of trials.
    """
    if ratings.session is None and ratings.order is None:
        raise InputError(
            f"{ratings.source}: drift needs the order of the ratings: a column 'session' or 'trial' with their numbers"
        )
    if ratings.session is not None:
        part, what = ratings.session, "session"
    else:
        assert ratings.order is not None
        part, what = np.minimum((PARTS * ratings.order).astype(int), PARTS - 1), "part"
    own, index = np.unique(ratings.participant * (int(part.max()) + 1) + part, return_inverse=True)
    who, which = np.divmod(own, int(part.max()) + 1)
    names = tuple(f"{ratings.participants[k]}, {what} {part + 1}" for k, part in zip(who, which, strict=True))
    covariates = {name: tuple(texts[k] for k in who) for name, texts in ratings.covariates.items()}
    note = f"drift: {len(ratings.participants)} raters have a scale of their own in each {what}, {len(names)} in all"
    notes = (*ratings.notes, note)
    return replace(ratings, participants=names, participant=index, covariates=covariates, notes=notes)


def with_rounded_loads(ratings: Ratings, step: float) -> Ratings:
    """Return ratings whose loads are the nearest multiples of a step, with a note that says what was merged.

    Parameters
    ----------
    ratings
        The ratings.
    step
        Step, in N for forces and in mm for indentations.

    Raises
    ------
    InputError
        If the step is not positive, or a load would become 0 or leave its range.
    """
    LOAD_STEPS.require("round_load", step)
    unit = Decimal(repr(float(step)))
    rounded: list[Load] = []
    groups: dict[Load, list[str]] = {}
    for load in ratings.loads:
        column, kind, value = load_column(load)
        count = (Decimal(column.write(value(load))) / unit).to_integral_value(ROUND_HALF_EVEN)
        try:
            rounded.append(kind(column.parse(f"{(count * unit).normalize():f}")))
        except ValueError as error:
            raise InputError(
                f"round_load {step:g}: {load} would become {count * unit} {column.unit}, which is not a load "
                f"({error}); give a smaller step"
            ) from None
        groups.setdefault(rounded[-1], []).append(str(load))
    # rounding keeps the order of loads
    order = {load: k for k, load in enumerate(groups)}
    told = [f"{load} from {listing(members, 3)}" for load, members in groups.items() if len(members) > 1]
    note = f"loads rounded to multiples of {step:g}: {len(ratings.loads)} became {len(groups)}"
    if told:
        note += f": {'; '.join(told[:3])}" + (f"; and {len(told) - 3} more" if len(told) > 3 else "")
    places = np.array([order[load] for load in rounded], dtype=np.intp)
    return replace(ratings, loads=tuple(order), load=places[ratings.load], notes=(*ratings.notes, note))
