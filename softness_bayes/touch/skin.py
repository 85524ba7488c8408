"""The skin: readings of its compression, and its modulus (model.md 2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError, NumericalError

Array = NDArray[np.float64]

ONE_STEP = 1e-5
"""Size of a step in ln v, relative to 1/v where v > 1, after which the next is of the size of its cube."""


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


def skin_modulus(
    log_scale: ArrayLike, p: ArrayLike, log_k: ArrayLike, b: ArrayLike, m: ArrayLike, start: Array | None = None
) -> Array:
    """Solve E = b exp(m u), u = C E^-p (1 + k E)^(p-1), for the skin's modulus E [Pa].

    Parameters
    ----------
    log_scale, p
        ln C and p of a load's `compression` (`contact.Indentation`, `contact.Force`).
    log_k
        `contact.log_compliance_ratio` [ln 1/Pa].
    b, m
        Modulus at rest [Pa] and stiffening exponent, m >= 0. All arguments broadcast.
    start
        As `log_stiffening` takes it.

    Raises
    ------
    InputError
        If b is not positive or m is negative: the paper's skin stiffens (model.md 2).
    """
    b, m = np.asarray(b, float), np.asarray(m, float)
    if not ((b > 0) & np.isfinite(b)).all() or not ((m >= 0) & np.isfinite(m)).all():
        raise InputError("skin: expected finite b > 0 and m >= 0")
    return stiffened(b, log_stiffening(log_scale, p, log_k, b, m, start))


def stiffened(b: Array, w: Array) -> Array:
    """Return the skin's modulus b e^v [Pa] at rest b [Pa] and w = ln v; the exponent stays in the range of numbers."""
    return b * np.exp(np.minimum(np.exp(w), 600.0))


def log_stiffening(
    log_scale: ArrayLike, p: ArrayLike, log_k: ArrayLike, b: ArrayLike, m: ArrayLike, start: Array | None = None
) -> Array:
    """Return w = ln v of the skin's stiffening, E = b e^v; arguments as `skin_modulus` takes them.

    With v = m u the equation becomes w + p e^w + (1-p) softplus(ln(k b) + e^w) = ln(m C) - p ln b. The left side rises
    and is convex in w, so Newton's method finds the root from any starting point, without a bracket. Halley's
    correction lengthens steps above the root (to at most twice Newton's) and shortens those below it; three steps are
    typical, and one from a starting point within `ONE_STEP`. It is `upper_bound` unless another is given.
    """
    w = upper_bound(log_scale, p, log_k, b, m) if start is None else start.copy()
    target, offset = _equation(log_scale, p, log_k, b, m)
    p = np.asarray(p, float)
    q = 1.0 - p
    for _ in range(100):
        v = np.exp(w)
        softplus, logistic = _softplus(offset + v)
        rise = v * (p + q * logistic)
        newton = (w + p * v + q * softplus - target) / (1.0 + rise)
        bend = (rise + v * v * q * logistic * (1.0 - logistic)) / (1.0 + rise)
        step = newton / np.maximum(1.0 - 0.5 * newton * bend, 0.5)
        w -= step
        if (np.abs(step) * np.maximum(v, 1.0) <= ONE_STEP).all():
            return w
    raise NumericalError("skin: the modulus did not converge")  # pragma: no cover - never seen


def upper_bound(log_scale: ArrayLike, p: ArrayLike, log_k: ArrayLike, b: ArrayLike, m: ArrayLike) -> Array:
    """Return a value of w above that of `log_stiffening`, which takes the same arguments.

    It is the smaller of two bounds, one sharp for a soft and one for a stiff fabric.
    """
    q = 1.0 - np.asarray(p, float)
    target, offset = _equation(log_scale, p, log_k, b, m)
    stiff = np.maximum(target - q * offset, 1.0)
    return np.minimum(
        target - q * _softplus(offset)[0],
        np.where(stiff > 1.0, np.log(stiff - np.log(stiff - np.log(stiff))), target - q * offset),
    )


def _equation(log_scale: ArrayLike, p: ArrayLike, log_k: ArrayLike, b: ArrayLike, m: ArrayLike) -> tuple[Array, Array]:
    """Return ln(m C) - p ln b, the equation's right side, and ln(k b)."""
    log_b = np.log(b)
    # m = 0 gives v = 0, replaced by a tiny positive number in logarithms
    target = np.asarray(log_scale, float) + np.log(np.maximum(m, 1e-300)) - np.asarray(p, float) * log_b
    return target, np.asarray(log_k, float) + log_b


def _softplus(x: Array) -> tuple[Array, Array]:
    """Return ln(1 + e^x) and its derivative, without overflow; both take less time than `numpy.logaddexp`."""
    small = np.exp(-np.abs(x))
    return np.maximum(x, 0.0) + np.log1p(small), np.where(x < 0.0, small, 1.0) / (1.0 + small)
