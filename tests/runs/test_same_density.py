"""A run goes on if its density is the same within numerical errors, whatever the kind of ratings, and not otherwise."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.likelihood.error_laws import NORMAL, STUDENT
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.runs.identity import identity, require_density
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import EnsembleState
from softness_bayes.sampler.sampling import Settings
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import MENDED


def walkers(resolution, errors):
    """The density of few simulated ratings, in whole numbers or exact, and walkers evaluated a few at a time."""
    fabrics = Fabrics(tuple("abcdefghijkl"), effective_modulus=np.geomspace(1e4, 7e6, 12))
    loads, truth = (Indentation(2e-3), Indentation(3e-3)), usual_values(MENDED, given={"sigma_0": 8.0})
    how = {"participants": 6, "mu": np.log(4), "resolution": resolution}
    made = simulate_ratings(np.random.default_rng(2), fabrics, loads, truth, **how)
    assert (made.ratings.rating == 0).any() == (resolution > 0)
    held = PAPER_CHANNELS._asdict() | {name: truth[name] for name in ("alpha", "beta", "eps")}
    density = build(Experiment(made.ratings, fabrics, ()), ModelOptions(fix=held, errors=errors)).posterior
    density = density.for_sampling
    z = density.draw_start(np.random.default_rng(1), 400)
    z = z[np.argsort(-density(z))[:96]]
    return density, z, np.concatenate([density(part) for part in np.split(z, 8)])


def state_of(z, values):
    """What is compared of a run: the state of one ensemble, at z."""
    ensemble = EnsembleState(z, values, np.random.RandomState(1).get_state())
    return SimpleNamespace(ensembles=(ensemble,), map=TriangularMap.identity(z.shape[1]))


@pytest.mark.parametrize(("resolution", "errors"), [(0.0, None), (1.0, NORMAL), (1.0, STUDENT)])
def test_a_run_goes_on_although_other_points_are_evaluated_together(resolution, errors):
    density, z, values = walkers(resolution, errors)
    assert_allclose(density(z), values, rtol=1e-11)
    require_density(density, state_of(z, values))
    with pytest.raises(InputError, match="has the software changed"):
        require_density(density, state_of(z, values + 0.01))


def test_a_run_goes_on_where_the_last_digits_of_the_rheobase_are_others(monkeypatch):
    fabrics, loads = Fabrics(tuple("abcd"), effective_modulus=np.geomspace(1e4, 7e6, 4)), (Indentation(2e-3),)
    made = simulate_ratings(np.random.default_rng(2), fabrics, loads, usual_values(MENDED), participants=3)
    data, plain = Experiment(made.ratings, fabrics, ()), ParameterSpace.rheobase_shift

    def described(off):
        monkeypatch.setattr(ParameterSpace, "rheobase_shift", lambda *of: plain(*of) + off)
        return identity(data, build(data, ModelOptions()).posterior, Settings(), {})

    here = described(0.0)
    assert "Bent(" in here["coordinate of alpha"]
    assert described(1e-13) == here
    assert described(0.01) != here
