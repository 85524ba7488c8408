"""Charts of the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.models import ColumnDataSource, LinearColorMapper, Range1d
from bokeh.models.annotations import ColorBar
from bokeh.palettes import Viridis256
from bokeh.plotting import figure
from numpy.typing import NDArray

from softness_bayes.parameters.declared import KPA
from softness_bayes.plotting.panels import title
from softness_bayes.plotting.style import USUAL
from softness_bayes.plotting.touch import SEEN
from softness_bayes.report.charts import INK, add_bands, add_ratings, blank_chart, plain_ticks
from softness_bayes.report.explore.picture import Picture

if TYPE_CHECKING:
    from softness_bayes.report.explore.subject import Subject

MODULUS_WORDS = "fabric modulus E_fab [kPa]"
BANDS = ("low50", "high50", "low90", "high90")
ROUND = np.linspace(0.0, 2.0 * np.pi, 97)
"""Angles of the points that outline the contact."""


COLUMNS = {
    "curve": ("x", "rate", "rating"),
    "others": ("xs", "rate", "rating"),
    "touched": ("x", "rate", "rating"),
    "turn": ("x",),
    **{f"{name}/band": ("x", "median", *BANDS) for name in ("rate", "rating")},
    **{f"{name}/turn": ("left", "middle", "right") for name in ("rate", "rating")},
    "data": ("x", "mean", "low", "high"),
    "firing": ("x", "rate"),
    "receptors": ("x", "y"),
    "firing receptors": ("x", "y", "rate"),
    "contact": ("x", "y"),
}
"""Source of data in the charts -> its columns; what belongs to ratings stays empty without a run."""


class Charts:
    """The charts of a subject, without contents until `draw`.

    Parameters
    ----------
    subject
        The model to explore.
    """

    figures: dict[str, figure]
    """The charts by name."""
    sources: dict[str, ColumnDataSource]
    """The columns of the charts by name."""

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self.sources = {name: ColumnDataSource({key: [] for key in keys}, name=name) for name, keys in COLUMNS.items()}
        self.figures = {"rate": self._curves("rate", "total rate [spikes/s]", "linear")}
        if subject.rated is not None:
            self.figures["rating"] = self._curves("rating", subject.rated.scale.label, subject.rated.scale.axis)
            add_ratings(self.figures["rating"], self.sources["data"])
        rate = "firing rate of a receptor [Hz]"
        firing = _chart("distance from the contact's axis [mm]", rate, title="Receptors by distance")
        firing.line("x", "rate", source=self.sources["firing"], color=INK, line_width=2)
        self.colours = LinearColorMapper(palette=Viridis256, low=0.0, high=1.0)
        self.figures |= {"firing": firing, "pad": self._pad()}

    # contents

    def draw(self, load: int, shown: Picture) -> None:
        """Show a picture, under a load."""
        rated = self.subject.rated
        curves = {"rate": shown.rate} if shown.rating is None else {"rate": shown.rate, "rating": shown.rating}
        here = {"rate": shown.chosen["total_rate_hz"], "rating": shown.chosen.get("typical_rating")}
        self._put("curve", x=shown.modulus, **{name: values[load] for name, values in curves.items()})
        self._put("turn", x=shown.turn[[load]][np.isfinite(shown.turn[[load]])])
        self._put("touched", x=[shown.chosen["e_fab_kpa"]], **{name: [here[name]] for name in curves})
        others = {name: list(np.delete(values, load, axis=0)) for name, values in curves.items()}
        self.sources["others"].data = {"xs": [shown.modulus] * (len(shown.rate) - 1), **others}
        if rated is not None:
            self._put("data", **{key: rated.charts[load].fabrics[key] for key in COLUMNS["data"]})
        for name, values in curves.items():
            chart, columns = self.figures[name], [np.ravel(values)]
            chart.title = title(self.subject.loads[load])
            if rated is not None:
                self._put(f"{name}/band", **getattr(rated.charts[load], name))
                self._put(f"{name}/turn", **rated.charts[load].turn)
                columns += [np.asarray(getattr(one, name)[key], float) for one in rated.charts for key in BANDS]
                if name == "rating":
                    columns += [np.asarray(one.fabrics[key], float) for one in rated.charts for key in ("low", "high")]
            logarithmic = name == "rating" and rated is not None and rated.scale.axis == "log"
            chart.y_range.update(**axis_ends(np.concatenate(columns), logarithmic, from_zero=name == "rate"))
        self._draw_receptors(shown)

    def _put(self, name: str, **columns: Any) -> None:
        """Replace the columns of a source, which are numbers."""
        self.sources[name].data = {key: np.asarray(value, float) for key, value in columns.items()}

    def _draw_receptors(self, shown: Picture) -> None:
        chart, x, y = self.figures["firing"], *(self.subject.receptors.T * 1e3)
        seen = shown.distance[shown.stress > SEEN * shown.stress.max()]
        self._put("firing", x=shown.distance, rate=shown.firing)
        chart.x_range.update(start=0.0, end=step_above(float(seen.max(initial=shown.distance[1]))))
        chart.y_range.update(**axis_ends(shown.firing, from_zero=True))
        fires = shown.receptors > 1e-9  # receptors that do not fire stay open circles
        self._put("receptors", x=x, y=y)
        self._put("firing receptors", x=x[fires], y=y[fires], rate=shown.receptors[fires])
        self.colours.high = step_above(float(shown.firing.max()))
        centre = np.asarray(self.subject.finger.contact_centre)[:, None] * 1e3
        outline = centre + shown.chosen["contact_radius_mm"] * np.array([np.cos(ROUND), np.sin(ROUND)])
        self._put("contact", x=outline[0], y=outline[1])

    # the charts

    def _curves(self, name: str, label: str, axis: str) -> figure:
        """Return the chart of the response or of the rating against the modulus."""
        chart = _chart(MODULUS_WORDS, label, x_axis_type="log", y_axis_type=axis)
        chart.x_range = Range1d(start=self.subject.ends[0] / KPA, end=self.subject.ends[1] / KPA)
        if self.subject.rated is not None:
            add_bands(chart, self.sources[f"{name}/band"], self.sources[f"{name}/turn"])
        if axis == "log":
            plain_ticks(chart)
        others, curve, turn, touched = (self.sources[key] for key in ("others", "curve", "turn", "touched"))
        chart.multi_line("xs", name, source=others, color=USUAL.absent, line_width=1)
        chart.line("x", name, source=curve, color=INK, line_width=2.5)
        chart.vspan(x="x", source=turn, color=USUAL.inflection, line_width=2, line_dash="dashed")
        chart.scatter("x", name, source=touched, marker="diamond", size=13, color=INK)
        return chart

    def _pad(self) -> figure:
        """Return the chart of receptors on the pad, to scale."""
        long, wide = self.subject.finger.pad_length * 1e3, self.subject.finger.pad_width * 1e3
        chart = _chart("along the finger [mm]", "across [mm]", sizing_mode="fixed", title="Receptors of the pad")
        chart.width = min(round(219 * long / wide), 420) + 122  # 219: height of the frame; 122: axis and colours
        chart.x_range, chart.y_range = Range1d(start=0.0, end=long), Range1d(start=0.0, end=wide)
        drawn: Any = {"size": 6, "line_color": USUAL.absent, "line_width": 0.5}
        fill: Any = {"field": "rate", "transform": self.colours}
        chart.scatter("x", "y", source=self.sources["receptors"], fill_color=None, **drawn)
        chart.scatter("x", "y", source=self.sources["firing receptors"], fill_color=fill, **drawn)
        chart.line("x", "y", source=self.sources["contact"], color=INK)
        chart.add_layout(ColorBar(color_mapper=self.colours, title="Hz", background_fill_color=None), "right")
        return chart


def _chart(x: str, y: str, **options: Any) -> figure:
    chart = blank_chart(x, y, **{"title": "", "height": 290} | options)
    chart.y_range = Range1d(start=0.1, end=1.0)
    return chart


def step_above(value: float) -> float:
    """Return a rounded number that is at least a value, so that axes stay while a slider moves a little; 1 for 0."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0) if step * power >= value))


def axis_ends(values: NDArray[np.float64], logarithmic: bool = False, from_zero: bool = False) -> Mapping[str, float]:
    """Return start and end of an axis that holds some values; NaN counts as nothing.

    An axis from zero begins a little below it, so that a line at zero stays visible.
    """
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if from_zero:
        end = step_above(high)
        return {"start": -0.04 * end, "end": end}
    if logarithmic:
        margin = 1.1 * (high / low) ** 0.04
        return {"start": low / margin, "end": high * margin}
    margin = 0.06 * (high - low) or 0.5
    return {"start": low - margin, "end": high + margin}
