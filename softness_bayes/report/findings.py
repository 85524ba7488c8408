"""Findings of the verdict on a run: values from its result, and the outcome derived from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.arviz_bridge import SAMPLE_DIMS
from softness_bayes.checking.check_table import doubts
from softness_bayes.checking.exactness import Exactness, compare_likelihoods
from softness_bayes.checking.levelled import DOUBTFUL
from softness_bayes.checking.misfit import Fit, fit_of
from softness_bayes.checking.modulus_errors import MovedMost, moved_most
from softness_bayes.checking.reproduction import Reproduction, inflection_reproduced
from softness_bayes.checking.sensitivity import INFORMED
from softness_bayes.files.run_files import MODULUS_ERRORS
from softness_bayes.results.result import Result

if TYPE_CHECKING:
    import pandas as pd

MATTERS = 0.5
"""Shift of a posterior mean, in posterior standard deviations, from which errors of 10 % of the moduli matter: 90 %
intervals that are off by as much hold the truth in 86 %."""

MOSTLY = 0.5
"""Share of the differences between fabrics from which the response is said to explain them."""


class Standing(Enum):
    """Consequence of a finding for the conclusions; the value is its style."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    BAD = "bad"
    NEUTRAL = "neutral"
    """For information, or because the data cannot tell."""


class Doubt(Enum):
    """Reason why a finding that is good by itself is unreliable."""

    NOT_CONVERGED = 1
    MODEL_FAILED = 2
    """The model does not follow the ratings."""


@dataclass(frozen=True, kw_only=True)
class Finding(ABC):
    """One finding of the verdict.

    Parameters
    ----------
    doubt
        Another finding of the run that puts it in doubt, if there is one.
    """

    doubt: Doubt | None = None

    @property
    @abstractmethod
    def outcome(self) -> Standing:
        """Standing according to its own values."""

    @property
    def shaken(self) -> bool:
        """True if the finding would be good without its doubt."""
        return self.outcome is Standing.GOOD and self.doubt is not None

    @property
    def standing(self) -> Standing:
        """Consequence for the conclusions; no finding of a doubtful run is good."""
        return Standing.DOUBTFUL if self.shaken else self.outcome


@dataclass(frozen=True)
class Convergence(Finding):
    """Convergence of the sampler."""

    converged: bool
    verdict: str
    """The run's own sentence, with the numbers behind it."""

    @property
    def outcome(self) -> Standing:
        """Good if converged, else bad."""
        return Standing.GOOD if self.converged else Standing.BAD


@dataclass(frozen=True)
class Agreement(Finding):
    """Agreement of the model with the ratings, without which no other finding counts."""

    fit: Fit

    @property
    def outcome(self) -> Standing:
        """Bad if the model runs against the ratings or is flat; else by the share that the response explains."""
        if self.fit.direction.against_data or self.fit.flat:
            return Standing.BAD
        whole = self.fit.explained[-1] if self.fit.explained else None
        if whole is None or not whole.p_value < DOUBTFUL:
            return Standing.NEUTRAL
        return Standing.GOOD if whole.share >= MOSTLY else Standing.DOUBTFUL


@dataclass(frozen=True)
class FastModel(Finding):
    """Effect of the fast forward model on the posterior."""

    exactness: Exactness
    sentence: str
    """The run's own sentence."""
    numerical_error: float
    firing_error: float
    """Errors of the response, from the integration and from the firing rates, relative to its peak."""
    reweighted: bool
    """True if the result uses draws weighted by the exact likelihood."""

    @property
    def outcome(self) -> Standing:
        """Good if exact enough, else bad; for information where it was not checked."""
        if not self.exactness.checked:
            return Standing.NEUTRAL
        return Standing.GOOD if self.exactness.exact_enough else Standing.BAD


@dataclass(frozen=True)
class TurningPoints(Finding):
    """Reproduction of the turning point under each load."""

    judged: tuple[Reproduction, ...]
    table: pd.DataFrame
    """Probabilities of a turning point, as `Result.inflection` returns them."""

    def loads(self, reproduced: bool | None) -> tuple[str, ...]:
        """Return the loads under which it is reproduced, is not, or cannot be told (None)."""
        return tuple(one.load for one in self.judged if one.reproduced is reproduced)

    @property
    def outcome(self) -> Standing:
        """Bad if it is not reproduced under one load; else good if it is under one."""
        if self.loads(False):
            return Standing.BAD
        return Standing.GOOD if self.loads(True) else Standing.NEUTRAL


@dataclass(frozen=True)
class OtherChecks(Finding):
    """Reproduction of all other test quantities."""

    unreproduced: tuple[str, ...]
    """Quantities that the model does not reproduce."""
    remarks: tuple[str, ...]
    """Sentences of the checks of residuals."""

    @property
    def outcome(self) -> Standing:
        """Good if every quantity is reproduced."""
        return Standing.DOUBTFUL if self.unreproduced else Standing.GOOD


@dataclass(frozen=True)
class InputErrors(Finding):
    """Dependence of the conclusions on errors of the fabrics' moduli, and whether loads were taken as exact."""

    assumed: bool
    """True if moduli were taken as exact without having been declared exact."""
    p_value: float
    """p-value of the check whether mean ratings deviate in the way that wrong moduli would cause."""
    largest: MovedMost | None
    """The quantity that errors of the moduli would shift most; None if no shift exceeds its Monte-Carlo error."""
    remarks: tuple[str, ...]
    """The run's own sentences about errors of moduli and loads."""

    @property
    def sensitive(self) -> bool:
        """True if moduli were assumed to be exact and usual errors would change conclusions."""
        return self.assumed and self.largest is not None and self.largest.shift >= MATTERS

    @property
    def outcome(self) -> Standing:
        """Good if the ratings show no errors, and conclusions do not rest on the assumption that there are none."""
        return Standing.DOUBTFUL if self.sensitive or self.p_value < DOUBTFUL else Standing.GOOD


@dataclass(frozen=True)
class Information(Finding):
    """Parameters that the data informed."""

    summary: pd.DataFrame
    remarks: tuple[str, ...] = ()
    """Further sentences of the run."""

    @property
    def informed(self) -> int:
        """Number of parameters whose posterior is clearly narrower than the prior."""
        return int((self.summary["contraction"] >= 1.0 - INFORMED**2).sum())

    @property
    def outcome(self) -> Standing:
        """For information."""
        return Standing.NEUTRAL


@dataclass(frozen=True)
class PlateForces(Finding):
    """Growth of forces with indentation under the fitted skin."""

    exponent: float
    """Exponent of the measured forces; NaN where they do not determine it."""
    p_value: float
    sentence: str
    """The run's own sentence."""

    @property
    def outcome(self) -> Standing:
        """By the predictive p-value, if there is one."""
        if not np.isfinite(self.exponent):
            return Standing.NEUTRAL
        return Standing.GOOD if self.p_value >= DOUBTFUL else Standing.BAD


@dataclass(frozen=True)
class NeedsRatings(Finding):
    """A question that a run without ratings does not answer."""

    of: type[Finding]
    """The finding that answers it for a run on ratings."""

    @property
    def outcome(self) -> Standing:
        """For information."""
        return Standing.NEUTRAL


def findings(result: Result) -> list[Finding]:
    """Return the findings, most decisive first; none is good without convergence or after a failed fit."""
    convergence = _convergence(result)
    rest = [*(_of_ratings(result) if result.has_ratings else _without_ratings()), _information(result)]
    rest += [_plate(result)] if result.has_compression else []
    if not convergence.converged:
        rest = [_doubted(finding, Doubt.NOT_CONVERGED) for finding in rest]
    if not result.has_ratings:
        return [convergence, *rest]
    follows: Finding = Agreement(fit_of(result.tree))
    if not convergence.converged:
        follows = _doubted(follows, Doubt.NOT_CONVERGED)
    if follows.standing is Standing.BAD:
        return [follows, *(_doubted(finding, Doubt.MODEL_FAILED) for finding in (convergence, *rest))]
    return [convergence, rest[0], follows, *rest[1:]]


def exactness_of(result: Result) -> Exactness:
    """Return the comparison with exact firing rates, from the differences that the result keeps."""
    stats, draws = result.group("sample_stats"), result.group("posterior")
    difference = stats["exact_difference"].values
    compared = np.isfinite(difference)
    sampled = result.group("log_prior").items()
    names = tuple(str(name) for name, density in sampled if density.dims == SAMPLE_DIMS)
    theta = np.stack([draws[name].values[compared] for name in names], axis=-1)
    return compare_likelihoods(names, theta, np.zeros(int(compared.sum())), difference[compared])


def input_errors_of(result: Result) -> InputErrors | None:
    """Return what errors of the moduli would do; None for a result of an earlier version, which did not ask."""
    residuals = result.provenance.residuals
    if not residuals.modulus_check:
        return None
    table = result.tables.get(MODULUS_ERRORS)
    largest = None if table is None else moved_most(table)
    return InputErrors(
        result.moduli_assumed, residuals.modulus_p_value, largest, (*result.said_of_moduli(), result.said_of_loads())
    )


def _doubted(finding: Finding, why: Doubt) -> Finding:
    """Put a finding in doubt; the first doubt stays."""
    return finding if finding.doubt is not None else replace(finding, doubt=why)


def _convergence(result: Result) -> Convergence:
    ending = result.provenance.ending
    return Convergence(ending.converged, ending.verdict)


def _of_ratings(result: Result) -> list[Finding]:
    errors, residuals, checks = (
        result.provenance.errors,
        result.provenance.residuals,
        result.tables["predictive_checks"],
    )
    return [
        FastModel(
            exactness_of(result),
            errors.exactness,
            errors.numerical_error,
            errors.firing_error,
            errors.exact_reweight,
        ),
        _turning_points(result),
        OtherChecks(tuple(doubts(checks)), residuals.sentences),
        *([] if (inputs := input_errors_of(result)) is None else [inputs]),
    ]


def _turning_points(result: Result) -> TurningPoints:
    judged, table = inflection_reproduced(result.tables["predictive_checks"]), result.inflection()
    # earlier versions judged each of many loads alone
    return TurningPoints(tuple(one for one in judged if one.load in table.index), table)


def _without_ratings() -> list[Finding]:
    return [NeedsRatings(FastModel), NeedsRatings(TurningPoints)]


def _information(result: Result) -> Information:
    held = result.provenance.held_eps
    return Information(result.summary(), (held,) if held else ())


def _plate(result: Result) -> PlateForces:
    plate = result.provenance.plate
    return PlateForces(plate.force_exponent, plate.force_p_value, plate.force_check)
