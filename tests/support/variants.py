"""Brief runs of every kind of data and model, for the contract of all and for what is special about each."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from softness_bayes.base.laws import LogNormal, Normal, Uniform
from softness_bayes.checking.checks import ALONG, EXPONENTS, FABRICS, NOISE, SKINS
from softness_bayes.data import Experiment
from softness_bayes.data.ratings import Ratings
from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.likelihood.scales import AGGREGATED, FREE, RANKS
from softness_bayes.model import fingers as individual
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression, simulate_ratings
from softness_bayes.results import draws
from softness_bayes.results.result import Result
from softness_bayes.runs.run import sample
from softness_bayes.touch.contact import Force
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
from support.report_runs import CLOTH, HELD, LOADS, OPTIONS, experiment, quickly

RATERS = 20
"""Raters of each mean of the variant of cells."""

WITHOUT_TAU = {name: value for name, value in HELD.items() if name != "tau"}


def cells() -> Experiment:
    """Return means of `RATERS` raters, with their standard deviations."""
    values, rng = usual_values(MENDED, given={"sigma_0": 7.0, "varsigma": 0.2}), np.random.default_rng(12)
    made = simulate_ratings(rng, CLOTH, LOADS, values, participants=RATERS, scale=AGGREGATED)
    return Experiment(made.ratings, CLOTH, ())


def pressed_too() -> Experiment:
    """Return forces on the fingers of the third and fifth rater, and on those of two strangers, beside ratings."""
    whole = experiment()
    made = simulate_compression(np.random.default_rng(5), usual_values(MENDED, n_fingers=4), fingers=4).compression
    people = whole.ratings.participants
    return whole._replace(compression=replace(made, participants=("F1", people[4], "F3", people[2])))


def errors_of_loads() -> Experiment:
    """Return ratings of which every third has no error of its own, and the first an exact load."""
    made = experiment()
    cv = np.where(np.arange(len(made.ratings)) % 3, 0.1, np.nan)
    cv[0] = 0.0
    return made._replace(ratings=replace(made.ratings, load_cv=cv))


def vague_moduli() -> Experiment:
    """Return fabrics of which the first has an error of its own, the second none, the third a bracket, one nothing."""
    none = np.full(4, np.nan)
    fabrics = replace(
        CLOTH,
        effective_modulus=np.array([*CLOTH.effective_modulus[:2], np.nan, np.nan]),
        effective_modulus_cv=np.array([0.2, *none[1:]]),
        effective_modulus_low=np.array([*none[:2], 2e5, np.nan]),
        effective_modulus_high=np.array([*none[:2], 8e5, np.nan]),
    )
    return experiment()._replace(fabrics=fabrics)


def batches() -> Experiment:
    """Return fabrics of two mills, the second of which measured the last two."""
    return experiment()._replace(fabrics=replace(CLOTH, batch=("mill A", "mill A", "mill B", "mill B")))


MEANT, TOUCHES = (0.5, 1.0, 2.0), 8
"""Forces that were meant [N], and the touches at each, each with another force."""


def measured_loads() -> Experiment:
    """Return ratings that fall with the fabrics' stiffness, every touch with a force of its own."""
    rng, total = np.random.default_rng(3), TOUCHES * len(MEANT)
    newton = np.sort(np.repeat(MEANT, TOUCHES) * np.exp(rng.uniform(-0.1, 0.1, total)))
    fabric, participant = np.arange(total) % 4, np.arange(total) // 4 % 4
    rating = 300.0 * (CLOTH.effective_modulus[fabric] / 1e4) ** -0.8 * np.exp(0.05 * rng.standard_normal(total))
    people, touch = ("P1", "P2", "P3", "P4"), np.arange(total)
    ratings = Ratings(people, CLOTH.names, tuple(map(Force, newton)), participant, fabric, touch, rating, touch + 2)
    return Experiment(ratings, CLOTH, ())


def whole_numbers() -> Experiment:
    """Return whole numbers from 0 on, one of them ten times too large."""
    rated = experiment(participants=2)
    whole = np.maximum(np.round(rated.ratings.rating / 6.0), 0.0)
    whole[3] *= 10.0
    whole[5] = 0.0
    return rated._replace(ratings=replace(rated.ratings, rating=whole, resolution=np.ones(whole.size)))


def orders() -> Experiment:
    """Return places of the fabrics of each load, with lists that the table names."""
    ratings = whole_numbers().ratings
    return experiment()._replace(
        ratings=replace(ratings, lists=10 * ratings.participant + ratings.load, resolution=None)
    )


@dataclass(frozen=True)
class Variant:
    """A kind of run: its data and options, and what it must say."""

    data: Callable[[], Experiment]
    options: dict[str, Any]
    sampled: set[str]
    """Parameters beside the usual ones."""
    said: tuple[str, ...] = ()
    """Texts on the page of the report or among the notes."""
    findings: tuple[str, ...] = ()
    """Checks that must have a p-value."""
    files: tuple[str, ...] = ()


VARIANTS = {
    "cells": Variant(cells, {"fix": WITHOUT_TAU, "scale": AGGREGATED}, {"tau"}, (f"geometric means of {RATERS}",)),
    "finger": Variant(
        experiment,
        {
            "priors": {"radius": Normal(8, 0.5), "receptor_depth": Uniform(0.5, 0.9)},
            "discretisation": Discretisation(8, 9.0, 1e-3),
        },
        {"radius", "receptor_depth"},
        ("receptor_depth",),
    ),
    "own fingers": Variant(
        pressed_too, {"individual": ("b",)}, {"tau_b"}, ("--individual b",), (SKINS,), ("rater_fingers.csv",)
    ),
    "own answers": Variant(
        experiment,
        {"individual": ("gamma", "varsigma")},
        {"tau_gamma", "tau_varsigma"},
        ("--individual gamma,varsigma",),
        (NOISE, EXPONENTS),
        ("rater_answers.csv",),
    ),
    "loads": Variant(errors_of_loads, {"load_cv": 0.05}, set(), ("relative errors of 0.05 to 0.1",), (FABRICS, ALONG)),
    "moduli": Variant(
        vague_moduli,
        {"unknown_modulus": LogNormal(150, 1.5)},
        {f"fabric_modulus[{CLOTH.names[k]}]" for k in (0, 2, 3)},
        ("Would errors of the fabrics",),
        (),
        ("fabric_moduli.csv", "modulus_errors.csv"),
    ),
    "batches": Variant(batches, {"shared_modulus_cv": 0.2}, {"modulus_scale", "modulus_scale_2"}),
    "measured loads": Variant(measured_loads, {}, set(), ("24 loads in 3 groups",)),
    "whole numbers": Variant(
        whole_numbers, {"errors": STUDENT, "direction": FREE, "max_steps": 4}, {"nu"}, ("censored",)
    ),
    "orders": Variant(orders, {"fix": WITHOUT_TAU, "scale": RANKS}, {"varsigma"}, ("places in",)),
}


def fitted(name: str) -> Result:
    """Return a run of a variant that is far from converged."""
    one = VARIANTS[name]
    with quickly(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(individual, "NODES", {**individual.NODES, 1: {"b": 9}})
        if one.options.get("errors") is STUDENT:  # whose integrals take longest
            patch.setattr(draws, "REPLICATES", 30)
        return sample(one.data(), **OPTIONS | one.options)
