"""The page of calibrations says what the kept ones found."""

import pandas as pd
import pytest

from softness_bayes.readable import percent
from support.pages import text_of
from support.paths import ROOT

KEPT = ROOT / "notebooks" / "results"
PAGE = text_of("calibration.md")


@pytest.mark.parametrize("kind", ["calibration", "calibration_ranks", "calibration_pairs"])
def test_the_verdict_is_the_kept_one(kind):
    verdict = (KEPT / kind / "verdict.txt").read_text().splitlines()[0]
    assert f"> {verdict}" in PAGE


def test_shares_are_the_kept_ones():
    kept = {kind: pd.read_csv(KEPT / f"calibration_{kind}" / "coverage.csv") for kind in ("ranks", "pairs")}
    shares = {kind: table[table["mass"] == 0.9].set_index("quantity")["share"] for kind, table in kept.items()}
    for name in shares["ranks"].index:
        assert f"| `{name}` | {percent(shares['ranks'][name], 1)} | {percent(shares['pairs'][name], 1)} |" in PAGE
