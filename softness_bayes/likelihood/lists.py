"""Places in padded lists: probabilities of orders under the Plackett-Luce model, and information from comparisons.

See model.md 9. Comparisons depend only on differences of drives in units of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.design import FloatArray, IndexArray

MOST_TIED = 6
"""Largest number of tied touches; the sum over their possible orders takes 2^n steps."""

ORDERS = 8
"""Number of simulated orders per set of conditions over which the information is averaged."""


@dataclass(frozen=True)
class RankedLists:
    """Lists as rows of one array, each from its top down; shorter lists leave the last slots empty."""

    row: IndexArray
    """Row of each slot, shape (lists, slots); arbitrary for empty slots."""
    group: IndexArray
    """Index of each slot's group of tied places, from the top down, same shape."""
    present: NDArray[np.bool_]
    """True if the slot holds a touch, same shape."""
    filled: NDArray[np.bool_]
    """True if the slot held a touch before any were left out, same shape."""
    ties: tuple[tuple[int, IndexArray, IndexArray], ...]
    """Groups of tied places, by size: the size, and the list and the first slot of each group."""

    @classmethod
    def of(cls, values: FloatArray, place: IndexArray) -> RankedLists:
        """Return the lists for rows with these values and list indices."""
        order = np.lexsort((-values, place))
        slot, count = index_within(place[order]), np.bincount(place)
        shape = (count.size, int(count.max()))
        row, filled = np.zeros(shape, np.intp), np.zeros(shape, bool)
        row[place[order], slot], filled[place[order], slot] = order, True
        new = np.ones(shape, bool)
        new[:, 1:] = values[row][:, 1:] != values[row][:, :-1]
        new |= ~filled
        ties = _ties(new, filled)
        if ties and ties[-1][0] > MOST_TIED:
            raise InputError(
                f"ratings: {ties[-1][0]} touches of one list share a place, expected at most {MOST_TIED}: "
                "with so many ties, use categories"
            )
        return cls(row, np.cumsum(new, axis=1) - 1, filled, filled, ties)

    @property
    def width(self) -> int:
        """Number of slots."""
        return self.row.shape[1]

    def among(self, chosen: NDArray[np.bool_]) -> RankedLists:
        """Return the lists restricted to the chosen touches, shape (lists, slots)."""
        return replace(self, present=self.filled & chosen)

    def by_row(self, values: FloatArray) -> FloatArray:
        """Return values (..., lists, slots) rearranged by row, shape (..., rows)."""
        found = np.empty((*values.shape[:-2], int(self.filled.sum())))
        found[..., self.row[self.filled]] = values[..., self.filled]
        return found

    def reordered(self, latent: FloatArray, values: FloatArray) -> FloatArray:
        """Return the lists' places sorted by latent values (..., rows), of the same shape."""
        drawn = np.where(self.filled, latent[..., self.row], -np.inf)
        rank = np.argsort(np.argsort(-drawn, axis=-1, kind="stable"), axis=-1, kind="stable")
        own = np.broadcast_to(values[self.row], rank.shape)
        return self.by_row(np.take_along_axis(own, rank, axis=-1))

    def log_factors(self, worth: FloatArray, extra: FloatArray | None = None) -> FloatArray:
        """Return log probabilities whose sum over slots is that of each list's order, (..., lists, slots).

        Parameters
        ----------
        worth
            Log worths in the sense of Luce, shape (..., lists, slots).
        extra
            Log worth of one additional touch, placed after the whole list, shape (..., lists).
        """
        worth = np.where(self.present, worth, -np.inf)
        rest = np.logaddexp.accumulate(worth[..., ::-1], axis=-1)[..., ::-1]
        if extra is not None:
            rest = np.logaddexp(rest, extra[..., None])
        with np.errstate(invalid="ignore"):
            found = np.where(self.present, worth - rest, 0.0)
        below = np.full((*rest.shape[:-1], 1), -np.inf) if extra is None else extra[..., None]
        rest = np.concatenate([rest, np.broadcast_to(below, (*rest.shape[:-1], 1))], axis=-1)
        for size, of, first in self.ties:
            tied = of[:, None], first[:, None] + np.arange(size)
            joint = _log_first(worth[..., *tied], self.present[tied], rest[..., of, first + size])
            found[..., *tied] = 0.0
            found[..., of, first] = joint
        return found

    def log_chances(self, worth: FloatArray, slot: int) -> tuple[FloatArray, FloatArray]:
        """Return log probabilities of places for the touches of one slot, left out here, given the order of the others.

        Returns
        -------
        above, lower : ndarray, shape (..., lists)
            Log probability that the touch comes below all groups above its own; and that it also comes below its own
            group and the next one, minus infinity if there is no next one.
        """
        own = self.group[:, [slot]]
        each = self.log_factors(worth, worth[..., slot]) - self.log_factors(worth)
        least = np.where(self.present & (self.group > own), self.group, self.group.max() + 1).min(axis=1)
        # the probability of a tie is stored in the first slot of its group, present or not
        same = (self.group[:, :, None] == self.group[:, None, :]) & self.present[:, None, :]
        among = same.any(axis=-1)
        above = np.where(among & (self.group < own), each, 0.0).sum(axis=-1)
        lower = np.where(among & (self.group <= least[:, None]), each, 0.0).sum(axis=-1)
        return above, np.where(least > self.group.max(), -np.inf, lower)


def index_within(groups: IndexArray) -> IndexArray:
    """Return the running index of each element within its group, shape (n,)."""
    order, count = np.argsort(groups, kind="stable"), np.bincount(groups)
    found = np.empty(groups.size, np.intp)
    found[order] = np.arange(groups.size) - np.repeat(np.cumsum(count) - count, count)
    return found


def shares(numbers: FloatArray, lists: IndexArray) -> FloatArray:
    """Return the share of its list below each number, counting ties half, shape (..., rows); 1/2 in a list of one.

    Parameters
    ----------
    numbers
        Shape (..., rows).
    lists
        Index of each row's list, shape (rows,).
    """
    from scipy.stats import rankdata  # imported here because it takes a third of a second

    order = np.argsort(lists, kind="stable")
    found = np.full(np.shape(numbers), 0.5)
    for rows in np.split(order, np.flatnonzero(np.diff(lists[order])) + 1):
        if rows.size > 1:
            found[..., rows] = (rankdata(numbers[..., rows], axis=-1) - 1.0) / (rows.size - 1)
    return found


def _ties(new: NDArray[np.bool_], filled: NDArray[np.bool_]) -> tuple[tuple[int, IndexArray, IndexArray], ...]:
    """Return the groups of tied places by size; a group starts where ``new`` is true, shape (lists, slots)."""
    of, first = np.nonzero(new)
    size = np.diff(np.append(np.flatnonzero(new), new.size))
    shared = filled[of, first] & (size > 1)
    return tuple((n, of[shared & (size == n)], first[shared & (size == n)]) for n in np.unique(size[shared]).tolist())


def _log_first(worth: FloatArray, present: NDArray[np.bool_], rest: FloatArray) -> FloatArray:
    """Return the log probability that some touches come before all others, in any order.

    The sum is recursive: over the touch that comes first, and then over the orders of the remaining ones.

    Parameters
    ----------
    worth
        Their log worths, shape (..., k).
    present
        Whether each of them is present, shape (groups, k).
    rest
        Log of the total worth of all later touches, shape (...).
    """
    size = worth.shape[-1]
    found = [np.zeros(rest.shape)]
    for subset in range(1, 2**size):
        members = [k for k in range(size) if subset >> k & 1]
        total = np.logaddexp(rest, np.logaddexp.reduce(worth[..., members], axis=-1))
        with np.errstate(invalid="ignore"):  # if all of them are absent
            terms = [found[subset ^ (1 << k)] + worth[..., k] - total for k in members]
            ordered = np.logaddexp.reduce(np.stack(terms), axis=0)
        # a subset with an absent member equals the subset without it
        for k in members:
            ordered = np.where(present[:, k], ordered, found[subset ^ (1 << k)])
        found.append(ordered)
    return found[-1]


FEWEST = 3
"""Smallest number of fabrics that a reference is compared with."""


def references(pairs: IndexArray, group: IndexArray, fabrics: int) -> NDArray[np.bool_]:
    """Return which fabrics of pairs are references: they met twice as many others as the median fabric, or more.

    Parameters
    ----------
    pairs
        Indices of the two fabrics of each pair, shape (pairs, 2).
    group
        Group of each pair within which references are sought, such as a load, shape (pairs,).
    fabrics
        Number of fabrics.

    Returns
    -------
    ndarray
        Shape (pairs, 2); both are false for a pair of a fabric with itself.
    """
    found = np.zeros(pairs.shape, bool)
    for k in np.unique(group):
        own = pairs[group == k]
        met = np.zeros((fabrics, fabrics), bool)
        met[own[:, 0], own[:, 1]] = met[own[:, 1], own[:, 0]] = True
        partners = met.sum(axis=1)
        often = (partners >= FEWEST) & (partners >= 2.0 * np.median(partners[partners > 0]))
        found[group == k] = often[own]
    return found & (pairs[:, :1] != pairs[:, 1:])


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
