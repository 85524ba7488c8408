"""The skin: readings of its compression, and its modulus (model.md 2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError, NumericalError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SkinDisplacement:
    """A reading of the skin's compression u at the contact centre (model.md 2).

    u = (a^power / R) / (1 + k E_skin), with k = (1 - nu_fab²) / ((1 - nu_skin²) E_fab).
    """

    name: str
    power: int
    exponent_unit: str
    meaning: str = field(default="", repr=False, compare=False)
    """Description of the reading, for lists."""


STRAIN = SkinDisplacement(
    "printed", power=1, exponent_unit="–", meaning="the compression a/R, a strain, as the paper prints it"
)
DISPLACEMENT = SkinDisplacement(
    "displacement", power=2, exponent_unit="1/m", meaning="the compression a²/R, a displacement; m is then in 1/m"
)


def skin_modulus(log_scale: ArrayLike, p: ArrayLike, log_k: ArrayLike, b: ArrayLike, m: ArrayLike) -> Array:
    """Solve E = b exp(m u), u = C E^-p (1 + k E)^(p-1), for the skin's modulus E [Pa].

    With E = b e^v, v = m u and w = ln v the equation becomes w + p e^w + (1-p) softplus(ln(k b) + e^w) = ln(m C) -
    p ln b. The left side rises and is convex in w, so Newton's method finds the root from any starting point, without a
    bracket; it starts at the smaller of two upper bounds, one sharp for a soft and one for a stiff fabric. Halley's
    correction lengthens steps above the root (to at most twice Newton's) and shortens those below it; three steps are
    typical.

    Parameters
    ----------
    log_scale, p
        ln C and p of a load (`contact.Loads.compression`).
    log_k
        `contact.log_compliance_ratio` [ln 1/Pa].
    b, m
        Modulus at rest [Pa] and stiffening exponent, m >= 0. All arguments broadcast.

    Raises
    ------
    InputError
        If b is not positive or m is negative: the paper's skin stiffens (model.md 2).
    """
    b, m = np.asarray(b, float), np.asarray(m, float)
    if not ((b > 0) & np.isfinite(b)).all() or not ((m >= 0) & np.isfinite(m)).all():
        raise InputError("skin: expected finite b > 0 and m >= 0")
    log_b, p = np.log(b), np.asarray(p, float)
    # m = 0 gives v = 0, replaced by a tiny positive number in logarithms
    target = np.asarray(log_scale, float) + np.log(np.maximum(m, 1e-300)) - p * log_b
    offset, q = np.asarray(log_k, float) + log_b, 1.0 - p
    stiff = np.maximum(target - q * offset, 1.0)
    w = np.minimum(
        target - q * _softplus(offset)[0],
        np.where(stiff > 1.0, np.log(stiff - np.log(stiff - np.log(stiff))), target - q * offset),
    )
    for _ in range(100):
        v = np.exp(w)
        softplus, logistic = _softplus(offset + v)
        rise = v * (p + q * logistic)
        newton = (w + p * v + q * softplus - target) / (1.0 + rise)
        bend = (rise + v * v * q * logistic * (1.0 - logistic)) / (1.0 + rise)
        step = newton / np.maximum(1.0 - 0.5 * newton * bend, 0.5)
        w = w - step
        # the next step would be of the size of its cube
        if (np.abs(step) * np.maximum(v, 1.0) <= 1e-5).all():
            return np.asarray(b * np.exp(np.minimum(np.exp(w), 600.0)))  # the exponent stays in the range of numbers
    raise NumericalError("skin: the modulus did not converge")  # pragma: no cover - never seen


def _softplus(x: Array) -> tuple[Array, Array]:
    """Return ln(1 + e^x) and its derivative, without overflow; both take less time than `numpy.logaddexp`."""
    small = np.exp(-np.abs(x))
    return np.maximum(x, 0.0) + np.log1p(small), np.where(x < 0.0, small, 1.0) / (1.0 + small)
