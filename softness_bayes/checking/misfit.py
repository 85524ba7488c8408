"""Detection of failed fits: a direction that contradicts the data, or a flat prediction for ratings that differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.flatness import Explained, explain
from softness_bayes.checking.layout import Layout, groups_in, layout_of, values_in
from softness_bayes.provenance import DirectionTaken, Provenance
from softness_bayes.readable import chance, percent

if TYPE_CHECKING:
    import xarray as xr

TYPICAL = "typical_rating_of_condition"
"""Name of the predicted rating of a typical participant, by fabric and then load, in the group `predictions`."""

SILENT = 0.99
"""Share of silent draws above which a result without `TYPICAL` is assumed to predict equal ratings in all
conditions."""


MOSTLY_SILENT = 0.5
"""Share of silent draws and conditions above which a result explains their meaning."""


class Fit(NamedTuple):
    """Agreement of a model with its ratings, with the criteria of a failed fit."""

    direction: DirectionTaken
    """The direction of the run, and that of the data."""
    loads: tuple[str, ...]
    explained: tuple[Explained, ...]
    """Share explained by the response under each load, then under all; empty if a result does not store it."""
    silent: float
    """Share of posterior draws that are silent in every condition."""
    silent_conditions: float
    """Share of draws and conditions in which no receptor fires."""
    fabric_effects: bool
    """True if fabrics have random effects in addition to the response."""
    scale: str
    """The quantity whose standard deviations are given: log rating or z-score."""

    @property
    def flat(self) -> list[str]:
        """Loads under which the prediction is flat although ratings differ, one clause each."""
        if not self.explained:
            return []
        each = zip(self.loads, self.explained[:-1], strict=True)
        found = [f"at {load} {_flat(one)}" for load, one in each if one.flat]
        whole = self.explained[-1]
        if whole.flat:
            return found or [f"over all loads {_flat(whole)}"]
        return [] if self.fabric_effects else found

    @property
    def faults(self) -> list[str]:
        """Reasons for a failed fit, one sentence each, most important first; empty if it has not failed."""
        found = [self.direction.direction_note] if self.direction.against_data else []
        if self.flat:
            silent = (
                f" (in {percent(self.silent)} of the posterior no receptor fires in any condition)"
                if self.silent > 0.5
                else ""
            )
            found.append(f"the prediction is flat although the ratings differ{silent}: {'; '.join(self.flat)}")
        return found

    @property
    def silence_note(self) -> str:
        """The share of silence in the posterior and its meaning; empty for little silence, or a wrong direction."""
        if self.silent_conditions <= MOSTLY_SILENT or self.direction.against_data:
            return ""
        return (
            f"no receptor fires in {percent(self.silent_conditions)} of posterior draws and conditions; there the "
            "model predicts one rating for all fabrics, and only the prior and the absence of firing constrain skin "
            "and receptors. Check the units of moduli and loads, and whether the priors suit these fingers "
            "(--priors in-vivo)"
        )

    @property
    def sentence(self) -> str:
        """The share of the differences between ratings that the response explains, in words."""
        if not self.explained or not np.isfinite(self.explained[-1].p_value):
            return "the fit to the ratings cannot be assessed: these data do not show how large the noise is"
        whole = self.explained[-1]
        seen = f"a standard deviation of {whole.visible:.2g} between fabrics would have been detected"
        if not np.isfinite(whole.share) or not whole.p_value < 0.05:
            return (
                f"ratings do not differ between fabrics by more than noise explains (p = {whole.p_value:.2g}; {seen})"
            )
        return (
            f"the response explains {_share(whole)} of the differences between fabrics under the same load "
            f"(standard deviation {whole.spread:.2g} in the {self.scale}; {seen})"
        )


def fit_of(tree: xr.DataTree) -> Fit:
    """Return the agreement of the model of a result with its ratings.

    Parameters
    ----------
    tree
        The groups of a result.
    """
    layout, direction, silence = layout_of(tree), Provenance(tree.attrs).direction, Provenance(tree.attrs).silence
    ratings, names = values_in(tree, "observed_data", "rating"), groups_in(tree).names
    silent = silence.posterior_silent_everywhere
    predicted = _predicted(tree, silent, layout)
    explained: tuple[Explained, ...] = ()
    if predicted is not None:
        explained = tuple(explain(layout, layout.fit(ratings), layout.scale.additive(predicted)))
    conditions = silence.posterior_silent_conditions
    return Fit(
        direction,
        tuple(names[k] for k in layout.loads),
        explained,
        silent,
        silent if conditions is None else conditions,
        "omega" in tree["posterior"].to_dataset(),
        layout.scale.unit,
    )


def _predicted(tree: xr.DataTree, silent: float, layout: Layout) -> NDArray[np.float64] | None:
    """Return the typical rating in every condition of a layout, (draws, conditions); None if unknown."""
    known = predicted_ratings(tree, layout)
    if known is None and silent >= SILENT:
        return np.ones((1, layout.design.n_conditions))
    return known


def predicted_ratings(tree: xr.DataTree, layout: Layout) -> NDArray[np.float64] | None:
    """Return the rating of a typical rater in every condition of a layout, (draws, conditions); None if not stored."""
    stored = tree["predictions"].to_dataset() if "predictions" in tree.children else {}
    if TYPICAL not in stored:
        return None
    constant = tree["constant_data"].to_dataset()
    rows = constant["fabric_index"].values * constant["load"].size + constant["load_index"].values
    # stored by fabric and then load; a condition of a layout may contain several of these
    stored_of, values = np.unique(rows, return_inverse=True)[1], np.asarray(stored[TYPICAL].values[0], float)
    share = np.zeros((values.shape[1], layout.design.n_conditions))
    np.add.at(share, (stored_of, layout.design.condition), 1.0)
    if share.shape[0] == share.shape[1]:
        return values[:, share.argmax(axis=0)]
    return np.asarray(values @ (share / share.sum(axis=0)))


def _flat(one: Explained) -> str:
    return (
        f"it explains {_share(one)} of the differences between fabrics, whose mean ratings differ by a "
        f"standard deviation of {one.spread:.2g} (p = {one.p_value:.1g} under noise alone)"
    )


def _share(one: Explained) -> str:
    if one.high < 0:
        return "none"
    low, share, high = (chance(min(max(value, 0.0), 1.0)) for value in (one.low, one.share, one.high))
    return share if low == high else f"{share} (90 % interval {low} to {high})"
