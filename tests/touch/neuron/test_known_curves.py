"""The shipped rate curves: those that computation gives, found for their own arguments alone."""

from __future__ import annotations

import numpy as np
import pytest

from softness_bayes.tools.surface_build import CASES
from softness_bayes.touch.neuron.firing import exact_curve, known_curve
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.neuron.rate_curve import RateCurve
from support.onsets import EXACT_ENOUGH


def require_same(kept: RateCurve, made: RateCurve) -> None:
    # exp differs in its last bits between processors
    np.testing.assert_allclose(kept.rheobase, made.rheobase, rtol=1e-9)
    np.testing.assert_allclose(kept.onset_rate, made.onset_rate, rtol=1e-6)
    current = np.linspace(0.0, kept.max_current, 200)
    np.testing.assert_allclose(kept.rate(current), made.rate(current), rtol=1e-6, atol=1e-6)
    assert kept.max_current == made.max_current
    np.testing.assert_allclose(kept.error, made.error, rtol=0.1, atol=1e-6)


def test_the_usual_curve_goes_through_exact_rates() -> None:
    """As a whole it is compared with the computed one among the slow tests."""
    assert CASES[0] == (PAPER_CHANNELS, CONNOR_STEVENS, 40.0, 18)
    kept = known_curve(*CASES[0])
    current = kept.rheobase + np.array([-0.01, 0.01, 0.3, 2.0, 9.0, 20.0])
    exact = firing_rate(current, tolerance=EXACT_ENOUGH)
    assert exact[0] == 0.0 < exact[1]
    np.testing.assert_allclose(kept.rate(current), exact, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[1].name}-{case[2]}-{case[3]}")
def test_every_shipped_curve_is_the_computed_one(case) -> None:
    require_same(known_curve(*case), exact_curve(*case))
