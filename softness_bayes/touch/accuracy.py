"""Choice of a scene's resolution: the coarsest of three presets whose measured error stays under a bound.

Two errors are measured at given parameter vectors: that of the total rate, relative to the largest rate of the vector,
and that of log(N/N_ref + eps), which enters a likelihood of log ratings. The reference is the same scene with whole
stress tables, a much finer quadrature, and exact rate curves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import ACCURACIES
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import Channels, Membrane
from softness_bayes.touch.neuron.rate_curve import RateCurve
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Discretisation, Scene

Array = NDArray[np.float64]

PRESETS = (
    Discretisation(7, 4.0, 1e-4, rate_terms=14, load_nodes=2.6),
    Discretisation(),
    Discretisation(18, 11.0, 1e-7, rate_nodes=28, load_nodes=5.5),
)
"""The resolutions, from cheap to accurate: with errors of about 3e-4, 1e-5 and 1e-7 of the peak response. In each, the
extent of the population integral has the least of the errors measured under indentations of 1 to 3 mm and forces of 0.1
to 2 N, and the parts have similar errors, because refining one of them alone gains nothing."""

FEWER_LOADS = 0.77
"""Share of a preset's places along the loads that is tried first, where responses are interpolated along them: those to
forces are smoother than those to indentations, which determine the preset."""

MARGIN = 0.8
"""Share of the bound allowed at the measured vectors, because other vectors may have larger errors."""

DRAWS, EXACT_DRAWS = 256, 16
"""Number of parameter vectors at which errors are measured, and of those for which exact rate curves are computed if
none are stored, which takes a second or two."""

CONDITIONS = 120
"""Largest number of conditions at which errors are measured; more are thinned evenly, by fabric and then by load."""

TABLE = "firing_sample.npz"
"""Name of the data file of `FiringSample` next to this module."""


@dataclass(frozen=True)
class FiringSample:
    """Exact rate curves of a sample of channel vectors, log-normal about the centre of a firing-rate surface.

    Exact rates take milliseconds per current, so the curves are stored. ``python -m
    softness_bayes.tools.surface_build --sample`` recomputes them for every membrane that has a surface.

    Parameters
    ----------
    channels
        Multipliers, each of shape (n,).
    curve
        Their exact curves, of batch shape (n,).
    """

    channels: Channels
    curve: RateCurve
    noise = 0.0

    @classmethod
    def load(cls, membrane: Membrane) -> FiringSample | None:
        """Return the stored sample of a membrane, or None."""
        with (resources.files(__package__) / TABLE).open("rb") as file, np.load(file) as data:
            if membrane.name not in data:
                return None
            rows = data[membrane.name]
        surface = FiringSurface.load(membrane)
        curve = RateCurve(rows[:, 4], rows[:, 5], rows[:, 6:], surface.max_current, surface.error)
        return cls(Channels(*rows[:, :4].T), curve)

    def put_into(self, parameters: TouchParameters) -> TouchParameters:
        """Return the first parameter vectors, shape (vectors,), with the sample's channel multipliers."""
        size = min(np.size(parameters.alpha), self.curve.rheobase.size)
        some = first(parameters, size)
        return some._replace(**{name: values[:size] for name, values in self.channels._asdict().items()})

    def curves(self, channels: Channels, alpha: ArrayLike) -> RateCurve:
        """Return the curves of multipliers from the sample, shape (vectors,)."""
        order = np.argsort(self.channels.c_Na)
        place = np.searchsorted(np.asarray(self.channels.c_Na)[order], channels.c_Na)
        return self.curve.take(order[place])

    def exact(self) -> FiringSample:
        """Return this source: its curves are exact."""
        return self

    def shortened(self, terms: int) -> FiringSample:
        """Return this source: exact curves keep all terms."""
        return self


class Errors(NamedTuple):
    """Errors of a scene: one number, or one for each parameter vector."""

    peak: Array
    """Error of the total rate, relative to the largest rate of the vector."""
    log: Array
    """Error of log(N/N_ref + eps)."""

    @property
    def largest(self) -> float:
        """Larger of the two errors, at the worst vector."""
        return float(max(np.max(self.peak), np.max(self.log)))

    def quantile(self, share: float) -> Errors:
        """Return a quantile of each error over the vectors; 1 for the largest."""
        return Errors(*(np.asarray(np.quantile(error, share)) for error in self))

    def plus(self, peak: Array | float, log: Array | float) -> Errors:
        """Return the sums with other errors."""
        return Errors(np.asarray(self.peak + peak), np.asarray(self.log + log))


class Draws(NamedTuple):
    """Parameter vectors at which errors are measured."""

    parameters: TouchParameters
    """Shape (vectors,)."""
    eps: float | None
    """eps, added to N/N_ref in the logarithm [Hz] (its median if it varies); None if there is no logarithm."""
    usual_channels: bool
    """True if all channel multipliers vary: under their default priors, or a posterior within these."""


class ChosenResolution(NamedTuple):
    """The chosen discretisation with its measured errors."""

    accuracy: float
    """The bound."""
    discretisation: Discretisation
    mechanics: Errors
    """Errors of stress fields and population, maximum over the measured vectors and conditions."""
    firing: Errors
    """Errors of the rate curves."""
    scene: Scene
    """The scene at this resolution."""

    @property
    def errors(self) -> Errors:
        """Sum of both errors, which is below the bound."""
        return self.mechanics.plus(*self.firing)


def errors(rate: Array, better: Array, n_receptors: float, eps: float | None) -> Errors:
    """Compute errors of total rates relative to more accurate ones, both of shape (vectors, conditions).

    Parameters
    ----------
    rate, better
        Total rates [spikes/s].
    n_receptors
        Receptors of the pad.
    eps
        Constant added to N/N_ref in the logarithm [Hz]; None leaves the logarithm out.

    Returns
    -------
    Errors
        Each the largest over the conditions, shape (vectors,).
    """
    peak = better.max(axis=-1)
    relative = np.abs(rate - better).max(axis=-1) / np.where(peak > 0, peak, 1.0)
    if eps is None:
        return Errors(relative, np.zeros_like(relative))
    logs = np.log1p((rate - better) / (better + eps * n_receptors))
    return Errors(relative, np.abs(logs).max(axis=-1))


def measured(scene: Scene, draws: Draws, accuracy: float = 0.0) -> ChosenResolution:
    """Measure the errors of a scene at some parameter vectors; the bound `accuracy` is that to which they matter."""
    few = thinned(scene)
    fine = few.refined()
    unshortened = few.coarser(replace(few.discretisation, rate_terms=None))
    exact = fine.total_rate(draws.parameters)
    mechanics = errors(unshortened.total_rate(draws.parameters), exact, few.n_receptors, draws.eps).quantile(1.0)
    # the stress tables have a common error that this difference does not show
    mechanics = mechanics.plus(few.field_error, few.field_error)
    return ChosenResolution(accuracy, scene.discretisation, mechanics, _of_rates(few, fine, draws, accuracy), scene)


def _of_rates(few: Scene, fine: Scene, draws: Draws, accuracy: float) -> Errors:
    """Return the errors of a scene's rate curves, in the refined scene.

    It is the quantile that 1 % of the vectors exceed: as alpha approaches the rheobase, the response vanishes and
    relative errors become meaningless.
    """
    short = fine.coarser(replace(fine.discretisation, rate_terms=few.discretisation.rate_terms))
    parameters, firing, bound = draws.parameters, few.firing, 0.0
    exact = fine
    if isinstance(firing, FiringSurface):
        kept = FiringSample.load(firing.design.membrane) if draws.usual_channels else None
        parameters = first(parameters, EXACT_DRAWS) if kept is None else kept.put_into(parameters)
        exact = fine.fired_by(firing.exact() if kept is None else kept)
    elif isinstance(firing, FixedChannels) and not firing.noise:  # the error of an average over noise is its own
        bound = firing.curve.error.relative
        if bound > 0.2 * accuracy > 0.0:
            # the bound holds at every rate, even irrelevant ones; the difference from more exact rates matters
            exact, bound = fine.fired_by(firing.exact()), 0.0
    found = errors(short.total_rate(parameters), exact.total_rate(parameters), few.n_receptors, draws.eps)
    return found.quantile(0.99).plus(bound, bound)


def choose(
    compiled: Callable[[Discretisation], Scene],
    draws: Draws,
    accuracy: float,
    presets: Sequence[Discretisation] = PRESETS,
) -> ChosenResolution:
    """Return the first resolution whose errors at some parameter vectors stay under a bound, with the scene.

    Parameters
    ----------
    compiled
        Function that compiles the scene for a discretisation.
    draws
        Parameter vectors at which errors are measured.
    accuracy
        Bound on the error of the response, relative to its peak and in log(N/N_ref + eps).
    presets
        The resolutions tried. A scene that is evaluated only once gains nothing from the coarsest.

    Raises
    ------
    InputError
        If no preset reaches the bound; the message says which accuracy is reached, and what would help.
    """
    ACCURACIES.require("accuracy", accuracy)
    tried: list[ChosenResolution] = []
    for preset in presets:
        scene = compiled(preset)
        scenes = [scene]
        if scene.along and preset.load_nodes is not None:
            scenes.insert(0, scene.coarser(replace(preset, load_nodes=FEWER_LOADS * preset.load_nodes)))
        for one in scenes:
            tried.append(measured(one, draws, accuracy))
            if tried[-1].errors.largest <= MARGIN * accuracy:
                return tried[-1]
    best = min(tried, key=lambda one: one.errors.largest)
    helps = []
    if best.firing.largest > 0.5 * MARGIN * accuracy:
        helps.append(
            f"; the error of the firing rates alone is {best.firing.largest:.1e}: fix c_Na, c_K, c_L and c_A (--fix), "
            "which makes rates exact"
        )
    if best.scene.field_error > 0.2 * accuracy:
        reached = best.scene.field_error
        helps.append(f"; the error of its stress fields is {reached:.1e}: try another reading, or fewer loads")
    possible = best.errors.largest / MARGIN
    unit = 10.0 ** (np.floor(np.log10(possible)) - 1)
    raise InputError(
        f"accuracy {accuracy:g} cannot be reached for these fabrics and loads; the smallest possible is "
        f"{np.ceil(possible / unit) * unit:.1e}{''.join(helps)}"
    )


def thinned(scene: Scene) -> Scene:
    """Return a scene with at most `CONDITIONS` conditions, evenly spaced in modulus under each load, with both ends."""
    if scene.n_conditions <= CONDITIONS:
        return scene
    loads = np.unique(scene.load)
    if loads.size > CONDITIONS // 2:
        loads = loads[np.unique(np.linspace(0, loads.size - 1, CONDITIONS // 2).round().astype(int))]
    each = max(2, CONDITIONS // loads.size)
    kept = []
    for load in loads:
        under = np.flatnonzero(scene.load == load)
        under = under[np.argsort(scene.modulus[under])]
        kept.append(under[np.unique(np.linspace(0, under.size - 1, each).round().astype(int))])
    return scene.take(np.concatenate(kept))


def given_draws(values: Mapping[str, ArrayLike], parameters: TouchParameters) -> Draws:
    """Return the parameter vectors of a command that evaluates the model only at these."""
    shape = np.broadcast_shapes(*(np.shape(v) for v in parameters), (1,))
    eps = float(np.median(np.asarray(values["eps"], float))) if "eps" in values else None
    whole = parameters.broadcast(shape)
    varies = all(np.size(channel) > 1 for channel in parameters.channels)
    return Draws(first(whole, min(DRAWS, shape[0])), eps, varies)


def first(parameters: TouchParameters, size: int) -> TouchParameters:
    """Return the first `size` parameter vectors, repeated cyclically if there are too few."""
    return TouchParameters(*(np.resize(value, (size,)) for value in parameters))
