"""The figures of one result by name, for use in Python: ``result.plot.response()``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Any

from softness_bayes.kinds import require_kind
from softness_bayes.plotting.drawing import own_drawing
from softness_bayes.plotting.figures import FIGURES, Drawing, figure_named, figures_of
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softness_bayes.plotting.drawing import Drawable


class Plots:
    """Figures of a result: one method for each entry of `FIGURES`, which returns the figure.

    Parameters
    ----------
    result
        A finished run.
    """

    def __init__(self, result: Drawable) -> None:
        self._result = result

    def __call__(self, name: str | Drawing | Callable[..., Figure], style: Style = USUAL) -> Figure:
        """Draw a figure by its name, or a custom one: a `Drawing`, or a function of a result and a style.

        Raises
        ------
        InputError
            If there is no such figure, or the result lacks its data.
        """
        require_kind("style", style, Style, "a Style, such as Style.read('mine.mplstyle')")
        drawing = figure_named(name) if isinstance(name, str) else own_drawing("figure", name)
        figure = drawing(self._result, style)
        # notebooks display pyplot figures automatically, but these figures do not use pyplot
        setattr(figure, "_repr_png_", partial(_png, figure, style))  # noqa: B010
        return figure

    def __repr__(self) -> str:
        return f"figures of a run: {', '.join(figures_of(self._result))}"

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Callable[..., Figure]: ...


SCREEN = 90
"""Resolution of a figure in a notebook [dots per inch]: its file stays small."""


def _png(figure: Figure, style: Style) -> bytes:
    """Return a figure as PNG for a notebook."""
    picture = BytesIO()
    with style.applied():
        figure.savefig(picture, format="png", dpi=SCREEN)
    return picture.getvalue()


def _method(name: str, drawing: Drawing) -> Any:
    def draw(self: Plots, style: Style = USUAL) -> Figure:
        return self(name, style)

    draw.__name__, draw.__qualname__ = name, f"Plots.{name}"
    draw.__doc__ = f"Draw {drawing.shows}."
    return draw


for _name, _drawing in FIGURES.items():
    setattr(Plots, _name, _method(_name, _drawing))
