"""Figures: each function draws the arrays that are passed to it and returns a matplotlib ``Figure``.

The functions do not run the model. matplotlib is imported only when a figure is made. Each artist that shows data
has a ``gid`` of the form ``what/load``, for example ``median/1 mm``.
"""

from softness_bayes.plotting.figures import FIGURES, draw_figures, figures_of
from softness_bayes.plotting.parameters import corner_figure, prior_figure, rank_figure, trace_figure
from softness_bayes.plotting.rating import Observed, observed_ratings, rating_figure
from softness_bayes.plotting.response import inflection_figure, ratio_figure, response_figure
from softness_bayes.plotting.style import USUAL, Style, save

__all__ = [
    "FIGURES",
    "USUAL",
    "Observed",
    "Style",
    "corner_figure",
    "draw_figures",
    "figures_of",
    "inflection_figure",
    "observed_ratings",
    "prior_figure",
    "rank_figure",
    "rating_figure",
    "ratio_figure",
    "response_figure",
    "save",
    "trace_figure",
]
