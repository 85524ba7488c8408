"""Expected (Fisher) information of normal observations with common effects, of answers to pairs, and of orders.

y = f(x) + U e + noise, with e ~ N(0, diag D) and noise ~ N(0, s²): f has slopes J, and some columns of U share one
variance. The covariance is inverted by Woodbury's identity, so that only a matrix of the size of the effects is solved.
Comparisons depend only on differences of drives in units of the noise, so that there are no effects to integrate out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.special import ndtr

from softness_bayes.likelihood.places import index_within

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

ORDERS = 8
"""Number of simulated orders per set of conditions over which the information is averaged."""


class EffectGroup(NamedTuple):
    """Effects with a common standard deviation, which is a parameter."""

    columns: slice
    """Columns of U that belong to the group."""
    sd: float
    slope: FloatArray
    """Derivative of the standard deviation with respect to each of the d parameters, shape (d,)."""


def normal_information(
    effects: FloatArray | csr_array,
    slopes: FloatArray,
    variances: FloatArray,
    sd: float,
    sd_slope: FloatArray,
    groups: Sequence[EffectGroup] = (),
) -> FloatArray:
    """Return the Fisher information about d parameters, shape (d, d).

    Parameters
    ----------
    effects, slopes
        U, shape (rows, q), and J, shape (rows, d).
    variances
        D, the variance of every effect, shape (q,); those of effects in `groups` are ignored.
    sd, sd_slope
        s, and its derivative with respect to each parameter, shape (d,).
    groups
        Effects whose standard deviation is a parameter.
    """
    gram, cross = effects.T @ effects, effects.T @ slopes
    gram = gram if isinstance(gram, np.ndarray) else gram.toarray()
    variance = sd**2
    root = np.sqrt(variances)
    for group in groups:
        root[group.columns] = group.sd
    inner = root[:, None] * np.linalg.solve(variance * np.eye(root.size) + root[:, None] * gram * root, np.diag(root))
    about_mean = (slopes.T @ slopes - cross.T @ inner @ cross) / variance
    # U' S^-1 U and U' S^-2 U, S being the covariance of the rows
    left = np.eye(root.size) - gram @ inner
    once = left @ gram / variance
    twice = left @ gram @ left.T / variance**2
    shrunk = inner @ gram
    trace = (len(slopes) - 2.0 * np.trace(shrunk) + np.sum(shrunk * shrunk.T)) / variance**2
    change = [2.0 * sd * sd_slope, *(2.0 * group.sd * group.slope for group in groups)]
    products = np.zeros((len(change), len(change)))
    products[0, 0] = trace
    for k, one in enumerate(groups, start=1):
        products[0, k] = products[k, 0] = np.trace(twice[one.columns, one.columns])
        for other, two in enumerate(groups, start=1):
            products[k, other] = (once[one.columns, two.columns] ** 2).sum()
    changes = np.stack(change)
    return np.asarray(about_mean + 0.5 * changes.T @ products @ changes)


class Comparisons(NamedTuple):
    """Sets of conditions that are compared with one another."""

    members: IndexArray
    """Conditions of each set, shape (sets, width); smaller sets are padded with -1."""
    times: FloatArray
    """Number (or expected number) of comparisons of each set, shape (sets,)."""

    @classmethod
    def of_rows(cls, lists: IndexArray, condition: IndexArray) -> Comparisons:
        """Return the sets compared in a table, from the list and the condition of each row, each of shape (rows,)."""
        order = np.argsort(condition, kind="stable")
        of_list = np.unique(lists[order], return_inverse=True)[1]
        slot = index_within(of_list)
        members = np.full((of_list.max() + 1, slot.max() + 1), -1)
        members[of_list, slot] = condition[order]
        different, count = np.unique(members, axis=0, return_counts=True)
        return cls(different, count.astype(float))

    @property
    def paired(self) -> bool:
        """True if no set has more than two conditions."""
        return self.members.shape[1] == 2

    def with_others(self, members: IndexArray, times: FloatArray) -> Comparisons:
        """Return these sets with further ones added."""
        width = max(self.members.shape[1], members.shape[1])
        both = [np.pad(one, ((0, 0), (0, width - one.shape[1])), constant_values=-1) for one in (self.members, members)]
        return Comparisons(np.concatenate(both), np.append(self.times, times))


def pair_information(compared: Comparisons, drive: FloatArray, slopes: FloatArray, guesses: float = 0.0) -> FloatArray:
    """Return the Fisher information about d parameters from answers to pairs, shape (d, d).

    Parameters
    ----------
    compared
        The pairs.
    drive
        Drive of each condition in units of the noise of a difference, shape (conditions,).
    slopes
        Its slopes, shape (conditions, d).
    guesses
        Share of guesses among the answers.
    """
    whole = compared.members[:, 1] >= 0
    pairs, times = compared.members[whole], compared.times[whole]
    apart = drive[pairs[:, 0]] - drive[pairs[:, 1]]
    chance, other = ((1.0 - guesses) * ndtr(sign * apart) + 0.5 * guesses for sign in (1.0, -1.0))
    steep = (1.0 - guesses) * np.exp(-0.5 * apart**2) / np.sqrt(2.0 * np.pi)
    # for large differences the answer is certain and carries no information
    weight = np.divide(steep**2, chance * other, out=np.zeros_like(apart), where=chance * other > 0)
    along = slopes[pairs[:, 0]] - slopes[pairs[:, 1]]
    return np.asarray(along.T @ ((times * weight)[:, None] * along))


def order_information(
    rng: np.random.Generator, compared: Comparisons, drive: FloatArray, slopes: FloatArray, orders: int = ORDERS
) -> FloatArray:
    """Return the Fisher information about d parameters from orders under the Plackett-Luce model, shape (d, d).

    The information from an order is the sum, over its places, of the covariance of the slopes among the remaining
    touches, weighted by their worth. It is averaged over simulated orders.

    Parameters
    ----------
    rng
        Random generator of the orders.
    compared
        The lists.
    drive
        Drive of each condition in units of the noise, shape (conditions,).
    slopes
        Its slopes, shape (conditions, d).
    orders
        Number of simulated orders per set.
    """
    found = np.zeros((slopes.shape[1],) * 2)
    there = compared.members >= 0
    latent = np.where(there, drive[compared.members], -np.inf)
    for _ in range(orders):
        place = np.argsort(-(latent + rng.gumbel(size=latent.shape)), axis=1, kind="stable")
        own = np.take_along_axis(compared.members, place, axis=1)
        worth = np.where(own >= 0, drive[own], -np.inf)
        left = np.logaddexp.accumulate(worth[:, ::-1], axis=1)[:, ::-1]
        some = np.isfinite(left)
        # probability of each touch at each place up to its own, shape (sets, places, touches)
        with np.errstate(invalid="ignore"):
            log_chance = np.where(some[:, :, None], worth[:, None, :] - left[:, :, None], -np.inf)
        chance = np.triu(np.exp(np.minimum(log_chance, 0.0)))
        along = slopes[own]
        mean = chance @ along
        weight = compared.times[:, None] * chance.sum(axis=1)
        flat, middle = along.reshape(-1, along.shape[-1]), mean.reshape(-1, along.shape[-1])
        repeated = np.repeat(compared.times, own.shape[1])[:, None]
        found += flat.T @ (weight.reshape(-1, 1) * flat) - middle.T @ (repeated * middle)
    return found / orders
