"""Simulated answers in the form of data files: rounded numbers, places in lists, answers to pairs, panel means."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Ratings
from softness_bayes.data.forms import PANEL, AggregatedCells
from softness_bayes.errors import InputError
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.stated import Stated
from softness_bayes.touch.contact import Load
from softness_bayes.touch.scene import Scene


def averaged(filed: NDArray[np.float64], scene: Scene, fabrics: tuple[str, ...], loads: tuple[Load, ...]) -> Ratings:
    """Return geometric means and standard deviations over people of ratings (people, conditions), by condition."""
    log, conditions = np.log(filed), np.arange(filed.shape[1])
    return Ratings(
        (PANEL,),
        fabrics,
        loads,
        participant=np.zeros_like(conditions),
        fabric=scene.fabric,
        load=scene.load,
        rating=rounded(np.exp(log.mean(axis=0))),
        rows=conditions + 2,
        cells=AggregatedCells(len(filed), rounded(np.exp(log.std(axis=0, ddof=1)))),
    )


def places(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each fabric's place, from 1, for every participant and load, shape (people, fabrics, loads)."""
    place = 1.0 + table.argsort(axis=1, kind="stable").argsort(axis=1, kind="stable")
    return np.where(np.isnan(table), np.nan, place)


def paired(
    rng: np.random.Generator,
    model: Any,
    scene: Scene,
    participants: int,
    missing: float,
    drive: NDArray[np.float64],
    parameters: RatingParameters,
    fabrics: tuple[str, ...],
    loads: tuple[Load, ...],
) -> Ratings:
    """Return answers to pairs: each participant compares neighbours in a random circle of the fabrics for each load.

    Parameters
    ----------
    rng, model, scene, participants, missing
        As for `simulate_ratings`; the model is that of pairs.
    drive
        Drive of each condition, shape (conditions,).
    parameters
        Parameters of the model.
    fabrics, loads
        Names of the fabrics, and the loads.

    Raises
    ------
    InputError
        If all answers are left out.
    """
    each = [np.flatnonzero(scene.load == k) for k in np.unique(scene.load)]
    circles = np.array([[rng.permutation(conditions) for conditions in each] for _ in range(participants)])
    condition = np.stack([circles, np.roll(circles, -1, axis=2)], axis=-1).reshape(-1, 2)
    person = np.repeat(np.arange(participants), len(condition) // participants)
    kept = rng.random(len(condition)) >= missing
    rows, participant = condition[kept].ravel(), np.repeat(person[kept], 2)
    lists = np.repeat(np.arange(int(kept.sum())), 2)
    answers = np.tile([1.0, 0.0], int(kept.sum()))
    if not rows.size:
        raise InputError("simulate: all answers are missing at random; use a smaller share or another seed")
    zero = np.zeros(rows.size)
    asked = Design(rows, participant, scene.fabric, participants)
    observed = model.observe(answers, asked, Stated(answers, zero, zero, zero + np.inf, lists=lists))
    return Ratings(
        numbered("P", participants),
        fabrics,
        loads,
        participant=participant,
        fabric=scene.fabric[rows],
        load=scene.load[rows],
        rating=observed.replicate(rng, drive, parameters, None),
        rows=np.arange(2, 2 + rows.size),
        n_missing=2 * int((~kept).sum()),
        lists=lists,
    )


def rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values rounded to the digits that people and instruments typically report.

    Rounding also makes files identical on machines whose exponentials differ in the last bits.
    """
    return np.array([float(f"{value:.4g}") for value in values])


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """Return names that sort by their numbers, as P01 to P30."""
    return tuple(f"{letter}{i:0{len(str(count))}d}" for i in range(1, count + 1))
