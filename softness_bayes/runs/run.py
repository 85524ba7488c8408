"""One run from data to result: model, sampling, and everything that is predicted from the draws."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

import numpy as np

from softness_bayes import arviz_bridge
from softness_bayes.checking import direction
from softness_bayes.checking.check_table import check_table
from softness_bayes.checking.direction import Choice
from softness_bayes.checking.identifiability import direction_table, learning_table
from softness_bayes.checking.quantities import Layout
from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.checkpoints.identity import identity, require_density
from softness_bayes.data import Compression, Experiment
from softness_bayes.errors import InputError
from softness_bayes.files.command_line import storable
from softness_bayes.likelihood.directions import RatingDirection, direction_named
from softness_bayes.likelihood.models import rating_model
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.scales import MAGNITUDE, RATING_SCALES, Scale
from softness_bayes.model.build import design_of, scene_of
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.coordinates import Bent, Scaled
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.parameters.priors import Prior, parse_prior
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.provenance import Ending, attributes_of
from softness_bayes.results.assembly import assembled
from softness_bayes.results.plate import forces_of
from softness_bayes.results.result import Result
from softness_bayes.results.result_file import SCHEMA
from softness_bayes.results.versions import versions
from softness_bayes.sampler.sampling import Progress, Settings, progress_of, sampled_of, walk
from softness_bayes.sampler.serial import as_json
from softness_bayes.sampler.state import RunState
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.readings import MENDED, Readings
from softness_bayes.touch.scene import Discretisation, Scene

COARSE = Discretisation(8, 9.0, 1e-4)
"""Resolution that tells in which order fabrics fire."""

ALPHA_WIDTH = 0.3
"""Distance from the rheobase [µA/cm²] beyond which alpha's coordinate turns logarithmic."""


@dataclass(frozen=True)
class RunOptions:
    """Options of a run beyond its data.

    Parameters
    ----------
    fix, priors, prior_set
        As `parameter_space` takes them.
    readings, scale
        Readings of the chain and of the scale of the ratings.
    direction
        Whether ratings rise or fall with the response; None for the one that the data show, decided before sampling
        (`choose_direction`).
    direction_decided
        Whether the direction was taken from the data and not asked for, for the record; it decides nothing.
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
    direction: RatingDirection | None = None
    direction_decided: bool = False
    scale: Scale = MAGNITUDE
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
            *("direction_decided", "prior_set", "accuracy", "noise", "exact_reweight"),
            *("max_steps", "max_seconds", "min_steps", "processes", "seed", "command"),
        )
        return {
            "fix": dict(self.fix),
            "priors": {name: str(prior) for name, prior in self.priors.items()},
            "readings": self.readings.names,
            "direction": None if self.direction is None else self.direction.name,
            "scale": self.scale.name,
            "discretisation": asdict(self.discretisation),
            **{name: getattr(self, name) for name in plain},
        }

    @property
    def settings(self) -> Settings:
        """Settings of the sampler."""
        return Settings(
            max_steps=self.max_steps,
            max_seconds=self.max_seconds,
            min_steps=self.min_steps,
            processes=self.processes,
        )

    def chosen(self) -> dict[str, str]:
        """Choices that affect the draws beside data, parameters and the sampler, by name."""
        readings = {f"reading of {place}": name for place, name in self.readings.names.items()}
        return {
            **readings,
            "direction": "of the data" if self.direction is None else self.direction.name,
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
            If an option is missing, or not known to this version.
        """
        try:
            made: dict[str, Any] = {
                "priors": {name: parse_prior(text) for name, text in record["priors"].items()},
                "readings": Readings().override(record["readings"]),
                "direction": None if record["direction"] is None else direction_named(record["direction"]),
                "scale": RATING_SCALES[record["scale"]],
                "discretisation": Discretisation(**record["discretisation"]),
            }
            return cls(**{**record, **made})
        except (AttributeError, KeyError, TypeError) as error:
            raise InputError(f"options of a run that this version cannot make out: {error}") from None


def choose_direction(experiment: Experiment, options: RunOptions) -> Choice:
    """Return the direction that was asked for, or else that of the data, and what these say of it.

    Raises
    ------
    InputError
        If a rating does not suit the scale.
    """
    _require_suitable(experiment, options)
    ratings, conditions = experiment.ratings, experiment.ratings.conditions
    space = space_of(experiment, options)
    # noise rounds the foot of the rate curve, which changes no order, and takes minutes
    coarse = replace(COARSE, rate_nodes=options.discretisation.rate_nodes)
    scene = _scene(experiment, replace(options, noise=0.0, discretisation=coarse), space)
    layout = Layout(design_of(experiment), scene.modulus, conditions.load, scale=options.scale)
    draws = space.touch(space.draw_prior(np.random.default_rng(0), direction.DRAWS))
    firing = direction.firing_rises(scene, layout, draws)
    found = direction.evidence_in(layout, ratings.rating, [str(load) for load in ratings.loads], firing)
    return direction.choose(options.direction, found)._replace(
        asked=options.direction is not None and not options.direction_decided
    )


def with_direction(experiment: Experiment, options: RunOptions, checkpoint: Checkpoint | None = None) -> RunOptions:
    """Return options with a direction: as asked; else as a checkpoint's run had it; else as the data have it."""
    if options.direction is not None:
        return options
    if checkpoint is not None and (kept := checkpoint.description.get("direction")) is not None:
        return replace(options, direction=direction_named(kept), direction_decided=True)
    return replace(options, direction=choose_direction(experiment, options).direction, direction_decided=True)


def space_of(experiment: Experiment, options: RunOptions) -> ParameterSpace:
    """Return the parameters of an experiment's model, in coordinates not bent yet."""
    return parameter_space(
        fix=options.fix,
        priors=options.priors,
        prior_set=options.prior_set,
        skin_displacement=options.readings.skin_displacement,
        n_participants=len(experiment.ratings.participants),
        absent=set(RatingParameters._fields) - set(rating_model(options.scale).needs),
        n_fingers=None if experiment.compression is None else len(experiment.compression.participants),
        membrane=options.readings.membrane,
    )


def _scene(experiment: Experiment, options: RunOptions, space: ParameterSpace) -> Scene:
    """Return the compiled scene of an experiment."""
    conditions = experiment.ratings.conditions
    return scene_of(
        experiment.fabrics,
        experiment.ratings.loads,
        space.held,
        options.readings,
        conditions.fabric,
        conditions.load,
        options.discretisation,
        options.noise,
    )


def _require_suitable(experiment: Experiment, options: RunOptions) -> None:
    """Refuse ratings that do not suit the scale."""
    options.scale.require(experiment.ratings)


def posterior_of(experiment: Experiment, options: RunOptions) -> Posterior:
    """Return the posterior density of an experiment.

    Raises
    ------
    InputError
        If a rating does not suit the scale, or the options name what does not exist.
    """
    _require_suitable(experiment, options)
    options = with_direction(experiment, options)
    assert options.direction is not None
    space = space_of(experiment, options)
    scene = _scene(experiment, options, space)
    # the exponent's ridge with alpha is straight in the distance from the rheobase: tau falls by a third; and what
    # data tell of sigma_0 is the stress where firing begins: precise data make a thin sheet, straight in that alone
    rheobase = float(scene.firing.curves(space.touch(space.median)).rheobase)
    rheobase -= float(space.rheobase_shift(space.median))
    if np.isfinite(rheobase):
        unit = PARAMETERS["sigma_0"].prior.median
        space = replace(space, bent={"alpha": Bent(rheobase, ALPHA_WIDTH), "sigma_0": Scaled(unit)}, rheobase=rheobase)
    observation = rating_model(options.scale, options.direction).observe(
        experiment.ratings.rating, design_of(experiment)
    )
    plates = () if experiment.compression is None else (forces_of(experiment.compression, options.readings),)
    return Posterior(space, (observation, *plates), scene)


def walked(
    data: Experiment | Compression,
    density: Density,
    options: RunOptions,
    progress: Callable[[Progress], None] | None,
    checkpoint: Checkpoint | None,
    workers: Workers | None = None,
) -> RunState:
    """Walk to the goal or to a limit, from the start or from where the checkpoint is; arguments as `sample`'s."""
    density.space.require_sampled()
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
    return attributes_of(
        Ending(
            verdict=verdict.sentence(),
            converged=verdict.converged,
            steps=verdict.steps,
            missing_steps=verdict.more_steps,
            burn_in=verdict.burn_in,
            sampling_seconds=state.seconds,
            evaluations=state.nonfinite.evaluations,
            failures=state.nonfinite.count,
        )
    )


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
    given, options = options, with_direction(experiment, options, checkpoint)
    chosen = choose_direction(experiment, options)
    posterior = posterior_of(experiment, options)
    asked = {
        **requested(posterior, given),
        "direction": chosen.direction.name,
        "direction_asked": int(chosen.asked),
        "direction_note": chosen.sentence,
        "firing_rises": chosen.evidence.firing,
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
        tree, summary = assembled(
            experiment,
            posterior,
            sampled.chains,
            sampled.verdict.burn_in,
            rng,
            workers,
            {**asked, **outcome(state)},
            options.exact_reweight,
        )
    tables = {"directions": direction_table(tree), "predictive_checks": check_table(tree)}
    return Result(tree, summary.join(learning_table(tree)), tables)
