"""Oddities in a table of ratings: ends of scales, ties, nearly equal loads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.ranges import CATEGORIES_RANGE
from softness_bayes.base.readable import counted, percent
from softness_bayes.data.ratings import LOAD_COLUMNS, Ratings

CLOSE = 0.02
"""Relative difference below which two loads may have been intended to be equal."""

AT_AN_END = 0.1
"""Share of all ratings at the largest (smallest) number above which it is a ceiling (floor)."""

ROUND_ENDS, AT_A_ROUND_END = (1.0, 10.0, 100.0, 1000.0), 0.02
"""Usual upper ends of scales, and the share of ratings there from which one may end, if half of the raters use it."""

TIED = 0.5
"""Share of equal pairs among a rater's ratings of different fabrics under one load that causes a note."""


def oddities(ratings: Ratings, numbers: bool = True) -> list[str]:
    """Return notes on oddities in a table of ratings, empty if there are none.

    Parameters
    ----------
    ratings
        The table.
    numbers
        False for categories and ranks, in which ends and ties are normal.
    """
    of_numbers = [*_ends(ratings), *_ties(ratings), *_categories(ratings)] if numbers else []
    return [*_close_loads(ratings), *of_numbers]


def _close_loads(ratings: Ratings) -> list[str]:
    notes = []
    for column, kind, value in LOAD_COLUMNS:
        held = np.sort([value(load) for load in ratings.loads if isinstance(load, kind)])
        groups = 1 + int((np.diff(np.log(held)) > CLOSE).sum())
        if held.size < 2 or groups == held.size:
            continue
        pair = int(np.diff(np.log(held)).argmin())
        first, second = (f"{x / column.factor:.12g}" for x in held[pair : pair + 2])
        notes.append(
            f"{held.size} different {column.label}s form {groups} groups with neighbours within "
            f"{percent(CLOSE)} of each other, such as {first} and {second} {column.unit}; they are used as "
            "measured, and --round-load STEP makes them equal"
        )
    return notes


def _ends(ratings: Ratings) -> list[str]:
    if np.ptp(ratings.rating) == 0:
        return []
    notes, people = [], len(ratings.participants)
    for what, end in (("largest", ratings.rating.max()), ("smallest", ratings.rating.min())):
        at = ratings.rating == end
        share, raters = float(at.mean()), np.unique(ratings.participant[at]).size
        usual = end in ROUND_ENDS and share >= AT_A_ROUND_END and raters >= max(2.0, 0.5 * people)
        if not (share >= AT_AN_END or usual) or np.unique(ratings.rating).size < 12:
            continue
        remedy = f"; if so, use --ratings slider --slider 0,{end:g}" if usual else ""
        notes.append(
            f"{percent(share)} of the ratings are {end:g}, the {what} of all, by {raters} of {people} "
            f"participants: the scale may end there{remedy}"
        )
    return notes


def _categories(ratings: Ratings) -> list[str]:
    least, most = ratings.rating.min(), ratings.rating.max()
    whole = (ratings.rating == np.round(ratings.rating)).all()
    if not whole or ratings.cells is not None or not 1 <= least < most <= CATEGORIES_RANGE.high:
        return []
    return [
        f"all ratings are whole numbers from {least:g} to {most:g}; if these are numbers of ordered "
        "categories, use --ratings categories"
    ]


def _ties(ratings: Ratings) -> list[str]:
    def pairs(*of: NDArray[np.generic]) -> float:
        count = np.unique(np.stack(of), axis=1, return_counts=True)[1]
        return float((count * (count - 1)).sum())

    own = (ratings.participant, ratings.load)
    share = pairs(*own, ratings.rating) / max(pairs(*own), 1.0)
    if share < TIED or np.ptp(ratings.rating) == 0:
        return []
    return [f"{percent(share)} of the pairs of ratings of one participant under one load are ties"]


FEW_RATERS = 6
"""Number of raters below which a 90 % interval of the spread between them spans more than a factor of 3."""


def few_raters_sentence(raters: int) -> str:
    """Describe what too few raters do not show; empty for enough of them."""
    if raters >= FEW_RATERS:
        return ""
    return (
        f"only {counted(raters, 'rater')}: how much people differ (tau) rests on its prior, and conclusions hold for "
        f"{'this person' if raters == 1 else 'these people'}, not for people in general; at least {FEW_RATERS} raters "
        "narrow the spread between people to a factor of 3"
    )
