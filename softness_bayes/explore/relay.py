"""Relay of changes to the browser: one message per redraw, with text updated after the charts.

By default Bokeh sends a separate message for each change of a model, and each new text of a `Div` triggers a layout of
the whole page. Here one message carries all changes: the charts are drawn in one frame, and the text follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bokeh.models import ColumnDataSource, CustomJS, Model
from bokeh.models.widgets import Div

# with `sync` false, changes applied in the browser are not sent back to this process
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
    """Buffer of model changes until they are sent.

    Parameters
    ----------
    models
        The models by name.
    holder
        A model of the page; its tags hold the model that carries the message.
    """

    def __init__(self, models: Mapping[str, Model], holder: Model) -> None:
        self._models = dict(models)
        code = CustomJS(args={"names": [*self._models], "models": [*self._models.values()]}, code=_DISTRIBUTE)
        # no view shows this model, so changing it triggers no redraw
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
        """Apply all changes: to the models, or in one message once a browser shows them."""
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
