"""The joint prior law of skin and transduction that recorded afferents have taught."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit

from softness_bayes.base.laws import LogNormal, Prior

Array = NDArray[np.float64]

NAMES = ("b", "m", "alpha", "beta", "sigma_0")
"""The parameters of the law, in natural units."""


def coordinates(
    b: ArrayLike, m: ArrayLike, alpha: ArrayLike, beta: ArrayLike, sigma_0: ArrayLike, limit: float
) -> Array:
    """Return (ln b, ln m, ln alpha, ln beta, logit r), shape (..., 5), in which the law is normal.

    The current without stress is r times the smaller of the rheobase, `limit` [µA/cm²], and alpha / 2: with r in (0, 1)
    no receptor fires at rest, and sigma_0 is positive. NaN for a negative sigma_0.
    """
    alpha = np.asarray(alpha, float)
    rest = alpha * expit(-np.asarray(beta) * sigma_0)
    with np.errstate(invalid="ignore", divide="ignore"):
        last = logit(rest / np.minimum(limit, 0.5 * alpha))
        return np.stack(np.broadcast_arrays(*map(np.log, (b, m, alpha, beta)), last), axis=-1)


@dataclass(frozen=True)
class JointLaw:
    """A normal law of `coordinates`.

    Parameters
    ----------
    centre, root
        Its mean, and the Cholesky factor of its covariance, by rows.
    rheobase
        Rheobase of the paper's channels [µA/cm²], at which the run holds them.
    """

    centre: tuple[float, ...]
    root: tuple[tuple[float, ...], ...]
    rheobase: float

    @property
    def marginals(self) -> Mapping[str, Prior]:
        """Laws of the single parameters: exact but for sigma_0, whose median is the value at the centre."""
        sd = np.sqrt(np.square(self.root).sum(axis=1))
        sd[-1] = float(np.log(self.draw(np.random.default_rng(0), 4000)[:, -1]).std())
        middle = self._natural(np.array(self.centre))
        return {
            name: LogNormal(*(float(f"{x:.4g}") for x in law)) for name, *law in zip(NAMES, middle, sd, strict=True)
        }

    def _natural(self, u: Array) -> Array:
        """Return the parameters at coordinates, both (..., 5)."""
        b, m, alpha, beta = np.moveaxis(np.exp(u[..., :-1]), -1, 0)
        rest = expit(u[..., -1]) * np.minimum(self.rheobase, 0.5 * alpha)
        return np.stack([b, m, alpha, beta, np.log(alpha / rest - 1.0) / beta], axis=-1)

    def draw(self, rng: np.random.Generator, size: int) -> Array:
        """Return independent draws of `NAMES`, shape (size, 5)."""
        return self._natural(self.centre + rng.standard_normal((size, len(NAMES))) @ np.array(self.root).T)

    def log_density(self, x: Array) -> Array:
        """Return the log density of each of `NAMES` given those before it, at points (..., 5), of that shape.

        The last slope is that of logit r, r = I_0 / limit, I_0 = alpha s, s = 1 / (1 + exp(beta sigma_0)):
        beta (1 - s) / (1 - r).
        """
        b, m, alpha, beta, sigma_0 = np.moveaxis(x, -1, 0)
        u = coordinates(b, m, alpha, beta, sigma_0, self.rheobase)
        root = np.array(self.root)
        z = np.einsum("ij,...j->...i", np.linalg.inv(root), u - self.centre)
        slope = -np.log(np.where(x > 0, x, 1.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            slope[..., 4] = np.log(beta * expit(beta * sigma_0)) - np.log(expit(-u[..., 4]))
            density = -0.5 * z**2 - np.log(np.sqrt(2.0 * np.pi) * np.diag(root)) + slope
        return np.where(np.isfinite(density) & (x > 0), density, -np.inf)


JOINT_LAWS: Mapping[str, JointLaw] = MappingProxyType(
    {
        "recorded": JointLaw(
            centre=(2.096, 1.376, 3.783, -4.086, 4.167),
            root=(
                (0.25, 0.0, 0.0, 0.0, 0.0),
                (0.001, 0.1, 0.0, 0.0, 0.0),
                (0.022, -0.004, 0.153, 0.0, 0.0),
                (-0.096, -0.078, -0.163, 0.061, 0.0),
                (-0.132, 0.097, 0.371, -0.384, 0.71),
            ),
            rheobase=17.9865,
        )
    }
)
"""Joint laws by set of priors. `recorded` is the posterior of 21 mean rates of monkey SA1 afferents under spheres
(Goodwin, Browning and Wheat 1995), alone, by ``notebooks/studies/recorded_law.py``."""
