"""A real table of magnitude estimates, with zeros and grids of raters' own, from `check` to `compare`."""

import pandas as pd
import pytest
from scipy.stats import spearmanr

from softness_bayes.results.result import Result
from support.command_line import call
from support.paths import SHARED

TABLE = SHARED / "data" / "hardness_magnitude_16materials_cleland2024.csv"
BRACKETS = {
    "Tile": (1e5, 1e8),
    "Garden deck tile": (1e5, 1e8),
    "Plastic desk mat": (100, 1e6),
    "Plastic place mat": (100, 1e6),
    "Cork pad": (300, 5e4),
    "Door mat": (10, 1e4),
    "Astro turf": (10, 1e4),
    "Bath mat": (10, 1e4),
    "Firm foam pad": (20, 1e3),
    "Crash mat": (5, 500),
    "Chair pad": (5, 500),
    "Gel pad": (5, 500),
    "Rug 1": (1, 500),
    "Rug 2": (1, 500),
    "Towel": (1, 500),
    "Throw": (1, 500),
}
"""What each material may be, no modulus having been measured [kPa]."""

HELD = ("b=100", "m=2", "beta=0.6", "c_Na=1.05", "c_K=1.16", "c_L=1", "c_A=1.5")
"""What a table without measured moduli cannot tell."""


SOFT, RIGID = ("Rug 1", "Rug 2", "Throw", "Towel", "Gel pad"), ("Tile", "Garden deck tile")


def with_brackets(home):
    """Write the brackets into a directory; return the arguments that name the table and them."""
    if not TABLE.is_file():
        pytest.skip("the table is not there")
    rows = "".join(f"{name},{low:g},{high:g}\n" for name, (low, high) in BRACKETS.items())
    (home / "fabrics.csv").write_text("fabric,effective_modulus_low_kpa,effective_modulus_high_kpa\n" + rows)
    return ("--data", TABLE, "--column", "rating=hardness_rating", "--force-n", "2", "--fabrics", "fabrics.csv")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A directory with first looks at the table under two laws of errors, and what each printed."""
    home = tmp_path_factory.mktemp("hardness")
    data = with_brackets(home)
    held = [word for one in HELD for word in ("--fix", one)]
    said = {"check": call("check", *data, cwd=home)}
    for law in ("student", "normal"):
        options = ("--direction", "free", "--errors", law, "--quick", "--out", law)
        said[law] = call("sample", *data, *held, *options, cwd=home)
    return home, said


@pytest.mark.slow
def test_a_real_table_goes_through_without_a_dropped_row(runs):
    home, said = runs
    assert said["check"].returncode == 0, said["check"].stderr
    assert "ratings       1440, from 0 to 30; 0 missing" in said["check"].stdout
    assert "differ in 'condition', which is not used" in said["check"].stdout
    for law in ("student", "normal"):
        assert said[law].returncode == 0, said[law].stderr
        result = Result.load(home / law)
        filed = result.group("constant_data")["rating_as_filed"].values
        assert filed.size == 1440
        assert (filed == 0).sum() == 67
        assert call("report", law, cwd=home).returncode == 0
        assert (home / law / "report.html").stat().st_size > 1e5


@pytest.mark.slow
def test_what_a_first_look_at_it_says(runs):
    """Hardness rises with stiffness; the order is that of the mean ratings; outliers ask for heavy tails."""
    home, _ = runs
    result = Result.load(home / "student")
    assert result.provenance.direction.direction_rises > 0.99
    table = pd.read_csv(home / "student" / "fabric_ratings.csv")
    assert spearmanr(table["rated"], table["predicted"]).statistic > 0.9
    stiff = table.set_index("fabric")["predicted"]
    assert stiff[[*RIGID]].min() > stiff[[*SOFT]].max()
    done = call("compare", "student", "normal", cwd=home)
    assert done.returncode == 0, done.stderr
    compared = pd.read_csv(home / "compare.csv")
    assert compared["result"].tolist() == ["student", "normal"]
    assert compared["units"].tolist() == [1440, 1440]
    assert compared["elpd_diff"][1] < -40.0
