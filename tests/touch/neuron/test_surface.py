"""The firing-rate surface against exact rates, at its borders and where it ends."""

import json
from functools import cache
from importlib import resources

import numpy as np
import pytest

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.tools import surface_build
from softness_bayes.touch.neuron import firing
from softness_bayes.touch.neuron import surface as module
from softness_bayes.touch.neuron.cells import fold
from softness_bayes.touch.neuron.firing import exact_curves
from softness_bayes.touch.neuron.membrane import (
    CONNOR_STEVENS,
    HODGKIN_HUXLEY,
    PAPER_CHANNELS,
    Channels,
)
from softness_bayes.touch.neuron.rate import Onset, firing_rate
from softness_bayes.touch.neuron.surface import DESIGNS, ERRORS, TABLES, FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from support.onsets import CORNER, EXACT_ENOUGH

# exact rates of Hodgkin's and Huxley's membrane take twice as long
LONG_ORBITS = pytest.mark.parametrize(
    "surface", ["connor-stevens", pytest.param("hodgkin-huxley", marks=pytest.mark.slow)], indirect=True
)


@pytest.fixture(scope="module", params=sorted(DESIGNS))
def surface(request: pytest.FixtureRequest) -> FiringSurface:
    return FiringSurface.load(DESIGNS[request.param].membrane)


@pytest.fixture(scope="module")
def connor_stevens() -> FiringSurface:
    return FiringSurface.load(CONNOR_STEVENS)


@pytest.fixture(scope="module")
def born(births: tuple[Channels, Onset]) -> tuple[Channels, Onset]:
    """Two channel vectors of the surface and their onsets, folds of orbits."""
    channels, begin = births
    return Channels(*(c[1:] for c in channels)), Onset(*(x[1:] for x in begin))


def test_rates_at_random_points(surface: FiringSurface, rng: np.random.Generator) -> None:
    design = surface.design
    place = rng.uniform(-1.0, 1.0, (len(design.axes), 150))
    place = place[:, ~surface.corner(place)]
    channels = design.channels_at(place)
    curve = surface.curve(channels)
    current = curve.rheobase + rng.uniform(0.05, 1.0, place.shape[1]) * (design.max_current - curve.rheobase)
    exact = firing_rate(current, channels, design.membrane, EXACT_ENOUGH)
    np.testing.assert_allclose(curve.rate(current[:, None])[:, 0], exact, atol=2.0 * surface.error.hertz)
    assert exact.min() > 1.0
    # negative control: the curve of the paper's channels is no curve of theirs
    usual = surface.curve(PAPER_CHANNELS)
    assert np.abs(usual.rate(current) - exact).max() > 5.0


def test_rheobase_is_that_of_the_fold(connor_stevens: FiringSurface, rng: np.random.Generator) -> None:
    place = rng.uniform(-1.0, 1.0, (4, 2000))
    channels = connor_stevens.design.channels_at(place[:, ~connor_stevens.corner(place)])
    found = connor_stevens.curve(channels).rheobase
    np.testing.assert_allclose(found, fold(channels, CONNOR_STEVENS).current, atol=1e-5)


def test_measured_errors_are_kept_and_meet_what_is_promised() -> None:
    folder = resources.files("softness_bayes.touch.neuron")
    measured = json.loads((folder / ERRORS).read_text())
    assert measured.keys() == DESIGNS.keys()
    # firing begins where it should, but for what lies within the distance that the allowance leaves out
    onset_current = surface_build.NEAR_JUMP
    bounds = {"of_allowance": 1.0, "relative_median": 1e-5, "relative_999": 1e-3, "onset_current": onset_current}
    for name, error in measured.items():
        assert all(error[what] <= bound for what, bound in bounds.items())
        assert error["points"] >= 100_000
        assert (error["near_border"] >= 10_000) == (DESIGNS[name].border is not None)
    assert (folder / TABLES).stat().st_size <= 2_000_000


@LONG_ORBITS
def test_a_small_measurement_agrees_with_the_kept_one(surface: FiringSurface) -> None:
    error = surface_build.measure(surface, lambda _: None, points=6, corner=0, seed=7, onsets=0)
    assert error["of_allowance"] < 1.0
    assert error["relative_median"] < 1e-5
    # negative control: a table that is wrong in the third digit fails it
    spoilt = FiringSurface(surface.design, surface.table * 1.005, surface.border, surface.error, surface.degree)
    assert surface_build.measure(spoilt, lambda _: None, points=4, corner=0, seed=7, onsets=0)["of_allowance"] > 1.0


def test_beyond_the_border_a_vector_has_its_own_exact_curve(
    connor_stevens: FiringSurface, corner_onset: Onset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(firing, "onset", lambda *_, **__: corner_onset)
    exact_curve = cache(module.exact_curve)  # the same arguments make the same curve
    monkeypatch.setattr(module, "_own_curve", exact_curve)
    together = connor_stevens.curve(Channels(*np.array([PAPER_CHANNELS, CORNER, PAPER_CHANNELS]).T))
    own = exact_curve(CORNER, CONNOR_STEVENS, connor_stevens.max_current, connor_stevens.design.nodes)
    current = np.linspace(15.0, 60.0, 50)
    np.testing.assert_array_equal(together.take(1).rate(current), own.rate(current))
    assert together.onset_rate[1] > 5.0
    assert together.onset_rate[0] == together.onset_rate[2] == 0.0
    usual = connor_stevens.curve(PAPER_CHANNELS).rate(current)
    np.testing.assert_allclose(together.take(0).rate(current), usual, rtol=1e-12, atol=1e-12)


def test_the_border_is_where_firing_stops_beginning_at_the_fold(
    connor_stevens: FiringSurface, rng: np.random.Generator
) -> None:
    others = rng.uniform(-1.0, 0.0, (3, 60))
    design = connor_stevens.design
    before = connor_stevens.before_corner(np.array([others[0], np.zeros(60), others[1], others[2]]))
    border = before + 0.0  # the place of c_K on the border
    inside = border < 1.0
    assert inside.sum() > 10
    steps = np.array([[-0.01], [0.01]])
    place = np.array([np.broadcast_to(x, (2, 60)) for x in (others[0], border + steps, others[1], others[2])])
    channels = design.channels_at(place[..., inside].reshape(4, -1))
    current = fold(channels, CONNOR_STEVENS).current + design.border.distance**2
    before, beyond = (firing_rate(current, channels, tolerance=EXACT_ENOUGH) > 0.0).reshape(2, -1)
    assert before.mean() > 0.95
    assert beyond.mean() < 0.05


@LONG_ORBITS
def test_exact_curves_of_a_batch_go_through_exact_rates(
    surface: FiringSurface,
    born: tuple[Channels, Onset],
    rng: np.random.Generator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    channels = surface.design.channels_at(rng.uniform(-0.5, 0.5, (len(surface.design.axes), 3)))
    if surface.design.membrane == HODGKIN_HUXLEY:
        channels, begin = born
        monkeypatch.setattr(firing, "onset", lambda *_: begin)
    limit = np.array([22.0, 30.0, 40.0])[: channels.c_K.size]
    exact = exact_curves(channels, surface.design.membrane, limit, expected=surface.curve(channels).rheobase)
    current = np.linspace(exact.rheobase + 0.05, limit, 7, axis=-1)
    rates = firing_rate(current, Channels(*(c[:, None] for c in channels)), surface.design.membrane, EXACT_ENOUGH)
    np.testing.assert_allclose(exact.rate(current), rates, rtol=1e-4)


def test_what_lies_outside_is_refused(surface: FiringSurface) -> None:
    for name in (Channels._fields[axis] for axis in surface.design.axes):
        low, high = surface.design.interval(name)
        for value in (0.999 * low, 1.001 * high):
            with pytest.raises(InputError, match=rf"{name} = {value:.6g} lies outside"):
                surface.curve(PAPER_CHANNELS._replace(**{name: value}))
        surface.curve(PAPER_CHANNELS._replace(**{name: low}))
    several = PAPER_CHANNELS._replace(**{Channels._fields[axis]: 0.2 for axis in surface.design.axes})
    with pytest.raises(InputError) as refused:
        surface.curve(several)
    assert all(f"{Channels._fields[axis]} = 0.2 lies outside" in str(refused.value) for axis in surface.design.axes)
    with pytest.raises(InputError, match="c_K is not finite"):
        surface.curve(PAPER_CHANNELS._replace(c_K=np.nan))
    touch = TouchParameters(1e5, 2.0, surface.max_current * 1.01, 6e-4, 9e3, *PAPER_CHANNELS)
    with pytest.raises(NumericalError, match="fix the channel multipliers"):
        surface.curves(touch.channels, touch.alpha)


@pytest.mark.slow
def test_a_rebuilt_table_is_the_shipped_one(surface: FiringSurface) -> None:
    again = surface_build.build(surface.design, lambda _: None)
    np.testing.assert_allclose(again.border, surface.border, atol=1e-5)
    place = np.random.default_rng(0).uniform(-1.0, 1.0, (len(surface.design.axes), 500))
    channels = surface.design.channels_at(place[:, ~surface.corner(place)])
    current = np.full((channels.c_K.size, 1), 30.0)
    np.testing.assert_allclose(again.curve(channels).rate(current), surface.curve(channels).rate(current), atol=1e-6)
