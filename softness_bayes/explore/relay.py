"""Relay of changes to the browser: one message for all of a redraw, and words after the charts.

Each change of a model is a message of its own, and each new text of a `Div` lays out the whole page anew. Here one
message brings everything; charts are drawn in one frame, and the words are put into the page behind them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bokeh.models import ColumnDataSource, CustomJS, Model
from bokeh.models.widgets import Div

# what the browser does must not come back to this process as a change: `sync` is false
_DISTRIBUTE = """
const [columns, values, words] = cb_obj.tags
for (const [name, keys, lists] of columns) {
  const data = {}
  keys.forEach((key, k) => { data[key] = lists[k] })
  models[names.indexOf(name)].setv({data}, {sync: false, check_eq: false})
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
    """Changes of models, collected until they are sent.

    Parameters
    ----------
    models
        The models by name.
    holder
        A model of the page, among whose tags is the carrier of the message.
    """

    def __init__(self, models: Mapping[str, Model], holder: Model) -> None:
        self._models = dict(models)
        code = CustomJS(args={"names": [*self._models], "models": [*self._models.values()]}, code=_DISTRIBUTE)
        # no view shows it: one that did would draw itself anew
        self._carrier = ColumnDataSource()
        self._carrier.js_on_change("tags", code)
        holder.tags = [self._carrier]
        self._columns: dict[str, Mapping[str, Any]] = {}
        self._values: dict[tuple[str, str], Any] = {}

    def put(self, name: str, columns: Mapping[str, Any]) -> None:
        """Replace the columns of a source."""
        self._columns[name] = columns

    def set(self, name: str, attribute: str, value: Any) -> None:
        """Set an attribute of a model."""
        self._values[name, attribute] = value

    def send(self, at_once: bool) -> None:
        """Apply all changes: to the models themselves, or at once in the browser that shows them already."""
        columns, values, self._columns, self._values = self._columns, self._values, {}, {}
        if not at_once:
            for name, data in columns.items():
                source = self._models[name]
                assert isinstance(source, ColumnDataSource)
                source.data = dict(data)
            for (name, attribute), value in values.items():
                setattr(self._models[name], attribute, value)
            return
        words = [[name, value] for (name, _), value in values.items() if isinstance(self._models[name], Div)]
        others = [[*key, value] for key, value in values.items() if not isinstance(self._models[key[0]], Div)]
        self._carrier.tags = [[[name, [*data], [*data.values()]] for name, data in columns.items()], others, words]
