"""Relay of changes to the browser: one message per redraw, with text updated after the charts.

By default Bokeh sends a separate message for each change of a model, and each new text of a `Div` triggers a layout of
the whole page. Here one message carries all changes: the charts are drawn in one frame, and the text follows. Numbers
travel as bytes, columns that stay are not sent, and as long as the browser has not taken a message, no other is sent.
"""

from __future__ import annotations

import time
from base64 import b64encode
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, Model
from bokeh.models.widgets import Div
from numpy.typing import NDArray

Array = NDArray[np.float64]

PATIENCE = 2.0
"""Time [s] after which a message that the browser has not confirmed no longer holds back the next."""

# with `sync` false, changes applied in the browser are not sent back to this process
_DISTRIBUTE = """
const [number, columns, values, words, packed] = cb_obj.tags
cb_obj.name = number
const bytes = Uint8Array.from(atob(packed), (one) => one.charCodeAt(0))
const numbers = new Float64Array(bytes.buffer)
let place = 0
const next = (size) => numbers.subarray(place, place += size)
for (const [name, shapes] of columns) {
  const source = models[names.indexOf(name)], data = {...source.data}
  for (const [key, rows, size] of shapes) {
    data[key] = rows < 0 ? next(size) : Array.from({length: rows}, () => next(size))
  }
  source.setv({data}, {sync: false, check_eq: false})
}
for (const [name, attribute, value] of values) {
  models[names.indexOf(name)].setv({[attribute]: value}, {sync: false})
}
for (const [name, text] of words) {
  const model = models[names.indexOf(name)]
  model.setv({text}, {sync: false, silent: true})
  requestAnimationFrame(() => { Bokeh.index.find_one_by_id(model.id).markup_el.innerHTML = text })
}
"""


class Relay:
    """Buffer of model changes until they are sent.

    Parameters
    ----------
    models
        The models by name.
    holder
        A model of the page; its tags hold the model that carries the message.
    free
        Called when the browser has taken a message.
    """

    def __init__(self, models: Mapping[str, Model], holder: Model, free: Callable[[], None]) -> None:
        self._models = dict(models)
        code = CustomJS(args={"names": [*self._models], "models": [*self._models.values()]}, code=_DISTRIBUTE)
        # no view shows this model, so changing it triggers no redraw
        self._carrier = ColumnDataSource()
        self._carrier.js_on_change("tags", code)
        self._carrier.on_change("name", lambda _attr, _old, new: self._taken(new))
        holder.tags = [self._carrier]
        self._columns: dict[str, dict[str, Array]] = {}
        self._values: dict[tuple[str, str], Any] = {}
        self._known: dict[tuple[str, str], Any] = {}
        self._number, self._sent, self._free = 0, -np.inf, free

    @property
    def busy(self) -> bool:
        """True while the browser has not taken the last message."""
        return time.monotonic() - self._sent < PATIENCE

    def put(self, name: str, **columns: Array) -> None:
        """Replace columns of a source: numbers, or rows of numbers."""
        for key, column in columns.items():
            known = self._known.get((name, key))
            if known is None or not np.array_equal(known, column, equal_nan=True):
                self._columns.setdefault(name, {})[key] = self._known[name, key] = column

    def set(self, name: str, attribute: str, value: Any) -> None:
        """Set an attribute of a model."""
        if self._known.get((name, attribute)) != value:
            self._values[name, attribute] = self._known[name, attribute] = value

    def send(self, at_once: bool) -> None:
        """Apply all changes: to the models, or in one message once a browser shows them."""
        columns, values, self._columns, self._values = self._columns, self._values, {}, {}
        if at_once:
            self._carry(columns, values)
            return
        for name, data in columns.items():
            source = self._models[name]
            assert isinstance(source, ColumnDataSource)
            source.data = {**source.data, **{key: column.tolist() for key, column in data.items()}}
        for (name, attribute), value in values.items():
            setattr(self._models[name], attribute, value)

    def _carry(self, columns: Mapping[str, Mapping[str, Array]], values: Mapping[tuple[str, str], Any]) -> None:
        words = [[name, value] for (name, _), value in values.items() if isinstance(self._models[name], Div)]
        others = [[*key, value] for key, value in values.items() if not isinstance(self._models[key[0]], Div)]
        arrays = [np.asarray(column, "<f8") for data in columns.values() for column in data.values()]
        # one text instead of thousands of numbers, each of which Bokeh would search for references to models
        packed = b64encode(b"".join(column.tobytes() for column in arrays)).decode()
        shapes = [[name, [[key, *_shape(column)] for key, column in data.items()]] for name, data in columns.items()]
        self._number, self._sent = self._number + 1, time.monotonic()
        self._carrier.tags = [str(self._number), shapes, others, words, packed]

    def _taken(self, number: str) -> None:
        if number == str(self._number):
            self._sent = -np.inf
            self._free()


def _shape(column: Array) -> tuple[int, int]:
    """Return the number of rows, -1 for a plain column, and the numbers in each."""
    return (-1, column.size) if column.ndim == 1 else (column.shape[0], column.shape[1])
