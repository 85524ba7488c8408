"""Likelihood of recorded afferents beside laws written out, and its contract."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.stats import kstest, nbinom, norm

from softness_bayes.data import Afferents
from softness_bayes.likelihood.contract import NO_RESPONSE, Parameters
from softness_bayes.model.recordings.likelihood import (
    SILENT,
    RecordedRates,
    RecordingModel,
    draw_counts,
    less_probability,
    log_probability,
)
from softness_bayes.model.recordings.response import ProbedTouches
from softness_bayes.touch.contact import Force

NAN = float("nan")
POINT = Parameters(
    b_rec=8e3, m_rec=4.0, alpha_rec=40.0, beta_rec=2e-5, rest_rec=0.97, sd_rate=6.0, tau_afferent=0.3, fano=1.8
)
ROWS = 9


def table(counts=False, named=True):
    """Three afferents, two of them in several rows, one of these silent, and a mean of several with a stated error."""
    afferent = np.array([0, 0, 0, 0, 1, 1, 2, -1, -1]) if named else np.full(ROWS, -1)
    rate = np.array([0.0, 45.0, 90.0, 120.0, 30.0, 60.0, 25.0, 40.0, 70.0])
    counted = np.arange(ROWS) % 2 == 1 if counts else np.zeros(ROWS, bool)
    return Afferents(
        ("a", "b", "c") if named else (),
        afferent,
        (Force(0.1),) * 4 + (Force(0.2),) * 5,
        np.array([0.0, 200.0, 500.0, 690.0, 0.0, 200.0, 0.0, 80.0, 300.0]),
        np.zeros(ROWS),
        np.where(counted, np.round(rate * 0.5) / 0.5, rate),
        np.where(np.arange(ROWS) == 7, 4.0, 1.0),
        np.where(np.arange(ROWS) == 7 - counts, 8.0, NAN) if not counts else np.full(ROWS, NAN),
        np.where(counted, 0.5, NAN),
        np.arange(2, 2 + ROWS),
    )


def likelihood(data):
    touches = ProbedTouches(data.loads, data.curvature, data.distance)
    return RecordedRates(data, touches, RecordingModel.of(data))


def row_density(data, i, rate):
    """Density of one row at an expected rate, written out for mean rates and over-dispersed counts."""
    if not np.isnan(data.count[i]):
        mean = (rate + SILENT) * data.window[i]
        return nbinom.pmf(data.count[i], mean / (POINT.fano - 1.0), 1.0 / POINT.fano)
    sd = POINT.sd_rate if np.isnan(data.sd[i]) else data.sd[i] / np.sqrt(data.n[i])
    if data.rate[i] == 0.0:
        return norm.cdf(0.0, rate, sd)
    return norm.pdf(data.rate[i], rate, sd)


@pytest.mark.parametrize("counts", [False, True])
def test_sensitivities_are_integrated_out(counts):
    data = table(counts)
    term = likelihood(data)
    rate = term.rate(POINT)
    expected = 0.0
    for j in (0, 1, 2):
        rows = np.flatnonzero(data.afferent == j)

        def joint(z, rows=rows):
            factor = np.exp(POINT.tau_afferent * z - 0.5 * POINT.tau_afferent**2)
            return norm.pdf(z) * np.prod([row_density(data, i, rate[i] * factor) for i in rows])

        peak = max(map(joint, np.linspace(-6, 6, 241)))
        whole = quad(lambda z, of=joint, peak=peak: of(z) / peak, -8, 8, limit=400, points=[-2, 0, 2])[0]
        expected += np.log(whole * peak)
    expected += sum(np.log(row_density(data, i, rate[i])) for i in np.flatnonzero(data.afferent < 0))
    assert term.log_likelihood(NO_RESPONSE, POINT) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("counts", [False, True])
def test_contract(counts):
    """Batches, the chain rule, left-out rows and exact draws, as for every likelihood."""
    data = table(counts)
    term = likelihood(data)
    batch = POINT.replace(beta_rec=np.array([1.5e-5, 2e-5]), tau_afferent=np.array([0.5, 0.3]))
    both = term.log_likelihood(NO_RESPONSE, batch)
    assert both[1] == pytest.approx(term.log_likelihood(NO_RESPONSE, POINT), abs=1e-9)
    alone = term.left_out(NO_RESPONSE, POINT)
    for i in (1, 4, 6, 8):
        rest = term.without(np.arange(ROWS) == i)
        assert alone.log_density[i] == pytest.approx(both[1] - rest.log_likelihood(NO_RESPONSE, POINT), abs=2e-3)
        if not counts:
            grid = np.append(0.0, np.linspace(1e-9, data.rate[i], 81))
            others = [term.with_values(np.where(np.arange(ROWS) == i, y, data.rate)) for y in grid]
            density = np.exp([one.left_out(NO_RESPONSE, POINT).log_density[i] for one in others])
            below = density[0] + np.trapezoid(density[1:], grid[1:])
            assert below == pytest.approx(alone.below[i], abs=3e-3)
    many = POINT.each(lambda value: np.full(4000, value))
    rng = np.random.default_rng(3)
    drawn = term.draw_effects(rng, NO_RESPONSE, many).log_factor
    # replicates of new afferents, whose sensitivities are then drawn given them, have the law of new ones
    new = term.new_effects(rng, many, (4000,))
    assert np.exp(new.log_factor).mean() == pytest.approx(1.0, abs=0.02)
    assert drawn.std(axis=0)[0] < 0.3 * new.log_factor.std(axis=0)[0]
    made = term.replicate(rng, term.rate(many), many, new)
    again = np.array(
        [term.with_values(values).draw_effects(rng, NO_RESPONSE, POINT).log_factor for values in made[:400]]
    )
    assert kstest(again[:, 0], new.log_factor[:, 0]).pvalue > 1e-3


@pytest.mark.parametrize("fano", [0.3, 0.8, 1.0, 1.5, 4.0])
@pytest.mark.parametrize("mean", [0.05, 3.0, 40.0])
def test_counts_have_a_law_of_their_dispersion(fano, mean):
    k = np.arange(0.0, 400.0)
    law = np.exp(log_probability(k, np.full(1, mean), np.full(1, fano)))
    assert law.sum() == pytest.approx(1.0, abs=1e-6)
    assert_allclose(np.cumsum(law) - law, less_probability(k, np.full(1, mean), np.full(1, fano)), atol=1e-5)
    average = (k * law).sum()
    drawn = draw_counts(np.random.default_rng(2), np.full(20_000, mean), np.full(1, fano))
    assert drawn.mean() == pytest.approx(average, abs=5.0 * np.sqrt(fano * mean / 2e4) + 1e-3)
    if fano >= 1.0:
        assert average == pytest.approx(mean, rel=1e-5)
        assert_allclose(
            law[:60], nbinom.pmf(k[:60], mean / max(fano - 1.0, 1e-9), 1.0 / max(fano, 1 + 1e-9)), atol=1e-6
        )
    elif mean > 10:
        assert average == pytest.approx(mean - 0.5 * (1.0 - fano), abs=0.02)
        assert ((k - average) ** 2 * law).sum() / mean == pytest.approx(fano, rel=0.05)


def test_silence_has_a_finite_likelihood():
    """Where no receptor fires, spikes are improbable, but not impossible, whatever the dispersion."""
    data = table(counts=True)
    silent = POINT.replace(alpha_rec=5.0)
    assert not likelihood(data).rate(silent).any()
    for fano in (0.15, 1.0, 5.0):
        value = likelihood(data).log_likelihood(NO_RESPONSE, silent.replace(fano=fano))
        assert np.isfinite(value)
        assert value < likelihood(data).log_likelihood(NO_RESPONSE, POINT) - 20


def test_parameters_follow_from_the_table():
    assert RecordingModel.of(table(named=False)).needs[-1] == "sd_rate"
    assert "tau_afferent" not in RecordingModel.of(table(named=False)).needs
    assert {"fano", "tau_afferent", "sd_rate"} <= {*RecordingModel.of(table(counts=True)).needs}
    stated = dataclasses.replace(table(named=False), sd=np.full(ROWS, 5.0))
    assert RecordingModel.of(stated, ("b", "sigma_0")).needs == ("b", "m_rec", "alpha_rec", "beta_rec", "sigma_0")
