"""Predictive checks of categorical ratings and of paired comparisons, with psychometric curves for the pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.plotting import stored
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.names import short_name
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    Array,
    legend_below,
    make_panels,
    number_ticks,
    say_grouped,
)
from softness_bayes.plotting.style import Style
from softness_bayes.readable import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

IndexArray = NDArray[np.intp]


class Answers(NamedTuple):
    """Summary of the answers under one load along one axis, for the data and for replicates."""

    load: str
    """Name of the load."""
    title: str
    """Title of the panel."""
    x: Array
    """Categories, or E_fab of the fabrics [kPa], shape (points,)."""
    observed: Array
    """Number or share of answers, shape (points,)."""
    replicates: Array
    """The same for the replicates, shape (replicates, points)."""
    fabrics: Sequence[str] = ()
    """Names of the fabrics; none for categories."""


def category_counts(result: stored.Drawable, style: Style) -> Figure:
    """Draw the number of ratings in each category."""
    observed, again = stored.answers(result)
    categories = np.arange(1, int(max(observed.max(), again.max())) + 1)
    return _draw_by_load(
        result,
        style,
        stored.rated_load(result),
        lambda name, here: counts_of(name, categories, observed[here], again[:, here]),
    )


def psychometric(result: stored.Drawable, style: Style) -> Figure:
    """Draw the answers to pairs that contain the most frequently compared fabric."""
    constant = result.group("constant_data")
    fallback = constant["participant_index"].values * len(result.loads) + constant["load_index"].values
    rows = rows_of_pairs(constant["list_index"].values if "list_index" in constant else fallback)
    observed, again = (values[..., rows[:, 0]] for values in stored.answers(result))
    fabric, fabrics = constant["fabric_index"].values[rows], stored.fabric_names(result)
    modulus = stored.fabric_modulus(result)
    return _draw_by_load(
        result,
        style,
        stored.rated_load(result)[rows[:, 0]],
        lambda name, here: wins_of(name, fabrics, modulus, fabric[here], observed[here], again[:, here]),
    )


def _draw_by_load(
    result: stored.Drawable, style: Style, load: IndexArray, answers_of: Callable[[str, NDArray[np.bool_]], Answers]
) -> Figure:
    """Draw the answers of every load; `load` has the index of that of each answer."""
    here = ((name, load == k) for k, name in enumerate(result.load_groups.names))
    figure = _draw_answers([answers_of(name, some) for name, some in here if some.any()], style)
    return say_grouped(figure, result.load_groups, style, curves=False)


def counts_of(load: str, categories: IndexArray, observed: Array, replicates: Array) -> Answers:
    """Return the number of ratings in each category.

    Parameters
    ----------
    load
        Name of the load.
    categories
        The categories, shape (categories,).
    observed, replicates
        Categories of the ratings under this load, shapes (rows,) and (replicates, rows).
    """
    seen, again = (
        np.stack([(values == one).sum(axis=-1) for one in categories], axis=-1).astype(float)
        for values in (observed, replicates)
    )
    return Answers(load, load, categories.astype(float), seen, again)


def rows_of_pairs(lists: IndexArray) -> IndexArray:
    """Return the two rows of each pair, shape (pairs, 2): rows of the same list. Lists of one row are omitted."""
    order = np.argsort(lists, kind="stable")
    first = np.flatnonzero(lists[order][1:] == lists[order][:-1])
    return np.stack([order[first], order[first + 1]], axis=1)


def wins_of(
    load: str, names: Sequence[str], modulus: Array, pairs: IndexArray, observed: Array, replicates: Array
) -> Answers:
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
        The same for the replicates, shape (replicates, pairs).
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
    share = member / member.sum(axis=1)[:, None]
    softer, again = (np.where(first, values, 1.0 - values) for values in (observed[against], replicates[:, against]))
    title = f"{load}, against {short_name(names[standard])} ({counted(int(member.sum()), 'answer')})"
    called = [names[k] for k in fabrics]
    return Answers(load, title, modulus[fabrics] / 1e3, share @ softer, again @ share.T, called)


def _draw_answers(answers: Sequence[Answers], style: Style) -> Figure:
    """Draw the number of ratings in each category as bars, or shares of pairs as points, with limits of the replicates.

    The limits contain 90 % of the replicates, for each category or fabric separately. Artists are named
    ``observed/1 mm``, ``limits/1 mm`` and ``median/1 mm`` (E_fab in kPa).
    """
    pairs = bool(len(answers[0].fabrics))
    ylabel = "called softer [share]" if pairs else "number of ratings"
    grid = make_panels(len(answers), style, 1.6, min(len(answers), 3), ylabel=ylabel)
    for axes, one in zip(grid.panels, answers, strict=True):
        low, middle, high = np.quantile(one.replicates, [0.05, 0.5, 0.95], axis=0)
        lines = axes.vlines(one.x, low, high, color=style.tint(style.posterior, 0.7), linewidth=3.0, zorder=3)
        lines.set(label="90 % of replicates, pointwise", gid=f"limits/{one.load}")
        (marks,) = axes.plot(one.x, middle, "_", color=style.posterior, markersize=8, zorder=3)
        marks.set(label="their median", gid=f"median/{one.load}")
        axes.set_title(one.title)
        if pairs:
            points = axes.plot(one.x, one.observed, "o", color=style.data, markersize=3, label="observed", zorder=4)[0]
            points.set_gid(f"observed/{one.load}")
            name_rows(points, one.fabrics)
            axes.axhline(0.5, color=style.prior, linewidth=0.6)
            axes.set(xlabel=MODULUS_LABEL, xscale="log", ylim=(-0.05, 1.05))
            number_ticks(axes.xaxis)
        else:
            bars = axes.bar(one.x, one.observed, color=style.tint(style.data, 0.3), label="observed")
            for bar in bars:
                bar.set_gid(f"observed/{one.load}")
            axes.set(xlabel="category", xticks=one.x, ylim=(0.0, None))
    legend_below(grid.figure, grid.panels)
    return grid.figure
