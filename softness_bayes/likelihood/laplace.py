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
from numpy.typing import NDArray

from softness_bayes.likelihood.pieces import backward, cholesky, forward

if TYPE_CHECKING:
    from softness_bayes.likelihood.rater_effects import Given, Sums, Table

FloatArray = NDArray[np.float64]

SETTLED = 0.05
"""Newton's method ends once no effect moves by more than this, in its standard deviations given the others."""
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


class Quadratic(NamedTuple):
    """Gradient and negative Hessian of the log density of rows and effects."""

    of_own: FloatArray
    """Shape (draws, raters, effects)."""
    of_shared: FloatArray
    """Shape (draws, shared): the level, then fabrics."""
    own: FloatArray
    """A, shape (draws, raters, effects, effects)."""
    between: FloatArray
    """B, shape (draws, raters, effects, shared)."""
    shared: FloatArray
    """G, shape (draws, shared, shared)."""


def laplace(table: Table, given: Given, start: FloatArray | None = None) -> Laplace:
    """Return the mode of all effects, by Newton's method from a start (draws, effects), and the normal law about it."""
    start = table.start(given) if start is None else start
    # a step that is far too long overflows; it is then no rise, and its point not near a mode
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        point, value, sums = _search(table, given, start)
        normal = _newton(_quadratic(table, given, point, sums, False))
    near = normal[1] <= 2.0 * SETTLED
    if not near.all():  # the search has not ended: H may be indefinite there, and its factor without meaning
        some = np.flatnonzero(~near)
        safe = _newton(_safe(table, given, point, sums, some))
        for whole, part in zip(normal, safe, strict=True):
            whole[some] = part
    step, _, gain, own_root, coupling, shared_root = normal
    log_determinant = _log_determinant(own_root).sum(axis=-1) + _log_determinant(shared_root)
    mode = point + np.where(near[:, None], step, 0.0)
    log_density = value + np.where(near, gain, 0.0) - 0.5 * log_determinant
    return Laplace(mode, log_density, own_root, coupling, shared_root)


def _search(table: Table, given: Given, start: FloatArray) -> tuple[FloatArray, FloatArray, Sums]:
    """Return points near the modes, with the log density of rows and effects and the sums over rows there.

    A step that lowers the density is halved. A draw whose next step is small is settled.
    """
    point, trial, best = start.copy(), start.copy(), np.full(len(start), -np.inf)
    active, sums = np.arange(len(start)), table.sums(given, table.effects(given, start))
    here, part = sums, given
    for _ in range(MOST_STEPS):
        value = here["value"].reshape(active.size, -1).sum(axis=-1) - 0.5 * (trial[active] ** 2).sum(axis=-1)
        # where a spread or the density has overflowed or underflowed there is no rise
        risen = np.isfinite(value) & (value >= best[active] - 1e-9 * np.abs(value))
        up, down = active[risen], active[~risen]
        point[up], best[up] = trial[up], value[risen]
        for name, whole in sums.items():
            whole[up] = here[name][risen]
        trial[down] = 0.5 * (trial[down] + point[down])
        if up.size:
            every = up.size == len(start)
            of_up = sums if every else {name: value[up] for name, value in sums.items()}
            step, size = _step(table, given if every else given.part(up), point[up], of_up)
            trial[up] += step
            up = up[size > SETTLED]
        active = np.sort(np.concatenate([up, down]))
        if not active.size:
            break
        part = given if active.size == len(start) else given.part(active)
        here = table.sums(part, table.effects(part, trial[active]))
    return point, best, sums


def _step(table: Table, given: Given, point: FloatArray, sums: Sums) -> tuple[FloatArray, FloatArray]:
    """Return a Newton step and its size, from safe curvatures where the Hessian is not negative definite."""
    step, size, _, own_root, _, shared_root = _newton(_quadratic(table, given, point, sums, False))
    unsafe = ~(np.minimum(_least_pivot(own_root).min(axis=-1), _least_pivot(shared_root)) > 1.01 * LEAST_PIVOT)
    if unsafe.any():
        some = np.flatnonzero(unsafe)
        step[some], size[some] = _newton(_safe(table, given, point, sums, some))[:2]
    return step, size


def _safe(table: Table, given: Given, point: FloatArray, sums: Sums, some: NDArray[np.intp]) -> Quadratic:
    """Return `_quadratic` with safe curvatures, for some of the draws."""
    of_some = {name: value[some] for name, value in sums.items()}
    return _quadratic(table, given.part(some), point[some], of_some, True)


def _least_pivot(root: FloatArray) -> FloatArray:
    """Return the smallest pivot of a matrix from its lower factor, shape (...)."""
    return np.asarray((np.diagonal(root, axis1=-2, axis2=-1) ** 2).min(axis=-1))


def _quadratic(table: Table, given: Given, point: FloatArray, sums: Sums, safe: bool) -> Quadratic:
    """Return gradient and negative Hessian at a point; if `safe`, with curvatures that are nowhere negative.

    Safe curvatures are those of concave rows; terms that vanish in expectation are left out, as in Fisher scoring.
    """
    effects = table.effects(given, point)
    own, fabrics = effects.own, effects.fabric.shape[-1]
    cells = given.omega is not None

    second = -sums["curvature"] if safe else sums["mean2"]
    spreads = given.effects
    of_rater = {name: value.sum(axis=-1) if cells else value for name, value in {**sums, "mean2": second}.items()}
    first, mixed = [of_rater["mean"]], [[of_rater["mean2"]]]
    if given.tau_gamma is not None:
        first.append(of_rater["mean_c"])
        mixed.append([of_rater["mean2_c"], of_rater["mean2_cc"] + (0.0 if safe else of_rater["mean_c"])])
    if given.tau_varsigma is not None:
        first.append(of_rater["noise"])
        row = [of_rater["both"]] if given.tau_gamma is None else [of_rater["both"], of_rater["both_c"]]
        mixed.append([0.0 * value for value in row] if safe else row)
        mixed[-1].append(np.minimum(of_rater["noise2"], -0.5 * table.count) if safe else of_rater["noise2"])
    size = len(spreads)
    a = np.empty((*own.shape, size))
    for i in range(size):
        for j in range(i + 1):
            a[..., i, j] = a[..., j, i] = (i == j) - spreads[i] * spreads[j] * mixed[i][j]
    of_own = np.stack([s * each for s, each in zip(spreads, first, strict=True)], axis=-1) - own
    of_shared = np.empty((len(point), 1 + fabrics))
    of_shared[:, 0] = table.spread * first[0].sum(axis=-1) - effects.level
    g = np.zeros((len(point), 1 + fabrics, 1 + fabrics))
    g[:, 0, 0] = 1.0 - table.spread**2 * mixed[0][0].sum(axis=-1)
    b = np.empty((*own.shape, 1 + fabrics))
    for i in range(size):
        b[..., i, 0] = -table.spread * spreads[i] * mixed[i][0]
    if given.omega is not None:
        grown = np.ones(own.shape[:2]) if given.tau_gamma is None else np.exp(given.tau_gamma * own[..., 1])
        weight = (given.omega * grown)[..., None]
        of_shared[:, 1:] = (weight * sums["mean"]).sum(axis=1) - effects.fabric
        k = np.arange(1, 1 + fabrics)
        g[:, k, k] = 1.0 - (weight**2 * second).sum(axis=1)
        g[:, 0, 1:] = g[:, 1:, 0] = -table.spread * (weight * second).sum(axis=1)
        b[..., 0, 1:] = -given.tau[..., None] * weight * second
        if given.tau_gamma is not None:
            grows = sums["mean2_c"] + (0.0 if safe else sums["mean"])
            b[..., 1, 1:] = -given.tau_gamma[..., None] * weight * grows
        if given.tau_varsigma is not None:
            b[..., -1, 1:] = 0.0 if safe else -given.tau_varsigma[..., None] * weight * sums["both"]
    return Quadratic(of_own, of_shared, a, b, g)


def _newton(
    at: Quadratic,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return a Newton step, its size in standard deviations, its gain, and the factors of H: L, L⁻¹ B and that of S."""
    own_root = cholesky(at.own, LEAST_PIVOT)
    right = forward(own_root, np.concatenate([at.between, at.of_own[..., None]], axis=-1))
    coupling, pull = right[..., :-1], right[..., -1]
    shared_root = cholesky(at.shared - np.einsum("dpqi,dpqj->dij", coupling, coupling), LEAST_PIVOT)
    aim = at.of_shared - np.einsum("dpqi,dpq->di", coupling, pull)
    scaled = forward(shared_root, aim[..., None])
    shared = backward(shared_root, scaled)[..., 0]
    own = backward(own_root, (pull - np.einsum("dpqi,di->dpq", coupling, shared))[..., None])[..., 0]
    gain = 0.5 * ((scaled[..., 0] ** 2).sum(axis=-1) + (pull**2).sum(axis=(-2, -1)))
    moves = np.abs(own) * np.diagonal(own_root, axis1=-2, axis2=-1)
    size = np.maximum(
        moves.max(axis=(-2, -1)), (np.abs(shared) * np.diagonal(shared_root, axis1=-2, axis2=-1)).max(axis=-1)
    )
    step = np.concatenate([shared[:, :1], own.reshape(len(own), -1), shared[:, 1:]], axis=1)
    return step, size, gain, own_root, coupling, shared_root


def _log_determinant(root: FloatArray) -> FloatArray:
    """Return the log determinant of a matrix from its lower factor, shape (...)."""
    return np.asarray(2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))
