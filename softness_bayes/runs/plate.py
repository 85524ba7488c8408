"""Runs on compression data alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes import arviz_bridge
from softness_bayes.checking.checks import check_exponent
from softness_bayes.checking.identifiability import direction_table, information_table
from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.data.compression import Compression
from softness_bayes.model.build import SkinModel, build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.assembly import Listener, Stage, no_listener
from softness_bayes.results.constants import held_parameters
from softness_bayes.results.draws import (
    CURVES,
    DRAWS_PER_WALKER,
    PRIOR_DRAWS,
    REPLICATES,
    evenly,
    merged,
    named,
    sampled_groups,
    tree_of,
)
from softness_bayes.results.replicates import draw_plate, plate_attributes, plate_coordinates, plate_groups
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import RunOptions
from softness_bayes.results.summary import summarise
from softness_bayes.runs.run import labels_of, outcome, requested, rng_after, walked
from softness_bayes.sampler.sampling import Progress, sampled_of
from softness_bayes.sampler.workers import Workers

Array = NDArray[np.float64]

WIDE = ModelOptions(prior_set="wide")
"""Options of a model of compression data alone, with weakly informative priors of the skin."""


def sample_skin(
    compression: Compression,
    model: ModelOptions = WIDE,
    run: RunOptions = RunOptions(),
    progress: Callable[[Progress], None] | None = None,
    checkpoint: Checkpoint | None = None,
    **options: Any,
) -> Result:
    """Sample the skin's modulus and stiffening from compression data alone.

    Without ratings, the result has no response curves and no turning point; it contains replicated forces of the fitted
    skin, and their exponent against indentation.

    Parameters
    ----------
    compression
        Forces of a rigid plate on fingerpads.
    model
        Choices of the model; those about ratings are not used.
    run, progress, checkpoint, **options
        As for `sample`.

    Raises
    ------
    InputError
        If data and options do not make a model, or the result file cannot store a name or an option.
    NumericalError
        If the log-likelihood is not a number somewhere.
    """
    model, run = Request(model, run).with_options(**options)
    model.require_storable()
    return sample_skin_model(build_skin(compression, model), run, progress, checkpoint)


def sample_skin_model(
    model: SkinModel,
    run: RunOptions,
    progress: Callable[[Progress], None] | None = None,
    checkpoint: Checkpoint | None = None,
    listener: Listener = no_listener,
    workers: Workers | None = None,
) -> Result:
    """Sample a given model of compression data; arguments and errors as for `sample_skin`.

    The listener is called at later stages; the workers (by default new ones) have the posterior and are not closed.
    """
    compression, posterior, request = model.compression, model.posterior, Request(model.options, run)
    asked = requested(posterior, request)
    arviz_bridge.require_storable(asked, labels_of(compression))
    state = walked(compression, posterior, request, progress, checkpoint, workers)
    listener(Stage.REPLICATES)
    sampled = sampled_of(state)
    rng = rng_after(run)
    kept = sampled.chains.kept(sampled.verdict.burn_in, DRAWS_PER_WALKER)
    theta = kept.by_walker(posterior.natural(kept.coordinates))
    prior = posterior.space.draw_prior(rng, PRIOR_DRAWS)
    forces, skin = posterior.compression, posterior.skin_parameters
    drawn = draw_plate(rng, posterior, theta, theta[evenly(theta.shape, REPLICATES)], prior[:REPLICATES])
    assert forces is not None
    assert drawn is not None
    groups = plate_groups(compression, forces, skin(theta[evenly(theta.shape, CURVES)]), drawn)
    check = check_exponent(forces, drawn.again)
    own = {"prior": named(posterior.space, prior[None]), "constant_data": held_parameters(posterior.space)}
    attributes = {**asked, **outcome(state, run), **plate_attributes(compression, check)}
    tree = tree_of(
        merged(sampled_groups(posterior, kept, theta, "compression"), groups, own),
        {arviz_bridge.ENSEMBLE: kept.ensemble, **plate_coordinates(compression)},
        attributes,
    )
    natural = posterior.natural(kept.coordinates)
    summary = summarise(posterior.names, natural).join(information_table(tree))
    return Result(tree, summary, {"directions": direction_table(tree)})
