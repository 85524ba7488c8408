"""Expected (Fisher) information of normal observations with common effects, in closed form.

y = f(x) + U e + noise, with e ~ N(0, diag D) and noise ~ N(0, s²): f has slopes J, and some columns of U share one
variance. The covariance is inverted by Woodbury's identity, so that only a matrix of the size of the effects is solved;
the rows enter through cross products.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.design import Design

FloatArray = NDArray[np.float64]


class Moments(NamedTuple):
    """Cross products of the rows of U, with d slopes and q effects."""

    rows: int
    effects: FloatArray
    """U'U, shape (q, q)."""
    cross: FloatArray
    """U'J, shape (q, d)."""
    slopes: FloatArray
    """J'J, shape (d, d)."""

    @classmethod
    def of_rows(cls, effects: FloatArray, slopes: FloatArray) -> Moments:
        """Return the cross products of U (rows, q) and J (rows, d)."""
        return cls(len(slopes), effects.T @ effects, effects.T @ slopes, slopes.T @ slopes)

    @classmethod
    def of_design(cls, design: Design, slopes: FloatArray, fabrics: bool, level: bool = True) -> Moments:
        """Return the cross products for a design with one slope vector per condition, shape (conditions, d).

        Effects are those of participants, then those of fabrics if there are any, then the common level.
        """
        cells = design.cells
        blocks = [cells]
        of_fabric = np.eye(design.n_fabrics)[design.fabric]
        count = cells.sum(axis=0)
        if fabrics:
            blocks.append((of_fabric * count[:, None]).T)
        if level:
            blocks.append(count[None])
        # row k of `sums`: number of rows of each condition with effect k
        sums = np.concatenate(blocks)
        people, things = design.n_participants, design.n_fabrics if fabrics else 0
        gram = np.zeros((len(sums), len(sums)))
        gram[:people, :people] = np.diag(cells.sum(axis=1))
        if fabrics:
            gram[:people, people : people + things] = cells @ of_fabric
            gram[people : people + things, people : people + things] = np.diag(count @ of_fabric)
        if level:
            gram[:, -1] = sums.sum(axis=1)
        gram = np.triu(gram) + np.triu(gram, 1).T
        return cls(design.n_rows, gram, sums @ slopes, slopes.T @ (count[:, None] * slopes))


class EffectGroup(NamedTuple):
    """Effects with a common standard deviation, which is a parameter."""

    columns: slice
    """Columns of U that belong to the group."""
    sd: float
    slope: FloatArray
    """Derivative of the standard deviation with respect to each of the d parameters, shape (d,)."""


def normal_information(
    moments: Moments, variances: FloatArray, sd: float, sd_slope: FloatArray, groups: Sequence[EffectGroup] = ()
) -> FloatArray:
    """Return the Fisher information about d parameters, shape (d, d).

    Parameters
    ----------
    moments
        Cross products of effects and slopes.
    variances
        D, the variance of every effect, shape (q,).
    sd, sd_slope
        s, and its derivative with respect to each parameter, shape (d,).
    groups
        Effects whose standard deviation is a parameter.
    """
    rows, gram, cross, slopes = moments
    variance = sd**2
    root = np.sqrt(variances)
    inner = root[:, None] * np.linalg.solve(variance * np.eye(root.size) + root[:, None] * gram * root, np.diag(root))
    about_mean = (slopes - cross.T @ inner @ cross) / variance
    # U' S^-1 U and U' S^-2 U, S being the covariance of the rows
    left = np.eye(root.size) - gram @ inner
    once = left @ gram / variance
    twice = left @ gram @ left.T / variance**2
    shrunk = inner @ gram
    trace = (rows - 2.0 * np.trace(shrunk) + np.sum(shrunk * shrunk.T)) / variance**2
    change = [2.0 * sd * sd_slope, *(2.0 * group.sd * group.slope for group in groups)]
    products = np.zeros((len(change), len(change)))
    products[0, 0] = trace
    for k, one in enumerate(groups, start=1):
        products[0, k] = products[k, 0] = np.trace(twice[one.columns, one.columns])
        for other, two in enumerate(groups, start=1):
            products[k, other] = (once[one.columns, two.columns] ** 2).sum()
    changes = np.stack(change)
    return np.asarray(about_mean + 0.5 * changes.T @ products @ changes)
