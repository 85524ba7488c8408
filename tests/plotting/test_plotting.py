"""Figures, by the data that their artists carry."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.base.readable import chance
from softness_bayes.checking.inflection import Inflection, find_inflection
from softness_bayes.likelihood.scales import RATING_SCALES, Scale
from softness_bayes.plotting import rating
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.plotting.parameters import MOST_STEPS, corner, prior, rank, trace
from softness_bayes.plotting.rating import Observed, observed_ratings
from softness_bayes.plotting.response import inflection, response
from softness_bayes.plotting.style import USUAL, save
from support.figures import (
    FABRICS,
    FINGER_RADIUS,
    LOADS,
    artist,
    drawn,
    invented_curves,
    invented_draws,
    invented_run,
    outline,
)  # fmt: skip


@pytest.mark.parametrize("draws", [1, 60])
def test_response_shows_the_quantiles_of_every_load(draws: int) -> None:
    loads = LOADS["mixture"]
    curves = invented_curves(loads, draws)
    found = find_inflection(curves, 0.0, (FABRICS.min(), FABRICS.max()))
    figure = drawn(response(invented_run(loads, curves), USUAL))
    panels = {artist(figure, f"median/{load}").axes for load in loads}
    assert len(panels) == len(loads)
    # each panel and its margin, nothing else
    assert len(figure.axes) == 2 * len(loads)
    for index, load in enumerate(loads):
        rate = curves.total_rate[:, index]
        median = artist(figure, f"median/{load}")
        assert_allclose(median.get_xdata(), curves.modulus / 1e3)
        assert_allclose(median.get_ydata(), np.median(rate, axis=0))
        for level, limits in ((50, (0.25, 0.75)), (90, (0.05, 0.95))):
            assert_allclose(outline(artist(figure, f"band{level}/{load}")), np.quantile(rate, limits, axis=0))
        assert_allclose(artist(figure, f"fabrics/{load}").get_xdata(), FABRICS / 1e3)
        share = np.mean(found.outcome[:, index] == 1)
        assert artist(figure, f"probability/{load}").get_text().startswith(f"turning point {chance(share)}")
        # the strip spans the part of the grid with a/R > 0.5
        beyond = curves.modulus[np.median(curves.radius[:, index], axis=0) > 0.5 * FINGER_RADIUS]
        strip = artist(figure, f"hertz/{load}").get_paths()[0].vertices[:, 0]
        assert_allclose([strip.min(), strip.max()], [beyond.min() / 1e3, beyond.max() / 1e3])


def test_ratio_follows_every_draw_on_its_own_axis() -> None:
    curves = invented_curves(LOADS["one"], 5)
    # one curve of the ratio for all draws: on that axis their spread must vanish
    ratio = curves.modulus / curves.skin_modulus
    same = curves._replace(total_rate=100.0 * np.log1p(ratio))
    figure = drawn(response(invented_run(LOADS["one"], same), USUAL, against_ratio=True))
    median = artist(figure, "median/1 N")
    assert_allclose(median.get_ydata(), 100.0 * np.log1p(median.get_xdata()), rtol=2e-3, atol=0.2)
    low, high = outline(artist(figure, "band90/1 N"))
    assert_allclose(low, high, rtol=5e-3, atol=0.2)
    assert median.get_xdata()[0] == pytest.approx(ratio[:, 0, 0].max())
    expected = np.median(FABRICS[:, None] / curves.skin_modulus[:, 0, 0], axis=1)
    assert_allclose(artist(figure, "fabrics/1 N").get_xdata(), expected)


def test_silence_is_drawn_without_an_inflection() -> None:
    loads = LOADS["mixture"]
    curves = invented_curves(loads, 3, loudness=0.0)
    run = invented_run(loads, curves)
    above = drawn(response(run, USUAL))
    assert artist(above, f"fabrics/{loads[0]}").axes.get_ylim() == (0.0, 1.0)
    figure = drawn(inflection(run, USUAL))
    for load in loads:
        assert artist(figure, f"silent/{load}").get_width() == 100
        assert artist(figure, f"interior/{load}").get_width() == 0
        assert not artist(figure, f"density/{load}").get_data().values.any()
        assert artist(above, f"probability/{load}").get_text() == "turning point <1 %\nsilent >99 %"
    assert not figure.findobj(lambda each: str(each.get_gid()).startswith(("median", "interval")))


def test_inflection_has_the_area_of_its_probability() -> None:
    loads = LOADS["mixture"]
    rng = np.random.default_rng(3)
    outcome = rng.choice([0, 1, 2], size=(400, len(loads)), p=[0.3, 0.6, 0.1]).astype(np.int8)
    outcome[:, 0] = 0
    place = np.where(outcome == 1, 5e4 * np.exp(0.4 * rng.standard_normal(outcome.shape)), np.nan)
    found = Inflection(outcome, place, place, place, place, outcome == 1)
    figure = drawn(inflection(invented_run(loads, inflections=lambda: found), USUAL))
    assert len(figure.axes) == 2 * len(loads)
    for index, load in enumerate(loads):
        data = artist(figure, f"density/{load}").get_data()
        share = np.mean(outcome[:, index] == 1)
        assert np.sum(data.values * np.diff(np.log10(data.edges))) == pytest.approx(share)
        widths = [artist(figure, f"{name}/{load}").get_width() for name in ("none", "interior", "silent")]
        assert_allclose(widths, [100 * np.mean(outcome[:, index] == kind) for kind in (0, 1, 2)])
    known = place[outcome[:, 1] == 1, 1] / 1e3
    bar = artist(figure, f"interval/{loads[1]}").get_xdata()
    assert_allclose(bar, np.quantile(known, [0.05, 0.95]))
    assert_allclose(artist(figure, f"median/{loads[1]}").get_xdata(), np.median(known))


def test_a_failed_draw_leaves_a_gap() -> None:
    curves = invented_curves(LOADS["one"], 8)
    rate = curves.total_rate.copy()
    rate[2, 0, 40] = np.nan
    known = {"inflections": invented_run(LOADS["one"], curves).inflections}
    figure = drawn(response(invented_run(LOADS["one"], curves._replace(total_rate=rate), **known), USUAL))
    median = artist(figure, "median/1 N").get_ydata()
    assert np.flatnonzero(np.isnan(median)).tolist() == [40]
    everywhere = curves._replace(total_rate=np.full_like(rate, np.nan))
    drawn(response(invented_run(LOADS["one"], everywhere, **known), USUAL))


def test_observed_ratings_do_not_depend_on_the_scale_of_a_participant() -> None:
    rng = np.random.default_rng(4)
    participants, conditions = 6, 4
    truth = np.array([0.0, 0.5, 1.0, 2.0])
    noise = 0.2 * rng.standard_normal((participants, conditions))
    scale = rng.standard_normal(participants)
    who, what = (index.ravel() for index in np.indices((participants, conditions)))
    summary = [
        observed_ratings(np.exp(truth + noise + s[:, None]).ravel(), what, who, FABRICS[[0, 1, 2, 2]], [0, 0, 1, 1])
        for s in (np.zeros(participants), scale - scale.mean())
    ]
    assert summary[0].limits is summary[1].limits is None
    for plain, scaled in zip(*(one[:-1] for one in summary), strict=True):
        assert_allclose(scaled, plain)
    assert_allclose(summary[0].mean, np.exp(truth + noise.mean(axis=0)))
    aligned = noise - noise.mean(axis=1, keepdims=True)
    spread = aligned.std(axis=0, ddof=1)
    assert_allclose(np.log(summary[0].high / summary[0].mean), spread)
    assert_allclose(np.log(summary[0].mean / summary[0].low), spread)


def test_observed_ratings_stand_gaps_repeats_and_nobody() -> None:
    # two participants whose scales differ by 8; the second left out the condition that the first rates high
    rating = [1.0, 4.0, 8.0, np.nan, 2.0, 8.0]
    observed = observed_ratings(rating, [0, 1, 0, 1, 2, 2], [0, 0, 1, 1, 0, 0], FABRICS, [0, 0, 0])
    assert observed.participants.tolist() == [2, 1, 1]
    assert_allclose(observed.mean[1:] / observed.mean[0], [4.0, 4.0])
    assert np.isnan(observed.low[1:]).all()
    nobody = observed_ratings([1.0], [0], [0], FABRICS, [0, 0, 0])
    assert np.isnan(nobody.mean[1:]).all()
    with pytest.raises(InputError, match="positive"):
        observed_ratings([0.0], [0], [0], FABRICS, [0, 0, 0])


@pytest.mark.parametrize("scale", RATING_SCALES.values(), ids=RATING_SCALES)
def test_rating_shows_prediction_and_data(scale: Scale, monkeypatch) -> None:
    loads = LOADS["mixture"]
    curves = invented_curves(loads, 30)
    unit = min(1.0, 0.1 * scale.drawn[1])  # places on a slider are shares
    ratings = unit * (1.0 + curves.total_rate / 100.0)
    mean = unit * np.array([1.0, 2.0, np.nan, 3.0])
    observed = Observed(
        FABRICS[[0, 1, 2, 0]],
        np.array([0, 0, 0, 2]),
        mean,
        mean / 2,
        mean * [2, np.nan, 1, 2],
        np.ones(4, int),
    )
    monkeypatch.setattr(rating, "observed_of", lambda run: observed)
    figure = drawn(rating.rating(invented_run(loads, curves, scale=scale, typical_ratings=lambda: ratings), USUAL))
    assert len(figure.axes) == len(loads)
    assert {axes.get_yscale() for axes in figure.axes} == {scale.axis}
    assert_allclose(artist(figure, "median/3 mm").get_ydata(), np.median(ratings[:, 1], axis=0))
    points = artist(figure, "ratings/1 mm")
    assert_allclose(points.get_xydata(), np.column_stack([FABRICS[:2] / 1e3, mean[:2]]))
    assert_allclose(artist(figure, "spread/1 mm").get_segments()[0][:, 1], [0.5 * unit, 2.0 * unit])
    assert len(artist(figure, "ratings/3 mm").get_xdata()) == 0
    assert figure.axes[0].get_xlabel().endswith("[kPa]")


@pytest.mark.parametrize(("dimension", "draws"), [(1, 500), (2, 30), (10, 9000)])
def test_corner_has_a_panel_for_every_pair(dimension: int, draws: int) -> None:
    run, labels = invented_draws(np.exp(np.random.default_rng(5).standard_normal((1, draws, dimension))))
    figure = drawn(corner(run, USUAL, every=True))
    assert len(figure.axes) == dimension**2
    below = [artist(figure, f"corner/{dimension - 1}/{k}").get_xlabel() for k in range(dimension)]
    assert below == [label.replace(" [", "\n[") for label in labels]
    assert artist(figure, f"corner/0/{dimension - 1}").has_data() == (dimension == 1)


def test_corner_says_what_it_cannot_draw() -> None:
    values = np.random.default_rng(6).standard_normal((1, 50, 2))
    for draws, match in ((values[:, :2], "more draws"), (values * [1, 0], "does not vary")):
        with pytest.raises(InputError, match=match):
            corner(invented_draws(draws)[0], USUAL)


def test_prior_and_posterior_are_densities() -> None:
    rng = np.random.default_rng(7)
    run, labels = invented_draws(rng.standard_normal((1, 4000, 5)), 3.0 * rng.standard_normal((1, 300, 5)))
    figure = drawn(prior(run, USUAL))
    assert [axes.get_xlabel() for axes in figure.axes] == labels
    for place in range(5):
        for name in ("posterior", "prior"):
            data = artist(figure, f"{name}/{place}").get_data()
            assert np.sum(data.values * np.diff(data.edges)) == pytest.approx(1.0, abs=0.01)
    drawn(prior(invented_draws(np.ones((1, 1, 5)))[0], USUAL))


def test_traces_and_ranks_tell_a_stray_ensemble() -> None:
    rng = np.random.default_rng(8)
    draws = rng.standard_normal((12, 2500, 3))
    draws[:4, :, 0] += 3.0
    run, labels = invented_draws(draws, ensemble=np.repeat([0, 1, 2], 4))
    traces = drawn(trace(run, USUAL))
    line = artist(traces, "median/1/2")
    assert line.get_xdata().size == MOST_STEPS
    assert_allclose(line.get_ydata(), np.median(draws[8:, line.get_xdata(), 1], axis=0))
    assert [axes.get_ylabel() for axes in traces.axes] == labels
    ranks = drawn(rank(run, USUAL))
    heights = [artist(ranks, f"rank/{place}/0").get_data().values for place in range(3)]
    assert heights[0].max() > 2.0
    assert_allclose(heights[1:], 1.0, atol=0.2)


def test_saved_files_are_the_same_bytes_every_time(tmp_path) -> None:
    for name in ("first", "second.v2"):
        figure = FIGURES["response"](invented_run())
        paths = save(figure, tmp_path / name, ("png", "pdf", "svg"))
        assert [path.name for path in paths] == [f"{name}.png", f"{name}.pdf", f"{name}.svg"]
    for suffix in ("png", "pdf", "svg"):
        assert (tmp_path / f"first.{suffix}").read_bytes() == (tmp_path / f"second.v2.{suffix}").read_bytes()
    with pytest.raises(InputError, match="'bmp'"):
        save(figure, tmp_path / "third", ("bmp",))
