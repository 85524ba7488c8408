"""Verdicts on the paper's claims under each reading of its equations, with their probabilities (model.md 11)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import Prior
from softness_bayes.base.ranges import PRIOR_DRAWS, require_mapping
from softness_bayes.checking.inflection import LEAST_DROP
from softness_bayes.claims.numbers import ERROR, Bench, Numbers
from softness_bayes.data import Fabrics, Ratings
from softness_bayes.model.scenes import firing_of
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.declared import SHAPE_PARAMETERS
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS, Membrane
from softness_bayes.touch.neuron.rate_curve import Firing
from softness_bayes.touch.readings import NAMED_READINGS, Readings

Array = NDArray[np.float64]
Booleans = NDArray[np.bool_]

LEVEL = 0.01
"""Change over the last decade of E_fab, as a share of the maximum, below which the response has levelled off."""
TOUCHING_FORCE = 1.0
"""Mean force of a finger that judges a material [N]."""
APART = 1.1
"""Ratio above which two places of the maximum count as different."""
HARDLY = 0.1
"""Change, as a share of the maximum, that counts as negligible."""


class ClaimVerdict(StrEnum):
    """Verdict of the model on a claim."""

    HOLDS = "holds"
    FAILS = "fails"
    SILENT = "silent"
    """No receptor fires under any load, so that the claim cannot be tested."""
    UNTESTED = "not testable"
    """The claim is about ratings, and none were given."""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and its criterion; functions take `Numbers` of shape (draws, loads)."""

    name: str
    statement: str
    criterion: str
    judged: str
    """Field of `Numbers` that is a number for the draws and loads with a response to judge."""
    holds: Callable[[Numbers, Booleans], Booleans]
    """Test of the claim for each draw, from the loads that can be evaluated, shape (draws,)."""
    tell: Callable[[Numbers], str]
    """The numbers behind the verdict on one draw, load by load."""
    of_ratings: bool = False

    def verdicts(self, numbers: Numbers, rated: bool = False) -> list[ClaimVerdict]:
        """Return the verdict on each draw; `rated` is true if there are ratings."""
        if self.of_ratings and not rated:
            return [ClaimVerdict.UNTESTED] * len(numbers.largest)
        speaks = np.isfinite(getattr(numbers, self.judged))
        told = np.where(self.holds(numbers, speaks), ClaimVerdict.HOLDS, ClaimVerdict.FAILS)
        return [ClaimVerdict(name) for name in np.where(speaks.any(axis=-1), told, ClaimVerdict.SILENT).tolist()]


def _clear(numbers: Numbers) -> Booleans:
    # no receptor fires at the soft end, so that a maximum with this drop to the stiff end exceeds both ends by it
    return np.asarray(numbers.interior & (numbers.drop >= LEAST_DROP))


def _place_depends_on_load(numbers: Numbers, speaks: Booleans) -> Booleans:
    clear = _clear(numbers)
    different = clear.sum(axis=-1) > 1
    for place in (numbers.modulus, numbers.ratio):
        # missing positions (NaN) sort last, and their differences are NaN
        gaps = np.diff(np.sort(np.where(clear, np.log(place), np.nan), axis=-1), axis=-1)
        different &= ((gaps > np.log(APART)) | np.isnan(gaps)).all(axis=-1)
    return np.asarray(different)


def _every(test: Callable[[Numbers], Booleans]) -> Callable[[Numbers, Booleans], Booleans]:
    """Return the criterion that a test passes under every load for which it can be evaluated."""
    return lambda numbers, speaks: np.asarray((test(numbers) | ~speaks).all(axis=-1))


def _listing(values: Array, style: str, unit: str = "", marks: Booleans | None = None) -> str:
    """Return the values of the loads as text: – for a missing value, † after a marked one.

    Without a style they have two significant digits, or all their integer digits if there are more.
    """
    texts = []
    for value, mark in zip(values, np.zeros(values.shape, bool) if marks is None else marks, strict=True):
        digits = 2 if abs(value) < 100 else len(f"{abs(value):.0f}")
        plain = f"{value:{style}}" if style else np.format_float_positional(value, digits, fractional=False, trim="-")
        texts.append(plain + "†" * bool(mark) if np.isfinite(value) else "–")
    return ", ".join(texts) + unit


def _wide(numbers: Numbers) -> Booleans:
    # a contact radius of exactly half the finger's does not exceed it
    return np.asarray(numbers.interior[0] & (numbers.radius[0] > 0.5 * (1 + 1e-9)))


def _tell_drop(numbers: Numbers) -> str:
    return "drop " + _listing(100 * numbers.drop[0], ".1f", " %", _wide(numbers))


def _tell_place(numbers: Numbers) -> str:
    clear = _clear(numbers)[0]
    if not clear.any():
        return "no turning point"
    modulus, ratio = (np.where(clear, place[0], np.nan) for place in (numbers.modulus, numbers.ratio))
    return f"{_listing(1e-3 * modulus, '', ' kPa', _wide(numbers))}; ratio {_listing(ratio, '')}"


CLAIMS = (
    Claim(
        "turn",
        "The response rises with E_fab, falls again and levels off",
        f"under at least one load an interior maximum, a drop of at least {100 * LEAST_DROP:g} % by 1 GPa, "
        f"and a change below {100 * LEVEL:g} % over the last decade",
        "drop",
        lambda numbers, speaks: np.asarray((_clear(numbers) & (numbers.levelling < LEVEL)).any(axis=-1)),
        _tell_drop,
    ),
    Claim(
        "threshold",
        "The turn is clear only beyond the mean touching force",
        f"a drop of at least {100 * LEAST_DROP:g} % under every load with {TOUCHING_FORCE:g} N or more at the maximum, "
        "and under no other",
        "drop",
        lambda numbers, speaks: np.asarray(
            (((numbers.force >= TOUCHING_FORCE) == _clear(numbers)) | ~speaks).all(axis=-1)
            & _clear(numbers).any(axis=-1)
        ),
        lambda numbers: f"{_tell_drop(numbers)} at {_listing(numbers.force[0], '', ' N')}",
    ),
    Claim(
        "place",
        "Where the response turns depends on the load, in E_fab and in E_fab/E_skin",
        f"at least two loads with a maximum and a drop of at least {100 * LEAST_DROP:g} % by 1 GPa, these maxima all "
        f"more than {100 * (APART - 1):.0f} % apart on both axes",
        "drop",
        _place_depends_on_load,
        _tell_place,
    ),
    Claim(
        "centre",
        "The response grows as the centre of contact moves from distal to proximal",
        "under every load the fabric set's mean response never falls from 0 to 30 mm",
        "growth",
        _every(lambda numbers: np.asarray((numbers.growth > 0) & (numbers.setback <= 3.0 * ERROR))),
        lambda numbers: (
            f"{_listing(100 * numbers.growth[0], '+.0f', ' %')}; most at "
            f"{_listing(1e3 * numbers.best_centre[0], '.0f', ' mm')}"
        ),
    ),
    Claim(
        "depth",
        "Receptor depths from 0.5 to 0.9 mm hardly differ",
        f"under every load at most {100 * HARDLY:g} % of the maximum between them, at any E_fab",
        "depth_spread",
        _every(lambda numbers: numbers.depth_spread <= HARDLY),
        lambda numbers: _listing(100 * numbers.depth_spread[0], ".0f", " %"),
    ),
    Claim(
        "linear",
        "Softness is linear in the response",
        "under every load a slope between mean standardised rating and response that differs from 0 at the 5 % level",
        "slope",
        _every(lambda numbers: numbers.slope >= numbers.slope_needed),
        lambda numbers: "slope " + _listing(numbers.slope[0], "+.2f"),
        of_ratings=True,
    ),
    Claim(
        "correlation",
        "Response and E_fab correlate negatively over the fabric set",
        "a negative correlation under every load",
        "correlation",
        _every(lambda numbers: numbers.correlation < 0),
        lambda numbers: "r " + _listing(numbers.correlation[0], "+.2f"),
    ),
)
"""Every claim, in the order of tables."""

CLOTH = Fabrics(
    tuple(f"cloth {k}" for k in range(1, 13)), effective_modulus=np.geomspace(1.1e3, 110e3, 12), source="real cloth"
)
"""The usual fabric set: twelve moduli, even in the logarithm, from the 5 to the 95 % quantile of 618 real fabrics."""

TOUCHES: Mapping[str, tuple[Load, ...]] = {
    "indentation": tuple(Indentation(depth) for depth in (1e-3, 1.5e-3, 2e-3, 3e-3)),
    "force": tuple(Force(newton) for newton in (0.5, 1.0, 2.0, 4.0)),
}
"""The usual loads, by what is held."""

PRIORS = ("default", "in-vivo")
"""The usual prior sets: of the paper's forces, and of real fingerpads."""

DRAWS = 200
"""Usual number of prior draws, which gives probabilities to three or four per cent."""


class ClaimFinding(NamedTuple):
    """The verdict on one claim in one trial."""

    claim: Claim
    verdict: ClaimVerdict
    """At the priors' medians."""
    numbers: str
    """The numbers behind it, load by load."""
    shares: Mapping[ClaimVerdict, float]
    """Probability of each verdict over draws of the prior; empty without draws."""


class Trial(NamedTuple):
    """All claims under one set of readings, one prior set and one kind of load."""

    readings: str
    prior_set: str
    control: str
    loads: tuple[Load, ...]
    median: Numbers
    """At the priors' medians, shape (1, loads)."""
    draws: Numbers | None
    """Over draws of the prior, shape (draws, loads)."""
    rated: bool

    @property
    def findings(self) -> tuple[ClaimFinding, ...]:
        """The verdicts on all claims."""
        found = []
        for claim in CLAIMS:
            (verdict,) = claim.verdicts(self.median, self.rated)
            drawn = claim.verdicts(self.draws, self.rated) if self.draws is not None else []
            shares = {kind: drawn.count(kind) / len(drawn) for kind in ClaimVerdict} if drawn else {}
            decided = verdict in (ClaimVerdict.HOLDS, ClaimVerdict.FAILS)
            found.append(ClaimFinding(claim, verdict, claim.tell(self.median) if decided else "", shares))
        return tuple(found)


def evaluate_claims(
    readings: Mapping[str, Readings] = NAMED_READINGS,
    prior_sets: Sequence[str] = PRIORS,
    touches: Mapping[str, tuple[Load, ...]] = TOUCHES,
    fabrics: Fabrics = CLOTH,
    ratings: Ratings | None = None,
    draws: int = DRAWS,
    seed: int = 0,
    fix: Mapping[str, float] | None = None,
    priors: Mapping[str, Prior] | None = None,
    executor: Executor | None = None,
) -> tuple[Trial, ...]:
    """Judge the paper's claims at the priors' medians and over draws of the priors.

    Parameters
    ----------
    readings
        Sets of readings by name.
    prior_sets
        Names of `parameters.declared.PRIOR_SETS`.
    touches
        Loads by the quantity that is controlled (force or indentation): claims compare loads of one kind.
    fabrics
        Fabric set of the claims about the centre of contact and about correlation.
    ratings
        Ratings of these fabrics; without them the claim about ratings is not testable.
    draws
        Number of draws from each prior; 0 evaluates the medians alone.
    seed
        Seed of the draws, which are the same under all readings and loads.
    fix, priors
        As for `parameter_space`; channel multipliers are fixed.
    executor
        Executor that evaluates each set of readings as one task; by default all run in this process.

    Returns
    -------
    tuple of Trial
        Ordered by readings, then priors, then kind of load.

    Raises
    ------
    InputError
        If a prior set or parameter does not exist, a channel multiplier is freed, a rated fabric is not in the set,
        or there is nothing to evaluate.
    """
    require_mapping("readings", readings, "NAMED_READINGS")
    require_mapping("touches", touches, "{'force': (Force(1.0),)}")
    if not (readings and prior_sets and touches):
        raise InputError("claims: expected at least one set of readings, prior set and load")
    PRIOR_DRAWS.require("claims: number of draws", draws)
    for names, why in (
        (PAPER_CHANNELS._fields, "channel multipliers are fixed here; give a value instead of a prior"),
        (SHAPE_PARAMETERS, "claims are tested on one finger of known shape; omit the prior"),
    ):
        if freed := [name for name in names if name in (priors or {})]:
            raise InputError(f"{', '.join(freed)}: {why}")
    held = {**PAPER_CHANNELS._asdict(), **(fix or {})}
    asked = tuple(prior_sets), touches, fabrics, ratings, draws, seed, held, priors
    # readings with the same membrane share its rates: the multipliers are the same under every prior set
    firing: dict[Membrane, Firing] = {}
    tasks = []
    for name, chosen in readings.items():
        if chosen.membrane not in firing:
            space = parameter_space(held, priors, prior_sets[0], chosen.skin_displacement)
            firing[chosen.membrane] = firing_of(space.held, chosen.membrane)
        tasks.append((name, chosen, firing[chosen.membrane]))
    with Workers(asked, 1, executor) as workers:
        return tuple(trial for some in workers.map(_judge, tasks) for trial in some)


def _judge(asked: tuple[Any, ...], name: str, readings: Readings, rates: Firing) -> list[Trial]:
    """Return the trials under one set of readings, ordered by priors and then by kind of load.

    The same was asked of all: prior sets, touches, fabrics, ratings, draws, seed, fixed values and priors.
    """
    prior_sets, touches, fabrics, ratings, draws, seed, held, priors = asked
    benches = {control: Bench(readings, loads, fabrics, rates, ratings) for control, loads in touches.items()}
    trials = []
    for prior_set in prior_sets:
        space = parameter_space(held, priors, prior_set, readings.skin_displacement)
        drawn = space.draw_prior(np.random.default_rng(seed), draws)
        for control, bench in benches.items():
            median = bench.measure(space.touch(space.median[None]))
            some = bench.measure(space.touch(drawn)) if draws else None
            trials.append(Trial(name, prior_set, control, bench.loads, median, some, bench.rated))
    return trials
