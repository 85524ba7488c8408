"""Findings as text, each with a question, an answer and some sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from softness_bayes.checking.check_table import unreproduced_sentence
from softness_bayes.checking.identifiability import information_sentences
from softness_bayes.checking.levelled import DOUBTFUL
from softness_bayes.defaults import in_words, shown_of
from softness_bayes.readable import number
from softness_bayes.report.findings import (
    Agreement,
    Convergence,
    Doubt,
    FastModel,
    Finding,
    Information,
    InputErrors,
    NeedsRatings,
    OtherChecks,
    PlateForces,
    Standing,
    TurningPoints,
)
from softness_bayes.report.words import sentence, with_error

QUESTIONS: Mapping[type[Finding], str] = MappingProxyType(
    {
        Convergence: "Has the sampler converged?",
        Agreement: "Does the model follow the ratings?",
        FastModel: "Is the fast model accurate enough?",
        TurningPoints: "Does the model reproduce the turning point (maximum), where the ratings can show it?",
        OtherChecks: "Does it pass all other predictive checks?",
        InputErrors: "Would errors of the fabrics' moduli change the conclusions?",
        Information: "Which parameters did the data inform?",
        PlateForces: "Does the skin model reproduce the forces of the plate?",
    }
)
"""Questions answered by each kind of finding."""

DOUBTS: Mapping[Doubt, str] = MappingProxyType(
    {
        Doubt.NOT_CONVERGED: "The chains have not converged: this is for inspection only.",
        Doubt.MODEL_FAILED: "The model does not follow these ratings: see the first finding.",
    }
)
"""Sentences on reservations about otherwise favourable findings."""

REPRODUCED: Mapping[bool | None, str] = MappingProxyType(
    {True: "reproduced", False: "not reproduced", None: "not shown by the ratings"}
)

NO_RATINGS = "Only compression data were fitted: the run has no receptors, responses or ratings."


class Card(NamedTuple):
    """A finding in the form shown on the page."""

    question: str
    answer: str
    standing: Standing
    details: Sequence[str]


def cards(findings: Iterable[Finding]) -> list[Card]:
    """Return findings as text."""
    return [card(finding) for finding in findings]


def card(finding: Finding) -> Card:
    """Return one finding as text."""
    asked = finding.of if isinstance(finding, NeedsRatings) else type(finding)
    answer, details = _told(finding)
    doubt = [DOUBTS[finding.doubt]] if finding.doubt is not None and finding.shaken else []
    return Card(QUESTIONS[asked], answer, finding.standing, [*details, *doubt])


def _told(finding: Finding) -> tuple[str, list[str]]:
    """Return the answer and its supporting sentences."""
    good = finding.outcome is Standing.GOOD
    match finding:
        case Convergence():
            return "Converged" if good else "Not converged", [finding.verdict]
        case Agreement():
            return _agreement(finding)
        case FastModel():
            answer = "Exact enough" if good else "Not exact enough"
            return answer if finding.exactness.checked else "Not checked", _errors(finding)
        case TurningPoints():
            return _turning(finding)
        case OtherChecks():
            told = [unreproduced_sentence(finding.unreproduced), *finding.remarks]
            return "No other discrepancy" if good else "Not everything", [*map(sentence, told)]
        case InputErrors():
            return _inputs(finding), [*map(sentence, finding.remarks)]
        case Information():
            told = [*information_sentences(finding.summary), *finding.remarks]
            return f"{finding.informed} of {len(finding.summary)}", [*map(sentence, told)]
        case PlateForces():
            known = {Standing.GOOD: "Yes", Standing.BAD: "No"}
            return known.get(finding.outcome, "Not judged"), [sentence(finding.sentence)]
        case NeedsRatings():
            return "Does not apply", [NO_RATINGS]
    raise TypeError(f"no words for {type(finding).__name__}")


def _agreement(finding: Agreement) -> tuple[str, list[str]]:
    fit = finding.fit
    details = [*map(sentence, [*fit.faults, fit.sentence, *([fit.silence_note] if fit.silence_note else [])])]
    if finding.outcome is Standing.BAD:
        against = fit.direction.against_data
        return "No: wrong direction of the ratings" if against else "No: the prediction is flat", details
    answers = {Standing.GOOD: "Yes", Standing.DOUBTFUL: "In part", Standing.NEUTRAL: "Not judged"}
    return answers[finding.outcome], [*details, sentence(fit.direction.direction_note)]


def _inputs(finding: InputErrors) -> str:
    if finding.p_value < DOUBTFUL:
        return "The ratings show errors"
    if finding.sensitive:
        return "Yes: the moduli are treated as exact"
    return "Hardly" if finding.assumed else "No: errors are included in the model"


def _errors(finding: FastModel) -> list[str]:
    numbers = (
        f"Largest error of the quadrature: {number(finding.numerical_error, 2)} of the peak response; of the "
        f"firing rates: {number(finding.firing_error, 2)}, if every receptor had the largest error."
    )
    weighted = "Summary and predictions use draws weighted by the exact likelihood."
    return [finding.sentence, numbers, *([weighted] if finding.reweighted else [])]


def _turning(finding: TurningPoints) -> tuple[str, list[str]]:
    yes, no, unknown = (in_words(finding.loads(answer)) for answer in (True, False, None))
    if no:
        answer = f"Not under {no}"
    elif yes:
        answer = f"Under {yes}" if unknown else "Under every load"
    else:
        answer = "Not shown by the ratings"
    if unknown and (yes or no):
        answer += f"; not shown by the ratings under {unknown}"
    details = [
        f"{one.load}: {REPRODUCED[one.reproduced]}; {one.seen}. From all loads together, under the model: the "
        f"response turns over with probability {_likely(finding.table.loc[one.load], 'p_interior')} (prior: "
        f"{_likely(finding.table.loc[one.load], 'prior_p_interior')})."
        for one in (finding.judged[k] for k in shown_of(len(finding.judged)))
    ]
    return answer, details


def _likely(row: Any, name: str) -> str:
    """Return a probability in per cent with its Monte Carlo error."""
    return with_error(100 * row[name], 100 * row[f"{name}_mcse"], "\u00a0%")
