"""What makes a fit a failed one whatever else holds: a readout against its data, a flat line through ratings."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.check_table import layout_of
from softness_bayes.checking.direction import Choice, evidence_in
from softness_bayes.checking.flatness import Explained, explain
from softness_bayes.checking.quantities import Layout
from softness_bayes.likelihood.magnitude import direction_named

if TYPE_CHECKING:
    import xarray as xr

TYPICAL = "typical_rating_of_condition"
"""Rating predicted of a typical participant in each condition, by fabric and then load, in the group `predictions`."""

SILENT = 0.99
"""Share of silent draws from which a result without `TYPICAL` is known to predict one rating for everything."""


MOSTLY_SILENT = 0.5
"""Share of silent draws and conditions beyond which it is said what their silence means."""


class Fit(NamedTuple):
    """Whether the model follows the ratings at all."""

    choice: Choice
    """The direction of the run, and what its data say of it."""
    loads: tuple[str, ...]
    explained: tuple[Explained, ...]
    """What the response explains under each load, then under all; empty where a result does not tell."""
    silent: float
    """Share of the posterior's draws that are silent in every condition."""
    silent_conditions: float
    """Share of draws and conditions in which no receptor fires."""
    fabric_effects: bool
    """Whether fabrics have effects of their own beside the response."""
    scale: str
    """What standard deviations are of."""

    @property
    def flat(self) -> list[str]:
        """Where the prediction runs flat through ratings that differ, a clause each."""
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
        """Why the fit has failed, a sentence each, the first the most telling; empty if it has not."""
        found = [self.choice.sentence] if self.choice.against_data else []
        if self.flat:
            silent = f" ({self.silent:.0%} of the posterior is silent in every condition)" if self.silent > 0.5 else ""
            found.append(f"the prediction is flat where the ratings are not{silent}: {'; '.join(self.flat)}")
        return found

    @property
    def silence(self) -> str:
        """How silent the posterior is and what that means; empty where it is not for the most part."""
        if self.silent_conditions <= MOSTLY_SILENT:
            return ""
        return (
            f"the posterior is {self.silent_conditions:.0%} silent (draws and conditions in which no receptor fires): "
            "there one rating is predicted for all fabrics, and skin and receptors are told by the prior, and by the "
            "limit that nothing may fire; are the units of moduli and loads right, and the priors those of these "
            "fingers (--priors in-vivo)?"
        )

    @property
    def sentence(self) -> str:
        """What the response explains of the ratings."""
        if not self.explained or not np.isfinite(self.explained[-1].p_value):
            return "whether the response follows the ratings cannot be told: nothing tells their differences from noise"
        whole = self.explained[-1]
        seen = f"a standard deviation of {whole.visible:.2g} between fabrics would have been seen"
        if not np.isfinite(whole.share) or not whole.p_value < 0.05:
            return f"fabrics do not differ in rating beyond noise (p = {whole.p_value:.2g}; {seen})"
        return (
            f"the response explains {_share(whole)} of the differences between fabrics under the same load "
            f"(standard deviation {whole.spread:.2g} in the {self.scale}; {seen})"
        )


def fit_of(tree: xr.DataTree) -> Fit:
    """Return how the model of a result follows its ratings.

    Parameters
    ----------
    tree
        The groups of a result.
    """
    layout, found = layout_of(tree), tree.attrs
    ratings = _values(tree, "observed_data", "rating")
    loads = [str(load) for load in _values(tree, "constant_data", "load")]
    evidence = evidence_in(layout, ratings, loads, float(found.get("firing_rises", 1.0)))
    choice = Choice(direction_named(str(found["direction"])), bool(found.get("direction_asked", 1)), evidence)
    silent = float(found.get("posterior_silent_everywhere", 0.0))
    predicted = _predicted(tree, silent, layout)
    explained: tuple[Explained, ...] = ()
    scale = "log rating" if layout.logarithmic else "z-score"
    if predicted is not None:
        known = np.log(predicted) if layout.logarithmic else predicted
        explained = tuple(explain(layout, layout.fit(ratings), known))
    silent_conditions = float(found.get("posterior_silent_conditions", silent))
    return Fit(
        choice, evidence.loads, explained, silent, silent_conditions, "omega" in tree["posterior"].to_dataset(), scale
    )


def _predicted(tree: xr.DataTree, silent: float, layout: Layout) -> NDArray[np.float64] | None:
    """Return the typical rating in every condition of a layout, (draws, conditions); None where it is not known."""
    stored = tree["predictions"].to_dataset() if "predictions" in tree.children else {}
    if TYPICAL in stored:
        by_fabric = np.argsort(np.lexsort((layout.load, layout.design.fabric)))
        return np.asarray(stored[TYPICAL].values[0], float)[:, by_fabric]
    return np.ones((1, layout.design.n_conditions)) if silent >= SILENT else None


def _flat(one: Explained) -> str:
    return (
        f"it explains {_share(one)} of the differences between fabrics, whose mean ratings differ by a standard "
        f"deviation of {one.spread:.2g} (p = {one.p_value:.1g} if by noise)"
    )


def _share(one: Explained) -> str:
    if one.high < 0:
        return "none"
    return f"{max(one.share, 0.0):.0%} (90 % interval {max(one.low, 0.0):.0%} to {one.high:.0%})"


def _values(tree: xr.DataTree, group: str, name: str) -> NDArray[np.float64]:
    return np.asarray(tree[group].to_dataset()[name].values)
