"""Effective moduli of an experiment's fabrics, with prior laws for the uncertain ones (model.md 1)."""

from __future__ import annotations

import numpy as np

from softness_bayes.data.fabrics import Fabrics, log_sd
from softness_bayes.parameters.fabric_moduli import KPA, UNKNOWN_MODULUS, FabricModuli
from softness_bayes.parameters.priors import LEAST_WIDTH, LogNormal, LogUniform, Prior
from softness_bayes.ranges import RELATIVE_ERRORS
from softness_bayes.touch.contact import FabricModulus


def fabric_moduli(
    fabrics: Fabrics, reading: FabricModulus, cv: float | None = None, unknown: Prior = UNKNOWN_MODULUS
) -> FabricModuli:
    """Return the moduli of some fabrics.

    A measured modulus E with relative standard error c is log-normal with median E and sd(log E)² = log(1 + c²). A
    bracket is uniform in the logarithm.

    Parameters
    ----------
    fabrics
        The measured properties and their errors.
    reading
        Formula of the rigidity from tensile modulus and thickness.
    cv
        Relative standard error of measured moduli that state none; None or 0 if these are exact.
    unknown
        Prior law of moduli about which nothing is known [kPa].

    Raises
    ------
    InputError
        If a modulus or the error is out of range.
    """
    if cv is not None:
        RELATIVE_ERRORS.require("modulus_cv", cv)
    middle = fabrics.modulus(reading, unknown=unknown.median * KPA)
    own = fabrics.modulus_cv()
    errors = log_sd(np.where(np.isnan(own), cv or 0.0, own))
    low, high = (side / KPA for side in (fabrics.effective_modulus_low, fabrics.effective_modulus_high))
    laws: list[Prior | None] = []
    for k, basis in enumerate(fabrics.basis):
        if not basis:
            laws.append(unknown)
        elif np.isfinite(low[k]) and np.isnan(fabrics.effective_modulus[k]):
            laws.append(LogUniform(float(low[k]), float(high[k])))
        elif errors[k] > LEAST_WIDTH:
            laws.append(LogNormal(float(middle[k] / KPA), float(errors[k])))
        else:
            laws.append(None)
    return FabricModuli(fabrics.names, tuple(middle.tolist()), tuple(laws))
