"""Simulated laboratories whose inputs are draws of their own distributions, for `latent_ranks`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from softness_bayes.data import Compression, Experiment, Fabrics, Ratings
from softness_bayes.data.fabrics import log_sd
from softness_bayes.likelihood.contract import NO_RESPONSE
from softness_bayes.likelihood.directions import RISES
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.plate import CompressionForces, FingerEffects
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.individual import fingers_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.other_loads import scaled
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import scene_of, touch_parameters
from softness_bayes.model.simulated_answers import numbered
from softness_bayes.model.simulated_forces import PLATE_DEPTHS
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.declared import EVERY_PARAMETER, SHAPE_PARAMETERS
from softness_bayes.parameters.priors import LogNormal, Normal, Uniform
from softness_bayes.touch.contact import Indentation, Load
from softness_bayes.touch.finger_grid import EFFECT_OF, SPREAD_OF
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

MODULI = np.geomspace(3e3, 6e5, 8)
"""Stated moduli [Pa], those of the usual calibration."""

LOADS: tuple[Load, ...] = (Indentation(1.5e-3), Indentation(2.5e-3))
RATERS = 20
PRESSED = 6
"""Number of raters, and number of those with plate forces."""

SCATTER = LogNormal(0.3, 0.3)
"""Prior of varsigma. Its default allows ratings almost without noise, whose posteriors are thin bent sheets."""

BRACKET = 1.5
"""Ratio of the upper end of a bracket to its middle."""


@dataclass(frozen=True)
class Kind:
    """Uncertain inputs of a laboratory, which it declares.

    Parameters
    ----------
    meaning
        In words.
    modulus_cv, load_cv, shared_load_cv
        Relative errors of all moduli; of loads, single or shared.
    bracketed, unknown
        Indices of the fabrics whose moduli are in brackets or unknown.
    shape
        Whether radius and receptor depth are sampled.
    individual
        What differs between raters' fingers.
    plates
        Whether some raters have plate forces.
    """

    meaning: str
    modulus_cv: float = 0.0
    bracketed: tuple[int, ...] = ()
    unknown: tuple[int, ...] = ()
    load_cv: float = 0.0
    shared_load_cv: float = 0.0
    shape: bool = False
    individual: tuple[str, ...] = ()
    plates: bool = False


KINDS: Mapping[str, Kind] = {
    "moduli": Kind("moduli with errors of 15 %", modulus_cv=0.15),
    "brackets": Kind(f"moduli in brackets, a factor of {BRACKET:g} to either side", bracketed=tuple(range(8))),
    "unknown": Kind("two unknown moduli", unknown=(2, 5)),
    "single_loads": Kind("errors of single loads, 10 %", load_cv=0.10),
    "shared_loads": Kind("error shared by all ratings at a load, 5 %", shared_load_cv=0.05),
    "finger": Kind("radius and depth of the receptors", shape=True),
    "own_b": Kind("raters' own `b`", individual=("b",)),
    "own_m": Kind("raters' own `m`", individual=("m",)),
    "own_sigma_0": Kind("raters' own `sigma_0`", individual=("sigma_0",)),
    "plates": Kind("raters' own `b`, with plate forces of six of them", individual=("b",), plates=True),
    "together": Kind(
        "moduli with errors, a bracket, an unknown one, shared load error, radius and depth",
        modulus_cv=0.15,
        bracketed=(1,),
        unknown=(5,),
        shared_load_cv=0.05,
        shape=True,
    ),
    "together_fingers": Kind(
        "moduli with errors, a bracket, an unknown one, own `b`, plate forces",
        modulus_cv=0.15,
        bracketed=(1,),
        unknown=(5,),
        individual=("b",),
        plates=True,
    ),
}
"""Kinds by the names of their files."""

FACTOR = 2.0
"""Ratio of true to declared errors in a control."""

FARTHEST = 3.9
"""Largest normal score of a true input; the model covers four standard deviations."""

Effects = Mapping[str, tuple[Callable[[Any], Array], float]]
"""Ranked effects: how to take them from drawn effects, and their true values."""


class Laboratory(NamedTuple):
    """One simulated laboratory."""

    theta: Array
    """True parameters, in natural units."""
    start: Mapping[str, float]
    """The same by name."""
    posterior: Callable[[Posterior], Posterior]
    """Function that gives a model of this kind the data of this laboratory."""
    effects: Effects


def stated(kind: Kind) -> Fabrics:
    """Return the fabrics as the laboratory states them."""
    names = tuple("abcdefgh")
    known, low, high = MODULI.copy(), np.full(8, np.nan), np.full(8, np.nan)
    places = list(kind.bracketed)
    low[places], high[places] = MODULI[places] / BRACKET, MODULI[places] * BRACKET
    known[[*places, *kind.unknown]] = np.nan
    return Fabrics(names, effective_modulus=known, effective_modulus_low=low, effective_modulus_high=high)


def model_of(kind: Kind) -> ExperimentModel:
    """Return the model of all laboratories of a kind, with ratings to be replaced."""
    participants = numbered("P", RATERS)
    ratings = Ratings.crossed(participants, tuple("abcdefgh"), LOADS, np.ones((RATERS, 8, len(LOADS))))
    compression = None
    if kind.plates:
        finger, depth = np.repeat(np.arange(PRESSED), len(PLATE_DEPTHS)), np.tile(PLATE_DEPTHS, PRESSED)
        names = participants[:PRESSED]
        compression = Compression(names, finger, depth, np.ones(depth.size), np.arange(depth.size))
    shape = {"radius": Normal(8, 1), "receptor_depth": Uniform(0.5, 0.9)} if kind.shape else {}
    options = ModelOptions(
        fix=PAPER_CHANNELS._asdict(),
        priors={"varsigma": SCATTER, **shape},
        direction=RISES,
        errors=NORMAL,
        resolution=0.0,
        modulus_cv=kind.modulus_cv or None,
        load_cv=kind.load_cv or None,
        shared_load_cv=kind.shared_load_cv or None,
        individual=kind.individual,
    )
    return build(Experiment(ratings, stated(kind), (), compression), options)


def laboratory(kind: Kind, model: ExperimentModel, number: int, control: bool) -> Laboratory:
    """Return one laboratory.

    Parameters
    ----------
    kind
        Its uncertain inputs.
    model
        The model of these laboratories, from `model_of`.
    number
        Seed.
    control
        Whether the normal scores of all true errors are `FACTOR` times as large as declared.
    """
    rng, posterior = np.random.default_rng((20261125, number, control)), model.posterior
    space, factor = posterior.space, FACTOR if control else 1.0
    theta = space.draw_prior(rng, 1)[0]
    uncertain = [*range(space.n_chain, space.dimension)]
    uncertain += [space.names.index(name) for name in SHAPE_PARAMETERS if name in space.names]
    for k in uncertain:
        law = space.sampled[k].prior
        score = np.clip(factor * ndtri(law.cumulative(theta[k])), -FARTHEST, FARTHEST)
        theta[k] = law.quantile(ndtr(score))
    values = {name: float(value) for name, value in space.values(theta).items()}
    modulus = space.modulus(theta)
    fabrics = Fabrics(model.experiment.ratings.fabrics, effective_modulus=MODULI if modulus is None else modulus)
    level: Any = posterior.observation.model
    made = _Made(rng, kind, fabrics, values, float(level.draw_level(rng, (), None)), factor)
    cube, effects, own_b = made.by_own_fingers() if kind.individual else made.by_one_finger()
    ratings = model.experiment.ratings
    answers = cube[ratings.participant, ratings.fabric, ratings.load]
    forces = made.forces(posterior, own_b) if kind.plates else None

    def with_data(of: Posterior) -> Posterior:
        observation: Any = of.observation.with_values(answers)
        if forces is None:
            return of.with_term(observation)
        pressed = replace(observation.pressed, forces=forces)
        return of.with_term(forces).with_term(observation.with_pressed(pressed))

    return Laboratory(theta, dict(zip(space.names, theta.tolist(), strict=True)), with_data, effects)


@dataclass(frozen=True)
class _Made:
    """Simulation of one laboratory by the forward model at its true inputs."""

    rng: np.random.Generator
    kind: Kind
    fabrics: Fabrics
    values: Mapping[str, float]
    mu: float
    factor: float

    def by_one_finger(self) -> tuple[Array, Effects, Array]:
        """Return ratings, shape (raters, fabrics, loads), ranked effects, and no deviations of fingers."""
        spread, loads = float(log_sd(np.array(self.kind.shared_load_cv))), LOADS
        effects: Effects = {}
        if spread:
            score = self.factor * self.rng.standard_normal(len(LOADS))
            loads = tuple(scaled(load, float(np.exp(spread * z))) for load, z in zip(LOADS, score, strict=True))
            effects = {f"error of {load}": (_Load(k), float(score[k])) for k, load in enumerate(LOADS)}
        load_cv = self.factor * self.kind.load_cv
        found = simulate_ratings(
            self.rng, self.fabrics, loads, self.values, participants=RATERS, mu=self.mu, load_cv=load_cv
        ).ratings
        cube = np.empty((RATERS, len(self.fabrics), len(LOADS)))
        cube[found.participant, found.fabric, found.load] = found.rating
        return cube, effects, np.zeros(RATERS)

    def by_own_fingers(self) -> tuple[Array, Effects, Array]:
        """Return ratings, ranked effects, and the deviations of raters' ln b."""
        values, rng, deviations, own = self.values, self.rng, {}, dict[str, Any](self.values)
        for name in fingers_of(self.kind.individual):
            deviation = self.factor * values[SPREAD_OF[name]] * rng.standard_normal(RATERS)
            # as in the model, an exponent that would be negative is 0
            own[name] = np.maximum(values[name] + deviation, 0) if name == "m" else values[name] * np.exp(deviation)
            deviations[name] = deviation
        scene = scene_of(self.fabrics, LOADS, values, MENDED)
        skins = TouchParameters(*np.broadcast_arrays(*touch_parameters(own), np.empty(RATERS))[:-1])
        x, typical = (
            np.log(scene.total_rate(each) / scene.n_receptors + values["eps"])
            for each in (skins, touch_parameters(values))
        )
        level = self.mu + values["tau"] * rng.standard_normal(RATERS)
        log_rating = level[:, None] + values["gamma"] * (x - typical.mean())
        log_rating += values["varsigma"] * rng.standard_normal(log_rating.shape)
        cube = np.exp(log_rating).reshape(RATERS, len(LOADS), len(self.fabrics)).transpose(0, 2, 1)
        effects: Effects = {
            f"{EFFECT_OF[name]}[{numbered('P', RATERS)[rater]}]": (_Finger(rater, k), float(deviations[name][rater]))
            for k, name in enumerate(deviations)
            for rater in (0, RATERS - 1)  # with and without plate forces
        }
        return cube, effects, deviations.get("b", np.zeros(RATERS))

    def forces(self, posterior: Posterior, own_b: Array) -> CompressionForces:
        """Return plate forces of the first raters, whose fingers' ln b deviate by `own_b`."""
        plate = posterior.compression
        assert plate is not None
        skin = plate.model.take({n: self.values[n] * EVERY_PARAMETER[n].si for n in plate.model.needs})
        m = self.values["tau_m"] * self.rng.standard_normal(PRESSED)
        drive = plate.drive(NO_RESPONSE, skin)
        return plate.with_values(plate.replicate(self.rng, drive, skin, FingerEffects(own_b[:PRESSED], m)))


@dataclass(frozen=True)
class _Load:
    """Takes the error of one load, in its standard deviations, from drawn effects."""

    load: int

    def __call__(self, drawn: Any) -> Array:
        return np.asarray(drawn.load[..., self.load])


@dataclass(frozen=True)
class _Finger:
    """Takes one deviation of a rater's finger from drawn effects."""

    rater: int
    quantity: int

    def __call__(self, drawn: Any) -> Array:
        return np.asarray(drawn.deviation[..., self.rater, self.quantity])
