"""Cards of a report: each a question about the run, its answer, what that means for the conclusions, and details."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from softness_bayes.base.defaults import in_words, shown_of
from softness_bayes.base.files.run_files import MODULUS_ERRORS, RULER
from softness_bayes.base.readable import number, sentence, with_error
from softness_bayes.checking.check_table import doubts
from softness_bayes.checking.checks import ALONG, LEVEL
from softness_bayes.checking.identifiability import INFORMED
from softness_bayes.checking.modulus_errors import MovedMost, moved_most
from softness_bayes.checking.provenance import NumericalErrors, PlateData
from softness_bayes.checking.quantities import Reproduction, turns_reproduced
from softness_bayes.checking.sentences import (
    information_sentences,
    plate_sentence,
    recorded_faults,
    residual_sentences,
    turn_sentence,
    unreproduced_sentence,
)
from softness_bayes.people.ruler import Fit
from softness_bayes.people.sentences import fit_faults, ruler_sentence, silence_note, untestable_sentence
from softness_bayes.results.result import Result

if TYPE_CHECKING:
    import pandas as pd

MATTERS = 0.5
"""Shift of a posterior mean, in posterior standard deviations, from which errors of 10 % of the moduli matter: 90 %
intervals that are off by as much hold the truth in 86 %."""

NOT_CONVERGED = "The chains have not converged: this is for inspection only."
MODEL_FAILED = "The model does not follow these ratings: see the first finding."
"""Reasons why an otherwise favourable finding is unreliable."""

FAST_MODEL = "Is the fast model accurate enough?"
TURNING = "Does the model reproduce the turning point (maximum), where the ratings can show it?"


class Standing(Enum):
    """Consequence of a finding for the conclusions, in words; the name is its style on the page."""

    GOOD = "good"
    DOUBTFUL = "with doubt"
    BAD = "bad"
    NEUTRAL = "for information"
    """No consequence, or the data cannot tell."""


class Card(NamedTuple):
    """A finding in the form shown on the page."""

    question: str
    answer: str
    standing: Standing
    details: Sequence[str] = ()

    def doubted(self, why: str) -> Card:
        """Return the card of a run that is in doubt for some reason: none of its findings is good."""
        if self.standing is not Standing.GOOD:
            return self
        return self._replace(standing=Standing.DOUBTFUL, details=[*self.details, why])


def cards(result: Result) -> list[Card]:
    """Return the cards of a run, most decisive first; none is good without convergence or after a failed fit."""
    provenance = result.provenance
    convergence = convergence_card(provenance.ending.converged, provenance.ending.verdict)
    follows: list[Card] = []
    if result.has_ratings:
        checks = result.tables["predictive_checks"]
        ruler = ruler_sentence(result.tables[RULER], result.scale) if RULER in result.tables else ""  # a custom scale
        follows = [agreement_card(result.fit, ruler)]
        rest = [
            fast_model_card(provenance.errors),
            turning_card(turns_reproduced(checks), result.inflection()),
            checks_card(doubts(checks), residual_sentences(provenance.findings, doubts(checks))),
            input_card(input_errors_of(result)),
        ]
    else:
        nothing = "Does not apply", Standing.NEUTRAL, ["The run has no ratings."]
        rest = [Card(FAST_MODEL, *nothing), Card(TURNING, *nothing)]
    rest.append(information_card(result.summary(), [*filter(None, [provenance.held_eps])]))
    rest += [plate_card(provenance.plate)] if result.has_compression else []
    rest += [recorded_card(result)] if result.has_afferents else []
    if not provenance.ending.converged:
        rest, follows = ([card.doubted(NOT_CONVERGED) for card in some] for some in (rest, follows))
    if follows and follows[0].standing is Standing.BAD:
        return [*follows, *(card.doubted(MODEL_FAILED) for card in (convergence, *rest))]
    return [convergence, *rest[:1], *follows, *rest[1:]]


def convergence_card(converged: bool, verdict: str) -> Card:
    """Return the card on the convergence of the sampler."""
    answer, standing = ("Converged", Standing.GOOD) if converged else ("Not converged", Standing.BAD)
    return Card("Has the sampler converged?", answer, standing, [verdict])


def agreement_card(fit: Fit, ruler: str) -> Card:
    """Return the card on the agreement of the model with the ratings, without which no other finding counts.

    It is good only if the chain keeps all that people's own means predict, and a loss would have been seen.
    """
    details = [*fit_faults(fit), ruler, untestable_sentence(fit), silence_note(fit)]
    answers = {
        None: ("The ratings cannot tell", Standing.NEUTRAL),
        True: ("Yes", Standing.GOOD),
        False: ("In part", Standing.DOUBTFUL),
    }
    answer, standing = answers[fit.follows.keeps]
    if fit.direction.against_data:
        answer, standing = "No: wrong direction of the ratings", Standing.BAD
    elif fit.untestable:
        answer, standing = "Not judged", Standing.NEUTRAL
    elif fit.follows.rejected:
        answer, standing = "No: it loses what people agree on", Standing.BAD
    if not fit.direction.against_data:
        details.append(fit.direction.direction_note)
    return Card("Does the model follow the ratings?", answer, standing, [sentence(one) for one in details if one])


def fast_model_card(errors: NumericalErrors) -> Card:
    """Return the card on the effect of the fast forward model on the posterior."""
    answer, standing = "Not checked", Standing.NEUTRAL
    if np.isfinite(errors.exactness_sd):
        enough = errors.exact_enough
        answer, standing = ("Exact enough", Standing.GOOD) if enough else ("Not exact enough", Standing.BAD)
    details = [
        errors.exactness,
        f"Largest error of the quadrature: {number(errors.numerical_error, 2)} of the peak response; of the "
        f"firing rates: {number(errors.firing_error, 2)}, if every receptor had the largest error.",
    ]
    if errors.exact_reweight:
        details.append("Summary and predictions use draws weighted by the exact likelihood.")
    return Card(FAST_MODEL, answer, standing, details)


def turning_card(judged: Sequence[Reproduction], table: pd.DataFrame) -> Card:
    """Return the card on the turning point under each load; `table` as `Result.inflection` returns it."""
    loads = {
        answer: in_words([one.load for one in judged if one.reproduced is answer]) for answer in (True, False, None)
    }
    if loads[False]:
        answer, standing = f"Not under {loads[False]}", Standing.BAD
    elif loads[True]:
        answer, standing = f"Under {loads[True]}" if loads[None] else "Under every load", Standing.GOOD
    else:
        answer, standing = "Not shown by the ratings", Standing.NEUTRAL
    if loads[None] and (loads[True] or loads[False]):
        answer += f"; not shown by the ratings under {loads[None]}"
    words = {True: "reproduced", False: "not reproduced", None: "not shown by the ratings"}
    details = []
    for one in (judged[k] for k in shown_of(len(judged))):
        row = 100.0 * table.loc[one.load]
        names = ("p_interior", "prior_p_interior")
        likely, before = (with_error(row[name], row[f"{name}_mcse"], "\u00a0%") for name in names)
        details.append(
            f"{one.load}: {words[one.reproduced]}; {turn_sentence(one)}. From all loads together, under the model: the "
            f"response turns over with probability {likely} (prior: {before})."
        )
    return Card(TURNING, answer, standing, details)


def checks_card(unreproduced: Sequence[str], remarks: Sequence[str]) -> Card:
    """Return the card on all other test quantities, with sentences of the checks of residuals."""
    answer, standing = (
        ("Not everything", Standing.DOUBTFUL) if unreproduced else ("No other discrepancy", Standing.GOOD)
    )
    details = [*map(sentence, [unreproduced_sentence(unreproduced), *remarks])]
    return Card("Does it pass all other predictive checks?", answer, standing, details)


class InputErrors(NamedTuple):
    """Dependence of the conclusions on errors of the fabrics' moduli, and whether loads were taken as exact."""

    assumed: bool
    """True if moduli were taken as exact without having been declared exact."""
    shown: bool
    """True if mean ratings deviate in the way that wrong moduli would cause."""
    largest: MovedMost | None
    """The quantity that errors of the moduli would shift most; None if no shift exceeds its Monte-Carlo error."""
    remarks: tuple[str, ...]
    """The run's own sentences about errors of moduli and loads."""

    @property
    def sensitive(self) -> bool:
        """True if moduli were assumed to be exact and usual errors would change conclusions."""
        return self.assumed and self.largest is not None and self.largest.shift >= MATTERS


def input_errors_of(result: Result) -> InputErrors:
    """Return what errors of the moduli would do to the conclusions of a run on ratings."""
    table = result.tables.get(MODULUS_ERRORS)
    return InputErrors(
        result.moduli_assumed,
        ALONG in doubts(result.tables["predictive_checks"]),
        None if table is None else moved_most(table),
        (*result.said_of_moduli(), result.said_of_loads()),
    )


def input_card(errors: InputErrors) -> Card:
    """Return the card on errors of the moduli."""
    if errors.shown:
        answer, standing = "The ratings show errors", Standing.DOUBTFUL
    elif errors.sensitive:
        answer, standing = "Yes: the moduli are treated as exact", Standing.DOUBTFUL
    else:
        answer = "Hardly" if errors.assumed else "No: errors are included in the model"
        standing = Standing.GOOD
    question = "Would errors of the fabrics' moduli change the conclusions?"
    return Card(question, answer, standing, [*map(sentence, errors.remarks)])


def information_card(summary: pd.DataFrame, remarks: Sequence[str] = ()) -> Card:
    """Return the card on the parameters that the data informed."""
    informed = int((summary["contraction"] >= 1.0 - INFORMED**2).sum())
    details = [*map(sentence, [*information_sentences(summary), *remarks])]
    question = "Which parameters did the data inform?"
    return Card(question, f"{informed} of {len(summary)}", Standing.NEUTRAL, details)


def plate_card(plate: PlateData) -> Card:
    """Return the card on the growth of plate forces with indentation."""
    answer, standing = ("Yes", Standing.GOOD) if plate.force_p_value >= LEVEL else ("No", Standing.BAD)
    if not np.isfinite(plate.force_exponent):
        answer, standing = "Not judged", Standing.NEUTRAL
    question = "Does the skin model reproduce the forces of the plate?"
    return Card(question, answer, standing, [sentence(plate_sentence(plate))])


def recorded_card(result: Result) -> Card:
    """Return the card on recorded afferents: fit, distance from the paper, and agreement with other sources."""
    faults = recorded_faults(result.provenance.recorded)
    answer, standing = ("No", Standing.BAD) if faults else ("Yes", Standing.GOOD)
    question = "Does the chain reproduce what afferents were recorded to do?"
    return Card(question, answer, standing, [*map(sentence, result.recorded_sentences)])
