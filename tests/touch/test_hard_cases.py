"""Hard cases, one after another: errors within bounds; and what has no answer says so."""

from __future__ import annotations

import numpy as np
import pytest

import hard_cases
from hard_cases import CASES, CLOTH, MILLIMETRE, NEWTON, scene_of, touch_parameters, touches
from oracles import plain_chain


def case_id(case):
    return case.name.replace(" ", "-")


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.slow if case.slow else (), id=case_id(case)) for case in CASES]
)
def test_worst_error_is_within_bounds(case):
    found = case.measure()
    assert found.usual <= case.allowed.usual
    assert found.fine <= case.allowed.fine


@pytest.mark.parametrize("broken", ["cos", "tan"])
def test_a_wrong_chain_is_found_out(broken, monkeypatch):
    """Negative control: an influence that is a little wrong is far outside the bounds."""
    right = getattr(np, broken)
    monkeypatch.setattr(plain_chain.np, broken, lambda x: right(x) * (1 + 1e-3))
    assert hard_cases.stiffening_skin().usual > 1e-4


@pytest.mark.parametrize(
    "quiet", [{"alpha": 17.999}, {"alpha": 18.0}, {"sigma_0": 1e9}, {"b": 1e-3, "m": 0.0}, {"sigma_0": 1e300}], ids=str
)
def test_all_fabrics_silent(quiet):
    parts = touches(CLOTH, [MILLIMETRE, NEWTON])
    assert all(plain_chain.total_rate(t, **{**hard_cases.MEDIANS, **quiet}) == 0 for t in parts)
    found = scene_of(parts).respond(touch_parameters(**quiet))
    assert (found.total_rate == 0).all()
    assert (found.responding == 0).all()
    # a mean over no receptor is no number, and is said to be none
    assert np.isnan(found.mean_rate).all()
    assert np.isnan(found.mean_interval).all()
