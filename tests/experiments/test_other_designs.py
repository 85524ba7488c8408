"""Choices of the next touch beside those of QUEST+ and ADO on a psychometric function with a graded answer.

Both sum over a grid of answers and of parameters. They are optional: without them, a dense sum of this file stands for
them. A rating is normal about lapse-free Phi((x - place) / width) on a scale of five units.
"""

from __future__ import annotations

import builtins

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ndtr
from scipy.stats import norm

from softness_bayes.experiments.information import single_gains

TRIALS, NOISE = 60, 0.4
STIMULI = np.linspace(-3.0, 3.0, 13)
PLACES, WIDTHS = np.linspace(-2.0, 2.0, 41), np.geomspace(0.3, 3.0, 15)
ANSWERS = np.linspace(-2.5, 7.5, 401)


def mean(x, place, width):
    return 5.0 * ndtr((x - place) / width)


def log_probability(x, y, place, width):
    """Return the log probability of a cell of the grid of answers."""
    return norm.logpdf(y, mean(x, place, width), NOISE) + np.log(ANSWERS[1] - ANSWERS[0])


class Dense:
    """Sums over the grids, with the same steps as the peers."""

    def __init__(self):
        place, width = (part.ravel() for part in np.meshgrid(PLACES, WIDTHS, indexing="ij"))
        self.log_likely = log_probability(STIMULI[:, None, None], ANSWERS, place[:, None], width[:, None])
        self.weight = np.full(place.size, 1.0 / place.size)

    @property
    def gains(self):
        likely = np.exp(self.log_likely)
        marginal = np.einsum("xpy,p->xy", likely, self.weight)
        given = np.einsum("xpy,xpy,p->x", likely, self.log_likely, self.weight)
        return given - (marginal * np.log(np.maximum(marginal, 1e-300))).sum(axis=1)

    def tell(self, stimulus, answer):
        self.weight = self.weight * np.exp(self.log_likely[stimulus, :, answer])
        self.weight /= self.weight.sum()


class Ado(Dense):
    """The engine of adopy."""

    def __init__(self):
        for name in ("int", "float", "bool"):  # adopy names what NumPy 2 no longer has
            if not hasattr(np, name):
                self.patch.setattr(np, name, getattr(builtins, name), raising=False)
        base = pytest.importorskip("adopy.base", reason="adopy is not installed")
        task = base.Task(designs=["x"], responses=["y"])
        model = base.Model(task, params=["place", "width"], func=log_probability)
        grid = {"place": PLACES, "width": WIDTHS}
        self.engine = base.Engine(
            task, model, {"x": STIMULI}, grid, {"y": ANSWERS}, noise_ratio=1e-15, dtype=np.float64
        )

    @property
    def gains(self):
        return np.asarray(self.engine.mutual_info)

    def tell(self, stimulus, answer):
        self.engine.update({"x": STIMULI[stimulus]}, {"y": ANSWERS[answer]})


class QuestPlus(Dense):
    """questplus, with the probabilities of graded answers; it says the expected entropy of the best stimulus alone."""

    def __init__(self):
        quest = pytest.importorskip("questplus", reason="questplus is not installed")
        xarray = pytest.importorskip("xarray")
        parameters = {"mean": PLACES, "sd": WIDTHS, "lower_asymptote": [0.0], "lapse_rate": [0.0]}
        self.quest = quest.QuestPlus(
            stim_domain={"intensity": STIMULI}, param_domain=parameters, outcome_domain={"response": ["Yes", "No"]},
            func="norm_cdf", stim_scale="linear",
        )  # fmt: skip
        super().__init__()
        shape = STIMULI.size, PLACES.size, WIDTHS.size, 1, 1, ANSWERS.size
        likely = np.moveaxis(np.exp(self.log_likely).reshape(shape), -1, 0)
        coordinates = {"response": np.arange(ANSWERS.size), "intensity": STIMULI, **self.quest.param_domain}
        self.quest.likelihoods = xarray.DataArray(likely, coords=coordinates, dims=list(coordinates))
        self.quest.outcome_domain = {"response": np.arange(ANSWERS.size)}

    @property
    def gains(self):
        chosen = self.quest.next_stim["intensity"] == STIMULI
        entropy = float(-(self.quest.posterior * np.log(self.quest.posterior.clip(1e-300))).sum())
        return np.where(chosen, entropy - self.quest.entropy, -np.inf)

    def tell(self, stimulus, answer):
        self.quest.update(stim={"intensity": STIMULI[stimulus]}, outcome={"response": answer})


@pytest.mark.parametrize("peer", [Dense, Ado, QuestPlus])
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_every_choice_is_that_of_a_peer(peer, rng, monkeypatch):
    peer.patch = monkeypatch
    other = peer()
    place, width = (part.ravel() for part in np.meshgrid(PLACES, WIDTHS, indexing="ij"))
    means, weight = mean(STIMULI[:, None], place, width).T, np.full(place.size, 1.0 / place.size)
    same = 0
    for _ in range(TRIALS):
        gains, theirs = single_gains(means, np.array([[NOISE]]), weight=weight), other.gains
        known = np.isfinite(theirs)
        assert_allclose(gains[known], theirs[known], atol=1e-4)
        k = int(theirs.argmax())
        same += theirs[k] - theirs[int(gains.argmax())] < 2e-4  # a tie within both errors
        answer = int(np.abs(ANSWERS - rng.normal(mean(STIMULI[k], 0.4, 0.9), NOISE)).argmin())
        other.tell(k, answer)
        weight = weight * norm.pdf(ANSWERS[answer], means[:, k], NOISE)
        weight /= weight.sum()
    assert same == TRIALS


def test_a_wrong_noise_chooses_otherwise():
    """The control: gains within 1e-4 are those of this noise alone."""
    place, width = (part.ravel() for part in np.meshgrid(PLACES, WIDTHS, indexing="ij"))
    means = mean(STIMULI[:, None], place, width).T
    gains = single_gains(means, np.array([[1.05 * NOISE]]))
    assert np.abs(gains - Dense().gains).max() > 1e-2
