"""Model behind the page: ranges of the parameters, scenes that are compiled once, and the data of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import as_file, files

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.defaults import ANSWER_DRAWS
from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LogNormal, LogUniform
from softness_bayes.checking.inflection import LEAST_DROP, RANGE_FACTOR
from softness_bayes.data import Fabrics
from softness_bayes.model.fingers import box_of_priors, require_one_source
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.prediction import deviations_of_fabrics
from softness_bayes.model.scenes import firing_of
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.declared import KPA, Parameter
from softness_bayes.report.charts import chart_data
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.result import Result
from softness_bayes.touch.contact import Finger, FingerBox, Indentation, Load
from softness_bayes.touch.neuron.rate_curve import Firing
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.receptors import draw_receptors
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

EXAMPLE_LOADS: tuple[Load, ...] = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
DIGITS = 5
"""Significant digits of a value: what is shown is what is computed with."""


def rounded(value: float) -> float:
    """Return a value to `DIGITS` significant digits."""
    return float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True)
class Span:
    """Range of one parameter with a slider.

    Parameters
    ----------
    name, meaning, unit
        As in the parameter's declaration.
    low, high, start
        Ends and initial value [unit].
    logarithmic
        True for a logarithmic scale.
    """

    name: str
    meaning: str
    unit: str
    low: float
    high: float
    start: float
    logarithmic: bool

    def place(self, value: float) -> float:
        """Return the slider position of a value: log10 of it on a logarithmic scale, else the value itself."""
        return float(np.log10(value)) if self.logarithmic else value

    def value(self, place: float) -> float:
        """Return the value at a slider position, the inverse of `place`."""
        return rounded(10.0**place if self.logarithmic else place)


def span_of(parameter: Parameter, start: float) -> Span:
    """Return the central 98 % of a parameter's prior, extended to include its initial value."""
    start, law = rounded(start), parameter.prior
    low, high = (rounded(float(end)) for end in np.asarray(law.quantile([0.01, 0.99]), float))
    low, high = min(low, start), max(min(high, parameter.largest), start)
    while hasattr(law, "law"):  # of a truncated or sign-symmetric law
        law = law.law
    unit = "" if parameter.unit == "–" else parameter.unit
    logarithmic = low > 0 and isinstance(law, (LogNormal, LogUniform))
    return Span(parameter.name, parameter.meaning, unit, low, high, start, logarithmic)


class Rated:
    """The model of a finished run on ratings, made once.

    Parameters
    ----------
    result
        The run.

    Raises
    ------
    InputError
        If the run's files lack inputs that its model needs.
    """

    def __init__(self, result: Result) -> None:
        fitted = Fitted(result, ANSWER_DRAWS)
        # of many loads: those of groups of them, and the index of the middle load of each group
        self.charts, self.load = chart_data(result)["e_fab"], result.load_groups.at.tolist()
        self.source, self.scale, self.posterior = result.source, result.scale, fitted.posterior
        self.medians = {name: float(np.median(values)) for name, values in fitted.named.items()}
        self.scene = fitted.posterior.scene
        moduli = self.posterior.space.modulus(self._theta(self.medians))
        self.moduli = result.fabrics.effective_modulus if moduli is None else moduli
        self.span = float(self.moduli.min()) / KPA, float(self.moduli.max()) / KPA

    def _theta(self, values: Mapping[str, float]) -> Array:
        return np.array([values[name] for name in self.posterior.names])

    def typical(self, values: Mapping[str, float], rate: Array, fabric: int | None = None) -> Array:
        """Return the typical rater's rating for given responses [unit of the ratings' file].

        It is the median over the level of the ratings given the data and these parameters, over the draws of `predict`
        at these values, or 15 where each takes integrals over intervals. They are the same each time, so that curves
        move smoothly; their number is odd, so that the median of categories is one.

        Parameters
        ----------
        values
            Every parameter by name, in natural units.
        rate
            Responses [spikes/s], shape (loads, k), one row for each load of `charts`.
        fabric
            Index of the rated fabric in the last column, or None. If the model has fabric deviations, that of this
            fabric is added in the last column.
        """
        posterior, observed = self.posterior, self.posterior.observation
        size = ANSWER_DRAWS if observed.ends is None else 15
        theta = np.repeat(self._theta(values)[None], size, axis=0)
        rated = np.repeat(posterior.response(theta[:1]), size, axis=0)
        parameters = posterior.rating_parameters(theta)
        effects = observed.draw_effects(np.random.default_rng(0), rated, parameters)
        one = posterior.rating_parameters(theta[:1])  # the drive is the same for every draw
        drive = observed.drive_at(rate.reshape(1, -1) / self.scene.n_receptors, rated[:1], one)
        drive = np.broadcast_to(drive.reshape(1, *rate.shape), (size, *rate.shape))
        deviations = None if fabric is None else deviations_of_fabrics(observed.single.named_effects(effects))
        if deviations is not None:
            drive = np.concatenate([drive[..., :-1], drive[..., -1:] + deviations[:, None, fabric, None]], axis=-1)
        ratings = [
            observed.typical(rated, parameters, effects, drive[:, k], np.flatnonzero(self.scene.load == load))
            for k, load in enumerate(self.load)
        ]
        return self.scale.filed(np.asarray(np.median(np.stack(ratings, axis=1), axis=0)))


@dataclass(frozen=True)
class State:
    """Settings of all sliders and choices.

    Parameters
    ----------
    values
        Values of the parameters with a slider, by name in natural units.
    load
        Index of the load.
    fabric
        Index of the fabric, or None for an unnamed fabric of modulus `modulus_kpa`.
    modulus_kpa
        E_fab of the unnamed fabric [kPa].
    """

    values: Mapping[str, float]
    load: int
    fabric: int | None
    modulus_kpa: float


@dataclass(frozen=True, eq=False)
class Subject:
    """All inputs that stay constant while sliders move.

    Parameters
    ----------
    spans
        The parameters with a slider: ranges and initial values.
    others
        Values of all other parameters by name, in natural units: fixed values, or posterior medians of a run.
    fabrics
        Fabrics by their effective moduli.
    loads
        The loads.
    readings, finger
        Readings of the model, and fingertip.
    firing
        Source of the rate curves.
    box
        Ranges of fingertip radius and receptor depth that the stress tables cover.
    poisson_ratio
        nu_fab of the curve and of the unnamed fabric [-].
    least_drop
        Smallest relative drop from a maximum to both ends for it to count as a turning point.
    rated
        Data and posterior of a run; None without a run.
    """

    spans: tuple[Span, ...]
    others: Mapping[str, float]
    fabrics: Fabrics
    loads: tuple[Load, ...]
    readings: Readings
    finger: Finger
    firing: Firing
    box: FingerBox | None
    poisson_ratio: float
    least_drop: float = LEAST_DROP
    rated: Rated | None = None

    @property
    def start(self) -> State:
        """The initial state: the medians, and the middle fabric under the last load."""
        middle = int(np.argsort(self.fabrics.effective_modulus)[len(self.fabrics) // 2])
        kpa = self.fabrics.effective_modulus[middle] / KPA
        values = {span.name: span.start for span in self.spans}
        return State(values, len(self.loads) - 1, middle, float(f"{kpa:.4g}"))

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Ends of the curves [Pa]: a tenth of the softest fabric, and ten times the stiffest."""
        moduli = self.fabrics.effective_modulus
        return float(moduli.min()) / RANGE_FACTOR, float(moduli.max()) * RANGE_FACTOR

    @cached_property
    def curves(self) -> Scene:
        """The scene of the curves: as many moduli as a run stores, under every load."""
        return self._scene(np.geomspace(*self.ends, 161), np.full(161, self.poisson_ratio))

    @cached_property
    def touches(self) -> Scene:
        """The scene of all fabrics and, in the last place, the unnamed fabric of any modulus, under every load."""
        free = float(np.sqrt(self.ends[0] * self.ends[1]))
        moduli = np.append(self.fabrics.effective_modulus, free)
        return self._scene(moduli, np.append(self.fabrics.poisson_ratio, self.poisson_ratio), self.ends)

    def touch(self, state: State) -> Scene:
        """Return the scene of a state's touch alone."""
        fabric = len(self.fabrics) if state.fabric is None else state.fabric
        here = (self.touches.fabric == fabric) & (self.touches.load == state.load)
        return self.touches.take(np.flatnonzero(here))

    def _scene(self, moduli: Array, poisson: Array, ends: tuple[float, float] | None = None) -> Scene:
        return Scene(
            moduli,
            poisson,
            self.loads,
            self.firing,
            finger=self.finger,
            readings=self.readings,
            modulus_range=ends,
            finger_box=self.box,
        )

    @cached_property
    def receptors(self) -> Array:
        """Receptor positions on the pad [m], shape (receptors, 2): one random draw with a fixed seed."""
        return draw_receptors(np.random.default_rng(0), self.finger, self.readings.receptor_density)

    def values(self, state: State) -> dict[str, float]:
        """Return every parameter by name, in natural units."""
        return {**self.others, **state.values}


def example_fabrics() -> Fabrics:
    """Return the fabrics of the example written by the command 'new'."""
    with as_file(files("softness_bayes") / "example" / "fabrics.csv") as path:
        return Fabrics.read(path)


def of_priors(fabrics: Fabrics, loads: Sequence[Load], options: ModelOptions = ModelOptions()) -> Subject:
    """Return the model at the medians of its priors.

    Parameters
    ----------
    fabrics, loads
        The fabrics, and the loads that press on them.
    options
        Readings, finger, priors and fixed values, as for a run. Fixed parameters have no slider.

    Raises
    ------
    InputError
        If the options are inconsistent, or a fabric has no modulus.
    """
    readings, finger = options.readings, options.finger
    require_one_source(options.priors, finger)
    space = parameter_space(
        fix=options.fix,
        priors=options.priors,
        prior_set=options.prior_set,
        skin_displacement=readings.skin_displacement,
        membrane=readings.membrane,
    )
    values = {name: float(value) for name, value in space.values(space.median).items()}
    chain = tuple(p for p in space.sampled if p.name in TouchParameters._fields)
    moduli, poisson = fabrics.modulus(readings.fabric_modulus), fabrics.poisson_ratio
    others = {name: value for name, value in values.items() if name not in {p.name for p in chain}}
    return Subject(
        tuple(span_of(p, values[p.name]) for p in chain),
        others,
        Fabrics(fabrics.names, effective_modulus=moduli, poisson_ratio=poisson),
        tuple(loads),
        readings,
        finger,
        firing_of(others, readings.membrane),
        box_of_priors(chain, finger),
        float(np.median(poisson)),
    )


def of_run(result: Result) -> Subject:
    """Return the finger, fabrics, loads and data of a finished run, at the medians of its posterior.

    Raises
    ------
    InputError
        If the run had no ratings, or its files lack inputs that its model needs.
    """
    if not result.has_ratings:
        raise InputError(f"{result.source}: a run without ratings has no response to explore")
    rated = Rated(result)
    space, scene, medians = rated.posterior.space, rated.scene, rated.medians
    # of the parameters behind the response, those of the spread of ratings are kept where they are
    moved = tuple(p for p in space.chain if p.name in (*TouchParameters._fields, "gamma", "eps"))
    varied, seen = {p.name for p in moved}, result.fabrics
    fabrics = Fabrics(seen.names, effective_modulus=rated.moduli, poisson_ratio=seen.poisson_ratio)
    return Subject(
        tuple(span_of(p, medians[p.name]) for p in moved),
        {name: value for name, value in medians.items() if name not in varied},
        fabrics,
        tuple(result.loads[k] for k in rated.load),
        result.readings,
        result.finger,
        scene.firing,
        scene.finger_box,
        float(np.median(scene.poisson)),
        result.least_drop,
        rated,
    )
