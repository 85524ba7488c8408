"""Page of sliders and charts: after each change the charts show what `picture` computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import CustomJSTickFormatter
from bokeh.models.widgets import Button, Div, Select, Slider

from softness_bayes.errors import SoftnessError
from softness_bayes.explore.charts import MODULUS_WORDS, Charts
from softness_bayes.explore.picture import Picture, picture
from softness_bayes.explore.subject import DIGITS, Span, State, Subject, rounded
from softness_bayes.parameters.fabric_moduli import KPA
from softness_bayes.plotting.panels import title

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
        self.subject, self.state = subject, subject.start
        self._document = document
        self._quiet = False  # true while one change of a widget sets others
        self._waiting = False  # true if the state will be drawn soon
        loads: list[Any] = [(str(k), title(load)) for k, load in enumerate(subject.loads)]
        names: list[Any] = [(str(k), name) for k, name in enumerate(subject.fabrics.names)]
        self.load = Select(title="load", options=loads, name="load", width=310)
        self.fabric = Select(title="fabric", options=[*names, ("", ANY)], name="fabric", width=310)
        low, high = (rounded(end / KPA) for end in subject.ends)
        self.modulus = Span(MODULUS, "modulus of the fabric", "kPa", low, high, self.state.modulus_kpa, True)
        self.sliders = {span.name: _slider(span) for span in (self.modulus, *subject.spans)}
        self.reset = Button(label="reset", name="reset")
        self.said = Div(name="said", sizing_mode="stretch_width")
        self.charts = Charts(subject)
        self._move_to(subject.start)
        self._listen()
        document.title = TITLE
        document.add_root(self._layout())

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
        """Draw a state; in a browser with the changes of the next 25 ms, so that a drag does not queue."""
        if self._quiet:
            return
        self.state = state
        if self._document.session_context is None:
            self._show()
        elif not self._waiting:
            self._waiting = True
            self._document.add_timeout_callback(self._show, 25)

    def _show(self) -> None:
        """Draw the state; if the model rejects it, show the message and keep the charts."""
        self._waiting = False
        try:
            found = picture(self.subject, self.state)
        except SoftnessError as error:
            self.said.text = f"<p>{escape(f'This cannot be drawn: {error}')}</p>"
            return
        load, rated = self.state.load, self.subject.rated
        self.charts.draw(load, found)
        words = [*found.told, *([] if rated is None else [f"Posterior of the run: {rated.shown[load].told}"])]
        self.said.text = _in_words(words, found)

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
    said = "Black: these parameters under the chosen load; grey: under the others; diamond: the touched fabric; dashed "
    said += "green: the turning point."
    if run:
        said += " Blue: 50 % and 95 % credible bands of the run; orange: mean ratings and their spread between raters."
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
