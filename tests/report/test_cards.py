"""The cards of a report: their standing and their words follow from values, and no page searches a text for words."""

import numpy as np
import pandas as pd
import pytest

from softness_bayes.checking.modulus_errors import MovedMost
from softness_bayes.checking.provenance import DirectionTaken, NumericalErrors, PlateData
from softness_bayes.checking.quantities import FALL, PLACE, TURNS_OVER, Reproduction
from softness_bayes.likelihood.scales import FALLS, MAGNITUDE, RISES
from softness_bayes.people.ruler import Fit, following
from softness_bayes.people.sentences import ruler_sentence
from softness_bayes.report.cards import (
    MODEL_FAILED,
    NOT_CONVERGED,
    InputErrors,
    Standing,
    agreement_card,
    checks_card,
    convergence_card,
    fast_model_card,
    information_card,
    input_card,
    plate_card,
    turning_card,
)

GOOD, DOUBTFUL, BAD, NEUTRAL = Standing


def ruled(share, low, high, lost, against=False, free=0):
    """The card of a fit with a ruler."""
    table = pd.DataFrame(
        {"value": [share, 50.0, 5.0, 0.1], "low": [low, np.nan, lost, np.nan], "high": [high, np.nan, 9.0, np.nan]},
        index=["share", "gain", "lost", "misfit"],
    )
    direction = DirectionTaken(FALLS if against else RISES, True, "the reason", direction_of_data=RISES.name)
    return agreement_card(Fit(direction, following(table), 0.0, free, 12), ruler_sentence(table, MAGNITUDE))


def exactness(sd):
    return fast_model_card(NumericalErrors(1e-4, 1e-4, "numbers", sd, sd, 1.0, 0.1, sd < 0.05, False, 0.05))


def turning(*reproduced):
    loads = [f"{k} mm" for k in range(1, 1 + len(reproduced))]
    columns = ("p_interior", "p_interior_mcse", "prior_p_interior", "prior_p_interior_mcse")
    row = pd.Series(dict.fromkeys(("observed", "replicated", "low", "high", "power", "power_mcse"), np.nan))
    rows = dict.fromkeys((TURNS_OVER, PLACE, FALL), row)
    judged = [Reproduction(load, one, rows) for load, one in zip(loads, reproduced, strict=True)]
    return turning_card(judged, pd.DataFrame(0.5, index=loads, columns=[*columns]))


def moduli(assumed, shown, shift=None):
    return input_card(InputErrors(assumed, shown, None if shift is None else MovedMost("b", shift), ("moduli: fine",)))


def plate(exponent, p_value):
    return plate_card(PlateData("", 0, 12.0, exponent, 2.0, 2.4, p_value))


SUMMARY = pd.DataFrame(
    {"contraction": [0.99, 0.1], "prior_shift": 0.0, "psens_prior": 0.01, "psens_prior_mcse": 0.001}, index=["b", "m"]
)
CASES = [
    (convergence_card(True, "numbers"), GOOD, "Converged"),
    (convergence_card(False, "numbers"), BAD, "Not converged"),
    (ruled(0.97, 0.92, 1.02, -1.0), GOOD, "Yes"),
    (ruled(0.94, 0.91, 0.97, 1.0), DOUBTFUL, "In part"),
    (ruled(0.6, 0.5, 0.7, 9.0), BAD, "No: it loses what people agree on"),
    (ruled(0.95, 0.4, 1.5, -1.0), NEUTRAL, "The ratings cannot tell"),
    (ruled(np.nan, np.nan, np.nan, -1.0), NEUTRAL, "The ratings cannot tell"),
    (ruled(0.97, 0.92, 1.02, -1.0, against=True), BAD, "No: wrong direction of the ratings"),
    (ruled(0.97, 0.92, 1.02, -1.0, free=12), NEUTRAL, "Not judged"),
    (ruled(0.97, 0.92, 1.02, -1.0, free=11), GOOD, "Yes"),
    (exactness(1e-3), GOOD, "Exact enough"),
    (exactness(1.0), BAD, "Not exact enough"),
    (turning(True, True), GOOD, "Under every load"),
    (turning(True, None), GOOD, "Under 1 mm; not shown by the ratings under 2 mm"),
    (turning(None, None), NEUTRAL, "Not shown by the ratings"),
    (turning(True, False, None), BAD, "Not under 2 mm; not shown by the ratings under 3 mm"),
    (turning(False), BAD, "Not under 1 mm"),
    (checks_card((), ("participants: fine", "fabrics: fine")), GOOD, "No other discrepancy"),
    (checks_card(("nothing else",), ("participants: fine",)), DOUBTFUL, "Not everything"),
    (moduli(True, False, 1.5), DOUBTFUL, "Yes: the moduli are treated as exact"),
    (moduli(True, False, 0.1), GOOD, "Hardly"),
    (moduli(True, False), GOOD, "Hardly"),
    (moduli(False, False, 1.5), GOOD, "No: errors are included in the model"),
    (moduli(False, True), DOUBTFUL, "The ratings show errors"),
    (information_card(SUMMARY), NEUTRAL, "1 of 2"),
    (plate(2.2, 0.4), GOOD, "Yes"),
    (plate(2.2, 1e-3), BAD, "No"),
    (plate(np.nan, np.nan), NEUTRAL, "Not judged"),
]


@pytest.mark.parametrize(("card", "standing", "answer"), CASES, ids=lambda each: getattr(each, "value", None))
def test_standing_and_answer_follow_from_the_values(card, standing, answer):
    assert (card.standing, card.answer) == (standing, answer)
    assert all(detail.strip() for detail in card.details)
    for doubt in (NOT_CONVERGED, MODEL_FAILED):
        doubted = card.doubted(doubt)
        assert doubted.standing is (DOUBTFUL if standing is GOOD else standing)
        assert (doubt in doubted.details) == (standing is GOOD)
        assert doubted.doubted("another") == doubted  # the first doubt stays alone
