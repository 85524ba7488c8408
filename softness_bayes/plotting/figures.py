"""Figures of a finished run by file name, including custom ones, and how they are drawn and written."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import require_outputs, write_outputs
from softness_bayes.base.ranges import require_kind
from softness_bayes.base.supplied import FORM, installed, is_supplied, supplied
from softness_bayes.likelihood.scales import CATEGORIES, PAIRS
from softness_bayes.plotting import checks, parameters, rating, response, touch
from softness_bayes.plotting.style import PLOT, USUAL, USUAL_FORMATS, Style, files_of, require_formats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softness_bayes.likelihood.scales import Scale
    from softness_bayes.plotting.stored import Drawable

FIRST_LOOK = "first look: not converged"
"""Note on every figure of a run that ended at its first convergence check."""


@dataclass(frozen=True)
class Drawing:
    """One figure of a finished run: ``drawing(result)`` returns it.

    Parameters
    ----------
    draw
        Function that makes the figure from the stored result.
    shows
        Description of the figure in one line.
    needs
        Variables of the result that the figure needs, as in ``predictions/total_rate``, and the message if one is
        missing.
    on_request
        Whether the figure is drawn only on request.
    only
        The rating scale that the figure is limited to; None for any scale.
    """

    draw: Callable[[Drawable, Style], Figure]
    shows: str
    needs: Mapping[str, str] = field(default_factory=dict)
    on_request: bool = False
    only: Scale | None = None

    def lacks(self, result: Drawable) -> str:
        """Return the reason why the data of this figure are missing; empty if the result has them."""
        for place, absent in self.needs.items():
            group, name = place.split("/")
            if group not in result.tree.children or name not in result.tree[group].data_vars:
                return absent
        wrong = self.only is not None and result.scale != self.only
        return f"its ratings are {result.scale.meaning}" if wrong else ""

    def __call__(self, result: Drawable, style: Style = USUAL) -> Figure:
        """Draw the figure.

        Raises
        ------
        InputError
            If the result lacks the data of the figure.
        """
        if reason := self.lacks(result):
            raise InputError(f"figure: cannot show {self.shows}: {reason}")
        with style.applied():
            figure = self.draw(result, style)
        if result.is_first_look:
            # a title of the figure, for which the layout makes room
            notes = filter(None, (FIRST_LOOK, figure.get_suptitle()))
            figure.suptitle("\n".join(notes), fontsize=style.small, color="firebrick")
        return figure


CURVES = {"predictions/total_rate": "the run had no ratings, so it has no response curves"}
REPLICATES = {"posterior_predictive/rating_of_new_participants": "it has no replicated ratings"}
PIT = {"constant_data/loo_pit": "it has no leave-one-out predictions"}
TOUCH = {"illustration_data/touch_stress_kpa": "it has no stored touches"}
FIRING = {"predictions/firing_rate_hz": "it has no stored firing rates"}
ENSEMBLES = {"sample_stats/ensemble": "it has no ensembles"}
RECORDED = {"predictions/expected_rate_hz": "the run had no recorded afferents"}
FORCES = {"predictions/typical_force_n": "the run had no compression data"}

FIGURES: Mapping[str, Drawing] = MappingProxyType(
    {
        "response": Drawing(
            response.response, "response against E_fab under each load, with credible bands of 50 and 90 %", CURVES
        ),
        "response_ratio": Drawing(
            partial(response.response, against_ratio=True), "response against E_fab / E_skin", CURVES
        ),
        "rating": Drawing(rating.rating, "predicted and observed ratings against E_fab under each load", CURVES),
        "rating_ratio": Drawing(
            partial(rating.rating, against_ratio=True), "predicted and observed ratings against E_fab / E_skin", CURVES
        ),
        "inflection": Drawing(response.inflection, "where the response turns over under each load", CURVES),
        "predictive_checks": Drawing(
            checks.checks,
            "posterior predictive checks: test quantities of the ratings and of replicates",
            CURVES | REPLICATES,
        ),
        "category_counts": Drawing(
            checks.category_counts,
            "number of ratings in each category, in the data and in replicates",
            REPLICATES,
            only=CATEGORIES,
        ),
        "psychometric": Drawing(
            checks.psychometric,
            "paired comparisons against the modulus, in the data and in replicates",
            REPLICATES,
            only=PAIRS,
        ),
        "loo_pit": Drawing(
            checks.loo_pit,
            "LOO-PIT: rank of each rating within its leave-one-out prediction, uniform if these are calibrated",
            CURVES | PIT,
        ),
        "touch": Drawing(
            touch.touch,
            "pressure and stress under the pad, and firing rates of its receptors, at the posterior medians",
            CURVES | TOUCH,
        ),
        "membrane": Drawing(touch.membrane, "firing rate against current, and example spike trains", CURVES | FIRING),
        "corner": Drawing(parameters.corner, "joint posterior of the most correlated pairs of parameters"),
        "corner_all": Drawing(
            partial(parameters.corner, every=True), "joint posterior of every pair of parameters", on_request=True
        ),
        "prior": Drawing(parameters.prior, "prior (grey) and posterior (blue) of every parameter"),
        "trace": Drawing(parameters.trace, "trace of every parameter in each ensemble, against the steps", ENSEMBLES),
        "rank": Drawing(
            parameters.rank,
            "ranks of the draws of each ensemble among all draws, uniform if the ensembles agree",
            ENSEMBLES,
        ),
        "compression": Drawing(
            touch.compression, "force of a rigid plate against indentation, with credible bands and the data", FORCES
        ),
        "recorded": Drawing(
            touch.recorded, "recorded firing against load, curvature and distance, with credible bands", RECORDED
        ),
    }
)
"""The only list of the built-in figures: file name -> figure."""


OWN_FIGURES = "figures"
"""Entry-point group of figures from installed packages."""


def every_figure() -> list[str]:
    """Return the names of all figures, those of installed packages last."""
    return [*FIGURES, *(name for name in installed(OWN_FIGURES) if name not in FIGURES)]


def figures_of(result: Drawable, every: bool = False) -> list[str]:
    """Return the names of the figures for which a result has data: ratings, compression data, or both.

    Parameters
    ----------
    result
        A finished run.
    every
        Whether to include figures that are drawn only on request.
    """
    drawings = {name: figure_named(name) for name in every_figure()}
    return [name for name, one in drawings.items() if not one.lacks(result) and (every or not one.on_request)]


def figure_named(name: str) -> Drawing:
    """Return a figure from `FIGURES`, from an installed package, or by its importable name.

    Raises
    ------
    InputError
        If the name is unknown; the message lists the known figures.
    """
    if name in FIGURES:
        return FIGURES[name]
    if not is_supplied(OWN_FIGURES, name):
        known = ", ".join(every_figure())
        raise InputError(f"figures: there is no {name!r}; expected some of {known}, or {FORM} for a custom figure")
    if (file := file_of(name)) in FIGURES:
        raise InputError(f"figures: {name}: a figure {file} already exists; use another name")
    return own_drawing(file, supplied(OWN_FIGURES, name))


def file_of(name: str) -> str:
    """Return the name of a figure's file, without its ending."""
    return name.rpartition(":")[2].rpartition(".")[2]


def own_drawing(name: str, given: Any) -> Drawing:
    """Return a custom figure: a `Drawing`, or a function of a result and a style that returns a figure.

    An error in the user's code is replaced by one that names the figure, so that a finished run ends with a message.

    Raises
    ------
    InputError
        If it is neither.
    """
    drawing = given
    if not isinstance(given, Drawing):
        if isinstance(given, type) or not callable(given):
            raise InputError(f"figures: {name} is {given!r:.60}, expected a Drawing, or a function (result, style)")
        try:
            inspect.signature(given).bind(None, None)
        except TypeError as error:
            expected = "expected a function (result, style)"
            raise InputError(f"figures: {name} takes {inspect.signature(given)}, {expected}: {error}") from None
        except ValueError:  # a compiled function has no signature
            pass
        drawing = Drawing(given, (given.__doc__ or "").strip().partition("\n")[0].rstrip(".") or f"the figure {name}")

    def draw(result: Drawable, style: Style) -> Figure:
        from matplotlib.figure import Figure

        try:
            figure = drawing.draw(result, style)
        except Exception as error:
            raise InputError(f"figures: {name} (custom) fails: {type(error).__name__}: {error}") from error
        if not isinstance(figure, Figure):
            raise InputError(f"figures: {name} (custom) returns {figure!r:.60}, expected a matplotlib Figure")
        return figure

    return replace(drawing, draw=draw)


def require_figures(names: Iterable[str]) -> None:
    """Raise an `InputError` for the first unknown name of a figure, with the known ones."""
    for name in names:
        figure_named(name)


def draw_figures(
    result: Drawable,
    directory: str | Path,
    names: Sequence[str] | None = None,
    formats: Sequence[str] = USUAL_FORMATS,
    style: Style = USUAL,
    told: Callable[[str, int], None] = lambda name, of: None,
) -> list[Path]:
    """Draw a result's figures and write them to a directory, which is created if necessary.

    Parameters
    ----------
    result
        A finished run, which contains all data of the figures.
    directory
        Directory of the figures.
    names
        Names as `figure_named` takes them; by default those of `figures_of`.
    formats
        File formats, as `save` takes them.
    style
        Style of the figures.
    told
        Called with the name of each figure before this process draws it, and with the number of all figures.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        If a name or a format is unknown, if the result lacks the data of a figure, or if an unrelated file with the
        same name exists.
    """
    directory = Path(directory)
    chosen = figures_of(result) if names is None else names
    require_figures(chosen)
    require_formats(formats)
    require_outputs(directory, [f"{file_of(name)}.{suffix}" for name in chosen for suffix in formats], PLOT)
    every = [drawn(result, name, tuple(formats), style) for name in announced(chosen, told)]
    return write_outputs(directory, {name: content for files in every for name, content in files.items()}, PLOT)


def announced(names: Sequence[str], told: Callable[[str, int], None]) -> Iterator[str]:
    """Yield names, each after it was told together with the number of all."""
    for name in names:
        told(name, len(names))
        yield name


def drawn(result: Drawable, name: str, formats: Sequence[str], style: Style = USUAL) -> dict[str, bytes]:
    """Draw one figure of a result, and return the contents of its files by their names."""
    return files_of(figure_named(name)(result, style), file_of(name), formats, style)


SCREEN = 90
"""Resolution of a figure in a notebook [dots per inch]: its file stays small."""


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

        def png() -> bytes:
            return files_of(figure, "", ("png",), style, SCREEN)[".png"]

        setattr(figure, "_repr_png_", png)  # noqa: B010
        return figure

    def __repr__(self) -> str:
        return f"figures of a run: {', '.join(figures_of(self._result))}"

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Callable[..., Figure]: ...


def _method(name: str, drawing: Drawing) -> Any:
    def draw(self: Plots, style: Style = USUAL) -> Figure:
        return self(name, style)

    draw.__name__, draw.__qualname__ = name, f"Plots.{name}"
    draw.__doc__ = f"Draw {drawing.shows}."
    return draw


for _name, _drawing in FIGURES.items():
    setattr(Plots, _name, _method(_name, _drawing))
