"""Interpretation of ratings: the interval that each number represents, and an error law suited to the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import CATEGORIES_RANGE
from softness_bayes.base.readable import counted, number, some_of
from softness_bayes.data.ratings import Ratings
from softness_bayes.likelihood import scales
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.error_laws import GUMBEL, LAPSES, NORMAL, STUDENT, ErrorLaw
from softness_bayes.likelihood.layout import Layout, merge
from softness_bayes.likelihood.lists import MOST_TIED, references, shares
from softness_bayes.model.fingers import differing, fingers_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.load_groups import groups_of

FloatArray = NDArray[np.float64]

MOST_STEPS = 5
"""Largest number of different grid steps listed by name."""


class Interpretation(NamedTuple):
    """The intervals represented by ratings, and their error law."""

    intervals: Stated
    law: ErrorLaw
    note: str
    """Interpretation of the numbers, as a sentence."""
    errors_note: str
    """Reason for the choice of the error law, as a sentence."""
    categories: int = 0
    """Number of ordered categories; 0 on other scales."""
    raters: int = 0
    """Number of raters averaged in each rating; 0 for ratings by single raters."""


def interpret(ratings: Ratings, options: ModelOptions) -> Interpretation:
    """Return the interpretation of ratings and their error law, as requested or as inferred from the table.

    Raises
    ------
    InputError
        If a rating is not on the scale, or the options request something that the scale or the model does not support.
    """
    options.scale.require(ratings)
    if options.guess is not None and options.scale != scales.PAIRS:
        raise InputError(f"--guess: a guess rate is one of pairs (--ratings {scales.PAIRS.name}); omit it")
    if options.scale in (scales.RANKS, scales.PAIRS):
        return _of_lists(ratings, options)
    if ratings.paired:
        raise InputError(
            f"{ratings.source}: the rows are pairs of fabrics (column fabric_2), which are {scales.PAIRS.name}, not "
            f"{options.scale.name} ratings; add --ratings {scales.PAIRS.name}"
        )
    means = scales.AGGREGATED.name
    if options.scale == scales.AGGREGATED and ratings.cells is None:
        raise InputError(
            f"{ratings.source}: {means} ratings are geometric means of n raters: expected the columns geometric_mean "
            "(or mean and sd) and n, and geometric_sd where it is known"
        )
    if options.scale != scales.AGGREGATED and ratings.cells is not None:
        raise InputError(
            f"{ratings.source}: the rows are means of {ratings.cells.raters} raters, which are {means}, not "
            f"{options.scale.name} ratings; add --ratings {means}"
        )
    if options.scale.model is not None:
        return _with_custom_model(ratings, options)
    alone = _needs_closed_form(ratings, options)
    # steps of 0 request exact numbers, which the closed form supports
    rounded = bool(options.resolution) or (ratings.resolution is not None and bool(np.nansum(ratings.resolution)))
    if alone and (rounded or options.errors not in (None, NORMAL)):
        raise InputError(
            f"ratings: {alone} need exact numbers with normal errors; omit --resolution and --errors, and "
            "remove a column resolution"
        )
    if alone and (ratings.rating <= 0).any() and options.scale == scales.MAGNITUDE:
        raise InputError(
            f"{ratings.source}: {(ratings.rating <= 0).sum()} ratings are 0, and {alone} need ratings above 0; "
            "leave these out with --drop-zeros, or omit that option"
        )
    if options.slider_ends != (0.0, 1.0) and options.scale != scales.SLIDER:
        raise InputError(f"slider: ends are given for {options.scale.name} ratings; add --ratings slider, or omit them")
    ends = options.slider_ends if options.scale == scales.SLIDER else None
    if options.scale == scales.CATEGORIES:
        intervals = stated(replace(ratings, resolution=None), 0.0)
    else:
        intervals = stated(ratings, 0.0 if alone else options.resolution, ends)
    if options.errors is not None:
        law, why = options.errors, options.errors.meaning + ("" if "errors" in options.decided else ", as asked")
    elif alone:
        law, why = NORMAL, f"normal, as {alone} need"
    else:
        law, why = law_of(ratings, intervals, options.scale)
    count, raters = _count_of(ratings, options), 0
    if ratings.cells is not None:
        raters, known = ratings.cells.raters, ratings.cells.geometric_sd
        spreads = "without standard deviations, so they do not inform the spread of raters' scales (tau)"
        if known is not None:
            spreads = f"{int(np.isfinite(known).sum())} of them with the standard deviation of their log ratings"
        note = f"ratings: geometric means of {raters} raters each, {spreads}"
    elif count:
        note = f"ratings: {count} ordered categories"
    else:
        note = _numbers_note(ratings, intervals, alone, options.slider_width)
    return Interpretation(intervals, law, note, f"errors: {why}", count, raters)


def _require_none(ratings: Ratings, wrong: NDArray[np.intp], expected: str, rest: str) -> None:
    """Raise an error that names the first of some wrong ratings, what was expected, and the rest of the reason."""
    if wrong.size:
        i = wrong[0]
        raise InputError(
            f"{ratings.source}: row {ratings.rows[i]}, column {ratings.rating_column!r}: expected {expected}, got "
            f"{ratings.rating[i]:.15g} ({wrong.size} of {len(ratings)} {rest}"
        )


def _with_custom_model(ratings: Ratings, options: ModelOptions) -> Interpretation:
    """Return exact numbers with the error law of a custom observation model."""
    assert options.scale.model is not None
    # a model without one is refused by name when the model of the run is built
    name, law = options.scale.name, getattr(options.scale.model(scales.RISES), "error", NORMAL)
    if options.resolution is not None or ratings.resolution is not None or options.errors not in (None, law):
        raise InputError(
            f"ratings: the custom model of {name} defines its own numbers and errors; omit --resolution and "
            "--errors, and remove a column resolution"
        )
    none = np.zeros(len(ratings))
    intervals = Stated(ratings.rating, none, none, np.full(len(ratings), np.inf))
    note = f"ratings: {options.scale.meaning}, as defined by the custom model of {name}"
    return Interpretation(intervals, law, note, f"errors: {law.meaning}, as defined by that model")


def stated(ratings: Ratings, resolution: float | None = None, ends: tuple[float, float] | None = None) -> Stated:
    """Return the intervals represented by ratings.

    Parameters
    ----------
    ratings
        The table; its column `resolution` takes precedence.
    resolution
        Grid step of all other rows, 0 for exact numbers; None to infer the step of each rater.
    ends
        Numbers of the ends of a slider, whose ratings become shares of its length; None for numbers without an end.

    Raises
    ------
    InputError
        If a rating lies beyond the ends, or all ratings are at one end.
    """
    low, high = ends or (0.0, 1.0)
    share, least = (ratings.rating - low) / (high - low), None
    if ends is not None:
        outside = np.flatnonzero((share < 0) | (share > 1))
        place = f"a place on a slider from {low:g} to {high:g}"
        _require_none(ratings, outside, place, "ratings lie outside it); give its ends with --slider LOW,HIGH")
        inner = share[(share > 0) & (share < 1)]
        if not inner.size:
            raise InputError(
                f"{ratings.source}: all ratings are at the ends of the slider, so they contain no information"
            )
        # grids much finer than the distance to an end do not matter
        least = float(np.minimum(inner, 1.0 - inner).min()) * (high - low)
    usual: FloatArray | float = 0.0 if resolution is None else resolution
    if resolution is None:
        people = range(len(ratings.participants))
        steps = np.array([step_of(ratings.rating[ratings.participant == k], least) for k in people])
        usual = steps[ratings.participant]
    own = np.full(len(ratings), np.nan) if ratings.resolution is None else ratings.resolution
    step = np.where(np.isnan(own), usual, own) / (high - low)
    limit = _limits(ratings, share, step)
    if ends is None:
        none = np.full(len(ratings), np.inf)
        return Stated(np.where((limit > 0) & (share < limit), 0.5 * limit, share), step, limit, none)
    most = 1.0 - _limits(ratings, 1.0 - share, step)
    values = np.where(share < limit, 0.5 * limit, np.where(share > most, 0.5 * (1.0 + most), share))
    return Stated(values, step, limit, most, 1.0)


def _of_lists(ratings: Ratings, options: ModelOptions) -> Interpretation:
    """Return ratings as places in lists, each expressed as the share of the list below it.

    Raises
    ------
    InputError
        If no list has two touches, too many touches share a place, or the options request something that orders do not
        support.
    """
    laws = (NORMAL, LAPSES) if options.scale == scales.PAIRS else (GUMBEL,)
    refused = {
        "--resolution (or a column resolution)": options.resolution is not None or ratings.resolution is not None,
        "--errors": options.errors not in (None, *laws),
        "--slider": options.slider_ends != (0.0, 1.0),
        "--categories": options.n_categories is not None,
    }
    if asked := [name for name, so in refused.items() if so]:
        raise InputError(f"ratings: {options.scale.name} have no {' and no '.join(asked)}; omit it")
    lists, own = ratings.own_lists, ratings.rating
    owners = np.unique(np.stack([lists, ratings.participant]), axis=1)[0]
    if owners.size > np.unique(lists).size:
        raise InputError(f"{ratings.source}: a list holds the places of several participants; expected those of one")
    _, place, of_row, count = np.unique(
        np.stack([lists, np.unique(own, return_inverse=True)[1]]),
        axis=1,
        return_index=True,
        return_inverse=True,
        return_counts=True,
    )
    if (count > MOST_TIED).any():
        i = place[count.argmax()]
        raise InputError(
            f"{ratings.source}: row {ratings.rows[i]}, column {ratings.rating_column!r}: {count.max()} touches "
            f"of one list have place {own[i]:g}, expected at most {MOST_TIED}; with so many ties, use "
            "--ratings categories"
        )
    sizes = np.bincount(lists)
    sizes = sizes[sizes > 0]
    if sizes.max() < 2:
        raise InputError(
            f"{ratings.source}: no list has two different ranks, so there is no order; by default a list is "
            "all touches of one participant under one load, and a column 'list' can define others"
        )
    tied = int((count[of_row.ravel()] > 1).sum())
    zero = np.zeros(own.size)
    intervals = Stated(shares(own, lists), zero, zero, zero + np.inf, lists=lists)
    if options.scale == scales.PAIRS:
        if sizes.max() > 2:
            raise InputError(
                f"{ratings.source}: a list holds {sizes.max()} touches, expected pairs; put both fabrics in one "
                "row (column fabric_2), mark the two rows of a pair in a column 'list', or use --ratings "
                f"{scales.RANKS.name} for longer lists"
            )
        law = options.errors or NORMAL
        if options.guess is not None:
            intervals = intervals._replace(reference=_reference_rows(ratings))
        note = (
            f"ratings: answers to {int((sizes == 2).sum())} pairs of touches; the larger number is that of the softer"
        )
        note += f"; {tied // 2} of them are ties, and contain no information" if tied > 1 else ""
        errors = f"errors: {law.meaning}, so that an answer is a probit of the difference"
        if options.guess is not None:
            rate = "a sampled rate" if isinstance(options.guess, str) else f"the rate {number(options.guess)}"
            errors += f"; against a reference, comparisons are guessed to be softer at {rate}"
        elif law == NORMAL:
            errors += "; --errors lapses also models guesses"
        return Interpretation(intervals, law, note, errors)
    span = " to ".join(dict.fromkeys((str(sizes.min()), str(sizes.max()))))
    note = f"ratings: places in {sizes.size} lists of {span} touches; a larger number is a higher place"
    note += f"; {tied} places are tied, and do not inform the order within ties" if tied else ""
    return Interpretation(intervals, GUMBEL, note, f"errors: {GUMBEL.meaning}")


def _reference_rows(ratings: Ratings) -> NDArray[np.bool_]:
    """Return the rows of the references of pairs, shape (n,); a fabric against itself has none.

    Raises
    ------
    InputError
        If a pair of different fabrics has no reference, or two.
    """
    lists = np.unique(ratings.own_lists, return_inverse=True)[1]
    order = np.argsort(lists, kind="stable")
    rows = order[np.bincount(lists)[lists[order]] == 2].reshape(-1, 2)
    pairs, load = ratings.fabric[rows], groups_of(ratings.loads).of[ratings.load[rows[:, 0]]]
    sides = references(pairs, load, len(ratings.fabrics))
    wrong = np.flatnonzero((sides.sum(axis=1) != 1) & (pairs[:, 0] != pairs[:, 1]))
    if wrong.size:
        first, second = (ratings.fabrics[k] for k in pairs[wrong[0]])
        raise InputError(
            f"{ratings.source}: row {ratings.rows[rows[wrong[0], 0]]}: a guess rate (--guess) needs pairs of a "
            f"comparison and a reference, which meets twice as many fabrics as the others, and {first} and {second} "
            f"are {'both' if sides[wrong[0]].any() else 'no'} references ({wrong.size} of {len(rows)} pairs); omit "
            "--guess; --errors lapses has guesses that prefer no side"
        )
    found = np.zeros(len(ratings), bool)
    found[rows[sides]] = True
    return found


def _limits(ratings: Ratings, numbers: FloatArray, step: FloatArray) -> FloatArray:
    """Return the number below which each row's rater answers 0: half a step, or the smallest of exact numbers.

    That of all raters stands for a rater who has none above 0.
    """
    limit, every = 0.5 * step, numbers[numbers > 0]
    least = float(every.min()) if every.size else 1.0
    for rater in np.unique(ratings.participant[numbers == 0]):
        of = ratings.participant == rater
        own = numbers[of & (numbers > 0)]
        limit[of & (step == 0)] = own.min() if own.size else least
    return limit


def _count_of(ratings: Ratings, options: ModelOptions) -> int:
    """Return the number of categories (by default the largest number in the table); 0 on other scales.

    Raises
    ------
    InputError
        If a rating is not the number of a category, there are too many categories, or their number is given for another
        scale.
    """
    if options.scale != scales.CATEGORIES:
        if options.n_categories is not None:
            raise InputError(f"categories: {options.n_categories} are given for {options.scale.name} ratings")
        return 0
    count = options.n_categories or int(np.clip(ratings.rating.max(), CATEGORIES_RANGE.low, CATEGORIES_RANGE.high))
    wrong = np.flatnonzero(~np.isin(ratings.rating, np.arange(1, count + 1)))
    _require_none(ratings, wrong, f"the number of a category, 1 to {count}", "are none)")
    if options.resolution is not None or ratings.resolution is not None:
        raise InputError("ratings: categories have no resolution; omit it")
    return count


def _needs_closed_form(ratings: Ratings, options: ModelOptions) -> str:
    """Return the requested features that need exact ratings with normal errors, in words; empty if none."""
    if options.scale == scales.STANDARDISED:
        return f"{options.scale.name} ratings"
    if options.scale == scales.AGGREGATED:
        return "means of several raters"
    if fingers_of(options.individual):
        return f"raters' {differing(options.individual)} (--individual)"
    if ratings.load_log_sd(options.load_cv).any():
        return "errors of loads (load_cv)"
    if options.shared_load_cv:
        return "errors of loads (shared_load_cv)"
    return ""


def _numbers_note(ratings: Ratings, intervals: Stated, alone: str, unit: float) -> str:
    if intervals.exact:
        return "ratings: treated as exact numbers" + (f", as {alone} need" if alone else "")
    people = len(ratings.participants)
    step = np.zeros(people)
    np.maximum.at(step, ratings.participant, intervals.step)
    parts, zeros = [], int((ratings.rating == 0).sum())
    if step.any():
        sizes, counts = np.unique(step[step > 0], return_counts=True)
        most = sorted(zip(counts.tolist(), sizes.tolist(), strict=True), reverse=True)
        named = [f"{unit * size:.6g} ({count})" for count, size in most[:MOST_STEPS]]
        named += [counted(len(most) - MOST_STEPS, "other")] if len(most) > MOST_STEPS else []
        parts.append(
            f"{some_of(int(counts.sum()), people, 'participant', 'rounds', 'round')} their answers to steps of "
            f"{', '.join(named)}; each rating counts as the interval that rounds to it"
        )
    if np.isfinite(intervals.end):
        low, high = (intervals.values < intervals.limit).sum(), (intervals.values > intervals.most).sum()
        if low or high:
            parts.append(f"{low} lie at the slider's lower end and {high} at the upper one; these are censored")
    elif zeros:
        one = "rating of 0 is censored: it counts as a number below the smallest that its participant uses"
        more = "ratings of 0 are censored: they count as numbers below the smallest that their participant uses"
        parts.append(counted(zeros, one, more))
    return "ratings: " + "; ".join(parts)


CHANCE = 0.01
"""Largest probability at which a rater's numbers would all fall on a coarser grid than the one in use by chance."""

NEGLIGIBLE = 0.02
"""Step, relative to each rating of a rater, up to which the numbers are taken as exact: a rating's error is ten times
as large, and rounding then adds less than a thousandth to its variance."""

WIDEST = 10**12
"""Largest ratio of a rater's numbers for which a grid is looked for."""

_FACTORS = 1, 2, 5  # of powers of ten: the steps of grids, beside halves and quarters
_QUARTERS = Decimal("0.25"), Decimal("0.5")


def step_of(numbers: ArrayLike, least: float | None = None) -> float:
    """Return the largest step of which all numbers are multiples, unless that may be chance; 0 if it is negligible.

    Steps are 1, 2 or 5 times a power of ten, a half or a quarter. A step is believed if so many different numbers of a
    finer one would all fall on it with a probability below `CHANCE`; the finest takes three different numbers. It is
    negligible beside the smallest number, or beside `least`.
    """
    # digits beyond the twelfth are those of rounding
    distinct = sorted({Decimal(f"{x:.12g}") for x in np.unique(np.asarray(numbers, float)).tolist() if x > 0})
    if not distinct or distinct[-1] > WIDEST * distinct[0]:
        return 0.0
    finest = min(int(x.normalize().as_tuple().exponent) for x in distinct)
    found, step = None, Decimal(1).scaleb(finest - 1)
    for coarser in _steps(finest, distinct[-1]):
        if all(x % coarser == 0 for x in distinct) and float(step / coarser) ** len(distinct) < CHANCE:
            found = step = coarser
    return float(step) if found and float(step) > NEGLIGIBLE * (float(distinct[0]) if least is None else least) else 0.0


def _steps(finest: int, largest: Decimal) -> Sequence[Decimal]:
    """Return the steps from a power of ten up to the largest number, in rising order."""
    found = [factor * Decimal(1).scaleb(k) for k in range(finest, largest.adjusted() + 1) for factor in _FACTORS]
    return sorted({step for step in (*found, *_QUARTERS) if Decimal(1).scaleb(finest) <= step <= largest})


HEAVY = 4.0
"""Number of standard errors by which the excess kurtosis must exceed 0 for Student's t errors to be the default."""

FEWEST = 30
"""Residual degrees of freedom below which normal errors are the default, as kurtosis is then too uncertain."""

LEAST_FREE = 1e-3
"""Standard deviation of a residual, relative to that of an error, below which it carries no information on the error
law."""


def law_of(ratings: Ratings, intervals: Stated, scale: scales.Scale) -> tuple[ErrorLaw, str]:
    """Return Student's t if the residuals of participants and conditions have heavy tails, else normal; and why.

    Censored ratings have no residual: a 0 is some number below a limit, and any number in its place may lie far out.
    """
    conditions, known = ratings.conditions, ~intervals.censored
    left_out = "" if known.all() else f", without {counted(int((~known).sum()), 'censored rating')}"
    rated, of_row = np.unique(conditions.of_rating[known], return_inverse=True)
    values, fabric = intervals.values[known], conditions.fabric[rated]
    design = Design(of_row, ratings.participant[known], fabric, len(ratings.participants))
    layout = Layout(design, np.ones(design.n_conditions), conditions.load[rated], scale=scale)
    groups, within = groups_of(ratings.loads), ""
    if groups.merged and design.n_rows - design.n_conditions - design.n_participants < FEWEST:
        # exact loads hardly repeat; changes of the response within a group have light tails
        layout, within = merge(layout, groups.of)[0], f" within {counted(groups.at.size, 'group')} of loads"
        design = layout.design
    fit = layout.fit(values)
    if layout.residual_freedom < FEWEST or not fit.sd > 0:
        why = f"normal, because too few ratings repeat a condition{within} to test for heavier tails"
        return NORMAL, (f"{why}; --errors overrides{', --round-load STEP merges nearby loads' if within else ''}")
    participant = np.nan_to_num(fit.participant)[design.participant]
    residual = scale.additive(values) - fit.condition[design.condition] - participant
    # ratings that alone determine their condition have zero residuals, which would look like a narrow peak
    spread = np.sqrt(np.maximum(1.0 - layout.leverage, 0.0))
    residual = residual[spread > LEAST_FREE] / spread[spread > LEAST_FREE]
    kurtosis = float((residual**4).mean() / (residual**2).mean() ** 2 - 3.0)
    error = float(np.sqrt(24.0 / layout.residual_freedom))
    numbers = f"(excess kurtosis of the residuals{within}{left_out} {kurtosis:.2f} ± {error:.2f}); --errors overrides"
    if kurtosis > HEAVY * error:
        return STUDENT, f"{STUDENT.meaning}, because tails are heavier than normal {numbers}"
    return NORMAL, f"normal, because tails are no heavier than that {numbers}"
