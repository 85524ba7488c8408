"""Page of sliders and charts: after each change the charts show what `picture` computes."""

from __future__ import annotations

from functools import partial
from html import escape
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import CustomJSTickFormatter
from bokeh.models.widgets import Button, Div, Select, Slider

from softness_bayes.base.errors import SoftnessError
from softness_bayes.parameters.declared import KPA
from softness_bayes.plotting.panels import title
from softness_bayes.report.explore.charts import MODULUS_WORDS, Charts
from softness_bayes.report.explore.picture import Picture, picture
from softness_bayes.report.explore.subject import DIGITS, Span, State, Subject, rounded

TITLE = "softness-bayes explore"

ANY = "(the modulus below)"
"""The choice of a fabric without a name."""

MODULUS = "E_fab"
"""Name of the modulus among the sliders."""

WRAPPED = "white-space: pre-wrap; overflow-wrap: anywhere; user-select: text"
"""Style of a command, of which no word is out of sight."""

REPEAT = "The command that repeats the numbers of this touch:"

POWER = f"return Number(Math.pow(10, tick).toPrecision({DIGITS})).toString()"

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
        self.subject, self._document = subject, document
        self._quiet = False  # true while one change of a widget sets others
        self._waiting = False  # true if the state will be drawn soon
        loads: list[Any] = [(str(k), title(load)) for k, load in enumerate(subject.loads)]
        names: list[Any] = [(str(k), name) for k, name in enumerate(subject.fabrics.names)]
        self.load = Select(title="load", options=loads, name="load", width=310)
        self.fabric = Select(title="fabric", options=[*names, ("", ANY)], name="fabric", width=310)
        low, high = (rounded(end / KPA) for end in subject.ends)
        modulus = Span(MODULUS, "modulus of the fabric", "kPa", low, high, subject.start.modulus_kpa, True)
        self.spans = {span.name: span for span in (modulus, *subject.spans)}
        self.sliders = {name: _slider(span) for name, span in self.spans.items()}
        self.reset = Button(label="reset", name="reset")
        self.said = Div(name="said", sizing_mode="stretch_width")
        self.charts = Charts(subject)
        for name, widget in {"load": self.load, "fabric": self.fabric, **self.sliders}.items():
            widget.on_change("value", partial(self._on_change, name))
        self.reset.on_click(self._start)
        self._start()
        document.title = TITLE
        document.add_root(self._layout())

    @property
    def state(self) -> State:
        """The settings of all widgets."""
        values = {name: span.value(self.sliders[name].value) for name, span in self.spans.items()}
        kpa, fabric = values.pop(MODULUS), self.fabric.value
        return State(values, int(self.load.value), int(fabric) if fabric else None, kpa)

    def _start(self) -> None:
        """Set all widgets to the initial state, and draw it once."""
        start = self.subject.start
        self._quiet = True
        self.load.value, self.fabric.value = str(start.load), str(start.fabric)
        for name, span in self.spans.items():
            self.sliders[name].value = span.place(span.start)
        self._quiet = False
        self._draw()

    def _on_change(self, name: str, _attribute: str, _old: object, _new: object) -> None:
        """Draw the new state; a named fabric has a fixed modulus, and another modulus belongs to none."""
        if self._quiet:
            return
        self._quiet = True
        if name == MODULUS:
            self.fabric.value = ""
        elif name == "fabric" and self.fabric.value:
            kpa = float(self.subject.fabrics.effective_modulus[int(self.fabric.value)]) / KPA
            self.sliders[MODULUS].value = self.spans[MODULUS].place(rounded(kpa))
        self._quiet = False
        self._draw()

    def _draw(self) -> None:
        """Draw the state; in a browser with the changes of the next 25 ms, so that a drag does not queue."""
        if self._document.session_context is None:
            self._show()
        elif not self._waiting:
            self._waiting = True
            self._document.add_timeout_callback(self._show, 25)

    def _show(self) -> None:
        """Draw the state; if the model rejects it, show the message and keep the charts."""
        self._waiting = False
        state, rated = self.state, self.subject.rated
        try:
            drawn = picture(self.subject, state)
        except SoftnessError as error:
            self.said.text = f"<p>{escape(f'This cannot be drawn: {error}')}</p>"
            return
        self.charts.draw(state.load, drawn)
        words = [
            *drawn.sentences,
            *([] if rated is None else [f"Posterior of the run: {rated.charts[state.load].sentence}"]),
        ]
        self.said.text = _in_words(words, drawn)

    def _layout(self) -> Any:
        about = "the medians of the priors" if self.subject.rated is None else self.subject.rated.source
        head = Div(text=f"<h2>{TITLE}</h2><p>{escape(about)}</p>")
        legend = Div(text=_legend(self.subject.rated is not None))
        controls = [self.load, self.fabric, *self.sliders.values(), self.reset]
        left = column(head, *controls, width=330)
        curves = [self.charts.figures[name] for name in ("rating", "rate") if name in self.charts.figures]
        pads = row([self.charts.figures["firing"], self.charts.figures["pad"]], sizing_mode="stretch_width")
        right = column(*curves, legend, pads, self.said, sizing_mode="stretch_width")
        return row(left, right, sizing_mode="stretch_width")


def _slider(span: Span) -> Slider:
    start, end = span.place(span.low), span.place(span.high)
    unit = f" [{span.unit}]" if span.unit else ""
    return Slider(
        start=start,
        end=end,
        step=(end - start) / 500,
        value=span.place(span.start),
        title=f"{span.name}{unit}, {span.meaning}",
        format=CustomJSTickFormatter(code=POWER) if span.logarithmic else f"0[.]{'0' * (DIGITS - 1)}",
        name=span.name,
        width=310,
    )


def _legend(run: bool) -> str:
    """Return a text that explains the lines of the charts."""
    text = "Black: these parameters under the chosen load; grey: under the others; diamond: the touched fabric; dashed "
    text += "green: the turning point."
    if run:
        text += " Blue: 50 % and 90 % credible bands of the run; orange: mean ratings and their spread between raters."
    return f"<p>{text}</p>"


def _in_words(words: list[str], touch: Picture) -> str:
    """Return sentences, the quantities of a touch as a table, and the command that reproduces them."""
    told = "".join(f"<p>{escape(one)}</p>" for one in words)
    rows = ""
    for name in (name for name in QUANTITIES if name in touch.chosen):
        value = touch.chosen[name]
        shown = f"{value:.4g}" if np.isfinite(value) else "none: no receptor fires"
        rows += f"<tr><td style='padding-right: 2em'>{escape(QUANTITIES[name])}</td><td>{shown}</td></tr>"
    repeat = f"<p><b>{REPEAT}</b></p><pre style='{WRAPPED}'>{escape(touch.command)}</pre>"
    return f"{told}<b>{escape(touch.fabric)}</b><table>{rows}</table>{repeat}"
