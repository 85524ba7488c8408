"""Places in padded lists, and probabilities of their orders under the Plackett-Luce model (model.md 9)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from softness_bayes.errors import InputError

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

MOST_TIED = 6
"""Largest number of tied touches; the sum over their possible orders takes 2^n steps."""


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
