"""Registry of all figures of a finished run, by file name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from softness_bayes.errors import InputError
from softness_bayes.files.outputs import require_outputs, write_outputs
from softness_bayes.likelihood.scales import CATEGORIES, PAIRS
from softness_bayes.plotting import contents
from softness_bayes.plotting.drawing import Drawing, VariableSource, own_drawing
from softness_bayes.plotting.style import PLOT, USUAL, USUAL_FORMATS, Style, files_of, require_formats
from softness_bayes.sampler.workers import Workers
from softness_bayes.supplied import FORM, installed, is_supplied, supplied

if TYPE_CHECKING:
    from softness_bayes.plotting.drawing import Drawable

CURVES = VariableSource("predictions/total_rate", "the run had no ratings, so it has no response curves")
REPLICATES = VariableSource("posterior_predictive/rating_of_new_participants", "it has no replicated ratings")
PIT = VariableSource("constant_data/loo_pit", "it has no leave-one-out predictions")
_OLDER = (
    "the run was written by a version that did not store it; 'softness-bayes resume DIR --more-steps 1' "
    "writes the results again"
)
TOUCH = VariableSource("illustrations/touch_stress_kpa", _OLDER)
FIRING = VariableSource("predictions/firing_rate_hz", _OLDER)
FORCES = VariableSource("predictions/typical_force_n", "the run had no compression data")

FIGURES: Mapping[str, Drawing] = MappingProxyType(
    {
        "response": Drawing(contents.response, "response against E_fab under each load", (CURVES,)),
        "response_ratio": Drawing(contents.response_ratio, "response against E_fab / E_skin", (CURVES,)),
        "rating": Drawing(contents.rating, "predicted and observed ratings against E_fab", (CURVES,)),
        "rating_ratio": Drawing(
            contents.rating_ratio, "predicted and observed ratings against E_fab / E_skin", (CURVES,)
        ),
        "inflection": Drawing(contents.inflection, "where the response turns over under each load", (CURVES,)),
        "predictive_checks": Drawing(
            contents.checks,
            "posterior predictive checks: test quantities of the ratings and of replicates",
            (CURVES, REPLICATES),
        ),
        "category_counts": Drawing(
            contents.category_counts,
            "number of ratings in each category, in the data and in replicates",
            (REPLICATES,),
            only=CATEGORIES,
        ),
        "psychometric": Drawing(
            contents.psychometric,
            "paired comparisons against the modulus, in the data and in replicates",
            (REPLICATES,),
            only=PAIRS,
        ),
        "loo_pit": Drawing(contents.loo_pit, "leave-one-out predictive check (LOO-PIT) of the ratings", (CURVES, PIT)),
        "touch": Drawing(
            contents.touch, "pressure and stress under the pad, and the firing rates of its receptors", (CURVES, TOUCH)
        ),
        "membrane": Drawing(
            contents.membrane, "firing rate against current, and example spike trains", (CURVES, FIRING)
        ),
        "corner": Drawing(contents.corner, "joint posterior of the most correlated pairs of parameters"),
        "corner_all": Drawing(contents.corner_all, "joint posterior of every pair of parameters", on_request=True),
        "prior": Drawing(contents.prior, "prior and posterior of every parameter"),
        "trace": Drawing(contents.trace, "traces of the ensembles"),
        "rank": Drawing(contents.rank, "ranks of the draws of each ensemble"),
        "compression": Drawing(contents.compression, "force of a rigid plate against indentation", (FORCES,)),
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


def require_figures(names: Iterable[str]) -> None:
    """Raise an error for unknown names of figures.

    Raises
    ------
    InputError
        Naming the first unknown name, and the known figures.
    """
    for name in names:
        figure_named(name)


def draw_figures(
    result: Drawable,
    directory: str | Path,
    names: Sequence[str] | None = None,
    formats: Sequence[str] = USUAL_FORMATS,
    style: Style = USUAL,
    processes: int = 1,
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
    processes
        Number of parallel processes.
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
    if processes == 1:
        every = [drawn(result, name, tuple(formats), style) for name in announced(chosen, told)]
    else:
        with Workers(result, min(processes, len(chosen))) as workers:
            every = workers.map(drawn, [(name, tuple(formats), style) for name in chosen])
    return write_outputs(directory, {name: content for files in every for name, content in files.items()}, PLOT)


def announced(names: Sequence[str], told: Callable[[str, int], None]) -> Iterator[str]:
    """Yield names, each after it was told together with the number of all."""
    for name in names:
        told(name, len(names))
        yield name


def drawn(result: Drawable, name: str, formats: Sequence[str], style: Style = USUAL) -> dict[str, bytes]:
    """Draw one figure of a result, and return the contents of its files by their names."""
    return files_of(figure_named(name)(result, style), file_of(name), formats, style)
