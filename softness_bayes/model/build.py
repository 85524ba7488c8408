"""Construction of an experiment's model: parameters, scene and likelihood, with direction and resolution chosen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.laws import LogNormal
from softness_bayes.base.ranges import require_kind
from softness_bayes.base.readable import counted
from softness_bayes.data import Afferents, Compression, Experiment, Measurements, Ratings
from softness_bayes.data.columns import CURVATURE
from softness_bayes.data.oddities import few_raters_sentence
from softness_bayes.data.ratings import FREE_TOUCH
from softness_bayes.data.texts import listing
from softness_bayes.likelihood.aggregated import RaterSpreads, SpreadModel
from softness_bayes.likelihood.contract import RATER_SPREADS, RatingsLikelihood, RatingsModel
from softness_bayes.likelihood.design import Design, LoadErrors
from softness_bayes.likelihood.individual import IndividualModel
from softness_bayes.likelihood.layout import Layout, merge
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.models import (
    rating_model,
    try_likelihood,
    under_load_errors,
)
from softness_bayes.likelihood.plate import SKIN, CompressionForces, PressedRaters
from softness_bayes.likelihood.scales import FREE, MAGNITUDE, RISES, STANDARDISED, RatingDirection
from softness_bayes.model import fingers, scenes
from softness_bayes.model.direction import DRAWS, DirectionChoice, evidence_of
from softness_bayes.model.interpretation import Interpretation, interpret
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.model.recordings.likelihood import RecordedRates, RecordingModel
from softness_bayes.model.recordings.response import ProbedTouches
from softness_bayes.parameters import declared
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.coordinates import Bent, Coordinate, Scaled
from softness_bayes.parameters.space import FabricModuli, ParameterSpace, scales_of
from softness_bayes.touch.accuracy import PRESETS, ChosenResolution, choose
from softness_bayes.touch.finger_grid import SPREAD_OF
from softness_bayes.touch.load_groups import groups_of
from softness_bayes.touch.neuron.membrane import HODGKIN_HUXLEY
from softness_bayes.touch.scene import Discretisation, Scene

COARSE = PRESETS[0]
"""Resolution sufficient to decide whether receptors fire, and to order fabrics by firing."""

ALPHA_WIDTH = 0.3
"""Distance from the rheobase [µA/cm²] beyond which alpha's coordinate is logarithmic."""

BY_REFERENCE = (
    "; effects of raters are summed over points in every step, because Laplace's method is too rough for this table"
)
"""Addition to the note on the errors of a model without approximation."""

SIGN_WIDTH = 0.1
"""Magnitude of a signed exponent below which its coordinate is linear."""


@dataclass(frozen=True)
class ExperimentModel:
    """The model of one experiment, whose parts are made when they are first needed.

    Parameters
    ----------
    data
        Ratings and fabrics; plate forces and recorded afferents if there are any.
    requested
        Choices of the model. If no direction is given, it is inferred from the data; if no discretisation is given, it
        is the coarsest preset that meets the accuracy.
    approximate
        Whether integrals over the effects of raters may be approximated in the steps of a run.

    Raises
    ------
    InputError
        If options cannot be combined with each other or with the data.
    """

    data: Experiment
    requested: ModelOptions = ModelOptions()
    approximate: bool = True

    def __post_init__(self) -> None:
        options = self.requested
        require_kind("experiment", self.data, Experiment, "an Experiment, as read_experiment returns it")
        require_kind("options", options, ModelOptions, "ModelOptions")
        if options.direction == FREE and options.scale == STANDARDISED:
            raise InputError(f"direction: {FREE.name} needs magnitude estimates, not {options.scale.name} ratings")
        if options.individual and len(self.data.ratings.participants) < 2:
            raise InputError(
                "individual: there is one participant only, whose "
                f"{fingers.differing(options.individual)[4:]} cannot be distinguished from the typical one's; omit it"
            )
        if fingers.fingers_of(options.individual) and (
            freed := sorted(declared.SHAPE_PARAMETERS.keys() & options.priors.keys())
        ):
            raise InputError(f"individual: raters' own fingers and a prior of {freed[0]} cannot be combined")

    @cached_property
    def options(self) -> ModelOptions:
        """The requested options, with error law, direction and discretisation filled in."""
        options = self.requested
        if options.errors is None:
            options = options.decide(errors=self.interpretation.law)
        if options.direction is None:
            options = options.decide(direction=self.directed)
        if self.resolution is not None:
            options = options.decide(discretisation=self.resolution.discretisation)
        return options

    @cached_property
    def interpretation(self) -> Interpretation:
        """Interpretation of the ratings, and their error law."""
        found = interpret(self.data.ratings, self.requested)
        return found if self.approximate else found._replace(errors_note=f"{found.errors_note}{BY_REFERENCE}")

    @cached_property
    def design(self) -> Design:
        """The design of the ratings, with conditions sorted by fabric, then load."""
        ratings, conditions = self.data.ratings, self.data.ratings.conditions
        return Design(conditions.of_rating, ratings.participant, conditions.fabric, len(ratings.participants))

    @cached_property
    def moduli(self) -> FabricModuli:
        """Effective moduli of the fabrics, and the laws of those that are uncertain."""
        options = self.requested
        reading = options.readings.fabric_modulus
        found = scenes.fabric_moduli(self.data.fabrics, reading, options.modulus_cv, options.unknown_modulus)
        priors = self._priors
        return replace(
            found, factors={of: priors[name] for of, name in scales_of(found.batch).items() if name in priors}
        )

    @property
    def _priors(self) -> dict[str, Any]:
        """The priors given, and those of errors that moduli share and of the force of a free touch, if any."""
        options, own = self.requested, dict[str, Any]()
        law = options.priors.get(declared.MODULUS_SCALE)
        if law is None and options.shared_modulus_cv:
            law = LogNormal(1.0, float(np.sqrt(np.log1p(options.shared_modulus_cv**2))))
        batches, scales = len(set(self.data.fabrics.batch)), scales_of(self.data.fabrics.batch)
        own |= {} if law is None else dict.fromkeys(scales.values(), law)
        if batches > len(scales) and declared.MODULUS_SCALES.keys() & {*own, *options.priors}:
            raise InputError(f"{batches} batches of moduli with an error each, expected at most {len(scales)}")
        if FREE_TOUCH in self.data.ratings.loads and declared.TOUCH_FORCE not in options.fix:
            own[declared.TOUCH_FORCE] = declared.EVERY_PARAMETER[declared.TOUCH_FORCE].prior
        return {**own, **options.priors}

    def space(self, direction: RatingDirection | None) -> ParameterSpace:
        """Return the parameters for a direction of the ratings, in plain coordinates and without the moduli.

        Raises
        ------
        InputError
            If the options contain an unknown name, or parameters of the finger that cannot vary in this model.
        """
        data, options = self.data, self.requested
        fingers.require_one_source(options.priors, options.finger)
        scenes.require_readings(options.prior_set, options.readings)
        if data.compression is not None and "radius" in options.priors:
            raise InputError(
                "radius is given a prior, but the model of compression data needs a known radius: omit the prior "
                "or the compression data"
            )
        needs, free = self.rating_model(RISES).needs, FREE_TOUCH in data.ratings.loads
        if free and options.individual and fingers.fingers_of(options.individual):
            raise InputError("individual: raters' own fingers and a free touch of unknown force cannot be combined")
        return parameter_space(
            fix=options.fixed,
            priors=self._priors,
            prior_set=options.prior_set,
            skin_displacement=options.readings.skin_displacement,
            n_participants=raters_told(data.ratings),
            absent={*RatingModel.needs, *declared.MODULUS_SCALES} - {*needs, *scales_of(data.fabrics.batch).values()}
            | (set() if free else {declared.TOUCH_FORCE}),
            n_fingers=None if data.compression is None else len(data.compression.participants),
            membrane=options.readings.membrane,
            spreads=[{**SPREAD_OF, **RATER_SPREADS}[name] for name in options.individual],
            signed=("gamma",) if direction == FREE else (),
            of_errors=declared.ERROR_PARAMETERS.keys() & {*needs},
            recorded=[name for term in recorded_terms(data, options) for name in term.model.needs],
        )

    def scene_at(self, space: ParameterSpace, discretisation: Discretisation, noise: float | None = None) -> Scene:
        """Return the scene at a resolution, with the noise of the options unless another is given."""
        conditions, options = self.data.ratings.conditions, self.requested
        return scenes.scene_of(
            self.data.fabrics,
            self.data.ratings.loads,
            space.held,
            options.readings,
            conditions.fabric,
            conditions.load,
            discretisation,
            options.noise if noise is None else noise,
            options.finger,
            self.moduli,
            fingers.box_of_priors(space.sampled, options.finger),
            scenes.skin_of_priors(space),
        )

    def rating_model(self, direction: RatingDirection) -> RatingsModel:
        """Return the observation model of the ratings.

        Raises
        ------
        InputError
            If this scale has no model of individual fingers or answers.
        """
        options, meaning = self.requested, self.interpretation
        if answers := fingers.answers_of(options.individual):
            return rating_model(options.scale, direction, meaning.law, differ=answers)
        if options.individual:
            if options.scale != MAGNITUDE:
                what = fingers.differing(options.individual)
                raise InputError(
                    f"individual: raters' {what} need magnitude estimates, not {options.scale.name} ratings"
                )
            return IndividualModel(direction, grid=fingers.grid_of(options.individual))
        model: Any = rating_model(options.scale, direction, meaning.law, meaning.intervals.exact)
        model = replace(model, categories=meaning.categories) if meaning.categories else model
        model = replace(model, guesses_given=True) if options.guess is not None else model
        return replace(model, raters=meaning.raters) if meaning.raters else model

    @cached_property
    def direction(self) -> DirectionChoice:
        """The requested direction, or the one inferred from the data, with the evidence of the data.

        Where the data do not decide, both directions are sampled.
        """
        (ratings, fabrics, *_), options, space = self.data, self.requested, self.space(self.requested.direction)
        # noise smooths the onset of the rate curve, which does not change the order but takes minutes
        coarse = replace(COARSE, rate_nodes=(options.discretisation or COARSE).rate_nodes)
        scene = self.scene_at(space, coarse, noise=0.0)
        layout = Layout(self.design, scene.modulus, ratings.conditions.load, scale=options.scale)
        draws = space.touch(space.draw_prior(np.random.default_rng(0), DRAWS))
        rate, groups = np.atleast_2d(scene.total_rate(draws)), groups_of(ratings.loads)  # one row if nothing is drawn
        if groups.merged:
            # a load that occurs with only one fabric does not order fabrics
            layout, share = merge(layout, groups.of)
            rate = rate @ share
        known = np.array([bool(basis) for basis in fabrics.basis])
        evidence = evidence_of(layout, self.interpretation.intervals.values, rate, known, groups.names)
        asked = options.direction is not None and "direction" not in options.decided
        # without an exponent that is sampled there is no sign to sample
        signed = options.scale.model is None and options.scale != STANDARDISED and "gamma" not in options.fix
        return DirectionChoice(options.direction or evidence.direction or (FREE if signed else RISES), asked, evidence)

    @property
    def directed(self) -> RatingDirection:
        """The direction of the ratings; the data are asked only if none was requested."""
        return self.requested.direction or self.direction.direction

    @cached_property
    def _space(self) -> ParameterSpace:
        return self.space(self.directed)

    @cached_property
    def resolution(self) -> ChosenResolution | None:
        """Reason for the discretisation; None if it was given."""
        if self.requested.discretisation is not None:
            return None
        return choose(partial(self.scene_at, self._space), scenes.prior_draws(self._space), self.requested.accuracy)

    @cached_property
    def scene(self) -> Scene:
        """The forward model."""
        if self.resolution is not None:
            return self.resolution.scene
        assert self.requested.discretisation is not None
        return self.scene_at(self._space, self.requested.discretisation)

    @cached_property
    def posterior(self) -> Posterior:
        """The density of the sampled parameters.

        Raises
        ------
        InputError
            If a rating does not suit the scale, the options contain an unknown name, the model cannot reach the
            accuracy, or the data do not suit the options.
        """
        data, options, stated = self.data, self.options, self.interpretation.intervals
        observation = self.rating_model(self.directed).observe(
            stated.values, self.design, None if stated.exact else stated
        )
        observation = _with_load_errors(observation, data, options)
        errors, plates = observation.load_errors, []
        if data.compression is not None:
            plates.append(forces_of(data.compression, options))
            if set(SKIN) & set(options.individual):
                # raters with plate forces on their own fingers, matched by name
                names = data.ratings.participants, data.compression.participants
                observation = observation.with_pressed(PressedRaters.of(plates[0], *names))
        posterior = Posterior(
            _bent(self._space, self.scene, self.directed).with_moduli(self.moduli),
            (observation, *spreads_between(data.ratings), *plates, *recorded_terms(data, options)),
            self.scene,
            None if errors is None else scenes.at_other_loads(self.scene, errors),
            fingers.family_of(self.scene, fingers.grid_of(options.individual))
            if fingers.fingers_of(options.individual)
            else None,
            self.approximate,
        )
        if options.scale.model is not None:
            # all members of a custom observation model are tested before a run depends on them
            drawn = posterior.space.draw_prior(np.random.default_rng(0), 2)
            values = {name: np.broadcast_to(value, len(drawn)) for name, value in posterior.space.values(drawn).items()}
            try_likelihood(observation, posterior.mean_rate(drawn), values)
        return posterior


@dataclass(frozen=True)
class SkinModel:
    """The model of data without ratings, which has no scene.

    Parameters
    ----------
    data
        Forces of a rigid plate on fingerpads, recorded afferents, or both.
    options
        The requested options; the discretisation is the default one, for the record.
    posterior
        The density of the sampled parameters.
    """

    data: Measurements
    options: ModelOptions
    posterior: Density


def build(experiment: Experiment, options: ModelOptions = ModelOptions()) -> ExperimentModel:
    """Build the whole model of an experiment; arguments and errors as for `ExperimentModel`."""
    model = ExperimentModel(experiment, options)
    _ = model.posterior
    return model


def _with_load_errors(observed: RatingsLikelihood, experiment: Experiment, options: ModelOptions) -> RatingsLikelihood:
    """Return the likelihood of ratings whose loads have errors, if any are stated.

    Raises
    ------
    InputError
        If they cannot be combined with each other or with individual fingers.
    """
    log_sd, shared = experiment.ratings.load_log_sd(options.load_cv), options.shared_load_cv or 0.0
    if FREE_TOUCH in experiment.ratings.loads and (log_sd.any() or shared):
        raise InputError("load_cv: the force of a free touch is unknown, and has no error beside that; omit it")
    if options.individual and (log_sd.any() or shared):
        what = fingers.differing(options.individual)
        raise InputError(f"individual: raters' {what} and errors of loads (load_cv) cannot be combined")
    if log_sd.any() and shared:
        raise InputError(
            "shared_load_cv: errors shared by all ratings of a load cannot be combined with independent "
            "errors of each rating's load (load_cv); state the larger one"
        )
    design = observed.design
    if shared:
        spread = float(np.sqrt(np.log1p(shared**2)))
        return under_load_errors(observed, LoadErrors.of(design, spread, experiment.ratings.conditions.load))
    return under_load_errors(observed, LoadErrors.of(design, log_sd)) if log_sd.any() else observed


def model_of(
    data: Experiment | Compression | Afferents | Measurements, options: ModelOptions
) -> ExperimentModel | SkinModel:
    """Build the model of some data, with or without ratings; errors as for `build` and `build_skin`."""
    return build(data, options) if isinstance(data, Experiment) else build_skin(data, options)


def build_skin(data: Compression | Afferents | Measurements, options: ModelOptions) -> SkinModel:
    """Build the model of data without ratings.

    Raises
    ------
    InputError
        If the options contain an unknown name, or a parameter that the data do not depend on.
    """
    data = Measurements.of(data)
    plates = [] if data.compression is None else [forces_of(data.compression, options)]
    recorded = recorded_terms(data, options)
    used = {name for term in (*plates, *recorded) for name in term.model.needs}
    if alone := [name for name in options.shared if not (plates and name in SKIN)]:
        raise InputError(f"shared: {alone[0]} occurs in no other data than the recorded afferents; omit it")
    space = parameter_space(
        fix=options.fix,
        priors=options.priors,
        prior_set=options.prior_set,
        skin_displacement=options.readings.skin_displacement,
        absent={*declared.PARAMETERS, *declared.SHAPE_PARAMETERS, *declared.MODULUS_SCALES} - used,
        n_fingers=None if data.compression is None else len(data.compression.participants),
        recorded=used,
    )
    posterior = Density(space, (*plates, *recorded))
    return SkinModel(data, replace(options, discretisation=Discretisation()), posterior)


def recorded_terms(data: Experiment | Measurements, options: ModelOptions) -> list[RecordedRates]:
    """Return the likelihood of recorded afferents, if there are any.

    Raises
    ------
    InputError
        If parameters are shared although nothing was recorded, a hollow is narrower than the finger, or the membrane
        cannot fire as slowly as recorded afferents do.
    """
    if data.afferents is None:
        if options.shared:
            raise InputError("shared: there are no recorded afferents (--afferents); omit it")
        return []
    if options.readings.membrane == HODGKIN_HUXLEY:
        raise InputError(
            "afferents: the reading membrane=hodgkin-huxley cannot fire below 54 Hz, as recorded afferents do; omit it"
        )
    rows, closest = data.afferents, -1.0 / options.finger.radius
    for row, curvature in zip(rows.rows, rows.curvature, strict=True):
        if curvature <= closest:
            raise InputError(
                f"{rows.source}: row {row}, column {CURVATURE.name!r}: expected more than {closest:g}, got "
                f"{curvature:g}: a narrower hollow does not touch the fingertip at one place"
            )
    freed = tuple(name for name in declared.OPTIONAL_RECORDING if name in {*options.fix, *options.priors})
    touches = ProbedTouches(rows.loads, rows.curvature, rows.distance, options.finger, options.readings)
    return [RecordedRates(rows, touches, RecordingModel.of(rows, options.shared, freed))]


def spreads_between(ratings: Ratings) -> tuple[RaterSpreads, ...]:
    """Return the likelihood of standard deviations between raters, for cell means that have them."""
    cells = ratings.cells
    if cells is None or cells.geometric_sd is None:
        return ()
    known, conditions = ~np.isnan(cells.geometric_sd), ratings.conditions
    design = Design(
        conditions.of_rating[known], ratings.participant[known], conditions.fabric, len(ratings.participants)
    )
    return (RaterSpreads(np.log(cells.geometric_sd[known]), design, SpreadModel(cells.raters)),)


def raters_told(ratings: Ratings) -> int:
    """Return the number of raters whose scales the ratings inform; for means, only through standard deviations."""
    own = len(ratings.participants)
    return ratings.cells.raters if own == 1 and ratings.cells is not None and spreads_between(ratings) else own


def forces_of(compression: Compression, options: ModelOptions) -> CompressionForces:
    """Return the likelihood of compression data for the given fingertip and readings of the skin."""
    return CompressionForces(
        compression.indentation,
        compression.force,
        compression.participant,
        len(compression.participants),
        displacement=options.readings.skin_displacement,
        shape=options.finger,
    )


def _bent(space: ParameterSpace, scene: Scene, directed: RatingDirection) -> ParameterSpace:
    """Return the parameters in coordinates in which the ridges of the posterior are straight.

    The ridge between the exponent and alpha is straight if alpha is expressed as distance from the rheobase, which
    reduces the autocorrelation time by a third. The data determine sigma_0 through the stress at which firing starts;
    with precise data, the posterior is a thin sheet that is straight only in this coordinate.
    """
    median = space.touch(space.median)
    rheobase = float(scene.firing.curves(median.channels, median.alpha).rheobase)
    rheobase -= float(space.rheobase_shift(space.median))
    # logarithmic away from 0 on either side
    bent: dict[str, Coordinate] = {"gamma": Bent(0.0, SIGN_WIDTH)} if directed == FREE else {}
    if not np.isfinite(rheobase):
        return replace(space, bent=bent)
    unit = declared.PARAMETERS["sigma_0"].prior.median
    # rounded: a run goes on where the last digits of a computed rheobase are others
    bent |= {"alpha": Bent(round(rheobase, 4), ALPHA_WIDTH), "sigma_0": Scaled(unit)}
    return replace(space, bent=bent, rheobase=rheobase)


def sharing_note(data: Afferents, shared: tuple[str, ...]) -> str:
    """Describe which parameters recorded afferents share with other data."""
    who = f"the recorded afferents ({', '.join(data.species)})" if data.species else "the recorded afferents"
    if shared:
        return f"{who} share {', '.join(shared)} with the other data, as --shared states"
    return f"{who} have a skin and a transduction of their own; --shared b,m says that they share some with other data"


def people_notes(experiment: Experiment, options: ModelOptions) -> list[str]:
    """Describe what too few raters do not show, whose moduli share an error, and who has plate forces and their use.

    Parameters
    ----------
    experiment, options
        The tables and the requested options.
    """
    ratings, batch = experiment.ratings, experiment.fabrics.batch
    raters = len(ratings.participants) if ratings.cells is None else ratings.cells.raters
    notes = [few_raters_sentence(raters)]
    scales = scales_of(batch)
    if any(batch) and (options.shared_modulus_cv or {*scales.values()} & options.priors.keys()):
        told = [f"{name} of {quoted(of)} ({counted(batch.count(of), 'fabric')})" for of, name in scales.items()]
        notes.append(f"moduli of a batch share a factor: {', '.join(told)}")
    elif any(batch):
        notes.append(
            "the column batch of the fabrics is not used without --shared-modulus-cv, the error that a batch shares"
        )
    if experiment.compression is not None:
        pressed = experiment.compression.participants
        both = [name for name in ratings.participants if name in pressed]
        whose = (
            f"{listing(both)}: rated and pressed ({len(both)} of {len(ratings.participants)} raters)" if both else ""
        )
        if not both:
            notes.append("no rater has the name of a pressed finger: they are treated as different people")
        elif own := [name for name in SKIN if name in options.individual]:
            known = f"each is one person, whose {' and '.join(own)} is inferred from forces and ratings together"
            notes.append(f"{whose}; {known}")
        else:
            notes.append(
                f"{whose}; without --individual b all raters have the typical finger, so the forces inform the "
                "typical finger and not those of single raters"
            )
    return [note for note in notes if note]
