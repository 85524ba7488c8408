"""The findings of a report: their standing follows from numbers, and their words from the findings."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from softness_bayes import report
from softness_bayes.checking.exactness import compare_likelihoods
from softness_bayes.checking.flatness import Explained
from softness_bayes.checking.misfit import Fit
from softness_bayes.checking.modulus_errors import MovedMost
from softness_bayes.checking.reproduction import Reproduction
from softness_bayes.likelihood.directions import FALLS, RISES
from softness_bayes.provenance import DirectionTaken
from softness_bayes.report.cards import DOUBTS, QUESTIONS, card
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

GOOD, DOUBTFUL, BAD, NEUTRAL = Standing


def fit(share=0.8, p_value=1e-6, against=False, **changed):
    """A fit whose response explains a share of the differences between fabrics."""
    each = Explained(share, share - 0.1, share + 0.1, 0.5, p_value, 0.1, matters=True)
    values = {"explained": (each, each), "silent": 0.0, "silent_conditions": 0.0, "fabric_effects": False}
    direction = DirectionTaken(FALLS if against else RISES, True, "the reason", direction_of_data=RISES.name)
    return Fit(direction, ("2 mm",), **{**values, **changed}, scale="log rating")


def exactness(sd):
    rng = np.random.default_rng(1)
    theta = rng.standard_normal((300, 1))
    return compare_likelihoods(("b",), theta, np.zeros(300), sd * theta[:, 0])


def turning(*reproduced):
    loads = [f"{k} mm" for k in range(1, 1 + len(reproduced))]
    columns = ("p_interior", "p_interior_mcse", "prior_p_interior", "prior_p_interior_mcse")
    table = pd.DataFrame(0.5, index=loads, columns=[*columns])
    return TurningPoints(
        tuple(Reproduction(load, one, "seen") for load, one in zip(loads, reproduced, strict=True)), table
    )


SUMMARY = pd.DataFrame(
    {"contraction": [0.99, 0.1], "psens_prior": [0.01, 0.01], "psens_prior_mcse": [0.001, 0.001]}, index=["b", "m"]
)
CASES = [
    (Convergence(True, "numbers"), GOOD, "Converged"),
    (Convergence(False, "numbers"), BAD, "Not converged"),
    (Agreement(fit()), GOOD, "Yes"),
    (Agreement(fit(share=0.3)), DOUBTFUL, "In part"),
    (Agreement(fit(share=np.nan)), DOUBTFUL, "In part"),
    (Agreement(fit(share=-0.2)), BAD, "No: the prediction is flat"),
    (Agreement(fit(against=True)), BAD, "No: wrong direction of the ratings"),
    (Agreement(fit(p_value=0.4)), NEUTRAL, "Not judged"),
    (Agreement(fit(p_value=np.nan)), NEUTRAL, "Not judged"),
    (Agreement(fit(explained=())), NEUTRAL, "Not judged"),
    (FastModel(exactness(1e-3), "numbers", 1e-4, 1e-4, False), GOOD, "Exact enough"),
    (FastModel(exactness(1.0), "numbers", 1e-4, 1e-4, True), BAD, "Not exact enough"),
    (turning(True, True), GOOD, "Under every load"),
    (turning(True, None), GOOD, "Under 1 mm; not shown by the ratings under 2 mm"),
    (turning(None, None), NEUTRAL, "Not shown by the ratings"),
    (turning(True, False, None), BAD, "Not under 2 mm; not shown by the ratings under 3 mm"),
    (turning(False), BAD, "Not under 1 mm"),
    (OtherChecks((), ("participants: fine", "fabrics: fine")), GOOD, "No other discrepancy"),
    (OtherChecks(("nothing else",), ("participants: fine",)), DOUBTFUL, "Not everything"),
    (InputErrors(True, 0.4, MovedMost("b", 1.5), ("moduli: fine",)), DOUBTFUL, "Yes: the moduli are treated as exact"),
    (InputErrors(True, 0.4, MovedMost("b", 0.1), ("moduli: fine",)), GOOD, "Hardly"),
    (InputErrors(True, 0.4, None, ("moduli: fine",)), GOOD, "Hardly"),
    (InputErrors(False, 0.4, MovedMost("b", 1.5), ("moduli: fine",)), GOOD, "No: errors are included in the model"),
    (InputErrors(False, 1e-3, None, ("moduli: off",)), DOUBTFUL, "The ratings show errors"),
    (Information(SUMMARY), NEUTRAL, "1 of 2"),
    (PlateForces(2.2, 0.4, "forces"), GOOD, "Yes"),
    (PlateForces(2.2, 1e-3, "forces"), BAD, "No"),
    (PlateForces(np.nan, np.nan, "forces"), NEUTRAL, "Not judged"),
    (NeedsRatings(TurningPoints), NEUTRAL, "Does not apply"),
]


@pytest.mark.parametrize(("finding", "standing", "answer"), CASES, ids=lambda each: getattr(each, "value", None))
def test_standing_and_answer_follow_from_the_values(finding, standing, answer):
    told = card(finding)
    assert (finding.standing, told.standing, told.answer) == (standing, standing, answer)
    assert told.question == QUESTIONS[getattr(finding, "of", type(finding))]
    assert all(detail.strip() for detail in told.details)
    for doubt in Doubt:
        shaken = replace(finding, doubt=doubt)
        assert shaken.standing is (DOUBTFUL if standing is GOOD else standing)
        assert (DOUBTS[doubt] in card(shaken).details) == (standing is GOOD)


def test_every_finding_and_every_standing_has_a_case():
    assert {type(finding) for finding, *_ in CASES} == set(Finding.__subclasses__())
    assert {standing for _, standing, _ in CASES} == set(Standing)
    assert set(QUESTIONS) == set(Finding.__subclasses__()) - {NeedsRatings}


def text_searches(code):
    """Return what in some code looks for words in text: ``"two words" in text``, ``text.startswith("word")``."""
    found = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Compare) and any(isinstance(op, ast.In | ast.NotIn) for op in node.ops):
            words = isinstance(node.left, ast.Constant) and isinstance(node.left.value, str) and " " in node.left.value
            found += [ast.unparse(node)] if words else []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            looks = node.func.attr in ("startswith", "endswith", "find", "rfind", "index", "search", "match")
            found += [ast.unparse(node)] if looks else []
    return found


def test_no_page_searches_a_text_for_words():
    assert text_searches('clean = all("nothing else" in doubt for doubt in doubts)')
    assert text_searches('bad = verdict.startswith("Not converged")')
    # these two read a command line, and names
    modules = {path.name for path in Path(report.__file__).parent.glob("*.py")} - {"repeat.py", "anonymity.py"}
    for name in sorted(modules):
        assert not text_searches((Path(report.__file__).parent / name).read_text(encoding="utf-8")), name
