"""Every figure of a finished run, by the name of its file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softness_bayes.plotting.chains import rank_figure, trace_figure
from softness_bayes.plotting.compression import compression_figure
from softness_bayes.plotting.inflection import inflection_figure
from softness_bayes.plotting.parameters import corner_figure, prior_figure
from softness_bayes.plotting.rating import Observed, observed_ratings, rating_figure
from softness_bayes.plotting.response import ratio_figure, response_figure
from softness_bayes.plotting.style import USUAL, Style, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softness_bayes.result import Result

Array = NDArray[np.float64]


def _response(result: Result, style: Style) -> Figure:
    from softness_bayes.touch.contact import Finger

    return response_figure(
        result.curves(),
        result.loads,
        _fabric_modulus(result),
        inflection=result.inflections(),
        finger_radius=Finger().radius,
        style=style,
    )


def _response_ratio(result: Result, style: Style) -> Figure:
    return ratio_figure(result.curves(), result.loads, _fabric_modulus(result), style=style)


def _rating(result: Result, style: Style) -> Figure:
    stored = result.group("predictions").isel(chain=0)
    modulus, rating = stored["e_fab_kpa"].values * 1e3, stored["typical_rating"].values
    return rating_figure(
        modulus, rating, _observed(result), result.loads, logarithmic=_logarithmic(result), style=style
    )


def _inflection(result: Result, style: Style) -> Figure:
    return inflection_figure(result.inflections(), result.loads, _fabric_modulus(result), style=style)


def _corner(result: Result, style: Style) -> Figure:
    names = _sampled(result)
    return corner_figure(_draws(result, "posterior", names), _labels(names), style=style)


def _prior(result: Result, style: Style) -> Figure:
    names = _sampled(result)
    posterior, prior = (_draws(result, group, names) for group in ("posterior", "prior"))
    return prior_figure(posterior, prior, _labels(names), style=style)


def _trace(result: Result, style: Style) -> Figure:
    names = _sampled(result)
    return trace_figure(*_walkers(result, names), _labels(names), style=style)


def _rank(result: Result, style: Style) -> Figure:
    names = _sampled(result)
    return rank_figure(*_walkers(result, names), _labels(names), style=style)


def _compression(result: Result, style: Style) -> Figure:
    stored, constant = result.group("predictions").isel(chain=0), result.group("constant_data")
    return compression_figure(
        stored["plate_indentation_mm"].values * 1e-3,
        stored["typical_force_n"].values,
        constant["force_indentation_mm"].values * 1e-3,
        result.group("observed_data")["plate_force_n"].values,
        constant["finger_index"].values,
        style=style,
    )


FIGURES: Mapping[str, Callable[[Result, Style], Figure]] = MappingProxyType(
    {
        "response": _response,
        "response_ratio": _response_ratio,
        "rating": _rating,
        "inflection": _inflection,
        "corner": _corner,
        "prior": _prior,
        "trace": _trace,
        "rank": _rank,
        "compression": _compression,
    }
)
"""File name -> what draws it from a result."""

_OF_RATINGS = ("response", "response_ratio", "rating", "inflection")


def figures_of(result: Result) -> list[str]:
    """Return the names of the figures that a result can fill: those of ratings, of compression data, or both."""
    absent = (*(() if result.has_ratings else _OF_RATINGS), *(() if result.has_compression else ("compression",)))
    return [name for name in FIGURES if name not in absent]


def draw_figures(
    result: Result,
    directory: str | Path,
    names: Sequence[str] | None = None,
    formats: Sequence[str] = ("png", "pdf"),
    style: Style = USUAL,
) -> list[Path]:
    """Draw a result's figures and write them to a directory, which is made if there is none.

    Parameters
    ----------
    result
        A finished run; all that is drawn is stored in it.
    directory
        Where to write.
    names
        Which of `FIGURES`; by default those of `figures_of`.
    formats
        File formats, as `save` takes them.
    style
        How they look.

    Returns
    -------
    list of Path
        The files written.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    chosen = figures_of(result) if names is None else names
    drawn = [save(FIGURES[name](result, style), directory / name, formats, style) for name in chosen]
    return [path for paths in drawn for path in paths]


def _fabric_modulus(result: Result) -> Array:
    return result.group("constant_data")["effective_modulus_kpa"].values * 1e3


def _observed(result: Result) -> Observed:
    """Return the ratings by condition, a condition being a fabric under a load."""
    constant, modulus = result.group("constant_data"), _fabric_modulus(result)
    participant, fabric, load = (constant[f"{what}_index"].values for what in ("participant", "fabric", "load"))
    count = len(result.loads)
    return observed_ratings(
        result.group("observed_data")["rating"].values,
        load * modulus.size + fabric,
        participant,
        np.tile(modulus, count),
        np.repeat(np.arange(count), modulus.size),
        logarithmic=_logarithmic(result),
    )


def _logarithmic(result: Result) -> bool:
    from softness_bayes.inference.scales import RATING_SCALES

    return RATING_SCALES[str(result.attributes.get("rating_scale", "magnitude"))].positive


def _sampled(result: Result) -> list[str]:
    from softness_bayes.inference.parameters import EVERY_PARAMETER

    return [name for name in EVERY_PARAMETER if name in result.group("posterior")]


def _labels(names: Sequence[str]) -> list[str]:
    from softness_bayes.inference.parameters import EVERY_PARAMETER

    return [EVERY_PARAMETER[name].label for name in names]


def _draws(result: Result, group: str, names: Sequence[str]) -> Array:
    """Return draws of all chains side by side in time, shape (draws, parameters)."""
    stored = result.group(group)
    return np.stack([stored[name].values.T.ravel() for name in names], axis=-1)


def _walkers(result: Result, names: Sequence[str]) -> tuple[Array, NDArray[np.intp]]:
    stored = result.group("posterior")
    return np.stack([stored[name].values for name in names], axis=-1), stored["ensemble"].values
