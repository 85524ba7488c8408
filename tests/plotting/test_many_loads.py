"""Figures and words of a result with more loads than are shown one by one."""

from dataclasses import replace

import numpy as np
import pytest

from softness_bayes.base.defaults import MOST_SHOWN, in_words, shown_of
from softness_bayes.checking.layout import LOAD_GROUP
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.plotting.rating import observed_of
from softness_bayes.plotting.style import USUAL
from softness_bayes.results import result
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.load_groups import NEAR, LoadGroup, LoadGroups, groups_of


def test_few_are_all_shown_and_many_keep_their_ends():
    assert shown_of(0) == []
    assert shown_of(MOST_SHOWN) == list(range(MOST_SHOWN))
    found = shown_of(300)
    assert len(found) == MOST_SHOWN
    assert (found[0], found[-1]) == (0, 299)
    assert np.ptp(np.diff(found)) <= 1


def test_many_names_are_counted():
    assert in_words(["1 N", "2 N"]) == "1 N, 2 N"
    assert in_words([f"{k} N" for k in range(1, 31)]) == "30 loads, 1 N to 30 N"


def test_few_loads_are_alone():
    loads = [Indentation(1e-3), *(Force(1.0 + 0.001 * k) for k in range(MOST_SHOWN - 1))]
    found = groups_of(loads)
    assert found.called == tuple(loads)
    assert found.names == [str(load) for load in loads]
    assert not found.merged
    assert found.sentence == ""


def test_measured_loads_are_grouped_about_those_that_were_meant(rng):
    meant = np.repeat([0.5, 1.0, 2.0], 40)
    newton = np.sort(meant * np.exp(rng.uniform(-0.1, 0.1, meant.size)))
    found = groups_of([Indentation(1e-3), *map(Force, newton)])
    assert found.of.tolist() == [0, *np.repeat([1, 2, 3], 40)]
    np.testing.assert_allclose([found.called[k].load.newton for k in (1, 2, 3)], [0.5, 1.0, 2.0], rtol=0.03)
    assert found.called[0] == Indentation(1e-3)
    assert found.names[1] == f"{newton[0]:.3g} to {newton[39]:.3g} N"
    assert found.sentence == "121 loads in 4 groups"


def test_groups_are_narrow_or_as_many_as_are_shown(rng):
    for spread in (0.2, 3.0):
        newton = np.sort(np.exp(rng.uniform(0, spread, 3000)))
        found = groups_of([*map(Force, newton)])
        ends = [(newton[found.of == k].min(), newton[found.of == k].max()) for k in range(found.at.size)]
        assert found.at.size <= MOST_SHOWN
        assert found.at.size == MOST_SHOWN or max(high / low for low, high in ends) < NEAR
        assert (np.diff(found.of) >= 0).all()
        assert len(set(found.names)) == found.at.size
        assert (found.of[found.at] == np.arange(found.at.size)).all()


@pytest.mark.parametrize("most", [1, 2, 3])
def test_kinds_of_loads_are_never_merged(most):
    found = groups_of([*(Indentation(1e-3 * (1 + 0.01 * k)) for k in range(5)), Force(1.0)], most)
    assert found.of[-1] not in found.of[:-1]


@pytest.fixture
def merged(report_run, monkeypatch):
    """The two loads of a finished run are a group, whose curves are those of the second one."""
    both = LoadGroups(np.array([0, 0]), np.array([1]), (LoadGroup(Force(0.5), "a to b N"),))
    monkeypatch.setattr(result, "groups_of", lambda loads: both)
    made = report_run("ratings")
    tree = made.tree.copy()
    for group in ("predictions", "inflection", "prior_inflection"):
        stored = tree[group].to_dataset()
        tree[group].dataset = stored.isel(load=[1]).drop_vars("load").rename_dims(load=LOAD_GROUP)
    return replace(made, tree=tree)


@pytest.mark.parametrize("name", ["response", "response_ratio", "rating", "rating_ratio", "inflection"])
def test_a_figure_says_that_loads_are_grouped(name, merged):
    figure = FIGURES[name](merged, USUAL)
    assert figure.get_suptitle() == "2 loads in 1 group; curves are at the middle load of each"
    assert any(axes.get_title(loc) == "Force a to b N" for axes in figure.axes for loc in ("left", "center"))
    named = {artist.get_gid() for axes in figure.axes for artist in axes.get_children()}
    assert any(gid and gid.endswith("/a to b N") for gid in named) or name == "inflection"


def test_the_ratings_that_are_drawn_are_those_of_the_group(merged):
    observed = observed_of(merged)
    constant, rating = merged.group("constant_data"), merged.group("observed_data")["rating"].values
    first = rating[constant["fabric_index"].values == 0]
    assert observed.mean[0] == pytest.approx(np.exp(np.log(first).mean()), rel=0.2)
    assert set(observed.load) == {0}
