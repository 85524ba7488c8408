"""First-order shifts of a run's conclusions due to errors in moduli that were taken as exact."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.checking.checks import MODULUS_STEP
from softness_bayes.checking.modulus_errors import directions, posterior_shift, scores, shift_table
from softness_bayes.model.other_moduli import rates_of_other_moduli
from softness_bayes.results.draws import RatedDraws
from softness_bayes.results.groups import Variable, evenly
from softness_bayes.results.predictions import turning_draws

if TYPE_CHECKING:
    import pandas as pd

SHIFT_DRAWS = 1000
"""Number of posterior draws from which the shifts are estimated."""

SHIFTED = ("b", "m", "sigma_0", "gamma")
"""Parameters whose shifts are reported, if they are sampled."""


def modulus_shifts(draws: RatedDraws, inflection: Mapping[str, Variable]) -> pd.DataFrame | None:
    """Return the table of `shift_table` for the skin, the receptors' threshold, gamma and the turning points.

    Parameters
    ----------
    draws
        The draws of the run.
    inflection
        The group `inflection`, at the points of `turning_draws`.

    Returns
    -------
    DataFrame or None
        None if no modulus is taken as exact.
    """
    space, design = draws.posterior.space, draws.ratings.design
    exact = np.setdiff1d(np.arange(design.n_fabrics), () if space.moduli is None else space.moduli.uncertain)
    if not exact.size:
        return None
    points = turning_draws(draws)
    index = evenly(points.shape, int(draws.share * SHIFT_DRAWS))
    theta = points[index]
    signs, share = directions(exact.astype(np.intp), design.n_fabrics)
    rates = rates_of_other_moduli(draws.posterior, theta, MODULUS_STEP)
    score = scores(draws.ratings, rates, draws.posterior.rating_parameters(theta), signs)
    quantities = {name: np.log(np.abs(theta[:, space.names.index(name)])) for name in SHIFTED if name in space.names}
    modulus = inflection["inflection_e_fab_kpa"].values[index]
    for name, where in zip(draws.load_groups.names, modulus.T, strict=True):
        quantities[f"turning point at {name}"] = np.log(where)
    return shift_table([*quantities], [posterior_shift(values, score, share) for values in quantities.values()])
