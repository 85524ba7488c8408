"""Figures and words of a result with more loads than are shown one by one."""

import numpy as np
import pytest

from softness_bayes.defaults import MOST_SHOWN, in_words, shown_of
from softness_bayes.plotting import FIGURES, USUAL, contents
from softness_bayes.touch.contact import Force
from support.figures import finished_run


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


@pytest.fixture
def few_shown(monkeypatch):
    """The two loads of a finished run are more than are shown."""
    monkeypatch.setattr(contents, "shown_of", lambda count: [1])
    return finished_run()


@pytest.mark.parametrize("name", ["response", "response_ratio", "rating", "rating_ratio", "inflection"])
def test_a_figure_says_how_many_loads_it_leaves_out(name, few_shown):
    figure = FIGURES[name](few_shown, USUAL)
    assert figure.get_suptitle() == "1 of 2 loads, evenly spread"
    named = {artist.get_gid() for axes in figure.axes for artist in axes.get_children()}
    assert not any(gid and gid.endswith("/1 mm") for gid in named)
    assert any(gid and gid.endswith("/0.5 N") for gid in named) or name == "inflection"


def test_the_ratings_that_are_drawn_are_those_of_the_load(few_shown):
    some = contents._Some.of(few_shown)
    every = contents._observed(few_shown)
    assert some.loads == [Force(0.5)]
    assert set(some.observed().load) == {0}
    np.testing.assert_array_equal(some.observed().mean, every.mean[every.load == 1])
