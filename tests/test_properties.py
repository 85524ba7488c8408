"""Properties that hold for every scene, likelihood, prior and table; examples are drawn, the same in every run."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from softness_bayes.data import Ratings, ratings_csv
from softness_bayes.data.columns import BEARABLE, FINGERTIP, summarises
from softness_bayes.data.texts import identity
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.scene import Scene
from softness_bayes.touch.stress import HERTZ

FEW = settings(derandomize=True, deadline=None, database=None, max_examples=25)
"""Where each example makes scenes of its own."""

RHEOBASE = 18.0
FABRICS = np.geomspace(3e3, 1e7, 12)
INDENTED, PRESSED = Indentation(1.5e-3), Force(1.0)
RESOLVED = 3e-5
"""What the default discretisation leaves, relative to the largest response."""
"""Enough to tell laws apart, and quickly made."""


def in_decades(low, high):
    return st.floats(math.log10(low), math.log10(high)).map(lambda power: 10.0**power)


@st.composite
def touched(draw):
    """Parameters of the chain far beyond the priors' bulk, with a current above the rheobase."""
    return TouchParameters(
        b=draw(in_decades(3e3, 1e6)),
        m=draw(st.floats(0.0, 6.0)),
        alpha=draw(st.floats(RHEOBASE + 0.01, 59.0)),
        beta=draw(in_decades(5e-5, 1e-2)),
        sigma_0=draw(st.floats(300.0, 3e4)),
        c_Na=1.05,
        c_K=1.16,
        c_L=1.0,
        c_A=1.5,
    )


@pytest.fixture(scope="session")
def hertz(smooth_firing):
    return Scene(FABRICS, 0.3, [INDENTED], smooth_firing(), readings=Readings(pressure=HERTZ))


@pytest.fixture(scope="session")
def scene(smooth_firing):
    return Scene(FABRICS, 0.3, [INDENTED, PRESSED], smooth_firing())


def assert_rises(lower, higher):
    assert (higher >= lower - RESOLVED * max(higher.max(), lower.max())).all()


# the response


@FEW
@given(touched(), st.floats(1.001, 3.0))
def test_what_stiffens_the_contact_raises_hertz_stress_under_indentation(hertz, parameters, factor):
    """The contact radius is held and the whole pressure is proportional to E_star, which rises with E_fab, b and m."""
    rate = hertz.total_rate(parameters)
    assert_rises(rate[:-1], rate[1:])
    assert_rises(rate, hertz.total_rate(parameters._replace(b=factor * parameters.b)))
    assert_rises(rate, hertz.total_rate(parameters._replace(m=factor * parameters.m)))


def test_neither_holds_for_the_attenuated_pressure(smooth_firing, paper):
    """Negative control: there the response turns over, and the test above would see it."""
    turning = Scene(FABRICS, 0.3, [Indentation(3e-3)], smooth_firing()).total_rate(paper(m=1.0))
    with pytest.raises(AssertionError):
        assert_rises(turning[:-1], turning[1:])


@pytest.mark.parametrize(("onset_rate", "power"), [(0.0, 1.5), (10.0, 1.0)])
@FEW
@given(parameters=touched(), where=st.integers(3, 11))
def test_the_order_of_the_kink_at_the_onset(smooth_firing, scene, onset_rate, power, parameters, where):
    """How firing starts in a condition as alpha rises by d beyond what the peak stress needs.

    Stress falls from its peak like rho², so an area proportional to d responds. At a fold the rate starts like a
    root: summed over that area, N ~ d^(3/2), whose derivative is continuous (0 on both sides) and whose second
    is not. At a jump N ~ d: only N itself is continuous.
    """
    jumps = scene.take([where])
    jumps.firing = smooth_firing(onset_rate=onset_rate)
    peak = jumps.respond(parameters).peak_stress[0]
    odds = math.exp(-parameters.beta * (peak - parameters.sigma_0))
    if not 1e-3 < odds < 2.0:  # the onset lies outside the curve, or a hair above the rheobase
        return
    alpha = RHEOBASE * (1 + odds * (1 + np.array([-1e-4, -1e-9, 1e-7, 4e-7])))
    below, barely_below, one, four = jumps.total_rate(parameters._replace(alpha=alpha))[:, 0]
    assert below == barely_below == 0
    assert math.log(four / one, 4) == pytest.approx(power, abs=0.01)
    # the slope on this side, that on the other being 0: continuous for the fold alone
    slopes = np.array([one, four]) / (RHEOBASE * odds * np.array([1e-7, 4e-7]))
    assert slopes[0] / slopes[1] == pytest.approx(0.5 if power == 1.5 else 1.0, rel=0.02)


# the tables

NAMES = (
    st.text(st.characters(exclude_categories=("Cc", "Cs", "Zl", "Zp")), min_size=1, max_size=8)
    .map(str.strip)
    .filter(lambda name: name and not summarises(name))
)
DEPTHS, NEWTONS = (st.floats(among.low, among.high) for among in (FINGERTIP, BEARABLE))
FINITE = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def tables_of_ratings(draw):
    people = draw(st.lists(NAMES, min_size=1, max_size=3, unique_by=identity))
    fabrics = draw(st.lists(NAMES, min_size=1, max_size=3, unique_by=identity))
    depths = draw(st.lists(DEPTHS, max_size=2, unique=True))
    forces = draw(st.lists(NEWTONS, min_size=0 if depths else 1, max_size=2, unique=True))
    loads = [*map(Indentation, depths), *map(Force, forces)]
    rating = draw(hnp.arrays(float, (len(people), len(fabrics), len(loads)), elements=FINITE))
    return Ratings.crossed(people, fabrics, loads, rating)


def rows_of(ratings):
    return sorted(
        (ratings.participants[p], ratings.fabrics[f], str(type(ratings.loads[k])), ratings.loads[k], y)
        for p, f, k, y in zip(ratings.participant, ratings.fabric, ratings.load, ratings.rating, strict=True)
    )


def rewritten(path, separator):
    """The same table with another separator, and decimal commas where they do not separate."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    numeric = [k for k, title in enumerate(rows[0]) if title not in ("participant", "fabric")]
    if separator != ",":
        rows[1:] = [[c.replace(".", ",") if k in numeric else c for k, c in enumerate(row)] for row in rows[1:]]
    other = path.with_name("other.csv")
    with other.open("w", encoding="utf-8-sig", newline="") as file:
        csv.writer(file, delimiter=separator, lineterminator="\r\n").writerows(rows)
    return other


@FEW
@given(tables_of_ratings(), st.sampled_from(",;\t"))
def test_ratings_survive_a_file(tmp_path_factory, ratings, separator):
    path = tmp_path_factory.mktemp("ratings") / "ratings.csv"
    path.write_text(ratings_csv(ratings), encoding="utf-8")
    assert rows_of(Ratings.read(path)) == rows_of(ratings)
    assert rows_of(Ratings.read(rewritten(path, separator))) == rows_of(ratings)
