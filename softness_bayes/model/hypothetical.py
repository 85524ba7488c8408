"""Designs that might be: the one of an experiment, and others with more raters, loads, fabrics or repeats."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.design import Design
from softness_bayes.model.build import ExperimentModel, design_of
from softness_bayes.model.posterior import Posterior
from softness_bayes.ranges import Range
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.load_field import held
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

STEPS = (2.0, 4.0, 8.0)
"""Moduli of three further fabrics, as multiples of the stiffest or fractions of the softest."""

HEAVIER, LIGHTER = 1.5, 0.5
"""A further load, as a multiple of the greatest or of the least."""

DEEPEST = Range(1e-6, 8e-3, "m")
"""Indentations of a further load."""


class Planned(NamedTuple):
    """A design, and the response in its conditions."""

    name: str
    """The design in words; empty for the one of the experiment."""
    design: Design
    scene: Scene
    """Fabrics and loads of its conditions; fabrics of the experiment come first."""
    n_fabrics: int
    """Number of fabrics of the experiment, whose moduli may be sampled; others have known ones."""

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
    return Planned("", design_of(model.experiment), model.scene, len(model.experiment.fabrics.names))


def others(model: ExperimentModel) -> list[Planned]:
    """Return designs that cost more ratings: raters, repeats, a load, stiffer or softer fabrics."""
    now = as_it_is(model)
    d, people = now.design, now.design.n_participants
    twice = Design(np.tile(d.condition, 2), np.append(d.participant, d.participant + people), d.fabric, 2 * people)
    again = Design(np.tile(d.condition, 2), np.tile(d.participant, 2), d.fabric, people)
    found: list[Planned | None] = [
        now._replace(name="twice as many raters", design=twice),
        now._replace(name="every rating twice", design=again),
        *(_with_load(now, factor) for factor in (HEAVIER, LIGHTER)),
    ]
    moduli = now.scene.modulus
    stiffer, softer = moduli.max() * np.array(STEPS), moduli.min() / np.array(STEPS)
    found.append(_with_fabrics(now, stiffer, f"three stiffer fabrics, up to {stiffer.max() / 1e3:.3g} kPa"))
    found.append(_with_fabrics(now, softer, f"three softer fabrics, down to {softer.min() / 1e3:.3g} kPa"))
    return [one for one in found if one is not None]


def _with_load(now: Planned, factor: float) -> Planned | None:
    """Return the design in which everybody rates the same fabrics under one more load; None if there can be none."""
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
    return Planned(f"another load, {load}", design, scene, now.n_fabrics)


def _with_fabrics(now: Planned, moduli: Array, name: str) -> Planned:
    """Return the design in which everybody rates further fabrics of known moduli under the loads of the others."""
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
    return Planned(name, design, wider, now.n_fabrics)
