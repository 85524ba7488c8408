"""Choosing how finely a scene is resolved: the cheapest setting of each stage whose measured error stays under a bound.

The error is that of the total rate relative to the vector's largest one, and that of log(N/N_ref + eps), which is what
a likelihood of log ratings sees. Both are measured on the scene itself, at given parameter vectors, against one whose
stress fields are a hundred times closer and whose quadrature is far finer. That scene's fields cut shorter are the
candidates, so that the choice costs one compilation.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.touch.neuron.fixed_channels import Firing, FixedChannels
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Discretisation, Scene

Array = NDArray[np.float64]

QUADRATURES: tuple[tuple[int, float], ...] = (
    (4, 6.0), (5, 6.5), (6, 7.0), (7, 8.0), (8, 9.0), (9, 10.0), (10, 10.5), (12, 12.0), (14, 13.0), (16, 14.5),
    (18, 16.0), (21, 18.0), (24, 20.0), (30, 24.0),
)  # fmt: skip
"""Nodes of the population integral and how far it follows the sigmoid, from cheap to good: either alone is wasted."""

TOLERANCES = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8)
"""Tolerances of the stress fields, from cheap to good."""

COARSEST = Discretisation(*QUADRATURES[0], TOLERANCES[0])
"""Where the choice begins."""

RATE_NODES = (18, 28)
"""Exact rates that the curve of held channels goes through."""

REFERENCE = (40, 30.0)
"""Quadrature that others are measured against: within 1e-10 of the peak response."""

RATES_SHARE = 0.2
"""Share of the bound that the curve of held channels may use up before it goes through more exact rates."""

FIRST_SHARE = 0.5
"""Share of the bound that the quadrature may use up; the fields get what it and the rates leave."""

MARGIN = 0.8
"""Share of the bound that the vectors measured may reach, for there are others."""

BEYOND = 0.01
"""Share of the vectors that is not counted for the error of the rate curves."""

CONDITIONS = 120
"""Conditions at which errors are measured; more are thinned evenly under each load."""


class Errors(NamedTuple):
    """Errors of a scene: one number, or one for each parameter vector."""

    peak: Array
    """Of the total rate, relative to the vector's largest."""
    log: Array
    """Of log(N/N_ref + eps)."""

    @property
    def largest(self) -> float:
        """The larger of the two, at the worst vector."""
        return float(max(self.peak.max(), self.log.max()))

    def worst(self) -> Errors:
        """Return each one's largest over the vectors."""
        return Errors(np.asarray(self.peak.max()), np.asarray(self.log.max()))

    def plus(self, other: Errors) -> Errors:
        """Return the sums."""
        return Errors(self.peak + other.peak, self.log + other.log)


class Tried(NamedTuple):
    """One setting of one stage, the others at their best."""

    stage: str
    discretisation: Discretisation
    errors: Errors


class Choice(NamedTuple):
    """The discretisation chosen, and what was measured of it."""

    accuracy: float
    """The bound."""
    discretisation: Discretisation
    mechanics: Errors
    """Of fields and population, largest over the vectors and conditions measured."""
    firing: Errors
    """Of the rate curves."""
    tried: tuple[Tried, ...]
    """What was measured on the way."""
    reference: Scene
    """What it was measured against."""

    @property
    def errors(self) -> Errors:
        """The sum, which stays under the bound."""
        return self.mechanics.plus(self.firing)


def errors(rate: Array, better: Array, n_receptors: float, eps: float | None) -> Errors:
    """Compare total rates with better ones, both of shape (vectors, conditions).

    Parameters
    ----------
    rate, better
        Total rates [spikes/s].
    n_receptors
        Receptors of the pad.
    eps
        What is added to N/N_ref in the logarithm [Hz]; without one, no logarithm is taken of it.

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


def references(accuracy: float) -> tuple[Discretisation, ...]:
    """Return what a scene is compiled with to choose by, each with more exact rates of a held curve than the last.

    Raises
    ------
    InputError
        If the accuracy is not between 0 and 1.
    """
    if not 0 < accuracy < 1:
        raise InputError(f"accuracy is {accuracy}, expected a bound of relative errors between 0 and 1")
    wanted = max(1e-2 * accuracy, TOLERANCES[-1]) * (1.0 + 1e-9)
    tolerance = max(t for t in TOLERANCES if t <= wanted)
    return tuple(Discretisation(*REFERENCE, tolerance, rate_nodes) for rate_nodes in RATE_NODES)


def choose(
    reference: Scene,
    parameters: TouchParameters,
    accuracy: float,
    eps: float | None,
    rates: Errors,
    least: Discretisation = COARSEST,
) -> Choice:
    """Return the cheapest discretisation whose errors at some parameter vectors stay under a bound.

    Parameters
    ----------
    reference
        The scene, compiled with one of `references`.
    parameters
        Where errors are measured, shape (vectors,).
    accuracy
        The bound, of both errors.
    eps
        As `errors` takes it.
    rates
        The error of the scene's rate curves.
    least
        A discretisation than which no stage is resolved more coarsely.

    Raises
    ------
    InputError
        If the scene cannot reach the bound; the message says what it can, and what would help.
    """
    best, few = reference.discretisation, thinned(reference)
    exact = few.total_rate(parameters)
    # two fields may share an error that their difference does not show
    lacking = Errors(*np.full((2,), few.field_error))
    room, tried = MARGIN * accuracy - rates.largest, list[Tried]()

    def measured(stage: str, d: Discretisation) -> float:
        found = errors(few.coarser(d).total_rate(parameters), exact, few.n_receptors, eps).worst().plus(lacking)
        tried.append(Tried(stage, d, found))
        return found.largest

    allowed = FIRST_SHARE * (room - few.field_error)
    # saturation alone leaves its exponential, and a field hardly less than its tolerance: those need no measurement
    promising = (q for q in QUADRATURES if q[0] >= least.nodes and (np.exp(-q[1]) <= allowed or q == QUADRATURES[-1]))
    for nodes, saturation in promising:
        over = measured("population", replace(best, nodes=nodes, saturation=saturation)) - few.field_error
        if over <= allowed:
            break
    coarsest = max(min(0.5 * room, least.field_tolerance), best.field_tolerance)
    for tolerance in (t for t in TOLERANCES if best.field_tolerance <= t <= coarsest):
        source = best.field_tolerance if tolerance > best.field_tolerance else None
        d = replace(best, nodes=nodes, saturation=saturation, field_tolerance=tolerance, field_source=source)
        if measured("field", d) <= room:
            return Choice(accuracy, d, tried[-1].errors, rates, tuple(tried), reference)
    raise _unreachable(accuracy, min(t.errors.largest for t in tried), rates, reference)


def held_rates(scene: Scene) -> Errors:
    """Return the error of the curve of held channels: relative to every rate, so no response has more.

    A curve that is an average over noise is what it is; how well it is known is reported with it.
    """
    firing = scene.firing
    relative = firing.curve.error.relative if isinstance(firing, FixedChannels) and not firing.noise else 0.0
    return Errors(np.array(relative), np.array(relative))


def sampled_rates(scene: Scene, firing: Firing, parameters: TouchParameters, eps: float | None) -> Errors:
    """Return what other rate curves, exact ones, change of a scene's response at some parameter vectors.

    It is what all but `BEYOND` of the vectors stay under: as alpha comes close to the rheobase a response, and with it
    what an error is relative to, goes to nothing.

    Parameters
    ----------
    scene
        The scene.
    firing
        The exact curves.
    parameters, eps
        As `choose` takes them.
    """
    few = thinned(scene)
    found = errors(few.total_rate(parameters), few.fired_by(firing).total_rate(parameters), few.n_receptors, eps)
    return Errors(*(np.asarray(np.quantile(error, 1.0 - BEYOND)) for error in found))


def thinned(scene: Scene) -> Scene:
    """Return a scene of at most `CONDITIONS` of the conditions, even in the modulus under each load, its ends kept."""
    if scene.n_conditions <= CONDITIONS:
        return scene
    loads = np.unique(scene.load)
    each = max(2, CONDITIONS // loads.size)
    kept = []
    for load in loads:
        under = np.flatnonzero(scene.load == load)
        under = under[np.argsort(scene.modulus[under])]
        kept.append(under[np.unique(np.linspace(0, under.size - 1, each).round().astype(int))])
    return scene.take(np.concatenate(kept))


def _unreachable(accuracy: float, mechanics: float, rates: Errors, scene: Scene) -> InputError:
    helps = []
    if rates.largest > 0.5 * MARGIN * accuracy:
        helps.append(
            f"the firing rates alone are good to {rates.largest:.1e}: hold c_Na, c_K, c_L and c_A (--fix), for which "
            "rates are exact"
        )
    if scene.field_error > 0.2 * accuracy:
        helps.append(f"its stress fields are good to {scene.field_error:.1e}: try another reading, or fewer loads")
    reached = (mechanics + rates.largest) / MARGIN
    return InputError(
        f"accuracy {accuracy:g} is out of this scene's reach: it can reach {_rounded_up(reached):.1e}"
        + "".join(f"; {help_}" for help_ in helps)
    )


def _rounded_up(value: float) -> float:
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / unit) * unit)
