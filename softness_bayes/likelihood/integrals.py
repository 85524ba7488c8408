"""Integrals over the level and all effects of raters and fabrics, by Laplace's method or the reference (model.md 9).

Fabrics' deviations connect all raters. The reference takes importance draws of them about Laplace's mode (fixed Sobol
numbers), and sums over the level and raters' effects at each (`quadrature.Marginal`). With weights W_m of the draws
given all rows, a part of the rows has given the others the density 1 / sum W_m / p(part | others, h_m).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.cholesky import cholesky, forward
from softness_bayes.likelihood.laplace import Laplace, laplace
from softness_bayes.likelihood.pieces import log_sum, pieces
from softness_bayes.likelihood.quadrature import Marginal, heavy_tailed, log_heavy_tailed
from softness_bayes.likelihood.rater_effects import Given, Table

FloatArray = NDArray[np.float64]

FABRIC_DRAWS = 64
"""Importance draws of fabrics' deviations."""
INFLATION, FREEDOM = 1.05, 30.0
"""Their scale [standard deviations without one rater] and degrees of freedom."""
CACHED = 12_000
"""Elements of the arrays of a block, which then stay in the processor's cache."""


class Drawn(NamedTuple):
    """Draws of all effects given the rows."""

    mu: FloatArray
    """Shape (draws,)."""
    own: FloatArray
    """Raters' effects in units of their spreads, shape (draws, raters, effects)."""
    fabric: FloatArray
    """Fabrics' h, shape (draws, fabrics)."""


class _Parts(NamedTuple):
    """Marginal densities at importance draws of fabrics' deviations, for one draw of everything else."""

    log_weight: FloatArray  # of each importance draw, their sum being the density of all rows, (importance draws,)
    h: FloatArray  # (importance draws, fabrics)
    marginals: list[Marginal]


class Integrals:
    """Integrals over all effects, for one table.

    Parameters
    ----------
    table
        The rows.
    weight
        Weight of each row where the search for the mode starts, shape (rows,); 0 for intervals with an infinite end.
    finer
        Factor of the numbers of points of the reference.
    """

    def __init__(self, table: Table, weight: FloatArray, finer: int = 1) -> None:
        self.table, self._weight, self._finer = table, weight, finer

    def laplace(self, given: Given, middle: FloatArray) -> FloatArray:
        """Return the log density of all rows by Laplace's method, shape (draws,).

        Parameters
        ----------
        given
            Everything but the effects.
        middle
            A number inside of each row's interval, shape (rows,) or (draws, rows).
        """
        every = pieces(len(given.drive), self.table.rater.size, CACHED)
        return np.concatenate([self._law(given.part(one), _of(middle, one)).log_density for one in every])

    def log_density(self, given: Given, middle: FloatArray) -> FloatArray:
        """Return the log density of all rows by the reference, shape (draws,)."""
        return self._each(
            given,
            middle,
            lambda marginal: marginal.log_density,
            lambda parts: log_sum(parts.log_weight[None], axis=1),
        )

    def of_rows(self, given: Given, middle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the log density of each row given all others and the probability below it, each (draws, rows)."""

        def averaged(parts: _Parts) -> FloatArray:
            density, smaller = np.concatenate([np.stack(m.of_rows()) for m in parts.marginals], axis=1)
            log_odds = parts.log_weight[:, None] - log_sum(parts.log_weight, axis=0) - density
            alone = -log_sum(log_odds, axis=0)
            return np.stack([alone, (np.exp(log_odds + alone) * smaller).sum(axis=0)])[:, None]

        found = self._each(given, middle, lambda marginal: np.stack(marginal.of_rows()), averaged, axis=1)
        return found[0], found[1]

    def of_raters(self, given: Given, middle: FloatArray) -> FloatArray:
        """Return the log density of each rater's rows given all others', shape (draws, raters)."""

        def averaged(parts: _Parts) -> FloatArray:
            density = np.concatenate([marginal.of_raters for marginal in parts.marginals])
            log_odds = parts.log_weight[:, None] - log_sum(parts.log_weight, axis=0) - density
            return np.asarray(-log_sum(log_odds, axis=0))[None]

        return self._each(given, middle, lambda marginal: marginal.of_raters, averaged)

    def draw(self, rng: np.random.Generator, given: Given, middle: FloatArray) -> Drawn:
        """Return draws of all effects given the rows, one for each draw of everything else."""

        def packed(marginal: Marginal) -> FloatArray:
            mu, own = marginal.draw(rng)
            return np.concatenate([mu[:, None], own.reshape(len(mu), -1)], axis=1)

        def chosen(parts: _Parts) -> FloatArray:
            k = int((parts.log_weight + rng.gumbel(size=parts.log_weight.shape)).argmax())
            every = np.concatenate([packed(marginal) for marginal in parts.marginals])
            return np.concatenate([every[k], parts.h[k]])[None]

        found = self._each(given, middle, packed, chosen)
        size = self.table.n_raters, len(given.effects)
        last = 1 + size[0] * size[1]
        fabric = found[:, last:] if given.omega is not None else np.zeros((len(found), self.table.n_fabrics))
        return Drawn(found[:, 0], found[:, 1:last].reshape(-1, *size), fabric)

    def _each(
        self,
        given: Given,
        middle: FloatArray,
        known: Callable[[Marginal], FloatArray],
        averaged: Callable[[_Parts], FloatArray],
        axis: int = 0,
    ) -> FloatArray:
        """Return a quantity of every draw: from its marginal density, or averaged over fabrics' deviations."""
        found = []
        if given.omega is None:
            for marginal in self._marginals(given, middle, None):
                found.append(known(marginal))
        else:
            for k in range(len(given.drive)):
                found.append(averaged(self._over_fabrics(given.part(slice(k, k + 1)), _of(middle, slice(k, k + 1)))))
        return np.concatenate(found, axis=axis)

    def _law(self, given: Given, middle: FloatArray, start: FloatArray | None = None) -> Laplace:
        if start is None:
            start = self.table.start(given, middle, self._weight)
        return laplace(self.table, given, start)

    def _marginals(self, given: Given, middle: FloatArray, start: FloatArray | None) -> Iterator[Marginal]:
        """Yield the marginal density of each draw; their numbers of nodes differ."""
        for block in pieces(len(given.drive), self.table.rater.size, CACHED):
            part, own = given.part(block), _of(middle, block)
            law = self._law(part, own, None if start is None else start[block])
            for k in range(len(part.drive)):
                one = slice(k, k + 1)
                yield Marginal(self.table, part.part(one), law.part(one), _of(own, one), self._finer)

    def _over_fabrics(self, given: Given, middle: FloatArray) -> _Parts:
        """Return importance draws of fabrics' deviations for one draw of everything else."""
        assert given.omega is not None
        law = self._law(given, middle)
        fabrics = self.table.n_fabrics
        inverse = forward(law.shared_root, np.eye(1 + fabrics)[None])[0]
        root = cholesky((inverse.T @ inverse)[1:, 1:], 1e-12)
        last = law.mode.shape[1] - fabrics
        x = heavy_tailed(FABRIC_DRAWS * self._finer, fabrics, FREEDOM)
        # a rater fewer leaves a wider law
        wider = INFLATION * (1.0 + 1.0 / max(self.table.n_raters - 1, 1)) ** 0.5
        h = law.mode[0, last:] + wider * x @ root.T
        density = log_heavy_tailed(x, FREEDOM) - np.log(wider * np.diag(root)).sum()
        prior = -0.5 * (h**2 + np.log(2.0 * np.pi)).sum(axis=-1)
        # relative to the mean weight of the normal law at the same points, whose density is known to be 1
        normal = -0.5 * ((wider * x) ** 2 + np.log(2.0 * np.pi)).sum(axis=-1) - np.log(np.diag(root)).sum()
        many = np.zeros(len(x), np.intp)
        inner = given.part(many).with_fabrics(h, self.table.fabric)
        own = middle if middle.ndim == 1 else middle[many]
        marginals = list(self._marginals(inner, own, law.mode[many, :last]))
        rows = np.concatenate([marginal.log_density for marginal in marginals])
        return _Parts(rows + prior - density - log_sum(normal - density, axis=0), h, marginals)


def _of(middle: FloatArray, draws: slice) -> FloatArray:
    return middle if middle.ndim == 1 else middle[draws]
