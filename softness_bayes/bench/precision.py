"""Work-precision measurements of each stage and of the whole likelihood."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from softness_bayes.bench.subject import BATCH, Effort, Subject, quickest, subject
from softness_bayes.errors import InputError
from softness_bayes.touch.accuracy import FIELD_SHARE, QUADRATURES, REFERENCE, TOLERANCES, Errors, choose, errors
from softness_bayes.touch.firing_sample import FiringSample
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS
from softness_bayes.touch.population import Drive
from softness_bayes.touch.resolution import first
from softness_bayes.touch.scene import Discretisation, Scene

FIELD, POPULATION, RATES, LIKELIHOOD = "stress field", "population integral", "firing rates", "whole likelihood"

ACCURACIES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Settings of the dial."""

EXACT_VECTORS = 4
"""Vectors whose rate curves are made exactly, to time that."""

DIAL = 1e-3
"""The dial's usual setting."""

EXACT = Errors(np.array(0.0), np.array(0.0))
"""Error of fixed rate curves. The references share it, so that only the other errors are measured."""


class Point(NamedTuple):
    """One setting of one stage, or of a peer."""

    stage: str
    setting: str
    seconds: float
    """For each parameter vector, 36 conditions."""
    max_peak: float
    """Largest error relative to the vector's peak response, over draws and conditions."""
    median_peak: float
    """Median, over the draws that fire, of their largest errors."""
    max_log: float
    """Likewise of log(N/N_ref + eps)."""
    median_log: float
    dial: float = np.nan
    """The accuracy for which the dial chooses this setting."""


def work_precision(effort: Effort) -> Iterator[Point]:
    """Measure every stage and the whole, one setting after another."""
    best = Discretisation(*REFERENCE, field_tolerance=effort.finest, rate_nodes=28)
    held, free = (subject(best, is_held, effort.draws) for is_held in (True, False))
    yield from _fields(held, effort)
    yield from _population(held, effort)
    yield from _rates(free, effort)
    yield from _whole(held, free, effort)


def _point(stage: str, setting: str, seconds: float, found: Errors, dial: float = np.nan) -> Point:
    fires = found.peak > 0
    middle = [float(np.median(error[fires])) if fires.any() else 0.0 for error in found]
    worst = found.worst()
    return Point(stage, setting, seconds, float(worst.peak), middle[0], float(worst.log), middle[1], dial)


def _errors(scene: Scene, better: Scene, of: Subject) -> Errors:
    values = of.draws.parameters
    return errors(scene.total_rate(values), better.total_rate(values), scene.n_receptors, of.draws.eps)


def _profile_seconds(scene: Scene, of: Subject, repeats: int) -> float:
    """Return the time of the stress fields alone for a vector, from E_star to the inverted field."""
    contact = scene.contact(first(of.draws.parameters, BATCH))
    return quickest(lambda: scene.stress_profile(contact), repeats) / BATCH


def _fields(of: Subject, effort: Effort) -> Iterator[Point]:
    best = of.model.scene
    for tolerance in (t for t in TOLERANCES if t > effort.finest):
        scene = best.coarser(replace(best.discretisation, field_tolerance=tolerance))
        spent = _profile_seconds(scene, of, effort.repeats)
        yield _point(FIELD, f"tolerance {tolerance:.0e}", spent, _errors(scene, best, of))


def _population(of: Subject, effort: Effort) -> Iterator[Point]:
    """Time the population integral, for known contacts and rate curves."""
    best = of.model.scene
    some = first(of.draws.parameters, BATCH)
    usual = replace(best.discretisation, field_tolerance=max(TOLERANCES[4], effort.finest))
    for nodes, saturation in QUADRATURES:
        exactly = best.coarser(replace(best.discretisation, nodes=nodes, saturation=saturation))
        scene = best.coarser(replace(usual, nodes=nodes, saturation=saturation))
        fields = scene.mechanics.fields(some.b, some.m, None, scene.fingertip(some))
        drive = Drive(some.alpha, some.beta, some.sigma_0, scene.rates.curves(some))
        spent = quickest(partial(scene.population.sums, fields, drive), effort.repeats) / BATCH
        yield _point(POPULATION, f"{nodes} nodes, to exp(-{saturation:g})", spent, _errors(exactly, best, of))


def _exactly(of: Subject) -> tuple[Scene, Subject]:
    """Return the scene with exact rate curves, and the subject with draws that use the channels of these curves."""
    scene, sample = of.model.scene, FiringSample.load(CONNOR_STEVENS)
    assert sample is not None, "curves are kept for the membrane of the usual readings"
    values = sample.put_into(of.draws.parameters)
    return scene.fired_by(sample), of._replace(draws=of.draws._replace(parameters=values))


def _rates(of: Subject, effort: Effort) -> Iterator[Point]:
    surface = of.model.scene
    exactly, of = _exactly(of)
    some, few = (first(of.draws.parameters, size) for size in (BATCH, EXACT_VECTORS))
    spent = quickest(lambda: surface.firing.curves(some), effort.repeats) / BATCH
    yield _point(RATES, "surface", spent, _errors(surface, exactly, of))
    made = surface.fired_by(surface.firing.exact())
    spent = quickest(lambda: made.firing.curves(few), 1) / EXACT_VECTORS
    found = _errors(made, exactly, of._replace(draws=of.draws._replace(parameters=few)))
    yield _point(RATES, "exact, 14 rates for each vector", spent, found)


def _whole(held: Subject, free: Subject, effort: Effort) -> Iterator[Point]:
    """Time the whole likelihood at each accuracy setting, with channels fixed and free."""
    exactly, sampled = _exactly(free)
    surface = free.draws.firing(free.model.scene)
    models = (("held", held, held.model.scene, EXACT), ("free", sampled, exactly, surface))
    for accuracy in (a for a in ACCURACIES if a >= 10.0 * held.model.scene.field_error):
        for name, of, reference, rates in models:
            best = of.model.scene
            try:
                choice = choose(best, of.draws.parameters, accuracy, of.draws.eps, rates)
            except InputError:
                continue  # this accuracy cannot be reached: `sample` raises an error
            scene = best.coarser(choice.discretisation)
            model = replace(of.model.posterior, scene=scene)
            spent = quickest(partial(model.log_likelihood, of.theta), effort.repeats) / BATCH
            found = _errors(scene, reference, of)
            yield _point(LIKELIHOOD, f"channels {name}, accuracy {accuracy:g}", spent, found, accuracy)


def dialled(accuracy: float, effort: Effort, held: bool) -> Subject:
    """Return the model at the resolution for an accuracy setting, with channels fixed or free."""
    of = subject(
        Discretisation(*REFERENCE, field_tolerance=max(FIELD_SHARE * accuracy, effort.finest)), held, effort.draws
    )
    best = of.model.scene
    rates = EXACT if held else of.draws.firing(best)
    choice = choose(best, of.draws.parameters, accuracy, of.draws.eps, rates)
    return subject(choice.discretisation, held, effort.draws)
