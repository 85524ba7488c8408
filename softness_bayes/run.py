"""One run from data to result: model, sampling, and everything that is predicted from the draws."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from softness_bayes.assembly import Assembly, versions
from softness_bayes.data import Experiment
from softness_bayes.inference.coordinates import Bent
from softness_bayes.inference.design import Design
from softness_bayes.inference.observation import SOFTNESS, RatingDirection, RatingParameters
from softness_bayes.inference.parameters import parameter_space
from softness_bayes.inference.posterior import Posterior
from softness_bayes.inference.priors import Prior
from softness_bayes.inference.sampling import Progress, Settings, sample_until
from softness_bayes.inference.scales import MAGNITUDE, RatingScale
from softness_bayes.plate_groups import forces_of
from softness_bayes.result import SCHEMA, Result
from softness_bayes.study import scene_of
from softness_bayes.touch.readings import MENDED, Readings
from softness_bayes.touch.scene import Discretisation

ALPHA_WIDTH = 0.3
"""Distance from the rheobase [µA/cm²] beyond which alpha's coordinate turns logarithmic."""


@dataclass(frozen=True)
class RunOptions:
    """What a run is asked for beyond the data.

    Parameters
    ----------
    fix, priors, prior_set
        As `parameter_space` takes them.
    readings, direction, scale
        Readings of the chain, of what is rated, and of the scale of the ratings.
    discretisation
        Resolution of the scene.
    max_steps
        Steps of each ensemble after which the run ends in any case.
    processes
        Processes that share the ensembles; None for one for each core.
    seed
        Seed of all random numbers.
    command
        The command line, for the record.
    """

    fix: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, Prior] = field(default_factory=dict)
    prior_set: str = "default"
    readings: Readings = MENDED
    direction: RatingDirection = SOFTNESS
    scale: RatingScale = MAGNITUDE
    discretisation: Discretisation = Discretisation()
    max_steps: int = 30_000
    processes: int | None = None
    seed: int = 0
    command: str = ""


def design_of(experiment: Experiment) -> Design:
    """Return who rated what, the conditions by fabric, then load."""
    ratings, conditions = experiment.ratings, experiment.ratings.conditions
    return Design(conditions.of_rating, ratings.participant, conditions.fabric, len(ratings.participants))


def posterior_of(experiment: Experiment, options: RunOptions) -> Posterior:
    """Return the posterior density of an experiment.

    Raises
    ------
    InputError
        If a rating does not suit the scale, or the options name what does not exist.
    """
    ratings, fabrics = experiment.ratings, experiment.fabrics
    (ratings.require_positive if options.scale.positive else ratings.require_standardised)()
    space = parameter_space(
        fix=options.fix,
        priors=options.priors,
        prior_set=options.prior_set,
        skin_displacement=options.readings.skin_displacement,
        n_participants=len(ratings.participants),
        absent=set(RatingParameters._fields) - set(options.scale.parameters),
        n_fingers=None if experiment.compression is None else len(experiment.compression.participants),
    )
    conditions = ratings.conditions
    scene = scene_of(
        fabrics,
        ratings.loads,
        space.held,
        options.readings,
        conditions.fabric,
        conditions.load,
        options.discretisation,
    )
    # the exponent's ridge with alpha is straight in the distance from the rheobase: tau falls by a third
    bend = Bent(float(scene.firing.curves(space.touch(space.median)).rheobase), ALPHA_WIDTH)
    space = replace(space, bent={"alpha": bend} if np.isfinite(bend.centre) else {})
    observation = options.scale.model(options.direction).observe(ratings.rating, design_of(experiment))
    plate = None if experiment.compression is None else forces_of(experiment.compression, options.readings)
    return Posterior(space, scene, observation, plate)


def sample(
    experiment: Experiment,
    options: RunOptions = RunOptions(),
    progress: Callable[[Progress], None] | None = None,
) -> Result:
    """Sample the posterior of an experiment and predict from it.

    Parameters
    ----------
    experiment
        Ratings and fabrics.
    options
        What is asked for.
    progress
        Called after every round of steps.

    Raises
    ------
    InputError
        If data and options do not make a model, or the prior hardly ever fires.
    NumericalError
        If the log-likelihood is not a number somewhere.
    """
    posterior = posterior_of(experiment, options)
    settings = Settings(max_steps=options.max_steps, processes=options.processes)
    begun = time.monotonic()
    sampled = sample_until(posterior, settings, options.seed, progress)
    seconds = time.monotonic() - begun
    # a key of its own keeps what is drawn afterwards apart from the ensembles
    rng = np.random.default_rng(np.random.SeedSequence(options.seed, spawn_key=(1 << 20,)))
    assembly = Assembly(experiment, posterior, sampled.chains, sampled.verdict, rng)
    attributes = {
        "schema_version": SCHEMA,
        "command": options.command,
        "seed": options.seed,
        "prior_set": options.prior_set,
        **{f"prior_{p.name}": str(p.prior) for p in posterior.space.sampled},
        **{f"reading_{place}": name for place, name in options.readings.names.items()},
        "direction": options.direction.name,
        "rating_scale": options.scale.name,
        "digest_ratings": experiment.ratings.digest,
        "digest_fabrics": experiment.fabrics.digest,
        "missing_ratings": experiment.ratings.n_missing,
        "accuracy": str(options.discretisation),
        "verdict": sampled.verdict.sentence(),
        "converged": int(sampled.verdict.converged),
        "steps": sampled.verdict.steps,
        "burn_in": sampled.verdict.burn_in,
        "sampling_seconds": seconds,
        **versions(),
    }
    return Result(assembly.tree(attributes), assembly.summary())
