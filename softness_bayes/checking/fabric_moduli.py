"""Posteriors of uncertain fabric moduli compared with their prior laws, from the groups of a result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.sensitivity import INFORMED, contraction, prior_moments
from softness_bayes.parameters.fabric_moduli import FABRIC_MODULUS
from softness_bayes.parameters.priors import Prior, parse_prior

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

PROBABILITY = 0.9
"""Share of the draws within the limits."""

FAR = 2.0
"""Distance, in standard deviations of its law, from which a mean log modulus is reported as far from the measured
one."""

MODULUS_LAW = "fabric_modulus_law"
"""Law of each sampled modulus [kPa] in its written form, in the group `constant_data`."""

UNCERTAIN = "uncertain_fabric"
"""Axis of the fabrics whose modulus is sampled."""


def modulus_laws(constant: xr.Dataset) -> dict[str, Prior]:
    """Return the law of each sampled modulus [kPa] by fabric, from the group `constant_data`; empty without any."""
    if MODULUS_LAW not in constant:
        return {}
    return {
        str(name): parse_prior(str(text))
        for name, text in zip(constant[UNCERTAIN].values, constant[MODULUS_LAW].values, strict=True)
    }


def modulus_limits(posterior: xr.Dataset) -> NDArray[np.float64]:
    """Return the lower limit, median and upper limit (`PROBABILITY`) of sampled moduli [kPa], shape (3, fabrics)."""
    drawn, tail = posterior[FABRIC_MODULUS].values, 0.5 * (1.0 - PROBABILITY)
    return np.asarray(np.quantile(drawn.reshape(-1, drawn.shape[-1]), [tail, 0.5, 1.0 - tail], axis=0))


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
    import pandas as pd

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


def modulus_sentences(table: pd.DataFrame) -> list[str]:
    """Describe the moduli that the ratings narrow, and those that they move away from the measured values.

    Parameters
    ----------
    table
        From `modulus_table`.
    """
    width = (1.0 - table["contraction"]).clip(lower=0.0) ** 0.5
    narrowed = [f"{name} (to {share:.2g} of its error)" for name, share in width.items() if share <= INFORMED]
    which = f": {', '.join(narrowed)}" if narrowed else ""
    said = [f"fabric moduli: the ratings narrow {len(narrowed)} of {len(table)}{which}"]
    for name, row in table[table["shift"].abs() >= FAR].iterrows():
        side = "above" if row["shift"] > 0 else "below"
        said.append(
            f"  {name}: {row['median']:.3g} kPa ({row['low']:.3g} to {row['high']:.3g}), "
            f"{abs(row['shift']):.1f} standard errors {side} the {row['law_median']:.3g} kPa that were "
            "measured; repeat the measurement"
        )
    return said
