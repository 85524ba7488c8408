"""Posteriors of single fabrics' moduli and of single raters' fingers and answers, as tables, from a result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.laws import Prior
from softness_bayes.checking.identifiability import contraction, prior_moments
from softness_bayes.checking.layout import UNCERTAIN
from softness_bayes.likelihood.plate import SKIN
from softness_bayes.parameters.declared import FABRIC_MODULUS
from softness_bayes.parameters.priors import parse_prior
from softness_bayes.touch.finger_grid import EFFECT_OF

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

LIMITS = (0.05, 0.5, 0.95)
"""Lower limit, median and upper limit in tables, as quantiles."""

FAR = 2.0
"""Distance, in standard deviations of its law, from which a mean log modulus is reported as far from the measured
one."""

MODULUS_LAW = "fabric_modulus_law"
"""Law of each sampled modulus [kPa] in its written form, in the group `constant_data`."""

POPULATION = "population"
"""Row of the table for a rater drawn from the population."""


def modulus_laws(constant: xr.Dataset) -> dict[str, Prior]:
    """Return the law of each sampled modulus [kPa] by fabric, from the group `constant_data`; empty without any."""
    if MODULUS_LAW not in constant:
        return {}
    return {
        str(name): parse_prior(str(text))
        for name, text in zip(constant[UNCERTAIN].values, constant[MODULUS_LAW].values, strict=True)
    }


def modulus_limits(posterior: xr.Dataset) -> Array:
    """Return the lower limit, median and upper limit of sampled moduli [kPa], shape (3, fabrics)."""
    drawn = posterior[FABRIC_MODULUS].values
    return np.asarray(np.quantile(drawn.reshape(-1, drawn.shape[-1]), LIMITS, axis=0))


def modulus_table(tree: xr.DataTree) -> pd.DataFrame | None:
    """Return the posterior of each uncertain modulus; None if all are known exactly.

    Parameters
    ----------
    tree
        The groups of a result.

    Returns
    -------
    DataFrame
        A row per fabric: law (its written form), law_median; median, low and high (90 % limits) of the posterior
        [kPa]; law_sd_log and sd_log, standard deviations of the log modulus; contraction, 1 - (sd_log / law_sd_log)²;
        shift, the mean log modulus minus that of the law, in its standard deviations.
    """
    posterior = tree["posterior"].to_dataset()
    if FABRIC_MODULUS not in posterior:
        return None
    low, median, high = modulus_limits(posterior)
    laws = [*modulus_laws(tree["constant_data"].to_dataset()).values()]
    mean, sd = np.array([prior_moments(law, np.log) for law in laws]).T
    log = np.log(posterior[FABRIC_MODULUS].values.reshape(-1, median.size))
    spread = log.std(axis=0, ddof=1)
    columns = {
        "law": [str(law) for law in laws],
        "law_median": [law.median for law in laws],
        "median": median,
        "low": low,
        "high": high,
        "law_sd_log": sd,
        "sd_log": spread,
        "contraction": contraction(sd, spread),
        "shift": (log.mean(axis=0) - mean) / sd,
    }
    return pd.DataFrame(columns, index=pd.Index(posterior[UNCERTAIN].values.astype(str), name="fabric"))


def deviation_table(tree: xr.DataTree, effects: Mapping[str, str], spreads: Mapping[str, str]) -> pd.DataFrame | None:
    """Return the posterior of each rater's own quantities: of fingers, or of answers; None if all raters are typical.

    Parameters
    ----------
    tree
        The groups of a result.
    effects, spreads
        Variables of the raters' deviations, and of their standard deviation, by quantity.

    Returns
    -------
    DataFrame
        For each quantity that differs between raters a row for the population (a rater drawn from it) and one for
        each rater: participant and quantity (index); median, low and high (90 % limits) in the quantity's unit;
        ratio, the rater's median over that of the typical one; and of fingers pressed, whether plate forces on this
        rater's finger also inform the quantity.
    """
    posterior = tree["posterior"].to_dataset()
    names = [name for name, effect in effects.items() if effect in posterior]
    if not names:
        return None
    held = tree["constant_data"].to_dataset()
    people, rows = posterior["participant"].values.astype(str), []
    fingers = posterior["finger"].values.astype(str).tolist() if "finger" in posterior.coords else []
    rng = np.random.default_rng(0)
    for name in names:
        typical, spread = (
            np.ravel((posterior if one in posterior else held)[one].values).astype(float)
            for one in (name, spreads[name])
        )
        anyone = spread * rng.standard_normal(np.broadcast_shapes(typical.shape, spread.shape))
        each = posterior[effects[name]].values.reshape(-1, people.size)
        deviations = {POPULATION: anyone, **dict(zip(people.tolist(), each.T, strict=True))}
        for who, deviation in deviations.items():
            rows.append({"participant": who, "quantity": name, **_limits(name, typical, deviation)})
            if effects is EFFECT_OF:
                rows[-1]["pressed"] = name in SKIN and who in fingers
    return pd.DataFrame(rows).set_index(["participant", "quantity"])


def _limits(name: str, typical: Array, deviation: Array) -> dict[str, Any]:
    # only m deviates in its own unit, all others in the logarithm
    value = np.maximum(typical + deviation, 0.0) if name == "m" else typical * np.exp(deviation)
    low, median, high = np.quantile(value, LIMITS).tolist()
    middle = float(np.median(typical))
    return {"median": median, "low": low, "high": high, "ratio": median / middle if middle > 0 else np.nan}
