"""Ratings of touches that need not have been rated, at draws of a posterior given ratings (model.md 9)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.contract import Effects
from softness_bayes.likelihood.design import Design, IndexArray
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.model.individual import family_of
from softness_bayes.model.posterior import Posterior
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

NEW_RATERS = 10
"""New raters that are drawn for each draw of the posterior, so that the limits of their ratings are smooth."""


class OtherRatings(NamedTuple):
    """Ratings of the conditions of a scene at draws of a posterior [as filed]."""

    rate: Array
    """Response of the typical finger [spikes/s], shape (draws, conditions)."""
    typical: Array
    """Median rating of the typical rater, same shape."""
    new: Array
    """One rating of each of `NEW_RATERS` new raters, shape (draws, raters, conditions); none if nobody was asked."""
    mean: Array
    """Mean of the ratings of as many new raters as were asked, shape (draws, conditions); empty if nobody was."""
    alike: IndexArray
    """Number of each condition's group, shape (conditions,): in a group all have one response and one law of ratings,
    so that their draws are draws of the same."""


@dataclass(frozen=True)
class OtherTouches:
    """Touches whose ratings a posterior predicts.

    The response of each is centred as the likelihood centres it, over the rows that were rated: predictions are
    relative to the level that was inferred together with that centre.

    Parameters
    ----------
    posterior
        The density given ratings.
    scene
        Fabrics and loads that are touched, on the same finger.
    known
        Each fabric's index among those that were rated, shape (fabrics,); -1 for others, whose own deviations, if the
        model has them, are drawn. None for fabrics without deviations of their own.
    """

    posterior: Posterior
    scene: Scene
    known: IndexArray | None

    @cached_property
    def _beside(self) -> Posterior:
        """The posterior whose forward model is that of these touches; it has no moduli among its parameters."""
        of, fingers = self.posterior, self.posterior.fingers
        of = of.with_term(of.observation.with_pressed(None))  # new raters' fingers are anybody's
        return replace(
            of,
            space=replace(of.space, sampled=of.space.chain, moduli=None),
            scene=self.scene,
            other_loads=None,
            fingers=None if fingers is None else family_of(self.scene, fingers.grid),
        )

    @cached_property
    def _by_load(self) -> list[tuple[IndexArray, IndexArray | None]]:
        """The conditions under each load, and the rated ones that these are met among, where it was rated."""
        rated = self.posterior.scene
        if not isinstance(rated, Scene):
            raise TypeError("expected the posterior of a compiled scene")
        known = {load: np.flatnonzero(rated.load == k) for k, load in enumerate(rated.loads)}
        columns = (np.flatnonzero(self.scene.load == k) for k in range(len(self.scene.loads)))
        return [(here, known.get(load)) for here, load in zip(columns, self.scene.loads, strict=True) if here.size]

    def ratings(
        self, rng: np.random.Generator, theta: Array, raters: int = 0, modulus: Array | None = None
    ) -> OtherRatings:
        """Return the ratings at some draws.

        Parameters
        ----------
        rng
            Source of the effects given the data, of new raters and of the noise of their ratings.
        theta
            Draws of the posterior, shape (draws, dimension).
        raters
            Number of new raters whose mean is asked for; 0 if it is the typical rater alone, as it must be without
            deviations of fabrics.
        modulus
            E_fab [Pa] of each fabric at each draw, shape (draws, fabrics), where it is not the scene's.
        """
        grid = self.posterior.fingers
        columns = (1 if grid is None else 1 + grid.grid.size) * self.scene.n_conditions
        columns += self.posterior.observation.fabric_of_rate.size
        parts = [
            self._ratings(rng, theta[k], raters, None if modulus is None else modulus[k])
            for k in pieces(len(theta), columns)
        ]
        *drawn, alike = zip(*parts, strict=True)
        rate, typical, new, mean = (np.concatenate(part) for part in drawn)
        return OtherRatings(rate, typical, new, mean, _alike(np.stack(alike)))

    def _ratings(self, rng: np.random.Generator, theta: Array, raters: int, modulus: Array | None) -> OtherRatings:
        observed, conditions = self.posterior.observation, self.scene.n_conditions
        model, scale = observed.single, observed.model.scale
        rated, parameters = self.posterior.response(theta), self.posterior.rating_parameters(theta)
        response = self._beside.response(theta[:, : self.posterior.space.n_chain], modulus)
        drive = observed.drive_at(response, rated, parameters)
        effects = observed.draw_effects(rng, rated, parameters)
        fabrics = np.full(self.scene.fabric_modulus.size, -1) if self.known is None else self.known
        others = model.for_others(rng, parameters, effects, 1, fabrics)
        own = None if self.known is None else deviations_of_fabrics(model.named_effects(others))
        stated = drive[..., :conditions]
        touched = stated if own is None else stated + own[..., self.scene.fabric]
        typical = np.empty_like(touched)
        for columns, among in self._by_load:
            typical[..., columns] = observed.typical(rated, parameters, others, touched[..., columns], among)
        design = Design(np.arange(conditions), np.zeros(conditions, np.intp), self.scene.fabric, 1)
        asked = max(raters, NEW_RATERS) if raters else 0
        new, total = np.empty((len(theta), NEW_RATERS if raters else 0, conditions)), np.zeros((len(theta), conditions))
        for k in range(asked):
            rating = self._rating(rng, design, drive, parameters, others)
            if k < NEW_RATERS:
                new[:, k] = rating
            if k < raters:
                with np.errstate(divide="ignore"):  # of a rating of 0 the mean is 0 too
                    total += scale.additive(rating)
        mean = scale.natural(total / raters) if raters else np.empty((len(theta), 0))
        # with deviations of their own, fabrics that were rated differ whatever their response
        fabric = np.full(conditions, -1) if own is None else fabrics[self.scene.fabric]
        every = response.reshape(len(theta), -1, conditions)  # of raters' own fingers too
        alike = _alike(np.concatenate([fabric[None], every.reshape(-1, conditions)]))
        return OtherRatings(response[..., :conditions] * self.scene.n_receptors, typical, new, mean, alike)

    def _rating(
        self, rng: np.random.Generator, design: Design, drive: Array, parameters: RatingParameters, others: Effects
    ) -> Array:
        """Return the ratings of one more new rater at every draw, shape (draws, conditions)."""
        model = self.posterior.observation.single
        effects = model.with_new_participants(rng, parameters, others)
        return np.asarray(model.draw_ratings(rng, design, drive, parameters, effects))


def _alike(columns: NDArray[Any]) -> IndexArray:
    """Return the number of each column's group, shape (columns,): equal columns are of one group."""
    numbers: dict[bytes, int] = {}
    return np.array([numbers.setdefault(column.tobytes(), len(numbers)) for column in columns.T], np.intp)


def deviations_of_fabrics(effects: Mapping[str, tuple[Array, tuple[str, ...]]]) -> Array | None:
    """Return the sum of all fabrics' own deviations, shape (draws, fabrics); None if the model has none."""
    found = [values for values, axes in effects.values() if axes == ("fabric",)]
    return sum(found[1:], found[0]) if found else None
