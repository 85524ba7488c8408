"""Data that hardly say anything, or hardly can be: every verb ends with a statement or an error, never a traceback."""

from __future__ import annotations

import re

import pytest

from support.command_line import HELD, call, run

HEADER = "participant,fabric,indentation_mm,rating,effective_modulus_kpa\n"
FABRICS = {"a": 60, "b": 300, "c": 2000}
CHANNELS = [part for name in ("c_Na", "c_K", "c_L", "c_A") for part in ("--fix", f"{name}={HELD[name]}")]


def crossed(people, ratings):
    """Ratings of the three fabrics by some people, over and over."""
    cells = [(person, fabric) for person in people for fabric in FABRICS]
    return HEADER + "".join(
        f"{person},{fabric},2,{ratings[k % len(ratings)]},{FABRICS[fabric]}\n"
        for k, (person, fabric) in enumerate(cells)
    )


TABLES = {
    "one row": HEADER + "P1,a,2,20,100\n",
    "one participant": crossed(["P1"], ["20", "30", "25"]),
    "one fabric": HEADER + "P1,a,2,20,100\nP2,a,2,10,100\nP1,a,2,25,100\n",
    "identical": crossed(["P1", "P2"], ["20"]),
    "extreme": crossed(["P1", "P2"], ["1e-300", "1e300"]),
    "silent": HEADER + "P1,a,0.01,20,0.001\nP1,b,0.01,30,0.002\nP2,a,0.01,35,0.001\n",
}


@pytest.fixture
def table(tmp_path):
    def write(name):
        path = tmp_path / "ratings.csv"
        path.write_text(TABLES[name])
        return path

    return write


@pytest.mark.parametrize(
    ("name", "statement"),
    [
        ("one row", "one condition: the response does not vary"),
        ("one row", "one participant: the spread of rating scales between participants (tau)"),
        ("one participant", "one participant: the spread of rating scales between participants (tau)"),
        ("one fabric", "one condition: the response does not vary"),
        ("identical", "all ratings are equal"),
        ("extreme", "from 1e-300 to 1e+300"),
        ("silent", "E_fab 0.001 to 0.002 kPa"),
    ],
)
def test_check_says_what_the_data_cannot_tell(table, name, statement):
    done = call("check", "--data", table(name))
    assert done.returncode == 0, done.stderr
    assert statement in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", ["one row", "one participant", "one fabric"])
def test_a_run_on_them_ends_with_a_verdict(table, tmp_path, name):
    """Warnings are errors in the process that runs; no number of the report is none."""
    out = tmp_path / "out"
    done = run(
        "sample", "--data", table(name), "--out", out, "--max-steps", 20, "--processes", 1, *CHANNELS, timeout=900
    )
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert "Warning" not in done.stderr
    assert not re.search(r"\bnan\b", done.stdout), done.stdout
    assert (out / "figures" / "rating.png").stat().st_size > 0
