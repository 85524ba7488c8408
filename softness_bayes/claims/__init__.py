"""Verdicts on the paper's claims under each reading of its equations, with their probabilities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np

from softness_bayes.claims.criteria import CLAIMS, Claim, ClaimVerdict
from softness_bayes.claims.numbers import Bench, Numbers
from softness_bayes.data import Fabrics, Ratings
from softness_bayes.errors import InputError
from softness_bayes.kinds import require_mapping
from softness_bayes.model.scenes import firing_of
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.declared import SHAPE_PARAMETERS
from softness_bayes.parameters.priors import Prior
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.ranges import PRIOR_DRAWS
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.neuron.fixed_channels import Firing
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS, Membrane
from softness_bayes.touch.readings import NAMED_READINGS, Readings

__all__ = [
    "CLAIMS",
    "CLOTH",
    "DRAWS",
    "PRIORS",
    "TOUCHES",
    "Claim",
    "ClaimFinding",
    "ClaimVerdict",
    "Numbers",
    "Trial",
    "evaluate_claims",
]

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
        return tuple(self._finding(claim) for claim in CLAIMS)

    def _finding(self, claim: Claim) -> ClaimFinding:
        (verdict,) = claim.verdicts(self.median, self.rated)
        drawn = claim.verdicts(self.draws, self.rated) if self.draws is not None else []
        tells = verdict in (ClaimVerdict.HOLDS, ClaimVerdict.FAILS)
        shares = {kind: drawn.count(kind) / len(drawn) for kind in ClaimVerdict} if drawn else {}
        return ClaimFinding(claim, verdict, claim.tell(self.median) if tells else "", shares)


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
    if freed := [name for name in PAPER_CHANNELS._fields if name in (priors or {})]:
        raise InputError(f"{', '.join(freed)}: channel multipliers are fixed here; give a value instead of a prior")
    if freed := [name for name in SHAPE_PARAMETERS if name in (priors or {})]:
        raise InputError(f"{', '.join(freed)}: claims are tested on one finger of known shape; omit the prior")
    held = {**PAPER_CHANNELS._asdict(), **(fix or {})}
    asked = TrialInputs(tuple(prior_sets), touches, fabrics, ratings, draws, seed, held, priors)
    # readings with the same membrane share its rates: the multipliers are the same under every prior set
    firing: dict[Membrane, Firing] = {}
    tasks = []
    for name, chosen in readings.items():
        if chosen.membrane not in firing:
            firing[chosen.membrane] = firing_of(_spaces(asked, chosen)[prior_sets[0]].held, chosen.membrane)
        tasks.append((name, chosen, firing[chosen.membrane]))
    with Workers(asked, 1, executor) as workers:
        return tuple(trial for some in workers.map(_judge, tasks) for trial in some)


class TrialInputs(NamedTuple):
    """Inputs shared by the trials under all readings."""

    prior_sets: tuple[str, ...]
    touches: Mapping[str, tuple[Load, ...]]
    fabrics: Fabrics
    ratings: Ratings | None
    draws: int
    seed: int
    held: Mapping[str, float]
    priors: Mapping[str, Prior] | None


def _spaces(asked: TrialInputs, readings: Readings) -> dict[str, ParameterSpace]:
    """Return the parameter space of each prior set under the given readings."""
    displacement = readings.skin_displacement
    return {of: parameter_space((), asked.held, asked.priors, of, displacement) for of in asked.prior_sets}


def _judge(asked: TrialInputs, name: str, readings: Readings, rates: Firing) -> list[Trial]:
    """Return the trials under one set of readings."""
    loads = asked.touches.items()
    benches = {control: Bench(readings, some, asked.fabrics, rates, asked.ratings) for control, some in loads}
    return list(_trials(name, _spaces(asked, readings), benches, asked.draws, asked.seed))


def _trials(
    readings: str, spaces: Mapping[str, ParameterSpace], benches: Mapping[str, Bench], draws: int, seed: int
) -> Iterator[Trial]:
    """Yield the trials under one set of readings, ordered by priors and then by kind of load."""
    for prior_set, space in spaces.items():
        drawn = space.draw_prior(np.random.default_rng(seed), draws)
        for control, bench in benches.items():
            median = bench.measure(space.touch(space.median[None]))
            some = bench.measure(space.touch(drawn)) if draws else None
            yield Trial(readings, prior_set, control, bench.loads, median, some, bench.rated)
