"""Predictive checks of categorical ratings and of paired comparisons, with psychometric curves for the pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.names import short_name
from softness_bayes.plotting.panels import MODULUS_LABEL, Array, FreePanels, free_panels, legend_below, number_ticks
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.readable import percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

IndexArray = NDArray[np.intp]

INSIDE = 0.9
"""Probability of the replicates' pointwise limits, for each category or fabric separately."""


class Counts(NamedTuple):
    """Ratings in each category under one load."""

    load: str
    """Name of the load."""
    observed: Array
    """Number of ratings in each category, shape (categories,)."""
    replicates: Array
    """The same numbers for the replicates, shape (replicates, categories)."""


class Wins(NamedTuple):
    """Fraction of answers that judge each fabric softer than the standard, under one load."""

    load: str
    """Name of the load."""
    standard: str
    """Name of the standard: the fabric with which the others were compared."""
    modulus: Array
    """E_fab of the other fabrics [Pa], in ascending order, shape (fabrics,)."""
    fabrics: Sequence[str]
    """Names of the other fabrics."""
    answers: IndexArray
    """Number of answers for each of the other fabrics, shape (fabrics,)."""
    observed: Array
    """Fraction of these answers that judge the fabric softer than the standard, shape (fabrics,)."""
    replicates: Array
    """The same fractions for the replicates, shape (replicates, fabrics)."""


def counts_of(load: str, observed: Array, replicates: Array, categories: int) -> Counts:
    """Return the number of ratings in each category; categories are numbered from 1.

    Parameters
    ----------
    load
        Name of the load.
    observed, replicates
        Categories of the ratings under this load, shapes (rows,) and (replicates, rows).
    categories
        Number of categories.
    """
    each = np.arange(1, categories + 1)
    return Counts(load, _numbers(observed, each), np.stack([_numbers(one, each) for one in replicates]))


def rows_of_pairs(lists: IndexArray) -> IndexArray:
    """Return the two rows of each pair, shape (pairs, 2): rows of the same list. Lists of one row are omitted."""
    order = np.argsort(lists, kind="stable")
    first = np.flatnonzero(lists[order][1:] == lists[order][:-1])
    return np.stack([order[first], order[first + 1]], axis=1)


def wins_of(
    load: str,
    names: Sequence[str],
    modulus: Array,
    pairs: IndexArray,
    observed: Array,
    replicates: Array,
) -> Wins:
    """Return the fraction of answers that judge each fabric softer than the standard.

    The standard is the fabric that was compared most often. If several qualify, it is the middle one of these.

    Parameters
    ----------
    load
        Name of the load.
    names, modulus
        Names and E_fab [Pa] of all fabrics, shape (fabrics,).
    pairs
        Fabrics of each pair under that load, shape (pairs, 2).
    observed
        1 if the first fabric was judged softer, 0 if the second was, 1/2 if neither was, shape (pairs,).
    replicates
        The same values for the replicates, shape (replicates, pairs).
    """
    asked = np.bincount(pairs.ravel(), minlength=modulus.size)
    often = np.flatnonzero(asked == asked.max())
    standard = int(often[np.argsort(modulus[often], kind="stable")[often.size // 2]])
    against = (pairs == standard).any(axis=1) & (pairs[:, 0] != pairs[:, 1])
    first = pairs[against, 0] != standard  # whether the other fabric is the first of the pair
    other = np.where(first, pairs[against, 0], pairs[against, 1])
    fabrics = np.unique(other)
    fabrics = fabrics[np.argsort(modulus[fabrics], kind="stable")]
    member = other == fabrics[:, None]
    answers = member.sum(axis=1)
    share = member / answers[:, None]
    softer = np.where(first, observed[against], 1.0 - observed[against])
    again = np.where(first, replicates[:, against], 1.0 - replicates[:, against])
    called = [names[k] for k in fabrics]
    return Wins(load, names[standard], modulus[fabrics], called, answers, share @ softer, again @ share.T)


def categories_figure(counts: Sequence[Counts], *, style: Style = USUAL) -> Figure:
    """Draw the number of ratings in each category as bars, with the limits of the replicates.

    Parameters
    ----------
    counts
        One panel for each load.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``observed/1 mm``, ``limits/1 mm`` and ``median/1 mm``.

    Raises
    ------
    InputError
        If there is nothing to show.
    """
    with style.applied():
        grid = _panels(len(counts), style)
        for axes, one in zip(grid.panels, counts, strict=True):
            category = np.arange(1, one.observed.size + 1)
            bars = axes.bar(category, one.observed, color=style.tint(style.data, 0.3), label="observed")
            for bar in bars:
                bar.set_gid(f"observed/{one.load}")
            _limits(axes, category, one.replicates, one.load, style)
            axes.set(title=one.load, xlabel="category", xticks=category, ylim=(0.0, None))
        for axes in grid.leftmost:
            axes.set_ylabel("number of ratings")
        legend_below(grid.figure, grid.panels)
    return grid.figure


def psychometric_figure(wins: Sequence[Wins], *, style: Style = USUAL) -> Figure:
    """Draw the fraction of answers that judge a fabric softer than the standard, against the fabric's modulus.

    Parameters
    ----------
    wins
        One panel for each load.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Artists named ``observed/1 mm``, ``limits/1 mm`` and ``median/1 mm`` (E_fab in kPa).

    Raises
    ------
    InputError
        If there is nothing to show.
    """
    with style.applied():
        grid = _panels(len(wins), style)
        for axes, one in zip(grid.panels, wins, strict=True):
            x = one.modulus / 1e3
            _limits(axes, x, one.replicates, one.load, style)
            points = axes.plot(x, one.observed, "o", color=style.data, markersize=3, label="observed", zorder=4)[0]
            points.set_gid(f"observed/{one.load}")
            name_rows(points, one.fabrics)
            axes.axhline(0.5, color=style.prior, linewidth=0.6)
            head = f"{one.load}, against {short_name(one.standard)} ({one.answers.sum()} answers)"
            axes.set(title=head, xlabel=MODULUS_LABEL)
            axes.set(xscale="log", ylim=(-0.05, 1.05))
            number_ticks(axes.xaxis)
        for axes in grid.leftmost:
            axes.set_ylabel("called softer [share]")
        legend_below(grid.figure, grid.panels)
    return grid.figure


def _numbers(ratings: Array, each: IndexArray) -> Array:
    """Return the number of ratings equal to each value, shape (values,)."""
    return (ratings[:, None] == each).sum(axis=0).astype(float)


def _panels(count: int, style: Style) -> FreePanels:
    """Return a figure with the given number of panels; raise an error if the number is zero."""
    if not count:
        raise InputError("figure: no load has answers to show")
    return free_panels(count, style, columns=min(count, 3), height=1.6)


def _limits(axes: Axes, x: Array | IndexArray, replicates: Array, load: str, style: Style) -> None:
    """Draw the median of the replicates and the limits that contain the fraction `INSIDE` of them."""
    low, middle, high = np.quantile(replicates, [0.5 - INSIDE / 2, 0.5, 0.5 + INSIDE / 2], axis=0)
    colour = style.tint(style.posterior, 0.7)
    lines = axes.vlines(x, low, high, color=colour, linewidth=3.0, zorder=3)
    lines.set(label=f"{percent(INSIDE)} of replicates, pointwise", gid=f"limits/{load}")
    (marks,) = axes.plot(x, middle, "_", color=style.posterior, markersize=8, zorder=3)
    marks.set(label="their median", gid=f"median/{load}")
