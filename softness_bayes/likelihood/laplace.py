"""Laplace's method for the effects of raters, of fabrics and of the level: the joint mode, and a normal law about it.

The log density of rows and effects is a function of the level zeta and the fabrics' h, which all raters share, and of
each rater's own effects x_p. Its negative Hessian H has a block A_p for each rater, a block G for what is shared, and
blocks B_p between the two. Raters are eliminated first: with A_p = L_p L_p', the shared effects have the precision
S = G - sum B_p' A_p⁻¹ B_p. The log marginal density of the rows is then

    log p(rows, mode) - log det(H) / 2,    log det(H) = log det(S) + sum log det(A_p)

because all effects are standard normal a priori. This is what the sampler uses (model.md 9).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from softness_bayes.likelihood.design import FloatArray
from softness_bayes.likelihood.pieces import backward, cholesky, forward, log_determinant

if TYPE_CHECKING:
    from softness_bayes.likelihood.rater_effects import Given, Sums, Table


SETTLED = 0.05
"""Newton's method ends with a step that moves no effect by more than this, in its standard deviations given the
others."""
MOST_STEPS = 40
"""Most evaluations of the rows in one search: far from the data the mode need not be found."""
LEAST_PIVOT = 0.2
"""Smallest pivot of a factor of H. With concave rows every pivot is at least the prior's precision, 1."""


class Laplace(NamedTuple):
    """The normal law of all effects about their mode."""

    mode: FloatArray
    """Effects as `Table.effects` takes them, shape (draws, effects)."""
    log_density: FloatArray
    """Log marginal density of the rows, shape (draws,)."""
    own_root: FloatArray
    """Lower factors L_p of A_p, shape (draws, raters, effects, effects)."""
    coupling: FloatArray
    """L_p⁻¹ B_p, shape (draws, raters, effects, shared)."""
    shared_root: FloatArray
    """Lower factor of S, shape (draws, shared, shared)."""

    def part(self, draws: Any) -> Laplace:
        """Return some of the draws."""
        return Laplace(*(value[draws] for value in self))


class Step(NamedTuple):
    """A step of Newton's method from one point, and the factors of H there."""

    change: FloatArray
    """The step, shape (draws, effects)."""
    size: FloatArray
    """Largest part of it, in an effect's standard deviation given the others, shape (draws,)."""
    gain: FloatArray
    """Rise of the log density, were it quadratic, shape (draws,)."""
    own_root: FloatArray
    """As in `Laplace`, with the following ones."""
    coupling: FloatArray
    shared_root: FloatArray

    def replaced(self, draws: Any, new: Step) -> Step:
        """Return the same arrays with the steps of some draws replaced, in place."""
        for whole, part in zip(self, new, strict=True):
            whole[draws] = part
        return self


def laplace(table: Table, given: Given, start: FloatArray | None = None) -> Laplace:
    """Return the mode of all effects, by Newton's method from a start (draws, effects), and the normal law about it.

    A step that lowers the density of rows and effects is halved.
    """
    trial = (table.start(given) if start is None else start).copy()
    point, best, active = trial.copy(), np.full(len(trial), -np.inf), np.arange(len(trial))
    step, part = None, given
    # a step that is far too long overflows; it is then no rise, and its point not near a mode
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(MOST_STEPS):
            sums = table.sums(part, table.effects(part, trial[active]))
            value = sums.value.reshape(active.size, -1).sum(axis=-1) - 0.5 * (trial[active] ** 2).sum(axis=-1)
            # where a spread or the density has overflowed or underflowed there is no rise
            risen = np.isfinite(value) & (value >= best[active] - 1e-6 * np.abs(value))
            if step is None:
                risen[:] = True
            up, down = active[risen], active[~risen]
            trial[down] = 0.5 * (trial[down] + point[down])
            if up.size:
                point[up], best[up] = trial[up], value[risen]
                if not risen.all():
                    part, sums = part.part(risen), sums.part(risen)
                new = _step(table, part, sums, point[up])
                step = new if step is None else step.replaced(up, new)
                trial[up] += new.change
                active = np.sort(np.concatenate([up[~(new.size <= SETTLED)], down]))
            if not active.size:
                break
            part = given if active.size == len(trial) else given.part(active)
    assert step is not None, "the first evaluation makes a step"
    near = step.size <= SETTLED
    curvature = log_determinant(step.own_root).sum(axis=-1) + log_determinant(step.shared_root)
    mode = point + np.where(near[:, None], step.change, 0.0)
    return Laplace(mode, best + np.where(near, step.gain, 0.0) - 0.5 * curvature, *step[3:])


def _step(table: Table, given: Given, sums: Sums, point: FloatArray) -> Step:
    """Return a Newton step, from safe curvatures where it is long and the Hessian is not negative definite."""
    step = _newton(table, given, point, sums)
    least = np.minimum(_least_pivot(step.own_root).min(axis=-1), _least_pivot(step.shared_root))
    unsafe = ~((least > 1.01 * LEAST_PIVOT) | (step.size <= SETTLED))
    if unsafe.any():
        step = step.replaced(unsafe, _newton(table, given.part(unsafe), point[unsafe], sums.part(unsafe), safe=True))
    return step


def _least_pivot(root: FloatArray) -> FloatArray:
    """Return the smallest pivot of a matrix from its lower factor, shape (...)."""
    return np.asarray((np.diagonal(root, axis1=-2, axis2=-1) ** 2).min(axis=-1))


def _newton(table: Table, given: Given, point: FloatArray, sums: Sums, safe: bool = False) -> Step:
    """Return the step to the maximum of the quadratic function with the gradient and the Hessian at a point."""
    effects, bend, first = table.effects(given, point), sums.safe if safe else sums.second, sums.first
    fabrics, tau = effects.fabric.shape[-1], np.stack(given.effects, axis=-1)
    pull, curved = (first, bend) if given.omega is None else (first.sum(axis=2), bend.sum(axis=2))
    # the gradient, for raters' own effects and for shared ones, and the blocks of H
    of_own, of_shared = tau * pull - effects.own, np.empty((len(point), 1 + fabrics))
    of_shared[:, 0] = table.spread * pull[..., 0].sum(axis=-1) - effects.level
    a, b = np.eye(tau.shape[-1]) - tau[..., None] * curved * tau[..., None, :], np.empty((*pull.shape, 1 + fabrics))
    b[..., 0] = -table.spread * tau * curved[..., 0]
    g = np.zeros((len(point), 1 + fabrics, 1 + fabrics))
    g[:, 0, 0] = 1.0 - table.spread**2 * curved[..., 0, 0].sum(axis=-1)
    if given.omega is not None:
        weight, k = given.omega[..., None], np.arange(1, 1 + fabrics)
        moved = bend[..., 0]  # mixed derivatives with the expectation, (draws, raters, fabrics, effects)
        if given.tau_gamma is not None:
            weight = weight * np.exp(given.tau_gamma * effects.own[..., 1])[..., None]
            if not safe:  # the factor multiplies fabrics' deviations
                moved = moved + first[..., :1] * (np.arange(tau.shape[-1]) == 1)
        of_shared[:, 1:] = (weight * first[..., 0]).sum(axis=1) - effects.fabric
        g[:, k, k] = 1.0 - (weight**2 * bend[..., 0, 0]).sum(axis=1)
        g[:, 0, 1:] = g[:, 1:, 0] = -table.spread * (weight * bend[..., 0, 0]).sum(axis=1)
        b[..., 1:] = -tau[..., None] * np.swapaxes(weight[..., None] * moved, -1, -2)

    own_root = cholesky(a, LEAST_PIVOT)
    right = forward(own_root, np.concatenate([b, of_own[..., None]], axis=-1))
    coupling, pull = right[..., :-1], right[..., -1]
    shared_root = cholesky(g - np.einsum("dpqi,dpqj->dij", coupling, coupling), LEAST_PIVOT)
    aim = of_shared - np.einsum("dpqi,dpq->di", coupling, pull)
    scaled = forward(shared_root, aim[..., None])
    shared = backward(shared_root, scaled)[..., 0]
    own = backward(own_root, (pull - np.einsum("dpqi,di->dpq", coupling, shared))[..., None])[..., 0]
    gain = 0.5 * ((scaled[..., 0] ** 2).sum(axis=-1) + (pull**2).sum(axis=(-2, -1)))
    moves = (np.abs(own) * np.diagonal(own_root, axis1=-2, axis2=-1)).max(axis=(-2, -1))
    size = np.maximum(moves, (np.abs(shared) * np.diagonal(shared_root, axis1=-2, axis2=-1)).max(axis=-1))
    change = np.concatenate([shared[:, :1], own.reshape(len(own), -1), shared[:, 1:]], axis=1)
    return Step(change, size, gain, own_root, coupling, shared_root)
