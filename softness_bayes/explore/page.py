"""Page of sliders and charts: each change calls `picture`, and the charts show the resulting arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import (
    ColumnDataSource,
    CustomJSTickFormatter,
    LinearColorMapper,
    Range1d,
)
from bokeh.models.annotations import ColorBar, Title
from bokeh.models.widgets import Button, Div, Select, Slider
from bokeh.palettes import Viridis256
from bokeh.plotting import figure

from softness_bayes.errors import SoftnessError
from softness_bayes.explore.picture import Picture, picture
from softness_bayes.explore.relay import Relay
from softness_bayes.explore.span import DIGITS, STEPS, Span, rounded
from softness_bayes.explore.subject import State, Subject
from softness_bayes.parameters.fabric_moduli import KPA
from softness_bayes.plotting.panels import TINTS, title
from softness_bayes.plotting.style import USUAL
from softness_bayes.plotting.touch import SEEN
from softness_bayes.report.charts import INK, TURN_TINT, dress, plain_ticks

TITLE = "softness-bayes explore"

ANY = "(the modulus below)"
"""The choice of a fabric without a name."""

MODULUS = "E_fab"
"""Name of the modulus among the sliders."""

LEAST_RATE = 1e-9
"""Lowest rate drawn in colour [Hz]: receptors that do not fire are open circles."""

WRAPPED = "white-space: pre-wrap; overflow-wrap: anywhere; user-select: text"
"""Style of a command, of which no word is out of sight."""

REPEAT = "The command that repeats the numbers of this touch:"

STEPS_OF_ENDS = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.5)
"""Ends of axes and keys, times a power of ten."""

POWER = f"return Number(Math.pow(10, tick).toPrecision({DIGITS})).toString()"

MODULUS_WORDS = "fabric modulus E_fab [kPa]"

QUANTITIES = {
    "e_fab_kpa": MODULUS_WORDS,
    "e_skin_kpa": "skin modulus under load [kPa]",
    "indentation_mm": "indentation [mm]",
    "force_n": "force [N]",
    "contact_radius_mm": "contact radius [mm]",
    "peak_stress_kpa": "largest stress at the receptors [kPa]",
    "total_rate_hz": "total rate [spikes/s]",
    "responding": "firing receptors",
    "mean_rate_hz": "their mean rate [Hz]",
    "mean_interval_ms": "their mean interspike interval [ms]",
    "typical_rating": "rating of a typical participant",
}
"""Quantities of a touch in words, in the order of the table."""


class Page:
    """One page in one window.

    Parameters
    ----------
    subject
        The model to explore.
    document
        The page's Bokeh document, to which all widgets and charts are added.
    """

    def __init__(self, subject: Subject, document: Document) -> None:
        self.subject, self.state, self._quiet = subject, subject.start, False
        self.sources: dict[str, ColumnDataSource] = {}
        self.titles: dict[str, Title] = {}
        loads: list[Any] = [(str(k), title(load)) for k, load in enumerate(subject.loads)]
        names: list[Any] = [(str(k), name) for k, name in enumerate(subject.fabrics.names)]
        self.load = Select(title="load", options=loads, name="load", width=310)
        self.fabric = Select(title="fabric", options=[*names, ("", ANY)], name="fabric", width=310)
        low, high = (rounded(end / KPA) for end in subject.ends)
        self.modulus = Span(MODULUS, "modulus of the fabric", "kPa", low, high, self.state.modulus_kpa, True)
        self.sliders = {span.name: _slider(span) for span in (self.modulus, *subject.spans)}
        self.reset = Button(label="reset", name="reset")
        self.said = Div(name="said", sizing_mode="stretch_width")
        self.charts = self._charts()
        named = {f"{name} title": heading for name, heading in self.titles.items()}
        distances, colours = self.distances, self.colours
        models = {**self.sources, **named, "distances": distances, "colours": colours, "said": self.said}
        self.relay = Relay(models, self.said)
        self._move_to(subject.start)
        self._listen()
        document.title = TITLE
        document.add_root(self._layout())
        self._shown_already = document.session_context is not None

    def _listen(self) -> None:
        for span in self.subject.spans:
            self.sliders[span.name].on_change("value", self._on_parameter(span))
        self.sliders[MODULUS].on_change("value", lambda _attr, _old, new: self._on_modulus(self.modulus.value(new)))
        self.load.on_change("value", lambda _attr, _old, new: self._to(replace(self.state, load=int(new))))
        self.fabric.on_change("value", lambda _attr, _old, new: self._on_fabric(new))
        self.reset.on_click(lambda: self._move_to(self.subject.start))

    def _on_parameter(self, span: Span) -> Any:
        def moved(_attr: str, _old: float, new: float) -> None:
            self._to(replace(self.state, values={**self.state.values, span.name: span.value(new)}))

        return moved

    def _on_modulus(self, kpa: float) -> None:
        """Switch to the unnamed fabric: a named fabric has a fixed modulus."""
        if self._quiet:
            return
        self._quiet, self.fabric.value, self._quiet = True, "", False
        self._to(replace(self.state, fabric=None, modulus_kpa=kpa))

    def _on_fabric(self, chosen: str) -> None:
        if self._quiet:
            return
        if not chosen:
            self._move_to(replace(self.state, fabric=None))
            return
        kpa = rounded(float(self.subject.fabrics.effective_modulus[int(chosen)]) / KPA)
        self._move_to(replace(self.state, fabric=int(chosen), modulus_kpa=kpa))

    def _move_to(self, state: State) -> None:
        """Set all sliders and choices to a state, and draw it once."""
        self._quiet = True
        self.load.value, self.fabric.value = str(state.load), "" if state.fabric is None else str(state.fabric)
        self.sliders[MODULUS].value = self.modulus.place(state.modulus_kpa)
        for span in self.subject.spans:
            self.sliders[span.name].value = span.place(state.values[span.name])
        self._quiet = False
        self._to(state)

    def _to(self, state: State) -> None:
        """Draw a state; if the model rejects it, show the message and keep the charts."""
        if self._quiet:
            return
        self.state = state
        try:
            self.draw(picture(self.subject, state))
        except SoftnessError as error:
            self.relay.set("said", "text", f"<p>{escape(f'This cannot be drawn: {error}')}</p>")
        self.relay.send(self._shown_already)

    # charts

    def _source(self, name: str, *keys: str) -> ColumnDataSource:
        self.sources[name] = ColumnDataSource({key: [] for key in keys}, name=name)
        return self.sources[name]

    def _charts(self) -> dict[str, figure]:
        """Return the empty charts."""
        run = self.subject.rated is not None
        for name, place in (("curve", "x"), ("others", "xs"), ("touched", "x")):
            self._source(name, place, *(["rate", "rating"] if run else ["rate"]))
        self._source("turn", "x")
        charts = {"rate": self._curve_chart("rate", "total rate [spikes/s]", "linear")}
        if self.subject.rated is not None:
            scale = self.subject.rated.scale
            charts["rating"] = self._curve_chart("rating", scale.label, scale.axis)
            data = self._source("data", "x", "mean", "low", "high", "fabric")
            charts["rating"].segment(x0="x", x1="x", y0="low", y1="high", source=data, color=USUAL.data, alpha=0.6)
            charts["rating"].scatter(x="x", y="mean", source=data, size=8, color=USUAL.data)
        heading = Title(text="Receptors by distance")
        firing = _figure(heading, "distance from the contact's axis [mm]", "firing rate of a receptor [Hz]")
        firing.line("x", "rate", source=self._source("firing", "x", "rate"), color=INK, line_width=2)
        self.distances = firing.x_range = Range1d(start=0.0, end=1.0)
        return charts | {"firing": firing, "pad": self._pad()}

    def _curve_chart(self, name: str, label: str, axis: str) -> figure:
        self.titles[name] = Title(text="")
        chart = _figure(self.titles[name], MODULUS_WORDS, label, x_axis_type="log", y_axis_type=axis)
        chart.x_range = Range1d(start=self.subject.ends[0] / KPA, end=self.subject.ends[1] / KPA)
        if self.subject.rated is not None:
            self._bands(chart, name)
        if axis == "log":
            plain_ticks(chart)
        chart.multi_line("xs", name, source=self.sources["others"], color=USUAL.absent, line_width=1)
        chart.line("x", name, source=self.sources["curve"], color=INK, line_width=2.5)
        chart.vspan(x="x", source=self.sources["turn"], color=USUAL.inflection, line_width=2, line_dash="dashed")
        chart.scatter("x", name, source=self.sources["touched"], marker="diamond", size=13, color=INK)
        return chart

    def _bands(self, chart: figure, name: str) -> None:
        """Draw the turning point's interval and the credible bands of a run."""
        turn = self._source(f"{name}/turn", "left", "middle", "right")
        chart.vstrip(x0="left", x1="right", source=turn, color=USUAL.inflection, alpha=TURN_TINT)
        band = self._source(f"{name}/band", "x", "median", "low50", "high50", "low95", "high95")
        for level, tint in (("95", TINTS[1]), ("50", TINTS[0])):
            low, high = f"low{level}", f"high{level}"
            chart.varea(x="x", y1=low, y2=high, source=band, fill_color=USUAL.posterior, fill_alpha=tint)

    def _pad(self) -> figure:
        finger, mm = self.subject.finger, 1e3
        chart = _figure(Title(text="Receptors of the pad"), "along the finger [mm]", "across [mm]", match_aspect=True)
        chart.x_range = Range1d(start=0.0, end=finger.pad_length * mm)
        chart.y_range = Range1d(start=0.0, end=finger.pad_width * mm)
        self.colours = LinearColorMapper(palette=Viridis256, low=LEAST_RATE, high=1.0, low_color=(0, 0, 0, 0))
        fill: Any = {"field": "rate", "transform": self.colours}
        places = self._source("receptors", "x", "y", "rate")
        chart.scatter("x", "y", source=places, size=6, line_color=USUAL.absent, line_width=0.5, fill_color=fill)
        contact = self._source("contact", "x", "y", "radius")
        chart.circle("x", "y", radius="radius", source=contact, fill_color=None, line_color=INK)
        chart.add_layout(ColorBar(color_mapper=self.colours, title="Hz", background_fill_color=None), "right")
        return chart

    def draw(self, found: Picture) -> None:
        """Show a picture in the charts, the text, the table and the command."""
        load, rated = self.state.load, self.subject.rated
        curves = {"rate": found.rate} if found.rating is None else {"rate": found.rate, "rating": found.rating}
        here = {"rate": found.chosen["total_rate_hz"], "rating": found.chosen.get("typical_rating")}
        others = [k for k in range(len(self.subject.loads)) if k != load]
        x = found.modulus.tolist()
        self._put("curve", x=x, **{name: values[load].tolist() for name, values in curves.items()})
        every = {name: [values[k].tolist() for k in others] for name, values in curves.items()}
        self._put("others", xs=[x] * len(others), **every)
        self._put("turn", x=[float(found.turn[load])] if np.isfinite(found.turn[load]) else [])
        self._put("touched", x=[found.chosen["e_fab_kpa"]], **{name: [here[name]] for name in curves})
        if self._shown != load:
            self._show_load(load)
        self._put_receptors(found)
        words = [*found.told, *([] if rated is None else [f"Posterior of the run: {rated.shown[load].told}"])]
        self.relay.set("said", "text", _in_words(words, found))

    _shown = -1  # the load that the titles, the bands and the data show
    _shown_already = False  # true once a browser has loaded the document; the relay then sends all changes

    def _show_load(self, load: int) -> None:
        """Name the load in the titles, and show the run's bands and data for this load behind the curves."""
        for name in self.titles:
            self.relay.set(f"{name} title", "text", title(self.subject.loads[load]))
        if self.subject.rated is not None:
            shown = self.subject.rated.shown[load]
            for name in self.titles:
                self._put(f"{name}/band", **getattr(shown, name))
                self._put(f"{name}/turn", **shown.turn)
            self._put("data", **{key: shown.fabrics[key] for key in ("x", "mean", "low", "high", "fabric")})
        self._shown = load

    def _put_receptors(self, found: Picture) -> None:
        self._put("firing", x=found.distance.tolist(), rate=found.firing.tolist())
        seen = found.distance[found.stress > SEEN * found.stress.max()]
        self.relay.set("distances", "end", step_above(float(seen.max(initial=found.distance[1]))))
        (x, y), (across, up) = self.subject.receptors.T * 1e3, self.subject.finger.contact_centre
        self._put("receptors", x=x.tolist(), y=y.tolist(), rate=found.receptors.tolist())
        self.relay.set("colours", "high", step_above(float(found.firing.max()) or 1.0))
        self._put("contact", x=[across * 1e3], y=[up * 1e3], radius=[found.chosen["contact_radius_mm"]])

    def _put(self, name: str, **columns: Any) -> None:
        self.relay.put(name, columns)

    def _layout(self) -> Any:
        about = "the medians of the priors" if self.subject.rated is None else self.subject.rated.source
        head = Div(text=f"<h2>{TITLE}</h2><p>{escape(about)}</p>")
        legend = Div(text=_legend(self.subject.rated is not None))
        controls = [self.load, self.fabric, *self.sliders.values(), self.reset]
        left = column(head, *controls, width=330)
        curves = [self.charts[name] for name in ("rating", "rate") if name in self.charts]
        pads = row(self.charts["firing"], self.charts["pad"], sizing_mode="stretch_width")
        right = column(*curves, legend, pads, self.said, sizing_mode="stretch_width")
        return row(left, right, sizing_mode="stretch_width")


def step_above(value: float) -> float:
    """Return a rounded upper limit for an axis or key; coarse steps avoid frequent new layouts of the chart."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * next(step for step in STEPS_OF_ENDS if step * power >= value))


def _slider(span: Span) -> Slider:
    start, end = span.place(span.low), span.place(span.high)
    unit = f" [{span.unit}]" if span.unit else ""
    return Slider(
        start=start,
        end=end,
        step=(end - start) / STEPS,
        value=span.place(span.start),
        title=f"{span.name}{unit}, {span.meaning}",
        format=CustomJSTickFormatter(code=POWER) if span.logarithmic else f"0[.]{'0' * (DIGITS - 1)}",
        name=span.name,
        width=310,
    )


def _figure(heading: Title, x: str, y: str, **options: Any) -> figure:
    # set by name, because Bokeh's type hints lack these attributes of axes and tools
    options |= {"tools": "", "x_axis_label": x, "y_axis_label": y}
    chart = figure(title=heading, height=290, sizing_mode="stretch_width", toolbar_location=None, **options)
    dress(chart)
    return chart


def _legend(run: bool) -> str:
    """Return a text that explains the lines of the charts."""
    said = "Black: these parameters under the chosen load; grey: under the others; diamond: the touched fabric; dashed "
    said += "green: the turning point."
    if run:
        said += " Blue: 50 % and 95 % credible bands of the run; red: mean ratings and their spread between raters."
    return f"<p>{said}</p>"


def _in_words(words: list[str], found: Picture) -> str:
    """Return sentences, the quantities of a touch as a table, and the command that reproduces them."""
    told = "".join(f"<p>{escape(one)}</p>" for one in words)
    rows = "".join(
        f"<tr><td style='padding-right: 2em'>{escape(name)}</td><td>{_shown_number(found.chosen, quantity)}</td></tr>"
        for quantity, name in QUANTITIES.items()
        if quantity in found.chosen
    )
    repeat = f"<p><b>{REPEAT}</b></p><pre style='{WRAPPED}'>{escape(found.command)}</pre>"
    return f"{told}<b>{escape(found.fabric)}</b><table>{rows}</table>{repeat}"


def _shown_number(values: Mapping[str, float], name: str) -> str:
    return f"{values[name]:.4g}" if np.isfinite(values[name]) else "none: no receptor fires"
