"""One replicate of simulation-based calibration: parameters drawn, ratings simulated, fitted, ranked.

Parameters are drawn from the prior, or from the posterior of a run. In the latter case, the model is fitted to the data
of that run and the simulated data together, and the parameters are also a draw from the joint posterior (Säilynoja,
Schmitt, Bürkner and Vehtari, arXiv:2502.03279, 2025).

Where the sampler does not converge, the true values are ranked among draws that are exchangeable with them
(`sampler.exchangeable`). Their ranks are uniform as well, but detect less.

Any function of parameters, participants and ratings has uniform ranks if the inference is correct. Without a turning
point, its position is set to zero, below all others, and ties are broken at random, so that no replicate is left out
and ranks remain uniform. The presence of a turning point is ranked as 0 or 1 with random ties, which compares its
probability with its frequency. Participants are exchangeable, so that one represents all. The log-likelihood is among
the ranked quantities, because it detects a posterior that ignores the data and equals the prior (Modrák et al.,
Bayesian Analysis 20, 461, 2025).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.calibration import DRAWS, Replicate
from softness_bayes.checking.inflection import CURVE_POINTS, CurveShape, turning_points
from softness_bayes.likelihood.contract import Effects, Likelihood, RatingsLikelihood
from softness_bayes.model.posterior import Posterior
from softness_bayes.sampler.exchangeable import STEPS, exchangeable_draws
from softness_bayes.sampler.sampling import Sampled, Settings, sample_until
from softness_bayes.touch.load_groups import groups_of
from softness_bayes.touch.scene import Scene

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

_MADE, _WALK, _EXCHANGED = 0, 1, 2  # parts of a replicate with random numbers of their own

ARCHIVE = 2_000
"""Largest number of draws of a run that has not converged from which chains through the truth learn their steps."""

ROUNDING = 1e-12
"""Relative difference up to which two values of a quantity are treated as tied."""

LOG_LIKELIHOOD = "log_likelihood"
"""Name of the joint log-likelihood among the ranked quantities."""

PARTICIPANT, PARTICIPANTS = "participant_effect", "participant_spread"
"""Names of the first participant's effect, and of the standard deviation of all participants' effects."""

FABRIC, FABRICS = "fabric_effect", "fabric_spread"
"""Names of the first fabric's deviation, and of the standard deviation of all fabrics' deviations."""


def replicate(
    posterior: Posterior,
    settings: Settings,
    seed: int,
    index: int,
    assume: Callable[[Likelihood], Likelihood] = lambda correct: correct,
    truths: FloatArray | None = None,
) -> Replicate:
    """Draw parameters, simulate ratings, sample their posterior and rank the truth.

    No prior draw is left out, including those without any firing. Space, compiled scene and design are those
    of `posterior`; its ratings are ignored, unless the parameters are draws of their posterior.

    Parameters
    ----------
    posterior
        The model.
    settings
        Settings of the sampler.
    seed, index
        Seeds of the parameters, the ratings and the sampler.
    assume
        Function that turns the correct observation model into the one assumed in the fit.
    truths
        Draws of the posterior in natural units, shape (draws, dimension), one of which is used instead of a prior draw.
        The raters of the simulated ratings are new.
    """
    rng = np.random.default_rng(_seeds(seed, index, _MADE))
    theta, observation, true_effects = _simulated(posterior, rng, truths)
    fitted = _fitted(posterior, assume(observation), truths)
    sampled = sample_until(fitted, settings, _seeds(seed, index, _WALK))
    converged = sampled.verdict.converged
    own = rng if converged else np.random.default_rng(_seeds(seed, index, _EXCHANGED))
    draws = _ranked_among(fitted, theta, sampled, own)
    effects = observation.draw_effects(rng, fitted.response(draws), fitted.rating_parameters(draws))
    true = quantities(fitted, theta[None], true_effects)
    among = quantities(fitted, draws, effects)
    truth = np.concatenate([*true.values()])
    rank = tuple(int(r) for r in ranks(truth, np.column_stack([*among.values()]), rng))
    tau = float(sampled.verdict.tau.max())
    steps = sampled.verdict.steps
    return Replicate((*true,), rank, tuple(truth.tolist()), steps, tau, converged)


def _ranked_among(fitted: Posterior, theta: FloatArray, sampled: Sampled, rng: np.random.Generator) -> FloatArray:
    """Return `DRAWS` draws among which a true value has a uniform rank, in natural units, shape (draws, dimension).

    They are those of the run or, if it has not converged, of chains through the truth, no longer than those of the run.

    Parameters
    ----------
    fitted
        The posterior.
    theta
        The true parameters, shape (dimension,).
    sampled
        Result of the run.
    rng
        Random generator.
    """
    if sampled.verdict.converged:
        return fitted.natural(independent(sampled, DRAWS, rng))
    kept = sampled.chains.kept(sampled.verdict.burn_in).coordinates.reshape(-1, len(fitted.names))
    archive = kept[rng.choice(len(kept), min(len(kept), ARCHIVE), replace=False)]
    draw = fitted.space.coordinates(theta[None])[0]
    return fitted.natural(exchangeable_draws(fitted, draw, archive, DRAWS, rng, min(STEPS, sampled.verdict.steps)))


def true_values(posterior: Posterior, seed: int, index: int, truths: FloatArray | None = None) -> dict[str, float]:
    """Return the true values that `replicate` ranks, by name, without any fit; arguments as there."""
    theta, observation, effects = _simulated(posterior, np.random.default_rng(_seeds(seed, index, _MADE)), truths)
    found = quantities(_fitted(posterior, observation, truths), theta[None], effects)
    return {name: float(values[0]) for name, values in found.items()}


def _seeds(seed: int, index: int, part: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(index, part))


def _simulated(
    posterior: Posterior, rng: np.random.Generator, truths: FloatArray | None
) -> tuple[FloatArray, Likelihood, Effects]:
    """Return true parameters, ratings simulated there, and their effects."""
    theta = posterior.space.draw_prior(rng, 1)[0] if truths is None else truths[rng.integers(len(truths))]
    return theta, *simulate(posterior.observation, posterior, theta, rng)


def _fitted(posterior: Posterior, observation: Likelihood, truths: FloatArray | None) -> Posterior:
    """Return the posterior of simulated ratings, together with those of the run that the truths are drawn from."""
    fitted = posterior.with_term(observation)
    return fitted if truths is None else replace(fitted, terms=(*fitted.terms, posterior.observation))


def simulate(
    observation: RatingsLikelihood, posterior: Posterior, theta: FloatArray, rng: np.random.Generator
) -> tuple[Likelihood, Effects]:
    """Return ratings simulated at a point, and their effects as a batch of one."""
    parameters, rate = posterior.rating_parameters(theta), posterior.response(theta)
    if observation.pressed is not None:  # there are no plate forces for these raters
        observation = observation.with_pressed(observation.pressed.as_strangers())
    effects = observation.new_effects(rng, parameters, ())
    ratings = observation.replicate(rng, observation.drive(rate, parameters), parameters, effects)
    return observation.with_values(ratings), effects.each(lambda each: each[None])


def independent(sampled: Sampled, count: int, rng: np.random.Generator) -> FloatArray:
    """Return nearly independent draws, in sampler coordinates, shape (count, dimension).

    They are chosen at random from all walkers at steps separated by the longest autocorrelation time. If there are too
    few of these, some are repeated.
    """
    chains, verdict = sampled
    kept = chains.kept(verdict.burn_in)
    tau = verdict.tau.max()
    stored = kept.log_density.shape[1]
    apart = max(1, math.ceil(tau / kept.stride)) if math.isfinite(tau) else stored
    candidates = kept.coordinates[:, ::-apart].reshape(-1, kept.coordinates.shape[-1])
    return candidates[rng.choice(len(candidates), count, replace=len(candidates) < count)]


def ranks(truth: FloatArray, draws: FloatArray, rng: np.random.Generator) -> IndexArray:
    """Return the number of draws below each true value; ties, values within `ROUNDING`, are broken at random.

    If no receptor fires, a likelihood of orders or answers is the same at every point, up to rounding errors that
    depend on the number of points evaluated together.

    Parameters
    ----------
    truth
        Shape (quantities,).
    draws
        Shape (draws, quantities).
    rng
        Random generator for breaking ties.
    """
    truth, draws = np.asarray(truth, float), np.asarray(draws, float)
    equal = np.abs(draws - truth) <= ROUNDING * np.abs(truth)
    below = ((draws < truth) & ~equal).sum(axis=0)
    return below + rng.integers(equal.sum(axis=0) + 1)


def quantities(posterior: Posterior, theta: FloatArray, effects: Effects) -> dict[str, FloatArray]:
    """Return the ranked quantities at some points, by name.

    Parameters
    ----------
    posterior
        The model, with the ratings of the points.
    theta
        Points in natural units, shape (points, dimension).
    effects
        Effects of each point, in the form drawn by the likelihood of the ratings.

    Returns
    -------
    dict of ndarray, each of shape (points,)
    """
    found = {name: theta[:, k] for k, name in enumerate(posterior.names)}
    drawn = posterior.observation.model.named_effects(effects)
    found |= {name: values for name, (values, axes) in drawn.items() if not axes}
    found |= {LOG_LIKELIHOOD: posterior.log_likelihood(theta)}
    if PARTICIPANT in drawn and posterior.space.held.get("tau") != 0.0:
        participants, _ = drawn[PARTICIPANT]
        found |= {PARTICIPANT: participants[:, 0], PARTICIPANTS: participants.std(axis=-1)}
    if FABRIC in drawn and "omega" in posterior.names:
        fabrics, _ = drawn[FABRIC]
        found |= {FABRIC: fabrics[:, 0], FABRICS: fabrics.std(axis=-1)}
    if isinstance(posterior.scene, Scene):
        found |= _turning_points(posterior, posterior.scene, theta)
    return found


def _turning_points(posterior: Posterior, scene: Scene, theta: FloatArray) -> dict[str, FloatArray]:
    groups = groups_of(scene.loads)
    touch = posterior.space.touch(theta).broadcast(len(theta))
    turn = turning_points(scene, touch, 0.0, CURVE_POINTS, [scene.loads[k] for k in groups.at])
    interior = turn.outcome == CurveShape.INTERIOR
    place = np.where(interior, turn.modulus * 1e-3, 0.0)
    # presence of a turning point, 0 or 1, and its position, 0 without one
    found = {f"turns[{load}]": interior[:, k].astype(float) for k, load in enumerate(groups.names)}
    return found | {f"turning_point_kpa[{load}]": place[:, k] for k, load in enumerate(groups.names)}
