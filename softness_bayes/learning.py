"""Tables of what a run has learnt, from the groups of its result alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.arviz_bridge import SAMPLE_DIMS
from softness_bayes.inference.priors import Prior, parse_prior
from softness_bayes.inference.sensitivity import (
    PRIOR_DRIVEN,
    SENSITIVE,
    contraction,
    find_directions,
    in_words,
    power_scaling,
    prior_moments,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]


def learning_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return how far each parameter came from its prior, and what its posterior rests on.

    Parameters
    ----------
    tree
        The groups of a result: `posterior`, `log_prior` and `log_likelihood`, and the priors' written
        forms in its attributes.

    Returns
    -------
    DataFrame
        A row per parameter that has a prior: prior_mean, prior_sd (natural units), contraction,
        psens_prior, psens_likelihood. The sensitivities of what was drawn after the run (mu) are
        missing: it is integrated out of the likelihood whose power they change.
    """
    import pandas as pd

    posterior, priors = _draws(tree, "posterior"), _draws(tree, "log_prior")
    log_prior, log_likelihood = (np.sum([*d.values()], axis=0) for d in (priors, _draws(tree, "log_likelihood")))
    rows = {}
    for name, prior in _priors(tree.attrs).items():
        if name not in posterior:
            continue
        draws, (mean, sd) = posterior[name], prior_moments(prior)
        sampled = name in priors
        rows[name] = {
            "prior_mean": mean,
            "prior_sd": sd,
            "contraction": float(contraction(sd, draws.std(ddof=1))),
            "psens_prior": power_scaling(draws, log_prior) if sampled else np.nan,
            "psens_likelihood": power_scaling(draws, log_likelihood) if sampled else np.nan,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def direction_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return the directions of what was learnt, stiffest first, in logarithms of the sampled parameters.

    Parameters
    ----------
    tree
        The groups of a result.

    Returns
    -------
    DataFrame
        A row per direction (index ``direction``, from 1): contraction along it; for each parameter the
        component of the unit vector, in units of the log parameter's prior sd; and its meaning in words.
    """
    import pandas as pd

    names = [*_draws(tree, "log_prior")]
    priors, posterior = _priors(tree.attrs), _draws(tree, "posterior")
    theta = np.stack([posterior[name] for name in names], axis=-1)
    found = find_directions([priors[name] for name in names], theta)
    table = pd.DataFrame(found.vectors, columns=names)
    table.insert(0, "contraction", found.contraction)
    table["meaning"] = [in_words(names, found, k) for k in range(len(names))]
    table.index = pd.RangeIndex(1, len(names) + 1, name="direction")
    return table


def learning_sentences(summary: pd.DataFrame) -> list[str]:
    """Say which parameters are prior-driven, and which feel the priors although the data speak.

    Parameters
    ----------
    summary
        A table with the columns of `learning_table`.
    """
    driven = [str(n) for n in summary.index[summary["contraction"] < PRIOR_DRIVEN]]
    moved = [str(n) for n in summary.index[summary["psens_prior"] > SENSITIVE] if n not in driven]
    lines = [
        f"prior-driven, the prior weighs more than the data: {', '.join(driven)}"
        if driven
        else "no parameter is prior-driven: the data weigh more than the prior in all of them"
    ]
    if moved:
        lines.append(f"told by the data, yet other priors would move them: {', '.join(moved)}")
    return lines


def _priors(attributes: Mapping[Any, Any]) -> dict[str, Prior]:
    """Return the priors among the attributes of a result."""
    written = {str(key).removeprefix("prior_"): text for key, text in attributes.items() if str(key)[:6] == "prior_"}
    return {name: parse_prior(text) for name, text in written.items() if isinstance(text, str) and "(" in text}


def _draws(tree: xr.DataTree, group: str) -> dict[str, Array]:
    """Return the scalar variables of a group, draws of all chains in one axis."""
    dataset = tree[group].to_dataset()
    return {str(name): v.values.ravel() for name, v in dataset.items() if v.dims == SAMPLE_DIMS}
