"""The verdict on a run in a few findings, each with its standing, from the result alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from softness_bayes.checking.check_table import doubt_sentences, doubts
from softness_bayes.checking.exactness import Exactness, compare
from softness_bayes.checking.identifiability import learning_sentences
from softness_bayes.checking.levelled import DOUBTFUL
from softness_bayes.checking.misfit import Fit, fit_of
from softness_bayes.checking.reproduction import inflection_reproduced
from softness_bayes.checking.sensitivity import INFORMED
from softness_bayes.report.words import sentence, with_error
from softness_bayes.results.result import Result


class Standing(Enum):
    """How a finding bears on what may be concluded; the value is its style."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    BAD = "bad"
    NEUTRAL = "neutral"


@dataclass(frozen=True)
class Finding:
    """One answer of the verdict.

    Parameters
    ----------
    question
        What was asked.
    answer
        In a word or two.
    standing
        What it means for the conclusions.
    details
        Sentences behind it.
    """

    question: str
    answer: str
    standing: Standing
    details: Sequence[str]


MOSTLY = 0.5
"""Share of the differences between fabrics from which the response is said to explain them."""

TURNING = "Does the model reproduce the turning point (maximum), where the ratings can tell?"
"""The question of the card about it."""

UNRELIABLE = "Of draws that have not converged: for inspection only."


NOT_OF_THESE_RATINGS = "Of a model that does not follow these ratings: see the first finding."


def findings(result: Result) -> list[Finding]:
    """Return the verdict, most decisive first; without convergence, or a fit, nothing in it stands as good."""
    convergence = _convergence(result)
    rest = [*(_of_ratings(result) if result.has_ratings else _without_ratings()), _information(result)]
    rest += [_plate(result)] if result.has_compression else []
    if convergence.standing is not Standing.GOOD:
        rest = [_shaken(finding, UNRELIABLE) for finding in rest]
    if not result.has_ratings:
        return [convergence, *rest]
    follows = _follows(fit_of(result.tree))
    if convergence.standing is not Standing.GOOD:
        follows = _shaken(follows, UNRELIABLE)
    if follows.standing is Standing.BAD:
        return [follows, *(_shaken(finding, NOT_OF_THESE_RATINGS) for finding in (convergence, *rest))]
    return [convergence, rest[0], follows, *rest[1:]]


def _shaken(finding: Finding, why: str) -> Finding:
    if finding.standing is not Standing.GOOD:
        return finding
    return replace(finding, standing=Standing.DOUBTFUL, details=[*finding.details, why])


def _follows(fit: Fit) -> Finding:
    """Say whether the model follows the ratings at all: whatever else holds, without that nothing does."""
    question = "Does the model follow the ratings?"
    details = [*map(sentence, [*fit.faults, fit.sentence, *([fit.silence] if fit.silence else [])])]
    if fit.faults:
        answer = "No: the readout runs against the data" if fit.choice.against_data else "No: a flat line through them"
        return Finding(question, answer, Standing.BAD, details)
    details.append(sentence(fit.choice.sentence))
    if not fit.explained or not fit.explained[-1].p_value < DOUBTFUL:
        return Finding(question, "Not judged", Standing.NEUTRAL, details)
    mostly = fit.explained[-1].share >= MOSTLY
    return Finding(question, "Yes" if mostly else "In part", Standing.GOOD if mostly else Standing.DOUBTFUL, details)


def _convergence(result: Result) -> Finding:
    converged = bool(result.attributes["converged"])
    return Finding(
        "Has the sampler converged?",
        "Converged" if converged else "Not converged",
        Standing.GOOD if converged else Standing.BAD,
        [str(result.attributes["verdict"])],
    )


def exactness_of(result: Result) -> Exactness:
    """Return what the comparison with exact firing rates found, from the differences that the result keeps."""
    stats, draws = result.group("sample_stats"), result.group("posterior")
    difference = stats["exact_difference"].values
    compared = np.isfinite(difference)
    names = tuple(str(name) for name in result.group("log_prior"))
    theta = np.stack([draws[name].values[compared] for name in names], axis=-1)
    return compare(names, theta, np.zeros(int(compared.sum())), difference[compared])


def _of_ratings(result: Result) -> list[Finding]:
    return [_exactness(result), _inflection(result), _criticism(result)]


def _exactness(result: Result) -> Finding:
    enough = exactness_of(result).exact_enough
    weighted = bool(result.attributes["exact_reweight"])
    numbers = (
        f"Quadrature: {float(result.attributes['numerical_error']):.1e} of the peak response at most; "
        f"firing rates: {float(result.attributes['firing_error']):.1e}, if every receptor had their largest error."
    )
    tail = ["Summary and predictions are those of draws weighted by the exact likelihood."] if weighted else []
    return Finding(
        "Are the fast model's numbers exact enough?",
        "Exact enough" if enough else "Not exact enough",
        Standing.GOOD if enough else Standing.BAD,
        [str(result.attributes["exactness"]), numbers, *tail],
    )


def _inflection(result: Result) -> Finding:
    judged = inflection_reproduced(result.tables["predictive_checks"])
    words = {True: "reproduced", False: "not reproduced", None: "ratings cannot tell"}
    under = {answer: ", ".join(one.load for one in judged if one.reproduced is answer) for answer in words}
    if under[False]:
        answer, standing = f"Not under {under[False]}", Standing.BAD
    elif under[True]:
        answer, standing = f"Under {under[True]}" if under[None] else "Under every load", Standing.GOOD
    else:
        answer, standing = "Ratings cannot tell", Standing.NEUTRAL
    if under[None] and (under[True] or under[False]):
        answer += f"; ratings cannot tell under {under[None]}"
    table = result.inflection()
    details = [
        f"{one.load}: {words[one.reproduced]}; {one.seen}. All loads and the model together: the response turns over "
        f"with probability {_likely(table.loc[one.load], 'p_interior')} (prior: "
        f"{_likely(table.loc[one.load], 'prior_p_interior')})."
        for one in judged
    ]
    return Finding(TURNING, answer, standing, details)


def _likely(row: Any, name: str) -> str:
    """Return a probability in per cent with its Monte-Carlo error."""
    return with_error(100 * row[name], 100 * row[f"{name}_mcse"], "\u00a0%")


def _criticism(result: Result) -> Finding:
    found = result.attributes
    sentences = [
        *doubt_sentences(result.tables["predictive_checks"]),
        str(found["exponent_check"]),
        str(found["fabric_check"]),
    ]
    clean = not doubts(result.tables["predictive_checks"])
    return Finding(
        "Does it reproduce everything else that was checked?",
        "Nothing else amiss" if clean else "Not everything",
        Standing.GOOD if clean else Standing.DOUBTFUL,
        [*map(sentence, sentences)],
    )


def _without_ratings() -> list[Finding]:
    reason = "The run is on compression data alone: no receptor, no response and no rating is in it."
    return [
        Finding(question, "Does not apply", Standing.NEUTRAL, [reason])
        for question in (
            "Are the fast model's numbers exact enough?",
            TURNING,
        )
    ]


def _information(result: Result) -> Finding:
    summary = result.summary()
    informed = int((summary["contraction"] >= 1.0 - INFORMED**2).sum())
    sentences = [*map(sentence, learning_sentences(summary))]
    sentences += [sentence(str(result.attributes[name])) for name in ("held_eps",) if name in result.attributes]
    return Finding(
        "Which parameters did the data inform?",
        f"{informed} of {len(summary)}",
        Standing.NEUTRAL,
        sentences,
    )


def _plate(result: Result) -> Finding:
    found = result.attributes
    question, details = "Does the skin reproduce the plate's forces?", [sentence(str(found["force_check"]))]
    if not np.isfinite(float(found["force_exponent"])):
        return Finding(question, "Not judged", Standing.NEUTRAL, details)
    well = float(found["force_p_value"]) >= DOUBTFUL
    return Finding(question, "Yes" if well else "No", Standing.GOOD if well else Standing.BAD, details)
