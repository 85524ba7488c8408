"""Predicted softest fabric under each load, from a result."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from softness_bayes.checking.layout import groups_in, layout_of
from softness_bayes.checking.misfit import predicted_ratings

if TYPE_CHECKING:
    import xarray as xr

CLEAR = 0.5
"""Probability above which a fabric is called the softest."""


class Softest(NamedTuple):
    """The fabric that is most probably the softest under one load."""

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
        """True if the fabric is more probably the softest than not, even allowing for Monte-Carlo error."""
        return self.probability - 2.0 * self.error > CLEAR


def softest_fabrics(tree: xr.DataTree) -> tuple[Softest, ...]:
    """Return the softest fabric under each load with at least two; empty for a result without predicted ratings.

    Parameters
    ----------
    tree
        The groups of a result on ratings.
    """
    layout = layout_of(tree)
    predicted = predicted_ratings(tree, layout)
    if predicted is None:
        return ()
    constant = tree["constant_data"].to_dataset()
    fabrics, loads = constant["fabric"].values.astype(str), groups_in(tree).names
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
        found.append(Softest(loads[load], name, float(share[best]), error, here.size))
    return tuple(found)
