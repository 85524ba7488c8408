"""Identifiability of the parameters of a run: contraction, sensitivity and informed combinations, from its result."""

from __future__ import annotations

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
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.signed import magnitude
from softness_bayes.provenance import Provenance

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]


def information_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return each parameter's posterior contraction, and its sensitivity to prior and likelihood.

    Parameters
    ----------
    tree
        The groups of a result: `posterior`, `log_prior` and `log_likelihood`, and the priors' written
        forms in its attributes.

    Returns
    -------
    DataFrame
        A row per parameter that has a prior: prior_mean, prior_sd (natural units), contraction,
        psens_prior, psens_likelihood, and their Monte-Carlo standard errors psens_prior_mcse,
        psens_likelihood_mcse. mu, which is drawn after the run, has no sensitivities, because it is integrated out of
        the power-scaled likelihood.
    """
    import pandas as pd

    posterior, priors = _draws(tree, "posterior"), _draws(tree, "log_prior")
    log_prior, log_likelihood = (np.sum([*d.values()], axis=0) for d in (priors, _draws(tree, "log_likelihood")))
    rows = {}
    for name, prior in Provenance(tree.attrs).priors.items():
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
    """Return principal directions of the posterior, best informed first, in logarithms of the sampled parameters.

    Parameters
    ----------
    tree
        The groups of a result.

    Returns
    -------
    DataFrame
        A row per direction (index ``direction``, from 1): contraction along it; for each parameter the
        component of the unit vector, in units of the log parameter's prior sd; then the product of parameters that
        represents it, if the data narrow it (product; factor_90, factor_90_mcse, prior_factor_90: factor between its
        median and its 90 % limits; width: width of the limits relative to that under the prior); and its meaning in
        words.
    """
    import pandas as pd

    names = [*_draws(tree, "log_prior")]
    priors, posterior = Provenance(tree.attrs).priors, _draws(tree, "posterior")
    theta = np.abs(np.stack([posterior[name] for name in names], axis=-1))  # a signed exponent has no logarithm
    laws = [magnitude(EVERY_PARAMETER[name].cut(priors[name])) for name in names]
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


def information_sentences(summary: pd.DataFrame) -> list[str]:
    """Describe which parameters the data determine, partly inform or leave open, and which depend on the prior.

    Parameters
    ----------
    summary
        A table with the columns of `information_table`.
    """
    width = _width(summary["contraction"])
    groups = {
        "determined by the data (posterior sd at most 1/3 of the prior sd)": width <= DETERMINED,
        f"partly informed by the data (posterior sd at most {INFORMED:g} of the prior sd)": (width > DETERMINED)
        & (width <= INFORMED),
        "weakly identified (posteriors nearly as wide as the priors)": width > INFORMED,
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
        lines.append(
            f"informed, but prior-sensitive (power-scaling sensitivity above {SENSITIVE} by two standard errors): "
            f"{named}. Another prior would change these posteriors: justify these priors, or compare runs with other "
            "priors (--prior). Weakly identified parameters follow their priors in any case"
        )
    if unclear.any():
        named = ", ".join(f"{name} ({pull[name]:.3f} ± {error[name] / 2:.1g})" for name in pull.index[unclear])
        lines.append(f"prior sensitivity unclear (within two standard errors of {SENSITIVE}): {named}")
    return lines


def direction_sentences(directions: pd.DataFrame) -> list[str]:
    """Describe the combinations of parameters that the data determine, partly inform, or leave open.

    Parameters
    ----------
    directions
        Table from `direction_table`.
    """
    width = directions["width"].astype(float)
    names = [*directions.columns[1 : directions.columns.get_loc("product")]]
    lines = []
    for words, there in {
        "combinations determined by the data (90 % interval at most 1/3 as wide as under the prior)": (
            width <= DETERMINED
        ),
        f"combinations partly informed by the data (at most {INFORMED:g} as wide)": (
            (width > DETERMINED) & (width <= INFORMED)
        ),
    }.items():
        if there.any():
            lines.append(f"{words}:")
            lines += [f"  {row['meaning'].partition(': ')[2]}" for _, row in directions[there].iterrows()]
    open_ = directions[~(width <= INFORMED)]
    if len(open_):
        share = (open_[names] ** 2).sum().sort_values(ascending=False, kind="stable")
        of = ", ".join(share.index[share >= 0.5])
        lines.append(
            f"weakly identified: {len(open_)} further combination{'s' * (len(open_) > 1)} of {of}, nearly as wide as "
            "under the prior. Many values of these fit the data equally well. To learn more, measure one of them "
            "directly; until then report results under several priors (--prior)"
        )
    return lines


def _open(contraction: float) -> str:
    width = float(_width(contraction))
    beside = "as wide as" if abs(width - 1.0) < 0.05 else f"{100 * width:.0f} % as wide as"
    return f"not informed: {beside} under the prior"


def _has_errors(summary: pd.DataFrame) -> bool:
    """Return whether a summary has Monte-Carlo errors of sensitivities, which earlier versions did not store."""
    return "psens_prior_mcse" in summary


def _width(contraction: Any) -> Any:
    """Posterior sd over prior sd."""
    return np.sqrt(np.maximum(1.0 - contraction, 0.0))


def _draws(tree: xr.DataTree, group: str) -> dict[str, Array]:
    """Return the scalar variables of a group, with the draws of all chains on one axis."""
    dataset = tree[group].to_dataset()
    return {str(name): v.values.ravel() for name, v in dataset.items() if v.dims == SAMPLE_DIMS}
