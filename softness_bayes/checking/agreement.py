"""Agreement of predicted with given ratings: the share of the differences explained, and the fabrics rated highest."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, fdtri

from softness_bayes.checking.check_table import posterior_quantities
from softness_bayes.checking.individual import modulus_laws
from softness_bayes.checking.layout import groups_in, layout_of, ratings_in, values_in
from softness_bayes.checking.quantities import QUANTITIES, Columns
from softness_bayes.checking.sensitivity import prior_moments
from softness_bayes.likelihood.layout import ROUNDING, Additive, Layout
from softness_bayes.provenance import DirectionTaken, Provenance

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

FloatArray = NDArray[np.float64]

TYPICAL = "typical_rating_of_condition"
"""Name of the predicted rating of a typical participant, by fabric and then load, in the group `predictions`."""

FREE_SD = 0.5
"""Standard deviation of the law of a log modulus from which it is free to follow the ratings: a factor of 2.3 up or
down with a probability of 90 %."""

RATERS_OF_CELLS = "raters"
"""Variable of `constant_data` with the number of raters per cell, if ratings are means."""

CLEARLY = 1e-3
"""p-value below which fabrics clearly differ."""

FLAT = 0.1
"""Explained share below which a prediction is flat; and share of the differences under all loads below which those
under one load are negligible."""


class Explained(NamedTuple):
    """Share of the differences between fabrics that a prediction explains, under one load or under all of them."""

    share: float
    """Explained share of their variance beyond noise, median over draws; negative if the prediction has the opposite
    trend, NaN if fabrics do not differ."""
    low: float
    high: float
    """5 and 95 % limits over draws."""
    spread: float
    """Standard deviation of mean (log) ratings between fabrics, beyond noise."""
    p_value: float
    """p-value of the differences under noise alone; NaN if the noise is unknown."""
    visible: float
    """Standard deviation between fabrics that would have been detected."""
    matters: bool
    """True if these differences are more than a tenth of those under all loads."""

    @property
    def flat(self) -> bool:
        """True if the prediction is flat although fabrics differ."""
        return bool(self.p_value < CLEARLY and self.share < FLAT and self.matters)


def explain(
    layout: Layout, fit: Additive, predicted: FloatArray, noise: tuple[float, float] | None = None
) -> list[Explained]:
    """Return the explained share under each load, then under all of them; the means of loads are removed.

    Let S be the sum of squares of the fabrics' means about the mean of their load, S_m that of the differences from the
    prediction, and n the part of either due to noise. The share is 1 - (S_m - n) / (S - n). An F-test of S against
    the residuals of the additive fit decides whether fabrics differ.

    Parameters
    ----------
    layout
        Design of the ratings.
    fit
        The additive fit of the ratings.
    predicted
        Predicted (log) rating of each condition, up to a constant of each draw, shape (draws, conditions).
    noise
        Standard deviation of the noise of a rating and its degrees of freedom, if they do not come from the residuals.
    """
    count = layout.design.cells.sum(axis=0)
    parts = [np.flatnonzero(layout.load == k) for k in layout.loads]
    seen, left = np.zeros(len(parts)), np.zeros((len(parts), len(predicted)))
    for k, some in enumerate(parts):
        seen[k] = _squares(fit.condition[some], count[some])
        left[k] = _squares(fit.condition[some] - predicted[:, some], count[some])
    freedom = np.array([some.size - 1 for some in parts])
    (sd, of_sd), whole = noise or (float(fit.sd), layout.residual_freedom), float(seen.sum())
    each = [_explained(seen[k], left[k], freedom[k], count[p].mean(), sd, of_sd, whole) for k, p in enumerate(parts)]
    return [*each, _explained(whole, left.sum(axis=0), int(freedom.sum()), count.mean(), sd, of_sd, whole)]


def _explained(
    seen: float, left: FloatArray, freedom: int, count: float, sd: float, residual: float, everything: float
) -> Explained:
    """Return the explained share of a sum of squares, from its degrees of freedom and those of the residuals' sd."""
    if freedom < 1 or not sd > ROUNDING:
        return Explained(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, False)
    noise = freedom * sd**2
    p_value = float(fdtrc(freedom, residual, seen / noise))
    visible = sd * np.sqrt(max(float(fdtri(freedom, residual, 1.0 - CLEARLY)) - 1.0, 0.0) / count)
    spread = np.sqrt(max(seen - noise, 0.0) / freedom / count)
    matters = seen - noise > FLAT * everything
    if not seen > noise:
        return Explained(np.nan, np.nan, np.nan, 0.0, p_value, float(visible), False)
    shares = 1.0 - (left - noise) / (seen - noise)
    low, share, high = np.quantile(shares, (0.05, 0.5, 0.95)).tolist()
    return Explained(share, low, high, float(spread), p_value, float(visible), bool(matters))


def _squares(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Return weighted sums of squares about the weighted mean, over the last axis."""
    centre = (values @ weight / weight.sum())[..., None]
    return (values - centre) ** 2 @ weight


class Fit(NamedTuple):
    """Agreement of a model with its ratings, with the criteria of a failed fit."""

    direction: DirectionTaken
    """The direction of the run, and that of the data."""
    loads: tuple[str, ...]
    explained: tuple[Explained, ...]
    """Share explained by the response under each load, then under all."""
    silent: float
    """Share of posterior draws that are silent in every condition."""
    silent_conditions: float
    """Share of draws and conditions in which no receptor fires."""
    fabric_effects: bool
    """True if fabrics have random effects in addition to the response."""
    unit: str
    """The quantity whose standard deviations are given: log rating or z-score."""
    free_moduli: int = 0
    """Number of sampled moduli whose laws are so wide that they can follow the ratings."""
    means: int = 0
    """Number of mean ratings: conditions."""

    @property
    def untestable(self) -> bool:
        """True if there are as many free moduli as means, so that the model can follow any ratings."""
        return 0 < self.means <= self.free_moduli

    @property
    def flat(self) -> list[tuple[str, Explained]]:
        """Loads under which the prediction is flat although ratings differ; all loads together if under no single one.

        With effects of fabrics only the prediction over all loads counts.
        """
        each = zip(self.loads, self.explained[:-1], strict=True)
        found = [(f"at {load}", one) for load, one in each if one.flat]
        whole = self.explained[-1]
        if whole.flat:
            return found or [("over all loads", whole)]
        return [] if self.fabric_effects else found

    @property
    def failed(self) -> bool:
        """True if the direction contradicts the data, or the prediction is flat although ratings differ."""
        return self.direction.against_data or bool(self.flat)

    @property
    def mostly_silent(self) -> bool:
        """True if no receptor fires in most draws and conditions."""
        return self.silent_conditions > 0.5


def fit_of(tree: xr.DataTree) -> Fit:
    """Return the agreement of the model of a result with its ratings.

    Parameters
    ----------
    tree
        The groups of a result.
    """
    layout, provenance, names = layout_of(tree), Provenance(tree.attrs), groups_in(tree).names
    laws = modulus_laws(tree["constant_data"].to_dataset())
    predicted = layout.scale.additive(predicted_ratings(tree, layout))
    data = layout.fit(ratings_in(tree))
    return Fit(
        provenance.direction,
        tuple(names[k] for k in layout.loads),
        tuple(explain(layout, data, predicted, _noise_of_cells(tree))),
        provenance.silence.posterior_silent_everywhere,
        provenance.silence.posterior_silent_conditions,
        "omega" in tree["posterior"].to_dataset(),
        layout.scale.unit,
        sum(prior_moments(law, np.log)[1] > FREE_SD for law in laws.values()),
        layout.design.n_conditions,
    )


def _noise_of_cells(tree: xr.DataTree) -> tuple[float, float] | None:
    """Return the noise of means over the raters of a cell, and its degrees of freedom; None for single ratings."""
    constant, posterior = (tree[group].to_dataset() for group in ("constant_data", "posterior"))
    if RATERS_OF_CELLS not in constant:
        return None
    raters = int(constant[RATERS_OF_CELLS])
    sd = float(np.median((posterior if "varsigma" in posterior else constant)["varsigma"])) / math.sqrt(raters)
    return sd, float(max(raters - 1, 1) * constant["fabric_index"].size)


def predicted_ratings(tree: xr.DataTree, layout: Layout) -> FloatArray:
    """Return the rating of a typical rater in every condition of a layout, (draws, conditions)."""
    constant = tree["constant_data"].to_dataset()
    rows = constant["fabric_index"].values * constant["load"].size + constant["load_index"].values
    # stored by fabric and then load; a condition of a layout may contain several of these
    stored_of = np.unique(rows, return_inverse=True)[1]
    values = values_in(tree, "predictions", TYPICAL)[0].astype(float)
    share = np.zeros((values.shape[1], layout.design.n_conditions))
    np.add.at(share, (stored_of, layout.design.condition), 1.0)
    if share.shape[0] == share.shape[1]:  # without products, so that equal ratings remain equal
        return np.asarray(values[:, share.argmax(axis=0)])
    return np.asarray(values @ (share / share.sum(axis=0)))


class HighestRated(NamedTuple):
    """The fabric that most probably has the highest rating under one load."""

    load: str
    fabric: str
    probability: float
    """Probability of the highest rating by a typical rater among the fabrics rated under this load, divided equally
    among ties."""
    error: float
    """Its Monte-Carlo standard error."""
    fabrics: int
    """Number of fabrics rated under this load."""

    @property
    def clear(self) -> bool:
        """True if the fabric is more probably the highest than not, even allowing for Monte-Carlo error."""
        return self.probability - 2.0 * self.error > 0.5


def highest_rated(tree: xr.DataTree) -> tuple[HighestRated, ...]:
    """Return the fabric with the highest predicted rating under each load with at least two.

    Parameters
    ----------
    tree
        The groups of a result on ratings.
    """
    layout = layout_of(tree)
    predicted = predicted_ratings(tree, layout)
    fabrics, loads = values_in(tree, "constant_data", "fabric").astype(str), groups_in(tree).names
    found = []
    for load in layout.loads:
        here = np.flatnonzero(layout.load == load)
        if here.size < 2:
            continue
        top = predicted[:, here] == predicted[:, here].max(axis=1, keepdims=True)
        share = (top / top.sum(axis=1, keepdims=True)).mean(axis=0)
        best = int(share.argmax())
        error = float(np.sqrt(share[best] * (1.0 - share[best]) / len(predicted)))
        name = str(fabrics[layout.design.fabric[here[best]]])
        found.append(HighestRated(loads[load], name, float(share[best]), error, here.size))
    return tuple(found)


def fabric_rating_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return rated and predicted mean ratings of every fabric under every load.

    Predictions are means of replicated ratings by the same participants, so that the band includes both the scatter of
    the actual number of ratings and the uncertainty of the model. The means are those of the additive fit to the
    participants (`layout.Layout.fit`), for magnitude estimates geometric ones. Because the replicates come from a
    fit to the same ratings, the differences are somewhat too small.

    Parameters
    ----------
    tree
        The groups of a result on ratings.

    Returns
    -------
    DataFrame
        Index load and fabric; columns e_fab_kpa, ratings (their number), rated, predicted (median), predicted_low and
        predicted_high (limits of 90 % of the replicates), difference_sd: rated minus the mean of the replicates, on the
        additive scale, in standard deviations of the replicates.
    """
    import pandas as pd

    layout = layout_of(tree)
    (means,) = posterior_quantities(tree, [one for one in QUANTITIES if one.columns is Columns.CONDITION])
    rated = np.array([finding.observed for finding in means.findings])
    low, middle, high = np.quantile(means.replicated, (0.05, 0.5, 0.95), axis=0)
    spread = means.replicated.std(axis=0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        difference = np.where(spread > 0, (rated - means.replicated.mean(axis=0)) / spread, np.nan)
    natural = layout.scale.natural
    columns = {
        "load": [load for load, _, _ in means.labels],
        "fabric": [fabric for _, fabric, _ in means.labels],
        "e_fab_kpa": layout.modulus * 1e-3,
        "ratings": layout.design.cells.sum(axis=0).astype(int),
        "rated": natural(rated),
        "predicted": natural(middle),
        "predicted_low": natural(low),
        "predicted_high": natural(high),
        "difference_sd": difference,
    }
    return pd.DataFrame(columns).set_index(["load", "fabric"])
