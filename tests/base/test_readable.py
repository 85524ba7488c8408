"""Shares and probabilities have one form, in every sentence."""

import numpy as np
import pytest

from softness_bayes.base.readable import chance, percent


@pytest.mark.parametrize("digits", [0, 1, 2])
def test_only_all_and_nothing_are_100_and_0_percent(digits):
    nearly = [10.0**-k for k in range(1, 15)]
    for share in [*nearly, *(1.0 - one for one in nearly), *np.linspace(0.001, 0.999, 999)]:
        said = percent(float(share), digits)
        assert float(said.strip("<> %")) not in (0.0, 100.0), (share, said)
        # what is said is true, to its digits
        number = float(said.strip("<> %")) / 100
        if said[0] == "<":
            assert share < number
        elif said[0] == ">":
            assert share > number
        else:
            assert abs(share - number) <= 0.5 * 10.0 ** -(2 + digits) * (1 + 1e-9)
    assert [percent(0.0, digits), percent(1.0, digits)] == ["0 %", "100 %"]


def test_what_is_not_known_is_a_dash_and_draws_show_no_certainty():
    assert percent(float("nan")) == percent(None) == "–"
    assert [chance(p) for p in (0.0, 0.0025, 0.5, 0.9975, 1.0)] == ["<1 %", "<1 %", "50 %", ">99 %", ">99 %"]
