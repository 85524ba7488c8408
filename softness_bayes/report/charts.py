"""Interactive charts of response and rating with credible bands, whose contents a script switches by load and axis."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from bokeh.embed import components
from bokeh.models import BasicTickFormatter, ColumnDataSource, FixedTicker, HoverTool, Range1d
from bokeh.models.annotations import Title
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure
from bokeh.resources import Resources
from numpy.typing import NDArray

from softness_bayes.base.readable import chance, number
from softness_bayes.checking.inflection import PERCENTS
from softness_bayes.likelihood.scales import Scale
from softness_bayes.plotting.panels import TINTS, title
from softness_bayes.plotting.rating import observed_of
from softness_bayes.plotting.response import modulus_axes
from softness_bayes.plotting.style import USUAL
from softness_bayes.report.tables import share
from softness_bayes.results.result import Result

Array = NDArray[np.float64]

QUANTILES: Mapping[str, float] = {"median": 0.5, "low50": 0.25, "high50": 0.75, "low90": 0.05, "high90": 0.95}
"""Column name -> quantile: the median and the limits of the central 50 % and 90 % of the draws."""

DIGITS = 5
"""Number of significant digits in the data of a chart."""


HEIGHT = 360
"""Height of a chart [CSS pixels]; its width is that of the page."""

TURN_TINT = 0.18
"""Colour strength of the turning point's interval."""

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
INK, LINES = "#1f2933", "#d9dee3"


class Axis(NamedTuple):
    """A possible horizontal axis of a chart."""

    name: str
    label: str
    unit: str


AXES = (Axis("e_fab", "Fabric modulus E_fab [kPa]", "kPa"), Axis("ratio", "E_fab / E_skin", "times the skin"))
"""The horizontal axes: E_fab, and its ratio to the modulus of the compressed skin."""


class ChartData(NamedTuple):
    """Contents of a chart for one load and axis; every list is a column."""

    title: str
    ends: tuple[float, float]
    """Ends of the axis."""
    rate: dict[str, list[float]]
    """Response [spikes/s]: x, and a column for each of `QUANTILES`."""
    rating: dict[str, list[float]]
    """Rating of a typical participant, with the same columns."""
    fabrics: dict[str, list[Any]]
    """Columns x, name, mean rating (NaN without ratings) and its spread between participants; `foot` is 0."""
    turn: dict[str, list[float]]
    """Columns left, middle and right: 90 % interval of the turning point; empty if no draw has a turning point."""
    sentence: str
    """Description of the turning point in words."""


def chart_data(result: Result) -> dict[str, list[ChartData]]:
    """Return the contents for each load, by the name of the axis.

    Parameters
    ----------
    result
        A finished run on ratings, which stores the curves. The curves of a group of loads are those of its middle load.
    """
    curves, table, groups = result.curves(), result.inflection(), result.load_groups
    typical, ratings = result.typical_ratings(), observed_of(result)
    fabric = 1e3 * result.group("constant_data")["effective_modulus_kpa"].values
    names = [str(name) for name in result.group("constant_data")["fabric"].values]
    contents: dict[str, list[ChartData]] = {}
    for axis in AXES:
        contents[axis.name] = []
        for k, (load, on) in enumerate(zip(groups.called, modulus_axes(curves, axis.name == "ratio"), strict=True)):
            row, here, x = table.loc[str(load)], ratings.load == k, on.grid
            observed = {name: _plain(getattr(ratings, name)[here]) for name in ("mean", "low", "high")}
            contents[axis.name].append(
                ChartData(
                    title(load),
                    (float(x[0]), float(x[-1])),
                    _band(x, on.carry(curves.total_rate[:, k])),
                    _band(x, on.carry(typical[:, k])),
                    {"x": _plain(on.place(fabric)), "fabric": names, "foot": [0.0] * len(names), **observed},
                    _turn(row, "e_fab_kpa" if axis.name == "e_fab" else "ratio"),
                    _turn_sentence(title(load), row, axis),
                )
            )
    return contents


def _band(x: Array, draws: Array) -> dict[str, list[float]]:
    limits = np.quantile(draws, [*QUANTILES.values()], axis=0)
    return {"x": _plain(x), **{name: _plain(column) for name, column in zip(QUANTILES, limits, strict=True)}}


def _turn(row: Any, name: str) -> dict[str, list[float]]:
    limits = [float(row[f"{name}_low"]), float(row[name]), float(row[f"{name}_high"])]
    keys = ("left", "middle", "right")
    return {key: [value] if np.isfinite(value) else [] for key, value in zip(keys, _rounded(limits), strict=True)}


def _turn_sentence(load: str, row: Any, axis: Axis) -> str:
    likely = f"the response turns over with probability {chance(row['p_interior'])}"
    likely += f" (prior: {chance(row['prior_p_interior'])})" if np.isfinite(row["prior_p_interior"]) else ""
    name = "e_fab_kpa" if axis.name == "e_fab" else "ratio"
    if not np.isfinite(row[name]):
        return f"{load}: {likely}."
    within = share(PERCENTS[2] - PERCENTS[0])
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    limits = f"{within} interval {number(low)} to {number(high)}"
    return f"{load}: {likely}; if so at {number(row[name])} {axis.unit} ({limits})."


def _rounded(values: Any) -> Array:
    return np.array([float(f"{value:.{DIGITS}g}") for value in np.asarray(values, float)])


def _plain(values: Any) -> list[float]:
    """Return rounded numbers as a list of Python floats."""
    numbers: list[float] = _rounded(values).tolist()
    return numbers


class Charts(NamedTuple):
    """HTML elements embedded in the page."""

    library: str
    """Element that contains the complete JavaScript library of the charts."""
    script: str
    """Element that draws the charts."""
    places: dict[str, str]
    """Chart name -> element in which the chart is drawn."""


def charts(first: ChartData, every: list[ChartData], scale: Scale) -> Charts:
    """Return the charts of response and rating in their initial state.

    Parameters
    ----------
    first
        Initial contents.
    every
        All possible contents. They determine the common axes, so that loads can be compared.
    scale
        Scale of the ratings.
    """
    rate = _chart("rate", first, "Total rate [spikes/s]", (0.0, 1.06 * _reach(every, "rate")[1]), "linear")
    low, high = _reach(every, "rating")
    low, high = scale.additive([low, high])
    margin = 0.06 * (high - low)
    low, high = scale.natural([low - margin, high + margin]).tolist()
    rating = _chart("rating", first, scale.label.capitalize(), (low, high), scale.axis)
    _fabrics(rate, first, foot=True)
    _fabrics(rating, first, foot=False)
    script, places = _numbered(*components({"rate": rate, "rating": rating}))
    return Charts(Resources("inline", components=["bokeh"]).render_js(), script, places)


def _numbered(script: str, places: dict[str, str]) -> tuple[str, dict[str, str]]:
    """Return a script and its elements with numbers for Bokeh's identifiers, which no two pages have in common."""
    random = re.compile(r"\b[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\b")
    models = re.compile(r'(?<="id":)"(p\d+)"')  # in the document; text of the data has no unescaped quotes
    number = {name: f"page-{k}" for k, name in enumerate(dict.fromkeys(random.findall(script)))}
    number |= {name: f"p{k}" for k, name in enumerate(dict.fromkeys(models.findall(script)))}
    document, drawing, items = script.partition("const render_items")
    document = models.sub(lambda found: f'"{number[found[1]]}"', random.sub(lambda found: number[found[0]], document))

    def numbered(text: str) -> str:
        return re.sub(r"[\w-]+", lambda found: number.get(found[0], found[0]), text)

    return document + drawing + numbered(items), {name: numbered(place) for name, place in places.items()}


def _reach(every: list[ChartData], what: str) -> tuple[float, float]:
    """Return the common range of all bands and, for ratings, of the data."""
    values = [getattr(one, what)[name] for one in every for name in ("low90", "high90")]
    if what == "rating":
        values += [one.fabrics[name] for one in every for name in ("mean", "low", "high")]
    low, high = float(np.nanmin(np.concatenate(values))), float(np.nanmax(np.concatenate(values)))
    return low, high if high > low else low + 1.0


def _chart(
    name: str, first: ChartData, label: str, ends: tuple[float, float], axis: Literal["log", "linear"]
) -> figure:
    """Return a chart of one quantity; the names of its Bokeh models begin with this quantity, as in ``rate/band``."""
    heading = Title(text=first.title, text_font=FONT, text_font_size="15px", text_color=INK)
    chart = blank_chart(
        AXES[0].label, label, name=name, height=HEIGHT, title=heading, x_axis_type="log", y_axis_type=axis
    )
    chart.x_range = Range1d(start=first.ends[0], end=first.ends[1])
    chart.y_range = Range1d(start=ends[0], end=ends[1])
    band = ColumnDataSource(dict(getattr(first, name)), name=f"{name}/band")
    turn = ColumnDataSource(dict(first.turn), name=f"{name}/turn")
    add_bands(chart, band, turn)
    chart.vspan(x="middle", source=turn, color=USUAL.inflection, line_width=2)
    line = chart.line(x="x", y="median", source=band, color=USUAL.posterior, line_width=2.5, name="median")
    rows = [("at", "@x{0.[000]}"), ("median", "@median{0.[00]}")]
    rows += [(f"{level} %", f"@low{level}{{0.[00]}} to @high{level}{{0.[00]}}") for level in ("50", "90")]
    chart.add_tools(HoverTool(renderers=[line], mode="vline", tooltips=rows, name=f"{name}/hover"))
    if axis == "log":
        plain_ticks(chart)
    return chart


def add_bands(chart: figure, band: ColumnDataSource, turn: ColumnDataSource) -> None:
    """Shade the credible bands of 50 % and 90 %, and the interval of the turning point, in a chart."""
    chart.vstrip(x0="left", x1="right", source=turn, color=USUAL.inflection, alpha=TURN_TINT)
    for level, tint in (("90", TINTS[1]), ("50", TINTS[0])):
        look: Any = {"fill_color": USUAL.posterior, "fill_alpha": tint}
        chart.varea(x="x", y1=f"low{level}", y2=f"high{level}", source=band, **look)


def add_ratings(chart: figure, source: ColumnDataSource) -> GlyphRenderer[Any]:
    """Mark mean ratings with their spread between participants in a chart; return the marks of the means."""
    chart.segment(x0="x", x1="x", y0="low", y1="high", source=source, color=USUAL.data, line_width=1.5, alpha=0.6)
    return chart.scatter(x="x", y="mean", source=source, size=8, color=USUAL.data)


def plain_ticks(chart: figure) -> None:
    """Write plain numbers along a logarithmic axis of values: 1, 2, 5, 10 and so on."""
    chart.yaxis.ticker = FixedTicker(ticks=[n * 10.0**k for k in range(-6, 9) for n in (1, 2, 5)])
    chart.yaxis.formatter = BasicTickFormatter(use_scientific=False)


def _fabrics(chart: figure, first: ChartData, foot: bool) -> None:
    """Mark the fabrics along the bottom of a chart, or at their ratings with the spread between participants."""
    source = ColumnDataSource(dict(first.fabrics), name=f"{chart.name}/fabrics")
    if foot:
        marks = chart.scatter(x="x", y="foot", source=source, marker="triangle", size=9, color=INK)
        rows = [("fabric", "@fabric"), ("at", "@x{0.[000]}")]
    else:
        marks = add_ratings(chart, source)
        rows = [("fabric", "@fabric"), ("at", "@x{0.[000]}"), ("mean rating", "@mean{0.[00]}")]
        rows += [("± 1 sd", "@low{0.[00]} to @high{0.[00]}")]
    chart.add_tools(HoverTool(renderers=[marks], tooltips=rows))


def blank_chart(x: str, y: str, **options: Any) -> figure:
    """Return a chart without contents in the style of the page, by the labels of its axes and options of Bokeh."""
    # set by name, because Bokeh's type hints lack these attributes of axes and tools
    usual: Any = {"sizing_mode": "stretch_width", "toolbar_location": None, "tools": ""}
    chart = figure(**usual | {"x_axis_label": x, "y_axis_label": y} | options)
    chart.background_fill_color = chart.border_fill_color = None
    chart.outline_line_color = None
    chart.xaxis.formatter = BasicTickFormatter(use_scientific=False)
    for axis in chart.axis:
        axis.axis_label_text_font, axis.axis_label_text_font_style = FONT, "normal"
        axis.axis_label_text_font_size, axis.major_label_text_font_size = "13px", "12px"
        axis.major_label_text_font = FONT
        axis.axis_label_text_color = axis.major_label_text_color = INK
        axis.axis_line_color = axis.major_tick_line_color = axis.minor_tick_line_color = "#8a96a3"
    chart.grid.grid_line_color = LINES
    return chart
