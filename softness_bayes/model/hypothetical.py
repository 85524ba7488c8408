"""Hypothetical designs: that of an experiment, and extensions by raters, loads, fabrics or repeats."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.comparison_information import Comparisons
from softness_bayes.likelihood.design import Design
from softness_bayes.model.build import ExperimentModel, design_of
from softness_bayes.model.posterior import Posterior
from softness_bayes.ranges import Range
from softness_bayes.readable import number
from softness_bayes.touch.contact import Force, Indentation, Load, held
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

STEPS = (2.0, 4.0, 8.0)
"""Moduli of three further fabrics, as multiples of the stiffest or fractions of the softest."""

HEAVIER, LIGHTER = 1.5, 0.5
"""Factor of a further load relative to the largest or smallest one."""

DEEPEST = Range(1e-6, 8e-3, "m")
"""Allowed indentations of a further load."""


class Planned(NamedTuple):
    """A design with the response in its conditions."""

    name: str
    """Description of the design; empty for that of the experiment."""
    design: Design
    scene: Scene
    """Fabrics and loads of the conditions; fabrics of the experiment come first."""
    n_fabrics: int
    """Number of fabrics of the experiment, whose moduli may be sampled; further fabrics have known moduli."""
    compared: Comparisons | None = None
    """Sets of conditions that are compared with one another; None if ratings are not comparisons."""

    @property
    def n_answers(self) -> int:
        """Number of ratings, places in lists, or answers to pairs."""
        if self.compared is None or not self.compared.paired:
            return self.design.n_rows
        return round(self.compared.times.sum())

    def rate(self, posterior: Posterior, theta: Array) -> Array:
        """Return the pad's mean rate N/N_ref [Hz] in every condition at points (points, d)."""
        touch, known = posterior.space.touch(theta), posterior.space.modulus(theta)
        if known is not None:
            own = self.scene.fabric_modulus[self.n_fabrics :]
            known = np.concatenate([known, np.broadcast_to(own, (*known.shape[:-1], own.size))], axis=-1)
        rate = self.scene.total_rate(touch, known) / self.scene.n_receptors
        return np.broadcast_to(rate, (*theta.shape[:-1], rate.shape[-1]))


def as_it_is(model: ExperimentModel) -> Planned:
    """Return the design of an experiment."""
    design, lists = design_of(model.experiment), model.interpretation.intervals.lists
    compared = None if lists is None else Comparisons.of_rows(lists, design.condition)
    return Planned("", design, model.scene, len(model.experiment.fabrics.names), compared)


def others(model: ExperimentModel) -> list[Planned]:
    """Return designs with additional ratings: raters, repeats, a load, stiffer or softer fabrics."""
    now = as_it_is(model)
    d, people = now.design, now.design.n_participants
    twice = Design(np.tile(d.condition, 2), np.append(d.participant, d.participant + people), d.fabric, 2 * people)
    again = Design(np.tile(d.condition, 2), np.tile(d.participant, 2), d.fabric, people)
    double = now.compared and now.compared._replace(times=2.0 * now.compared.times)
    found: list[Planned | None] = [
        now._replace(name="twice as many raters", design=twice, compared=double),
        now._replace(name="every rating twice", design=again, compared=double),
        *(_with_load(now, factor) for factor in (HEAVIER, LIGHTER)),
    ]
    moduli = now.scene.modulus
    stiffer, softer = moduli.max() * np.array(STEPS), moduli.min() / np.array(STEPS)
    found.append(_with_fabrics(now, stiffer, f"three stiffer fabrics, up to {number(stiffer.max() / 1e3)} kPa"))
    found.append(_with_fabrics(now, softer, f"three softer fabrics, down to {number(softer.min() / 1e3)} kPa"))
    return [one for one in found if one is not None]


def _with_load(now: Planned, factor: float) -> Planned | None:
    """Return the design with the same fabrics rated under one more load; None if such a load is out of range."""
    loads = now.scene.loads
    kind = Force if 2 * sum(isinstance(load, Force) for load in loads) > len(loads) else Indentation
    values = [held(load) for load in loads if isinstance(load, kind)]
    value = factor * (max(values) if factor > 1 else min(values))
    if kind is not Force and not DEEPEST.low <= value < DEEPEST.high:
        return None
    load: Load = kind(float(f"{value:.3g}"))
    d = now.design
    pairs = np.unique(np.stack([d.participant, d.fabric[d.condition]]), axis=1)
    fabrics = np.unique(pairs[1])
    extra = now.scene.n_conditions + np.searchsorted(fabrics, pairs[1])
    design = Design(
        np.append(d.condition, extra),
        np.append(d.participant, pairs[0]),
        np.append(d.fabric, fabrics),
        d.n_participants,
    )
    new = np.full(fabrics.size, len(loads))
    scene = now.scene.under((*loads, load), np.append(now.scene.fabric, fabrics), np.append(now.scene.load, new))
    compared = now.compared
    if compared and not compared.paired:
        own = Comparisons.of_rows(pairs[0], extra)
        compared = compared.with_others(own.members, own.times)
    elif compared:
        compared = _with_pairs(compared, np.unique(extra), np.empty(0, np.intp), d.n_participants)
    return Planned(f"another load, {load}", design, scene, now.n_fabrics, compared)


def _with_pairs(compared: Comparisons, new: IndexArray, old: IndexArray, people: int) -> Comparisons:
    """Return comparisons with more pairs: each participant compares neighbours in a random circle of conditions.

    Parameters
    ----------
    compared
        The existing pairs.
    new, old
        New and old conditions in the circle; pairs of two old ones are left out.
    people
        Number of participants.
    """
    first, second = np.triu_indices(new.size + old.size, 1)
    every = np.append(new, old)
    some = first < new.size
    share = 2.0 / max(every.size - 1, 1)
    return compared.with_others(
        np.stack([every[first[some]], every[second[some]]], axis=1), np.full(some.sum(), people * share)
    )


def _with_fabrics(now: Planned, moduli: Array, name: str) -> Planned:
    """Return the design with further fabrics of known moduli, rated by all participants under the same loads."""
    d, scene = now.design, now.scene
    size = scene.fabric_modulus.size
    pairs = np.unique(np.stack([d.participant, scene.load[d.condition]]), axis=1)
    loads = np.unique(pairs[1])
    fabric, load = np.repeat(size + np.arange(moduli.size), loads.size), np.tile(loads, moduli.size)
    place = scene.n_conditions + np.arange(moduli.size)[:, None] * loads.size + np.searchsorted(loads, pairs[1])
    design = Design(
        np.append(d.condition, place),
        np.append(d.participant, np.tile(pairs[0], moduli.size)),
        np.append(d.fabric, fabric),
        d.n_participants,
    )
    wider = scene.beside(moduli, np.append(scene.fabric, fabric), np.append(scene.load, load))
    compared = now.compared
    if compared and not compared.paired:
        # each list is extended by the further fabrics under its load
        further = scene.n_conditions + np.arange(moduli.size) * loads.size
        at = np.searchsorted(loads, scene.load[compared.members[:, 0]])
        compared = Comparisons(np.concatenate([further + at[:, None], compared.members], axis=1), compared.times)
    elif compared:
        for k, one in enumerate(loads):
            new = scene.n_conditions + np.arange(moduli.size) * loads.size + k
            old = np.flatnonzero(scene.load == one)
            compared = _with_pairs(compared, new, old, int((pairs[1] == one).sum()))
    return Planned(name, design, wider, now.n_fabrics, compared)
