"""Tables of what a run has learnt, from the groups of its result alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.arviz_bridge import SAMPLE_DIMS
from softness_bayes.checking.combinations import find_products
from softness_bayes.checking.sensitivity import (
    DETERMINED,
    INFORMED,
    SENSITIVE,
    contraction,
    find_directions,
    power_scaling_with_error,
    prior_moments,
)
from softness_bayes.parameters.priors import Prior, parse_prior

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
        psens_prior, psens_likelihood, and the Monte-Carlo errors psens_prior_mcse, psens_likelihood_mcse. The
        sensitivities of what was drawn after the run (mu) are
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
            "psens_prior": np.nan,
            "psens_likelihood": np.nan,
            "psens_prior_mcse": np.nan,
            "psens_likelihood_mcse": np.nan,
        }
        for kind, component in (("prior", log_prior), ("likelihood", log_likelihood)):
            if sampled:
                sensitivity, error = power_scaling_with_error(draws, component)
                rows[name] |= {f"psens_{kind}": sensitivity, f"psens_{kind}_mcse": error}
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
        component of the unit vector, in units of the log parameter's prior sd; then the product that it stands
        for, if the data narrow it (product, factor_90, factor_90_mcse, prior_factor_90: its 90 % limits are the
        middle times and over the factor; width: that of the limits over that under the prior); and its meaning in
        words.
    """
    import pandas as pd

    names = [*_draws(tree, "log_prior")]
    priors, posterior = _priors(tree.attrs), _draws(tree, "posterior")
    theta = np.stack([posterior[name] for name in names], axis=-1)
    laws = [priors[name] for name in names]
    found = find_directions(laws, theta)
    table = pd.DataFrame(found.vectors, columns=names)
    table.insert(0, "contraction", found.contraction)
    products = find_products(laws, theta, found)
    for column, of in (
        ("product", lambda one: one.written(names)),
        ("factor_90", lambda one: one.factor),
        ("factor_90_mcse", lambda one: one.error),
        ("prior_factor_90", lambda one: one.prior_factor),
        ("width", lambda one: one.width),
    ):
        table[column] = [None if one is None else of(one) for one in products]
    table["meaning"] = [
        _open(told) if one is None else one.sentence(names)
        for one, told in zip(products, found.contraction, strict=True)
    ]
    table.index = pd.RangeIndex(1, len(names) + 1, name="direction")
    return table


def learning_sentences(summary: pd.DataFrame) -> list[str]:
    """Say which parameters the data determine, inform and do not inform, and which ones other priors would move.

    Parameters
    ----------
    summary
        A table with the columns of `learning_table`.
    """
    width = _width(summary["contraction"])
    groups = {
        "determined by the data (posterior sd up to 1/3 of the prior's)": width <= DETERMINED,
        f"informed (up to {INFORMED:g})": (width > DETERMINED) & (width <= INFORMED),
        "not informed (wider; what is said of them is what their priors say)": width > INFORMED,
    }
    lines = [
        f"{words}: {', '.join(f'{name} {width[name]:.2g}' for name in summary.index[there]) or 'none'}"
        for words, there in groups.items()
    ]
    pull = summary["psens_prior"][width <= INFORMED]
    error = 2.0 * summary["psens_prior_mcse"].reindex(pull.index).fillna(0.0) if _has_errors(summary) else 0.0 * pull
    moved, unclear = pull > SENSITIVE + error, (pull - SENSITIVE).abs() <= error
    if moved.any():
        named = ", ".join(f"{name} ({pull[name]:.2g})" for name in pull.index[moved])
        lines.append(f"another prior would move (sensitivity beyond {SENSITIVE} by two errors): {named}")
    if unclear.any():
        named = ", ".join(f"{name} ({pull[name]:.3f} ± {error[name] / 2:.1g})" for name in pull.index[unclear])
        lines.append(f"cannot tell whether another prior would move: {named}")
    return lines


def direction_sentences(directions: pd.DataFrame) -> list[str]:
    """Say which combinations of parameters the data determine, which they inform, and which they leave open.

    Parameters
    ----------
    directions
        As `direction_table` returns it.
    """
    width = directions["width"].astype(float)
    names = [*directions.columns[1 : directions.columns.get_loc("product")]]
    lines = []
    for words, there in {
        "combinations that the data determine (90 % limits up to 1/3 as wide as under the prior)": width <= DETERMINED,
        f"combinations that they inform (up to {INFORMED:g})": (width > DETERMINED) & (width <= INFORMED),
    }.items():
        if there.any():
            lines.append(f"{words}:")
            lines += [f"  {row['meaning'].partition(': ')[2]}" for _, row in directions[there].iterrows()]
    open_ = directions[~(width <= INFORMED)]
    if len(open_):
        share = (open_[names] ** 2).sum().sort_values(ascending=False, kind="stable")
        of = ", ".join(share.index[share >= 0.5])
        one = len(open_) == 1
        lines.append(
            f"left open: {len(open_)} further combination{'' if one else 's'} of {of}, nearly as wide as under the "
            "prior. To go further, measure one of these parameters or compare runs under several priors (--prior)"
        )
    return lines


def _open(contraction: float) -> str:
    width = float(_width(contraction))
    beside = "as wide as" if abs(width - 1.0) < 0.05 else f"{width:.0%} as wide as"
    return f"not informed: {beside} under the prior"


def _has_errors(summary: pd.DataFrame) -> bool:
    """Return whether a summary has the errors of its sensitivities: those of earlier versions have none."""
    return "psens_prior_mcse" in summary


def _width(contraction: Any) -> Any:
    """Posterior sd over prior sd."""
    return np.sqrt(np.maximum(1.0 - contraction, 0.0))


def _priors(attributes: Mapping[Any, Any]) -> dict[str, Prior]:
    """Return the priors among the attributes of a result."""
    written = {str(key).removeprefix("prior_"): text for key, text in attributes.items() if str(key)[:6] == "prior_"}
    return {name: parse_prior(text) for name, text in written.items() if isinstance(text, str) and "(" in text}


def _draws(tree: xr.DataTree, group: str) -> dict[str, Array]:
    """Return the scalar variables of a group, draws of all chains in one axis."""
    dataset = tree[group].to_dataset()
    return {str(name): v.values.ravel() for name, v in dataset.items() if v.dims == SAMPLE_DIMS}
