"""Tables of simulated laboratories of each kind of ratings, with the true means of the raters in them."""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import expit, ndtr

from softness_bayes.data import Ratings
from softness_bayes.likelihood.error_laws import NORMAL, STUDENT
from softness_bayes.likelihood.scales import CATEGORIES, PAIRS, RANKS, SLIDER
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.contact import Indentation

LOADS = (Indentation(1e-3), Indentation(2e-3))
RATERS, FABRICS = tuple(f"rater {k:02d}" for k in range(12)), ("A", "B", "C", "D", "E")
THRESHOLDS = np.cumsum([0.0, 0.5, 0.4, 0.6, 0.5])
KINDS = ("normal", "whole", "student", "slider", "categories", "ranks", "pairs")


class Laboratory(NamedTuple):
    ratings: Ratings
    options: ModelOptions
    truth: Any
    """Mean rating of these raters, shape (fabrics, loads)."""


def laboratory(kind: str, rng: np.random.Generator, means: Any = None) -> Laboratory:
    """Return a laboratory of 12 raters of 5 fabrics under 2 loads; means (fabrics, loads) are drawn by default."""
    means = rng.normal(0.0, 0.7, (len(FABRICS), len(LOADS))) if means is None else np.asarray(means)
    tau, varsigma = np.exp(0.3 * rng.standard_normal(2)) * (0.5, 0.3)
    scale = tau * rng.standard_normal(len(RATERS))
    panel, shape = means + scale.mean(), (len(RATERS), *means.shape)
    error = rng.standard_t(4, shape) if kind == "student" else rng.standard_normal(shape)
    latent = means + scale[:, None, None] + varsigma * error
    if kind in ("normal", "whole", "student"):
        number = 20.0 * np.exp(latent)
        options = ModelOptions(errors=STUDENT if kind == "student" else NORMAL, resolution=float(kind == "whole"))
        return Laboratory(_crossed(number.round() if kind == "whole" else number), options, 20.0 * np.exp(panel))
    if kind == "slider":
        options = ModelOptions(scale=SLIDER, slider_ends=(0.0, 100.0), errors=NORMAL)
        return Laboratory(_crossed(np.round(100.0 * expit(latent))), options, 100.0 * expit(panel))
    if kind == "categories":
        category = 1.0 + (latent[..., None] + 1.0 > THRESHOLDS).sum(axis=-1)
        truth = 1.0 + ndtr((panel[..., None] + 1.0 - THRESHOLDS) / varsigma).sum(axis=-1)
        return Laboratory(_crossed(category), ModelOptions(scale=CATEGORIES, n_categories=6, errors=NORMAL), truth)
    worth = 1.5 * means
    chance = expit if kind == "ranks" else ndtr
    truth = np.stack([chance(worth[k] - np.delete(worth, k, axis=0)).mean(axis=0) for k in range(len(FABRICS))])
    if kind == "ranks":
        place = (worth + rng.gumbel(size=shape)).argsort(axis=1).argsort(axis=1) + 1.0
        return Laboratory(_crossed(place), ModelOptions(scale=RANKS), truth)
    who, load, first, second = np.indices((len(RATERS), len(LOADS), len(FABRICS), len(FABRICS))).reshape(4, -1)
    who, load, first, second = (index[first > second] for index in (who, load, first, second))
    won = worth[first, load] - worth[second, load] + rng.standard_normal(who.size) > 0
    return Laboratory(pairs_of(who, first, second, load, won), ModelOptions(scale=PAIRS), truth)


def pairs_of(who, first, second, load, won):
    """Return the table of pairs of fabrics, of which the first was judged softer where `won` is true."""
    fabric, rating = np.stack([first, second], axis=-1).ravel(), np.stack([won, ~won], axis=-1).ravel().astype(float)
    lists = np.repeat(np.arange(len(won)), 2)
    rows = np.arange(rating.size)
    return Ratings(RATERS, FABRICS, LOADS, np.repeat(who, 2), fabric, np.repeat(load, 2), rating, rows, lists=lists)


def _crossed(rating):
    return Ratings.crossed(RATERS, FABRICS, LOADS, rating)
