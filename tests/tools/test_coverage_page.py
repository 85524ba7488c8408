"""The table and figure of coverage with uncertain inputs: the page's table is that of the kept fits."""

import csv
import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from softness_bayes.tools.coverage import _stiff_direction
from softness_bayes.tools.coverage_page import DECLARED, FIGURE, WRONG, agreement, counted, draw, page_lines
from support.paths import ROOT

RESULTS = ROOT / "notebooks" / "results"
PAGE = ROOT / "softness_bayes" / "docs" / "calibration.md"


@pytest.fixture(scope="module")
def found():
    return counted(RESULTS)


def test_the_page_has_the_kept_shares(found):
    text = PAGE.read_text(encoding="utf-8")
    for line in page_lines(found):
        assert line in text
    assert (RESULTS / FIGURE).is_file()


def test_shares_and_limits_are_those_of_the_rows(found):
    with (RESULTS / "input_errors" / "coverage.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if (row["case"], row["quantity"]) == ("taken as exact", "b")]
    hits = sum(0.05 <= float(row["below"]) <= 0.95 for row in rows)
    one = next(share for share in found if (share.situation[:12], share.quantity) == ("moduli off b", "b"))
    assert (one.tables, one.share) == (len(rows), hits / len(rows))
    # the limits are the shares at which so few, or so many, have a chance of 2.5 %
    assert binom.sf(hits - 1, len(rows), one.low) == pytest.approx(0.025, abs=1e-9)
    assert binom.cdf(hits, len(rows), one.high) == pytest.approx(0.025, abs=1e-9)


def test_the_negative_controls_fail_and_declared_errors_do_not(found):
    """Shares that the controls cannot have by chance; of what is declared, none is below 0.85 for certain."""
    by = {share.situation: [other for other in found if other.situation == share.situation] for share in found}
    wrong = [shares for shares in by.values() if shares[0].role == WRONG and "off by" in shares[0].situation]
    assert len(wrong) == 3
    for shares in wrong:
        assert sum(share.high < 0.9 for share in shares) >= 2
    for shares in by.values():
        if shares[0].role != WRONG:
            assert all(share.high > 0.85 for share in shares)
        if shares[0].role == DECLARED:
            assert all(share.share >= 0.85 for share in shares)
    assert all(share.tables >= 200 for shares in by.values() for share in shares if "15 %, errors" in share.situation)


@pytest.mark.parametrize(("name", "bias", "scatter"), [("input_errors", 0.005, 0.03), ("finger_spreads", 0.01, 0.045)])
def test_weighted_draws_agree_with_walks(name, bias, scatter):
    said = agreement(RESULTS / name)
    assert said in PAGE.read_text(encoding="utf-8").replace("\n", " ")
    fits, mean, sd = (float(word.strip(",")) for word in re.findall(r"-?\d[\d.]*", said)[2:5])
    assert fits >= 90
    assert abs(mean) < bias
    # two samples of 1000 draws, of which several hundred are independent
    assert sd < scatter


def test_the_stiff_direction_shows_fingers_that_no_parameter_shows(found):
    """Different fingers taken as one: b is covered, the third stiffest direction is not; declared, both are."""
    cell = {(share.situation, share.quantity): share for share in found}
    for names in ("b", "b and m", "b, m and sigma_0"):
        situation = f"raters' own {names}, taken as one finger"
        assert cell[situation, "b"].share > 0.9
        assert cell[situation, "third stiffest direction"].high < 0.6
        declared = f"raters' own {names}, `--individual {names.replace(' and ', ',').replace(', ', ',')}`"
        assert 0.85 <= cell[declared, "third stiffest direction"].share <= 0.95


def test_the_third_stiffest_direction_is_that_of_the_third_smallest_variance(rng):
    """Of parameters with known spreads; those without a true value, or a true value of 0, do not count."""
    names, spread = ("wide", "first", "latent", "second", "third", "zero"), np.array([9.0, 0.01, 0.02, 0.1, 1.0, 0.05])
    posterior = SimpleNamespace(names=names, space=SimpleNamespace(coordinates=lambda theta: theta))
    theta = 3.0 + spread * rng.standard_normal((4000, 6))
    truth = {"wide": 1.0, "first": 2.0, "second": 3.0, "third": 5.0, "zero": 0.0}
    drawn, value = _stiff_direction(posterior, theta, truth)
    assert drawn.std() == pytest.approx(1.0, rel=0.05)
    assert np.corrcoef(drawn, theta[:, 4])[0, 1] > 0.99
    # the true value lies two standard deviations above the mean
    assert value - drawn.mean() == pytest.approx(2.0, abs=0.3)


def test_an_empty_folder_has_nothing(tmp_path):
    assert counted(tmp_path) == []


def test_the_figure_is_drawn(found, tmp_path):
    draw([share for share in found if share.quantity in ("b", "tau_b")], tmp_path / "one.png")
    assert (tmp_path / "one.png").read_bytes().startswith(b"\x89PNG")
