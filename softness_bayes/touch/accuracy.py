"""Choice of a scene's resolution: the cheapest setting of each stage whose measured error stays under a bound.

Two errors are measured: that of the total rate, relative to the largest rate of the parameter vector, and that of
log(N/N_ref + eps), which enters a likelihood of log ratings. The reference is the same scene at the same parameter
vectors, with stress fields a hundred times more accurate and a much finer quadrature. Candidates use truncated versions
of its fields, so that the choice requires only one compilation.
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
    (3, 4.0), (4, 5.5), (5, 7.0), (6, 8.0), (7, 8.5), (8, 9.5), (9, 10.5), (10, 11.0), (11, 12.0), (12, 12.5),
    (14, 14.0), (16, 15.5), (20, 19.0), (24, 22.0),
)  # fmt: skip
"""Nodes of the population integral and its extent along the sigmoid, from cheap to accurate. For each number of nodes
the extent has the least of the errors measured under indentations of 1 to 3 mm and forces of 0.1 to 2 N; both errors
shrink together, because refining one of them alone gains nothing."""

TOLERANCES = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8)
"""Tolerances of the stress fields, from cheap to accurate."""

RATE_TERMS = (8, 10, 12, 14, 16, 18, 20)
"""Numbers of terms of the rate curves, from cheap to accurate; all terms are left if none of these is sufficient."""

COARSEST = Discretisation(*QUADRATURES[0], TOLERANCES[0], rate_terms=RATE_TERMS[0])
"""The coarsest candidate."""

RATE_NODES = (18, 28)
"""Numbers of exact rates interpolated by the curve of fixed channels, first and second attempt."""

BEYOND_SATURATION = 0.002
"""Least error that a saturation leaves, relative to the exponential of its extent."""

REFERENCE = (40, 24.0)
"""Reference quadrature: within 1e-10 of the peak response."""

FIELD_SHARE = 1e-3
"""Tolerance of the reference's stress fields as a share of the accuracy. A scene whose fields have a tenth of the
accuracy is then refined (`Scene.refined`) without finer ones."""

RATES_SHARE = 0.2
"""Share of the bound that the error of a fixed-channel curve may use before more exact rates are added."""

SHORTER_SHARE = 0.2
"""Share of the bound that fewer terms of the rate curves may use."""

FIRST_SHARE = 0.3
"""Share of the bound that the quadrature error may use; the fields may use the remainder."""

MARGIN = 0.8
"""Share of the bound allowed at the measured vectors, because other vectors may have larger errors."""

BEYOND = 0.01
"""Share of the vectors with the largest errors that is excluded from the error of the rate curves."""

CONDITIONS = 120
"""Largest number of conditions at which errors are measured; more are thinned evenly, by fabric and then by load."""


class Errors(NamedTuple):
    """Errors of a scene: one number, or one for each parameter vector."""

    peak: Array
    """Error of the total rate, relative to the largest rate of the vector."""
    log: Array
    """Error of log(N/N_ref + eps)."""

    @property
    def largest(self) -> float:
        """Larger of the two errors, at the worst vector."""
        return float(max(self.peak.max(), self.log.max()))

    def worst(self) -> Errors:
        """Return the maximum of each error over the vectors."""
        return Errors(np.asarray(self.peak.max()), np.asarray(self.log.max()))

    def plus(self, other: Errors) -> Errors:
        """Return the sums of both errors."""
        return Errors(self.peak + other.peak, self.log + other.log)


class Tried(NamedTuple):
    """One setting of one stage, with the other stages at their most accurate."""

    stage: str
    discretisation: Discretisation
    errors: Errors


class ChosenResolution(NamedTuple):
    """The chosen discretisation with its measured errors."""

    accuracy: float
    """The bound."""
    discretisation: Discretisation
    mechanics: Errors
    """Errors of fields and population, maximum over the measured vectors and conditions."""
    firing: Errors
    """Errors of the rate curves, with the terms that are left out."""
    tried: tuple[Tried, ...]
    """The candidates and their errors."""
    reference: Scene
    """Reference scene for the errors."""

    @property
    def errors(self) -> Errors:
        """Sum of both errors, which is below the bound."""
        return self.mechanics.plus(self.firing)


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


def references(accuracy: float) -> tuple[Discretisation, ...]:
    """Return the resolutions of reference scenes, with increasing numbers of exact rates for a fixed-channel curve.

    Raises
    ------
    InputError
        If the accuracy is not between 0 and 1.
    """
    if not 0 < accuracy < 1:
        raise InputError(f"accuracy is {accuracy}, expected a bound of relative errors between 0 and 1")
    wanted = max(FIELD_SHARE * accuracy, TOLERANCES[-1]) * (1.0 + 1e-9)
    tolerance = max(t for t in TOLERANCES if t <= wanted)
    return tuple(Discretisation(*REFERENCE, tolerance, rate_nodes) for rate_nodes in RATE_NODES)


def choose(
    reference: Scene,
    parameters: TouchParameters,
    accuracy: float,
    eps: float | None,
    rates: Errors,
    least: Discretisation = COARSEST,
) -> ChosenResolution:
    """Return the cheapest discretisation whose errors at some parameter vectors stay under a bound.

    Parameters
    ----------
    reference
        The scene, compiled with one of `references`.
    parameters
        Parameter vectors at which errors are measured, shape (vectors,).
    accuracy
        The bound, of both errors.
    eps
        As for `errors`.
    rates
        The error of the scene's rate curves.
    least
        The coarsest resolution allowed for any stage.

    Raises
    ------
    InputError
        If the scene cannot reach the bound; the message says which accuracy it reaches, and what would help.
    """
    best, few = reference.discretisation, thinned(reference)
    exact = few.total_rate(parameters)
    # the two fields may have a common error that their difference does not show
    lacking = Errors(*np.full((2,), few.field_error))
    tried = list[Tried]()

    def measured(stage: str, d: Discretisation) -> float:
        found = errors(few.coarser(d).total_rate(parameters), exact, few.n_receptors, eps)
        found = (_usual(found) if stage == "firing rates" else found.worst()).plus(lacking)
        tried.append(Tried(stage, d, found))
        return found.largest

    terms = None
    for fewer in () if least.rate_terms is None else RATE_TERMS:
        over = measured("firing rates", replace(best, rate_terms=fewer)) - few.field_error
        if over <= SHORTER_SHARE * accuracy:
            terms, rates = fewer, rates.plus(Errors(*np.full((2,), over)))
            break
    room = MARGIN * accuracy - rates.largest
    allowed = FIRST_SHARE * (room - few.field_error)
    # truncation at a saturation costs a share of its exponential, a field about its tolerance: settings beyond the
    # bound are skipped
    left = {q: BEYOND_SATURATION * np.exp(-q[1]) for q in QUADRATURES}
    promising = (q for q in QUADRATURES if q[0] >= least.nodes and (left[q] <= allowed or q == QUADRATURES[-1]))
    for nodes, saturation in promising:
        over = measured("population", replace(best, nodes=nodes, saturation=saturation)) - few.field_error
        if over <= allowed:
            break
    coarsest = max(min(0.5 * room, least.field_tolerance), best.field_tolerance)
    for tolerance in (t for t in TOLERANCES if best.field_tolerance <= t <= coarsest):
        source = best.field_tolerance if tolerance > best.field_tolerance else None
        d = replace(best, nodes=nodes, saturation=saturation, field_tolerance=tolerance, field_source=source)
        if measured("field", d) <= room:
            d = replace(d, rate_terms=terms)
            return ChosenResolution(accuracy, d, tried[-1].errors, rates, tuple(tried), reference)
    raise _unreachable(accuracy, min(t.errors.largest for t in tried), rates, reference)


def held_rates(scene: Scene) -> Errors:
    """Return the error of the fixed-channel curve, relative to the rate: an upper bound for the response.

    The error is 0 for an average over noise, whose Monte-Carlo error is reported separately.
    """
    firing = scene.firing
    relative = firing.curve.error.relative if isinstance(firing, FixedChannels) and not firing.noise else 0.0
    return Errors(np.array(relative), np.array(relative))


def sampled_rates(scene: Scene, firing: Firing, parameters: TouchParameters, eps: float | None) -> Errors:
    """Return the change of a scene's response at some parameter vectors when exact rate curves are used.

    The result is the one exceeded by a share `BEYOND` of the vectors.

    Parameters
    ----------
    scene
        The scene.
    firing
        The exact curves.
    parameters, eps
        As for `choose`.
    """
    few = thinned(scene)
    return _usual(errors(few.total_rate(parameters), few.fired_by(firing).total_rate(parameters), few.n_receptors, eps))


def _usual(found: Errors) -> Errors:
    """Return the quantile of errors of the rates that a share `BEYOND` of the vectors exceeds.

    As alpha approaches the rheobase, the response vanishes and relative errors become meaningless.
    """
    return Errors(*(np.asarray(np.quantile(error, 1.0 - BEYOND)) for error in found))


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


def _unreachable(accuracy: float, mechanics: float, rates: Errors, scene: Scene) -> InputError:
    helps = []
    if rates.largest > 0.5 * MARGIN * accuracy:
        helps.append(
            f"the error of the firing rates alone is {rates.largest:.1e}: fix c_Na, c_K, c_L and c_A (--fix), "
            "which makes rates exact"
        )
    if scene.field_error > 0.2 * accuracy:
        helps.append(f"the error of its stress fields is {scene.field_error:.1e}: try another reading, or fewer loads")
    reached = (mechanics + rates.largest) / MARGIN
    return InputError(
        f"accuracy {accuracy:g} cannot be reached for these fabrics and loads; the smallest possible is "
        f"{_rounded_up(reached):.1e}" + "".join(f"; {help_}" for help_ in helps)
    )


def _rounded_up(value: float) -> float:
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / unit) * unit)
