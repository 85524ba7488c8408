"""Predictive checks of the ratings, and uniformity of ranks: of leave-one-out predictions and of a calibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.defaults import LEVELS, LIMITS
from softness_bayes.base.errors import InputError
from softness_bayes.base.readable import counted
from softness_bayes.plotting import stored
from softness_bayes.plotting.data import name_rows
from softness_bayes.plotting.panels import (
    MODULUS_LABEL,
    Array,
    fitting,
    legend_below,
    make_panels,
    number_ticks,
    say_grouped,
    short_name,
)
from softness_bayes.plotting.style import USUAL, Style, styled

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from softness_bayes.checking.quantities import QuantityCheck

QUANTITY_LABELS: Mapping[str, str] = MappingProxyType(
    {
        "turns over": "turns over [–]",
        "inflection e_fab_kpa": "turning point [kPa]",
        "drop beyond inflection": "drop [{scale}]",
        "spread of participants": "spread of participants [{scale}]",
        "residual spread": "residual spread [{scale}]",
        "largest residual / sd": "largest residual / sd [–]",
        "smallest residual / sd": "smallest residual / sd [–]",
    }
)
"""Axis labels of the test quantities; `scale` is replaced by the unit of the additive rating scale."""

BINS = 24
"""Number of bins in the histogram of a test quantity."""

LONGEST_TITLE = 20
"""Number of characters of a quantity's name that fit into one line above its panel."""

MOST_OUTSIDE = 6
"""Largest number of fabrics outside their limits that are named in a panel."""

FEW = 30
"""Smallest number of replicates for a histogram; fewer replicates are drawn as separate ticks."""


def checks(result: stored.Drawable, style: Style) -> Figure:
    """Draw observed mean ratings with the limits of the replicates, and histograms of test quantities.

    The bars contain 90 % of the replicates simultaneously over all conditions. Fabrics outside their bars are named.
    The histograms show the replicates for which a quantity is defined. If there are fewer than `FEW`, each one
    is drawn as a tick. A quantity that is undefined for the data and for all replicates is omitted, as are those of
    single participants. The location of a turning point is shown on a logarithmic axis.

    Returns
    -------
    Figure
        Artists named ``limits/1 mm`` and ``observed/1 mm`` (E_fab in kPa), ``observed/k``, and ``replicates/k``
        (a histogram) or ``each/k`` (ticks).

    Raises
    ------
    InputError
        If there is nothing to show.
    """
    from softness_bayes.checking.check_table import posterior_quantities
    from softness_bayes.checking.quantities import Columns

    modulus = dict(zip(stored.fabric_names(result), stored.fabric_modulus(result), strict=True))
    checked, scale = posterior_quantities(result.tree), result.scale.short
    means: dict[str, dict[str, QuantityCheck]] = {}
    quantities = []
    for one in checked:
        for (load, fabric, _), finding, values in zip(one.labels, one.findings, one.replicated.T, strict=True):
            if one.quantity.columns is Columns.CONDITION:
                means.setdefault(load, {})[fabric] = finding
            elif one.quantity.columns is not Columns.PARTICIPANT:
                label = QUANTITY_LABELS[one.quantity.name].format(scale=scale)
                quantities.append(
                    (f"{label}, {load}" if one.quantity.columns is Columns.LOAD else label, finding, values)
                )
    shown = [one for one in quantities if np.isfinite(one[1].observed) or np.isfinite(one[2]).any()]
    if not means and not shown:
        raise InputError("predictive checks: nothing to show")
    left = len(quantities) - len(shown)
    more = f"not shown, because these ratings and their replicates do not have them: {left} of {len(quantities)}"
    grid = make_panels(len(means) + len(shown), style, 1.2)
    for axes, (load, findings) in zip(grid.panels, means.items(), strict=False):
        _draw_means(axes, load, findings, np.array([modulus[name] for name in findings]), style)
    for place, (axes, (label, finding, values)) in enumerate(zip(grid.panels[len(means) :], shown, strict=True)):
        _draw_quantity(axes, finding, values, style, str(place))
        axes.set_xlabel(label)
    for axes in grid.panels[: len(means) : fitting(4, style)]:
        axes.set_ylabel(f"mean rating\n[{scale}]")
    legend_below(grid.figure, grid.panels, f"{more} quantities" if left else "")
    return say_grouped(grid.figure, result.load_groups, style, curves=False)


def _draw_means(axes: Axes, load: str, findings: Mapping[str, QuantityCheck], modulus: Array, style: Style) -> None:
    x, names = modulus / 1e3, list(findings)
    observed, low, high = np.array([(one.observed, one.low, one.high) for one in findings.values()]).T
    bars = axes.vlines(x, low, high, color=style.tint(style.posterior, 0.5), linewidth=3.0)
    bars.set(label="90 % of replicates", gid=f"limits/{load}")
    points = axes.plot(x, observed, "o", color=style.data, markersize=2.5, gid=f"observed/{load}")[0]
    points.set(label="observed", zorder=3)
    for marks in (bars, points):
        name_rows(marks, names)
    axes.set(xscale="log", title=load, xlabel=MODULUS_LABEL)
    number_ticks(axes.xaxis, narrow=True)
    for k in np.flatnonzero((observed < low) | (observed > high))[:MOST_OUTSIDE]:
        words = axes.annotate(short_name(names[k]), (x[k], observed[k]), (0, 4), textcoords="offset points")
        words.set(ha="center", fontsize=style.small, color=style.data, gid=f"name/{load}/{names[k]}")


def _draw_quantity(axes: Axes, finding: QuantityCheck, replicates: Array, style: Style, gid: str) -> None:
    known, seen = replicates[np.isfinite(replicates)], finding.observed
    every = np.append(known, seen) if np.isfinite(seen) else known
    yes_or_no = bool(np.isin(every, (0.0, 1.0)).all())
    low, high = (float(every.min()), float(every.max())) if every.size else (0.0, 1.0)
    wide = low > 0 and high > 10 * low
    if yes_or_no:
        edges = np.array([-0.5, 0.5, 1.5])
    elif wide:
        edges = np.geomspace(low, high, BINS + 1)
    else:
        spare = 0.5 * (low == high)
        edges = np.linspace(low - spare, high + spare, BINS + 1)
    if known.size < FEW and not yes_or_no:
        marks: Artist = axes.vlines(known, 0.0, 0.4, color=style.tint(style.posterior, 0.7), linewidth=0.8)
        marks.set(gid=f"each/{gid}", label="a single replicate")
        top = 1.0
    else:
        heights = np.histogram(known, edges)[0] / max(known.size, 1)
        marks = axes.stairs(heights, edges, fill=True, color=style.tint(style.posterior, 0.5))
        marks.set(gid=f"replicates/{gid}", label="replicates")
        top = float(heights.max())
    if np.isfinite(seen):
        axes.axvline(seen, color=style.data, linewidth=1.2, gid=f"observed/{gid}", label="of the data")
    note = f"p = {finding.p_value:.2f}" if np.isfinite(finding.p_value) else "not in the data"
    if known.size < replicates.size:
        note += f"\nin {known.size} of {replicates.size} replicates"
    words = axes.text(0.98, 0.99, note, transform=axes.transAxes, ha="right", va="top", fontsize=style.small)
    words.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1})
    axes.set(yticks=(), xscale="log" if wide else "linear")
    axes.set_ylim(0.0, (1.7 if "\n" in note else 1.3) * top or 1.0)  # space for the text
    axes.spines["left"].set_visible(False)
    if yes_or_no:
        axes.set_xticks((0, 1), ("no", "yes"))
    elif wide:
        number_ticks(axes.xaxis, narrow=True)


def loo_pit(result: stored.Drawable, style: Style) -> Figure:
    """Draw the distribution function of LOO-PIT values minus the uniform one, with simultaneous limits of 90 %.

    The limits assume independent values. LOO-PIT values are dependent, so the limits are approximate and slightly
    too wide.

    Returns
    -------
    Figure
        Artists named ``ecdf`` and ``band``.
    """
    from softness_bayes.checking.check_table import LOO_PIT, PIT_POINTS

    pit = result.group("constant_data")[LOO_PIT].values
    grid = make_panels(1, style, 1.7, 1, "LOO-PIT [–]", "ECDF − uniform [–]", narrow=True)
    (axes,) = grid.panels
    share = np.searchsorted(np.sort(pit), PIT_POINTS, side="right") / pit.size
    band, line = _draw_ecdf(axes, PIT_POINTS, share, pit.size, LEVELS[-1], style)
    band.set(gid="band", label="90 % of independent ones: approximate for ratings")
    line.set(gid="ecdf", label="leave-one-out probability integral transform (LOO-PIT) of the ratings")
    axes.axhline(0.0, color=style.prior, linewidth=0.6)
    axes.set_xlim(0, 1)
    grid.figure.legend(loc="outside lower center")
    return grid.figure


@styled
def rank_ecdf_figure(ranks: ArrayLike, draws: int, labels: Sequence[str], *, style: Style = USUAL) -> Figure:
    """Draw the empirical distribution function of each quantity's ranks minus the uniform one, with limits.

    The limits are those of the verdict: if a curve leaves its band, the verdict reports ranks that are not uniform.
    The title of the panel then names the fault, such as intervals of the wrong width.

    Parameters
    ----------
    ranks
        Ranks from 0 to `draws`, shape (replicates, quantities).
    draws
        Number of posterior draws among which each true value was ranked.
    labels
        Names of the quantities.
    style
        Style of the figure.

    Returns
    -------
    Figure
        Lines named ``ecdf/k`` and bands named ``band/k``, k the column.

    Raises
    ------
    InputError
        If labels and ranks disagree, or a rank lies outside its range.
    """
    from softness_bayes.checking.calibration import Calibration

    ranks = np.asarray(ranks)
    if ranks.ndim != 2 or ranks.shape[1] != len(labels) or not len(ranks):
        raise InputError(f"calibration figure: ranks of shape {ranks.shape} for {len(labels)} quantities")
    if ranks.min() < 0 or ranks.max() > draws:
        raise InputError(f"calibration figure: ranks from {ranks.min()} to {ranks.max()}, expected 0 to {draws}")
    calibration = Calibration(tuple(labels), ranks, draws)
    points, faults = calibration.points, calibration.fault_of()
    grid = make_panels(len(labels), style, 1.2, ylabel="ECDF − uniform")
    for place, (axes, label) in enumerate(zip(grid.panels, labels, strict=True)):
        share = (ranks[:, place, None] < np.arange(1, draws + 1)).mean(axis=0)
        band, line = _draw_ecdf(axes, points, share, len(ranks), 1.0 - calibration.threshold, style)
        band.set_gid(f"band/{place}")
        line.set_gid(f"ecdf/{place}")
        name = label if len(label) <= LONGEST_TITLE else label.replace("[", "\n[", 1)
        fault = f": {faults[label].partition(':')[0]}" if label in faults else ""
        axes.set(title=f"{name}{fault}", xlim=(0, 1), xlabel="rank / draws")
    return grid.figure


def _draw_ecdf(
    axes: Axes, x: Array, share: Array, size: int, probability: float, style: Style
) -> tuple[PolyCollection, Line2D]:
    """Draw the distribution function of values at x minus the uniform one, with simultaneous limits; return both."""
    from softness_bayes.checking.quantities import simultaneous_band

    low, high = simultaneous_band(size, x, probability)
    tint = style.tint(style.prior, 0.4)
    area = axes.fill_between(x, low - x, high - x, step="mid", color=tint, linewidth=0)
    return area, axes.plot(x, share - x, color=style.posterior, drawstyle="steps-mid")[0]


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
        low, middle, high = np.quantile(one.replicates, LIMITS[::2], axis=0)
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
    return grid.with_legend()
