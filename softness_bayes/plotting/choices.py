"""Predictive checks of categorical ratings and of paired comparisons, with psychometric curves for the pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.plotting import stored
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.names import short_name
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    Array,
    Panels,
    legend_below,
    make_panels,
    number_ticks,
    say_grouped,
)
from softness_bayes.plotting.style import USUAL, Style, styled
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


def category_counts(result: stored.Drawable, style: Style) -> Figure:
    """Draw the number of ratings in each category."""
    load, (observed, again) = stored.rated_load(result), stored.answers(result)
    most = int(max(observed.max(), again.max()))
    counts = [
        counts_of(name, observed[load == k], again[:, load == k], most)
        for k, name in enumerate(result.load_groups.names)
        if (load == k).any()
    ]
    return say_grouped(categories_figure(counts, style=style), result.load_groups, style, curves=False)


def psychometric(result: stored.Drawable, style: Style) -> Figure:
    """Draw the answers to pairs that contain the most frequently compared fabric."""
    constant = result.group("constant_data")
    fallback = constant["participant_index"].values * len(result.loads) + constant["load_index"].values
    rows = rows_of_pairs(constant["list_index"].values if "list_index" in constant else fallback)
    observed, again = (values[..., rows[:, 0]] for values in stored.answers(result))
    load, fabric = stored.rated_load(result)[rows[:, 0]], constant["fabric_index"].values[rows]
    names, modulus = stored.fabric_names(result), stored.fabric_modulus(result)
    wins = [
        wins_of(name, names, modulus, fabric[load == k], observed[load == k], again[:, load == k])
        for k, name in enumerate(result.load_groups.names)
        if (load == k).any()
    ]
    return say_grouped(psychometric_figure(wins, style=style), result.load_groups, style, curves=False)


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
    counts = [(replicates == category).sum(axis=1) for category in each]
    return Counts(load, (observed == each[:, None]).sum(axis=1).astype(float), np.stack(counts, axis=1).astype(float))


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


@styled
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
    grid = _panels(len(counts), "number of ratings", style)
    for axes, one in zip(grid.panels, counts, strict=True):
        category = np.arange(1, one.observed.size + 1)
        bars = axes.bar(category, one.observed, color=style.tint(style.data, 0.3), label="observed")
        for bar in bars:
            bar.set_gid(f"observed/{one.load}")
        _limits(axes, category, one.replicates, one.load, style)
        axes.set(title=one.load, xlabel="category", xticks=category, ylim=(0.0, None))
    legend_below(grid.figure, grid.panels)
    return grid.figure


@styled
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
    grid = _panels(len(wins), "called softer [share]", style)
    for axes, one in zip(grid.panels, wins, strict=True):
        x = one.modulus / 1e3
        _limits(axes, x, one.replicates, one.load, style)
        points = axes.plot(x, one.observed, "o", color=style.data, markersize=3, label="observed", zorder=4)[0]
        points.set_gid(f"observed/{one.load}")
        name_rows(points, one.fabrics)
        axes.axhline(0.5, color=style.prior, linewidth=0.6)
        axes.set_title(f"{one.load}, against {short_name(one.standard)} ({one.answers.sum()} answers)")
        axes.set(xlabel=MODULUS_LABEL, xscale="log", ylim=(-0.05, 1.05))
        number_ticks(axes.xaxis)
    legend_below(grid.figure, grid.panels)
    return grid.figure


def _panels(count: int, ylabel: str, style: Style) -> Panels:
    """Return a figure with the given number of panels; raise an error if the number is zero."""
    if not count:
        raise InputError("figure: no load has answers to show")
    return make_panels(count, style, 1.6, min(count, 3), ylabel=ylabel)


def _limits(axes: Axes, x: Array | IndexArray, replicates: Array, load: str, style: Style) -> None:
    """Draw the median of the replicates and the limits that contain the fraction `INSIDE` of them."""
    low, middle, high = np.quantile(replicates, [0.5 - INSIDE / 2, 0.5, 0.5 + INSIDE / 2], axis=0)
    colour = style.tint(style.posterior, 0.7)
    lines = axes.vlines(x, low, high, color=colour, linewidth=3.0, zorder=3)
    lines.set(label=f"{percent(INSIDE)} of replicates, pointwise", gid=f"limits/{load}")
    (marks,) = axes.plot(x, middle, "_", color=style.posterior, markersize=8, zorder=3)
    marks.set(label="their median", gid=f"median/{load}")
