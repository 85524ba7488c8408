"""Densities with several modes whose masses are known, and walks on them."""

import numpy as np

from softness_bayes.sampler.moves import MOVES, Student
from softness_bayes.sampler.sampling import Settings

DIMENSION = 6
FAR = np.full(DIMENSION, 4.0)
NEAR = np.zeros(DIMENSION)

LOCAL = tuple((move, share) for move, share in MOVES if not isinstance(move, Student))
"""Moves that never leap from a mode to another one."""


def settings(**changed):
    return Settings(**{"processes": 1, "max_steps": 2000, **changed})


def normal(centre, sd, correlation=0.0):
    """Log density of a normal law whose deviations are equal and equally correlated."""
    covariance = sd**2 * ((1 - correlation) * np.eye(DIMENSION) + correlation)
    precision, half = np.linalg.inv(covariance), 0.5 * np.linalg.slogdet(covariance)[1]
    return lambda z: -0.5 * np.einsum("ni,ij,nj->n", z - centre, precision, z - centre) - half


def banana(bend=0.4):
    """Log density of a normal law bent along its first coordinate, 0.3 thick."""

    def density(z):
        x = np.array(z)
        x[:, 1] -= bend * (x[:, 0] ** 2 - 1.0)
        return -0.5 * (x**2).sum(-1) - 0.5 * (x[:, 1] / 0.3) ** 2 + 0.5 * x[:, 1] ** 2 - np.log(0.3)

    return density


class Mixture:
    """Modes of known masses.

    Parameters
    ----------
    masses
        They add up to 1.
    modes
        A log density of each, normalised up to the same constant.
    starts
        Where draws start from: centre and spread about each mode.
    """

    names = tuple("abcdef")

    def __init__(self, masses, modes, starts):
        self._masses, self._modes, self._starts = masses, modes, starts

    def natural(self, z):
        return z

    def __call__(self, z):
        return np.logaddexp.reduce([np.log(m) + mode(z) for m, mode in zip(self._masses, self._modes, strict=True)])

    def draw_start(self, rng, size):
        centres, spreads = (np.array(part) for part in zip(*self._starts, strict=True))
        chosen = rng.integers(len(centres), size=size)
        return centres[chosen] + spreads[chosen, None] * rng.standard_normal((size, DIMENSION))

    def responsible(self, z):
        """Probability that each point of `z` is of the first mode."""
        return np.exp(np.log(self._masses[0]) + self._modes[0](z) - self(z))


def narrow_and_wide(narrow):
    """Two modes of sd 0.03 and 1, heights 21 apart where their masses are equal; `narrow` is that of the first."""
    return Mixture([narrow, 1 - narrow], [normal(NEAR, 0.03), normal(FAR, 1.0)], [(NEAR, 0.1), (FAR, 1.0)])


def narrow_within_wide():
    inside = np.eye(DIMENSION)[0]
    return Mixture([0.5, 0.5], [normal(inside, 0.03), normal(NEAR, 1.0)], [(inside, 0.03), (NEAR, 1.0)])


def mode_and_ridge():
    return Mixture([0.5, 0.5], [normal(FAR, 0.05), normal(NEAR, 1.0, 0.99)], [(FAR, 0.1), (NEAR, 1.0)])


def mode_and_banana():
    beside = 6.0 * np.eye(DIMENSION)[1]
    return Mixture([0.3, 0.7], [normal(beside, 0.1), banana()], [(beside, 0.1), (NEAR, 1.0)])
