"""One run from data to result: model, sampling, and everything that is predicted from the draws."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

import numpy as np

from softness_bayes import arviz_bridge
from softness_bayes.assembly import Assembly, versions
from softness_bayes.commands import storable
from softness_bayes.criticism import check_table
from softness_bayes.data import Compression, Experiment
from softness_bayes.inference.coordinates import Bent, Scaled
from softness_bayes.inference.design import Design
from softness_bayes.inference.observation import RATING_DIRECTIONS, SOFTNESS, RatingDirection, RatingParameters
from softness_bayes.inference.parameters import PARAMETERS, parameter_space
from softness_bayes.inference.posterior import Density, Posterior
from softness_bayes.inference.priors import Prior, parse_prior
from softness_bayes.inference.sampling import Progress, Settings, progress_of, sampled_of, walk
from softness_bayes.inference.scales import MAGNITUDE, RATING_SCALES, RatingScale
from softness_bayes.inference.state import RunState
from softness_bayes.inference.workers import Workers
from softness_bayes.learning import direction_table, learning_table
from softness_bayes.plate_groups import forces_of
from softness_bayes.result import SCHEMA, Result
from softness_bayes.storage.checkpoint import Checkpoint
from softness_bayes.storage.identity import identity, require_density
from softness_bayes.storage.serial import as_json
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
    accuracy
        What the discretisation was chosen to keep to (`plan.with_accuracy`), for the record; it decides nothing.
    noise
        Strength of the membranes' white current [µA/cm² sqrt(ms)]; needs fixed channel multipliers.
    exact_reweight
        Whether the result is that of draws weighted by the exact likelihood.
    max_steps, max_seconds
        Steps of each ensemble, and time, after which the run ends in any case.
    min_steps
        Steps of each ensemble before which it does not end for having converged.
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
    accuracy: float | None = None
    noise: float = 0.0
    exact_reweight: bool = False
    max_steps: int = 30_000
    max_seconds: float = math.inf
    min_steps: int = 0
    processes: int | None = None
    seed: int = 0
    command: str = ""

    def record(self) -> dict[str, Any]:
        """These options as JSON holds them; `from_record` is the inverse."""
        plain = (
            *("prior_set", "accuracy", "noise", "exact_reweight"),
            *("max_steps", "max_seconds", "min_steps", "processes", "seed", "command"),
        )
        return {
            "fix": dict(self.fix),
            "priors": {name: str(prior) for name, prior in self.priors.items()},
            "readings": self.readings.names,
            "direction": self.direction.name,
            "scale": self.scale.name,
            "discretisation": asdict(self.discretisation),
            **{name: getattr(self, name) for name in plain},
        }

    @property
    def settings(self) -> Settings:
        """How the sampler is set."""
        return Settings(
            max_steps=self.max_steps,
            max_seconds=self.max_seconds,
            min_steps=self.min_steps,
            processes=self.processes,
        )

    def chosen(self) -> dict[str, str]:
        """What decides the draws beside data, parameters and the sampler, by name."""
        readings = {f"reading of {place}": name for place, name in self.readings.names.items()}
        return {
            **readings,
            "direction": self.direction.name,
            "scale of the ratings": self.scale.name,
            "noise": str(self.noise),
            "discretisation": str(self.discretisation),
            "seed": str(self.seed),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """The options of which `record` made this.

        Raises
        ------
        InputError
            If a prior, a reading or a direction is not known to this version.
        """
        made: dict[str, Any] = {
            "priors": {name: parse_prior(text) for name, text in record["priors"].items()},
            "readings": Readings().override(record["readings"]),
            "direction": RATING_DIRECTIONS[record["direction"]],
            "scale": RATING_SCALES[record["scale"]],
            "discretisation": Discretisation(**record["discretisation"]),
        }
        return cls(**{**record, **made})


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
        membrane=options.readings.membrane,
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
        options.noise,
    )
    # the exponent's ridge with alpha is straight in the distance from the rheobase: tau falls by a third; and what
    # data tell of sigma_0 is the stress where firing begins: precise data make a thin sheet, straight in that alone
    rheobase = float(scene.firing.curves(space.touch(space.median)).rheobase)
    rheobase -= float(space.rheobase_shift(space.median))
    if np.isfinite(rheobase):
        unit = PARAMETERS["sigma_0"].prior.median
        space = replace(space, bent={"alpha": Bent(rheobase, ALPHA_WIDTH), "sigma_0": Scaled(unit)}, rheobase=rheobase)
    observation = options.scale.model(options.direction).observe(ratings.rating, design_of(experiment))
    plate = None if experiment.compression is None else forces_of(experiment.compression, options.readings)
    return Posterior(space, scene, observation, plate)


def walked(
    data: Experiment | Compression,
    density: Density,
    options: RunOptions,
    progress: Callable[[Progress], None] | None,
    checkpoint: Checkpoint | None,
    workers: Workers | None = None,
) -> RunState:
    """Walk to the goal or to a limit, from the start or from where the checkpoint is; arguments as `sample`'s."""
    settings, begin = options.settings, None
    if checkpoint is not None:
        begin = checkpoint.begin(identity(data, density, settings, options.chosen()))
        if begin is not None:
            require_density(density, begin)
    try:
        for state in walk(density, settings, options.seed, begin, workers):
            if checkpoint is not None:
                checkpoint.keep(state, settings, density)
            if progress is not None:
                progress(progress_of(state, settings))
    finally:
        if checkpoint is not None:
            checkpoint.flush()
    return state


def rng_after(options: RunOptions) -> np.random.Generator:
    """Return the source of what is drawn after a run, kept apart from the ensembles by a key of its own."""
    return np.random.default_rng(np.random.SeedSequence(options.seed, spawn_key=(1 << 20,)))


def labels_of(data: Experiment | Compression) -> dict[str, Sequence[str]]:
    """Return the names in some data that a result holds, by what they are of."""
    if isinstance(data, Compression):
        return {"finger": data.participants}
    fingers = {} if data.compression is None else labels_of(data.compression)
    return {"participant": data.ratings.participants, "fabric": data.ratings.fabrics, **fingers}


def requested(density: Density, options: RunOptions) -> dict[str, Any]:
    """Return what every run's result says of what was asked for, all of it known before the first step.

    Raises
    ------
    InputError
        If JSON cannot hold an option.
    """
    return {
        "schema_version": SCHEMA,
        "command": storable(options.command),
        "options": as_json(options.record(), "options of the run"),
        # NetCDF has no longer integers; int() reads either
        "seed": options.seed if options.seed < 1 << 63 else str(options.seed),
        "prior_set": options.prior_set,
        **{f"prior_{p.name}": str(p.prior) for p in density.space.sampled},
        **{f"reading_{place}": name for place, name in options.readings.names.items()},
        **versions(),
    }


def outcome(state: RunState) -> dict[str, Any]:
    """Return what every run's result says of how it ended."""
    verdict = sampled_of(state).verdict
    return {
        "verdict": verdict.sentence(),
        "converged": int(verdict.converged),
        "steps": verdict.steps,
        "missing_steps": verdict.more_steps,
        "burn_in": verdict.burn_in,
        "sampling_seconds": state.seconds,
        "evaluations": state.nonfinite.evaluations,
        "failures": state.nonfinite.count,
    }


def sample(
    experiment: Experiment,
    options: RunOptions = RunOptions(),
    progress: Callable[[Progress], None] | None = None,
    checkpoint: Checkpoint | None = None,
) -> Result:
    """Sample the posterior of an experiment and predict from it.

    Parameters
    ----------
    experiment
        Ratings and fabrics.
    options
        What is asked for.
    progress
        Called every few seconds at the latest.
    checkpoint
        Where the run is kept, and continued from if it holds one: an uninterrupted run with the same seed has
        the same draws. Its lock must be held (``with Checkpoint.create(directory) as checkpoint``).

    Raises
    ------
    InputError
        If data and options do not make a model, the prior hardly ever fires, the result's file could not hold a
        name or an option, or the checkpoint is of another run.
    NumericalError
        If no start has a finite density, or too many points have none.
    """
    posterior = posterior_of(experiment, options)
    asked = {
        **requested(posterior, options),
        "direction": options.direction.name,
        "noise": options.noise,
        "rating_scale": options.scale.name,
        "digest_ratings": experiment.ratings.digest,
        "digest_fabrics": experiment.fabrics.digest,
        "missing_ratings": experiment.ratings.n_missing,
        "accuracy": "none asked for" if options.accuracy is None else options.accuracy,
        "discretisation": str(options.discretisation),
    }
    arviz_bridge.require_storable(asked, labels_of(experiment))
    arviz_bridge.prepare()
    with options.settings.workers(posterior) as workers:
        state = walked(experiment, posterior, options, progress, checkpoint, workers)
        sampled, rng = sampled_of(state), rng_after(options)
        assembly = Assembly(
            experiment, posterior, sampled.chains, sampled.verdict, rng, workers, options.exact_reweight
        )
        levels = {f"prior_{name}": str(prior) for name, prior in assembly.model.levels.items()}
        tree = assembly.tree({**asked, **outcome(state), **levels})
        summary = assembly.summary().join(learning_table(tree))
        tables = {"directions": direction_table(tree), "predictive_checks": check_table(tree)}
    return Result(tree, summary, tables)
