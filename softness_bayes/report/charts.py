"""Interactive charts of response and rating with credible bands; a script switches their contents."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from bokeh.embed import components
from bokeh.models import BasicTickFormatter, ColumnDataSource, FixedTicker, HoverTool, Range1d
from bokeh.models.annotations import Title
from bokeh.plotting import figure
from bokeh.resources import Resources

from softness_bayes.likelihood.scales import Scale
from softness_bayes.plotting.panels import TINTS
from softness_bayes.plotting.style import USUAL
from softness_bayes.report.curves import AXES, Shown

HEIGHT = 360
"""Height of a chart [CSS pixels]; its width is that of the page."""

TURN_TINT = 0.18
"""Colour strength of the turning point's interval."""

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
INK, LINES = "#1f2933", "#d9dee3"


class Charts(NamedTuple):
    """HTML elements embedded in the page."""

    library: str
    """Element that contains the complete JavaScript library of the charts."""
    script: str
    """Element that draws the charts."""
    places: dict[str, str]
    """Chart name -> element in which the chart is drawn."""


def charts(first: Shown, every: list[Shown], scale: Scale) -> Charts:
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
    for chart in (rate, rating):
        dress(chart)
    script, places = components({"rate": rate, "rating": rating})
    return Charts(Resources("inline", components=["bokeh"]).render_js(), script, places)


def _reach(every: list[Shown], what: str) -> tuple[float, float]:
    """Return the common range of all bands and, for ratings, of the data."""
    values = [getattr(one, what)[name] for one in every for name in ("low95", "high95")]
    if what == "rating":
        values += [one.fabrics[name] for one in every for name in ("mean", "low", "high")]
    low, high = float(np.nanmin(np.concatenate(values))), float(np.nanmax(np.concatenate(values)))
    return low, high if high > low else low + 1.0


def _chart(name: str, first: Shown, label: str, ends: tuple[float, float], axis: Literal["log", "linear"]) -> figure:
    """Return a chart of one quantity; the names of its Bokeh models begin with this quantity, as in ``rate/band``."""
    # by name, because Bokeh's type hints lack the attributes of axes and tools
    options: dict[str, Any] = {
        "x_axis_type": "log",
        "y_axis_type": axis,
        "x_axis_label": AXES[0].label,
        "y_axis_label": label,
        "tools": "",
    }
    chart = figure(
        name=name,
        height=HEIGHT,
        sizing_mode="stretch_width",
        x_range=Range1d(start=first.ends[0], end=first.ends[1]),
        y_range=Range1d(start=ends[0], end=ends[1]),
        title=Title(text=first.title, text_font=FONT, text_font_size="15px", text_color=INK),
        toolbar_location=None,
        **options,
    )
    band = ColumnDataSource(dict(getattr(first, name)), name=f"{name}/band")
    turn = ColumnDataSource(dict(first.turn), name=f"{name}/turn")
    chart.vstrip(x0="left", x1="right", source=turn, color=USUAL.inflection, alpha=TURN_TINT)
    chart.vspan(x="middle", source=turn, color=USUAL.inflection, line_width=2)
    for level, tint in (("95", TINTS[1]), ("50", TINTS[0])):
        chart.varea(
            x="x",
            y1=f"low{level}",
            y2=f"high{level}",
            source=band,
            fill_color=USUAL.posterior,
            fill_alpha=tint,
        )
    line = chart.line(x="x", y="median", source=band, color=USUAL.posterior, line_width=2.5, name="median")
    rows = [("at", "@x{0.[000]}"), ("median", "@median{0.[00]}")]
    rows += [(f"{level} %", f"@low{level}{{0.[00]}} to @high{level}{{0.[00]}}") for level in ("50", "95")]
    chart.add_tools(HoverTool(renderers=[line], mode="vline", tooltips=rows, name=f"{name}/hover"))
    if axis == "log":
        plain_ticks(chart)
    return chart


def plain_ticks(chart: figure) -> None:
    """Write plain numbers along a logarithmic axis of values: 1, 2, 5, 10 and so on."""
    chart.yaxis.ticker = FixedTicker(ticks=[n * 10.0**k for k in range(-6, 9) for n in (1, 2, 5)])
    chart.yaxis.formatter = BasicTickFormatter(use_scientific=False)


def _fabrics(chart: figure, first: Shown, foot: bool) -> None:
    """Mark the fabrics along the bottom of a chart, or at their ratings with the spread between participants."""
    source = ColumnDataSource(dict(first.fabrics), name=f"{chart.name}/fabrics")
    if foot:
        marks = chart.scatter(x="x", y="foot", source=source, marker="triangle", size=9, color=INK)
        rows = [("fabric", "@fabric"), ("at", "@x{0.[000]}")]
    else:
        chart.segment(x0="x", x1="x", y0="low", y1="high", source=source, color=USUAL.data, line_width=1.5, alpha=0.6)
        marks = chart.scatter(x="x", y="mean", source=source, size=8, color=USUAL.data)
        rows = [("fabric", "@fabric"), ("at", "@x{0.[000]}"), ("mean rating", "@mean{0.[00]}")]
        rows += [("± 1 sd", "@low{0.[00]} to @high{0.[00]}")]
    chart.add_tools(HoverTool(renderers=[marks], tooltips=rows))


def dress(chart: figure) -> None:
    """Apply the style of the page to a chart."""
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
