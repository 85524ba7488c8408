"""Charts of the page: what stays is on one canvas layer, what moves with the sliders on another.

As long as the ends of the axes stay (`limits`), a redraw repaints only the moving layer: curves, marks and receptors,
but no axis, band or grid.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, LinearColorMapper, Model, Range1d
from bokeh.models.annotations import ColorBar, Title
from bokeh.palettes import Viridis256
from bokeh.plotting import figure
from numpy.typing import NDArray

from softness_bayes.explore.limits import BothEnds, UpperEnd
from softness_bayes.explore.picture import Picture
from softness_bayes.explore.rated import Rated
from softness_bayes.explore.relay import Relay
from softness_bayes.explore.subject import Subject
from softness_bayes.parameters.fabric_moduli import KPA
from softness_bayes.plotting.panels import TINTS, title
from softness_bayes.plotting.style import USUAL
from softness_bayes.plotting.touch import SEEN
from softness_bayes.report.charts import INK, TURN_TINT, dress, plain_ticks

MODULUS_WORDS = "fabric modulus E_fab [kPa]"

LEAST_RATE = 1e-9
"""Lowest rate drawn in colour [Hz]: receptors that do not fire stay open circles."""

ROUND = np.linspace(0.0, 2.0 * np.pi, 97)
"""Angles of the points that outline the contact."""

BELOW_ZERO = 0.04
"""Share of an axis below zero, so that a line at zero stays visible."""

HEIGHT = 290
"""Height of a chart [CSS pixels]."""

PAD_HEIGHT, LONGEST_PAD, PAD_BESIDE = 219, 420, 122
"""Height of the pad's frame in a chart and its largest width, to scale; width of axis and colours [CSS pixels]."""

MOVING: Any = {"level": "overlay"}
"""Option of a glyph on the layer that each redraw repaints."""

BANDS = ("low50", "high50", "low95", "high95")


class Charts:
    """The charts of a subject, without contents until `draw`.

    Parameters
    ----------
    subject
        The model to explore.
    """

    figures: dict[str, figure]
    """The charts by name."""
    models: dict[str, Model]
    """By name, the models that a relay changes: sources, titles, ranges, and the scale of colours."""

    def __init__(self, subject: Subject) -> None:
        self.subject, self.models, self._load = subject, {}, -1
        rated = subject.rated
        for name, place in (("curve", "x"), ("others", "xs"), ("touched", "x")):
            self._source(name, place, *(["rate", "rating"] if rated is not None else ["rate"]))
        self._source("turn", "x")
        self.figures = {"rate": self._curves("rate", "total rate [spikes/s]", "linear")}
        if rated is not None:
            self.figures["rating"] = self._ratings(rated)
        self.figures |= {"firing": self._firing(), "pad": self._pad()}
        self._ends = {name: UpperEnd() for name in ("rate", "distances", "firing", "colours")}
        self._behind = 0.0 if rated is None else float(np.nanmax([_reach(one.rate) for one in rated.shown]))
        self._rating_ends = None if rated is None else _rating_ends(rated)

    @property
    def sources(self) -> dict[str, ColumnDataSource]:
        """The columns of the charts by name."""
        return {name: model for name, model in self.models.items() if isinstance(model, ColumnDataSource)}

    def forget(self) -> None:
        """Let the next picture alone determine the ends of the axes."""
        for end in self._ends.values():
            end.forget()
        if self._rating_ends is not None:
            self._rating_ends.forget()

    # contents

    def draw(self, relay: Relay, load: int, found: Picture) -> None:
        """Put a picture, under a load, into a relay."""
        curves = {"rate": found.rate} if found.rating is None else {"rate": found.rate, "rating": found.rating}
        here = {"rate": found.chosen["total_rate_hz"], "rating": found.chosen.get("typical_rating")}
        relay.put("curve", x=found.modulus, **{name: values[load] for name, values in curves.items()})
        others = {name: np.delete(values, load, axis=0) for name, values in curves.items()}
        relay.put("others", xs=np.tile(found.modulus, (len(found.rate) - 1, 1)), **others)
        relay.put("turn", x=found.turn[[load]][np.isfinite(found.turn[[load]])])
        relay.put("touched", x=np.array([found.chosen["e_fab_kpa"]]), **{n: np.array([here[n]]) for n in curves})
        self._end(relay, "rate", max(float(found.rate.max()), self._behind))
        if self._rating_ends is not None and found.rating is not None:
            start, end = self._rating_ends.of(found.rating)
            relay.set("rating range", "start", start)
            relay.set("rating range", "end", end)
        if self._load != load:
            self._draw_load(relay, load)
        self._draw_receptors(relay, found)

    def _end(self, relay: Relay, name: str, largest: float) -> float:
        end = self._ends[name].of(largest)
        relay.set(f"{name} range", "end", end)
        if name != "distances":
            relay.set(f"{name} range", "start", -BELOW_ZERO * end)
        return end

    def _draw_load(self, relay: Relay, load: int) -> None:
        """Name the load in the titles, and show the run's bands and data for this load behind the curves."""
        names = [name for name in ("rate", "rating") if name in self.figures]
        for name in names:
            relay.set(f"{name} title", "text", title(self.subject.loads[load]))
        if self.subject.rated is not None:
            shown = self.subject.rated.shown[load]
            for name in names:
                relay.put(f"{name}/band", **_numbers(getattr(shown, name)))
                relay.put(f"{name}/turn", **_numbers(shown.turn))
            relay.put("data", **_numbers({key: shown.fabrics[key] for key in ("x", "mean", "low", "high")}))
        self._load = load

    def _draw_receptors(self, relay: Relay, found: Picture) -> None:
        seen = found.distance[found.stress > SEEN * found.stress.max()]
        end = self._end(relay, "distances", float(seen.max(initial=found.distance[1])))
        x = np.append(found.distance[found.distance < end], end)  # nothing clips a curve on the moving layer
        relay.put("firing", x=x, rate=np.interp(x, found.distance, found.firing))
        self._end(relay, "firing", float(found.firing.max()))
        x, y = self.subject.receptors.T * 1e3
        relay.put("receptors", x=x, y=y)
        fires = found.receptors >= LEAST_RATE
        relay.put("firing receptors", x=x[fires], y=y[fires], rate=found.receptors[fires])
        highest = self._ends["colours"].of(float(found.firing.max()))
        for name in ("colours", "bar colours"):
            relay.set(name, "high", highest)
        relay.put("contact", **self._outline(found.chosen["contact_radius_mm"]))

    def _outline(self, radius: float) -> dict[str, NDArray[np.float64]]:
        """Return the outline of the contact on the pad [mm]; NaN outside the pad."""
        finger, centre = self.subject.finger, np.asarray(self.subject.finger.contact_centre)
        size = np.array([finger.pad_length, finger.pad_width]) * 1e3
        places = centre * 1e3 + radius * np.stack([np.cos(ROUND), np.sin(ROUND)], axis=1)
        places[((places < 0.0) | (places > size)).any(axis=1)] = np.nan
        return {"x": places[:, 0], "y": places[:, 1]}

    # the charts

    def _source(self, name: str, *keys: str) -> ColumnDataSource:
        found = ColumnDataSource({key: [] for key in keys}, name=name)
        self.models[name] = found
        return found

    def _range(self, name: str, start: float = 0.0) -> Range1d:
        found = Range1d(start=start, end=1.0)
        self.models[f"{name} range"] = found
        return found

    def _curves(self, name: str, label: str, axis: str) -> figure:
        heading = self.models[f"{name} title"] = Title(text="")
        chart = _figure(heading, MODULUS_WORDS, label, x_axis_type="log", y_axis_type=axis)
        chart.x_range = Range1d(start=self.subject.ends[0] / KPA, end=self.subject.ends[1] / KPA)
        chart.y_range = self._range(name, 0.1)  # a logarithmic axis cannot begin at zero
        if self.subject.rated is not None:
            self._bands(chart, name)
        if axis == "log":
            plain_ticks(chart)
        others, curve, turn, touched = (self.sources[key] for key in ("others", "curve", "turn", "touched"))
        chart.multi_line("xs", name, source=others, color=USUAL.absent, line_width=1, **MOVING)
        chart.line("x", name, source=curve, color=INK, line_width=2.5, **MOVING)
        chart.vspan(x="x", source=turn, color=USUAL.inflection, line_width=2, line_dash="dashed", **MOVING)
        chart.scatter("x", name, source=touched, marker="diamond", size=13, color=INK, **MOVING)
        return chart

    def _bands(self, chart: figure, name: str) -> None:
        """Draw the turning point's interval and the credible bands of a run."""
        turn = self._source(f"{name}/turn", "left", "middle", "right")
        chart.vstrip(x0="left", x1="right", source=turn, color=USUAL.inflection, alpha=TURN_TINT)
        band = self._source(f"{name}/band", "x", "median", *BANDS)
        for level, tint in (("95", TINTS[1]), ("50", TINTS[0])):
            low, high = f"low{level}", f"high{level}"
            chart.varea(x="x", y1=low, y2=high, source=band, fill_color=USUAL.posterior, fill_alpha=tint)

    def _ratings(self, rated: Rated) -> figure:
        chart = self._curves("rating", rated.scale.label, rated.scale.axis)
        data = self._source("data", "x", "mean", "low", "high")
        chart.segment(x0="x", x1="x", y0="low", y1="high", source=data, color=USUAL.data, alpha=0.6)
        chart.scatter(x="x", y="mean", source=data, size=8, color=USUAL.data)
        return chart

    def _firing(self) -> figure:
        heading = Title(text="Receptors by distance")
        chart = _figure(heading, "distance from the contact's axis [mm]", "firing rate of a receptor [Hz]")
        chart.x_range, chart.y_range = self._range("distances"), self._range("firing")
        chart.line("x", "rate", source=self._source("firing", "x", "rate"), color=INK, line_width=2, **MOVING)
        return chart

    def _pad(self) -> figure:
        long, wide = self.subject.finger.pad_length * 1e3, self.subject.finger.pad_width * 1e3
        chart = _figure(Title(text="Receptors of the pad"), "along the finger [mm]", "across [mm]")
        chart.sizing_mode = "fixed"
        chart.width = min(round(PAD_HEIGHT * long / wide), LONGEST_PAD) + PAD_BESIDE
        chart.x_range, chart.y_range = Range1d(start=0.0, end=long), Range1d(start=0.0, end=wide)
        # two mappers, because Bokeh repaints a colour bar whenever its mapper has coloured receptors
        colours, bar_colours = (LinearColorMapper(palette=Viridis256, low=0.0, high=1.0) for _ in range(2))
        self.models |= {"colours": colours, "bar colours": bar_colours}
        fill: Any = {"field": "rate", "transform": colours}
        drawn: Any = {"size": 6, "line_color": USUAL.absent, "line_width": 0.5}
        chart.scatter("x", "y", source=self._source("receptors", "x", "y"), fill_color=None, **drawn)
        firing = self._source("firing receptors", "x", "y", "rate")
        chart.scatter("x", "y", source=firing, fill_color=fill, **drawn, **MOVING)
        chart.line("x", "y", source=self._source("contact", "x", "y"), color=INK, **MOVING)
        chart.add_layout(ColorBar(color_mapper=bar_colours, title="Hz", background_fill_color=None), "right")
        return chart


def _figure(heading: Title, x: str, y: str, **options: Any) -> figure:
    # set by name, because Bokeh's type hints lack these attributes of axes and tools
    options |= {"tools": "", "x_axis_label": x, "y_axis_label": y}
    chart = figure(title=heading, height=HEIGHT, sizing_mode="stretch_width", toolbar_location=None, **options)
    dress(chart)
    return chart


def _numbers(columns: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    return {name: np.asarray(column, float) for name, column in columns.items()}


def _reach(band: Mapping[str, Any]) -> float:
    return float(np.nanmax(band["high95"]))


def _rating_ends(rated: Rated) -> BothEnds:
    """Return the ends of the axis of ratings: those of bands and data under all loads, and of a state's curves."""
    behind = [one.rating[name] for one in rated.shown for name in BANDS]
    behind += [one.fabrics[name] for one in rated.shown for name in ("mean", "low", "high")]
    return BothEnds(np.concatenate([np.asarray(column, float) for column in behind]), *_transformation(rated))


def _transformation(rated: Rated) -> Any:
    """Return the transformation in which the axis of ratings is linear, and its inverse."""
    return (np.log, np.exp) if rated.scale.axis == "log" else (np.asarray, np.asarray)
