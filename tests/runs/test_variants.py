"""Every kind of run passes one contract: its file restores data and model, it predicts, it says what it modelled."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal, Normal, Uniform
from softness_bayes.data import Experiment
from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.likelihood.scales import AGGREGATED, STANDARDISED
from softness_bayes.model.build import build
from softness_bayes.model.fingers import finger_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.report.page import report_page
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.fitted import options_of
from softness_bayes.results.result import Result
from support.report_runs import COARSE, HELD, experiment, quickly
from support.variants import VARIANTS, cells, pressed_too


@pytest.mark.parametrize("name", VARIANTS)
def test_data_and_model_come_back_from_the_file(variant_run, tmp_path, name):
    variant, result = VARIANTS[name], variant_run(name)
    result.save(tmp_path / "run")
    assert all((tmp_path / "run" / file).is_file() for file in variant.files)
    again = Result.load(tmp_path / "run")
    options = options_of(again)
    assert options == options_of(result)
    assert ModelOptions.from_record(options.record()) == options
    for option, value in variant.options.items():
        stored = getattr(options, option, value)
        assert value.items() <= stored.items() if isinstance(value, dict) else stored == value
    assert again.tree.identical(result.tree)
    with quickly():
        one, other = (build(each, options).posterior for each in (experiment_of(again), variant.data()))
        assert one.names == other.names
        values, (stored,) = again.values(), again.group("log_likelihood_joint").data_vars.values()
        step = stored.size // 20
        theta = np.stack([values[parameter][::step] for parameter in one.names], axis=-1)
        found = one.log_likelihood(theta)
        assert_allclose(other.log_likelihood(theta), found, rtol=1e-8)
        assert_allclose(one.log_prior(theta), other.log_prior(theta), rtol=1e-8)
        if not (options.individual or options.errors is STUDENT):  # runs keep the faster integrals of the sampler
            assert_allclose(found, stored.values.T.ravel()[::step], rtol=1e-6)


@pytest.mark.parametrize("name", [name for name in VARIANTS if name != "orders"])
def test_it_predicts_ratings_of_new_raters(variant_run, name):
    with quickly():
        table = variant_run(name).predict(draws=20)
    low, high = (table[f"new_rater_rating_{end}"] for end in ("low", "high"))
    assert (high > table["typical_rating_high"]).all()
    assert (low < high).all()


@pytest.mark.parametrize("name", VARIANTS)
def test_it_says_what_it_modelled(variant_run, few_pictures, name):
    variant, result = VARIANTS[name], variant_run(name)
    assert variant.sampled <= {*result.summary().index}
    said = report_page(result) + result.provenance.rating_model.rating_note
    assert [text for text in variant.said if text not in said] == []
    assert all(np.isfinite(result.provenance.findings[check].p_value) for check in variant.findings)
    for group in ("log_likelihood", "posterior_predictive"):
        assert np.isfinite(result.group(group)["rating"].values).all()


def alone() -> Experiment:
    """Return the ratings of one participant."""
    made = experiment()
    one = replace(
        made.ratings, participants=made.ratings.participants[:1], participant=np.zeros_like(made.ratings.participant)
    )
    return made._replace(ratings=one)


DEPTH, OWN = {"receptor_depth": Uniform(0.5, 0.9)}, {"individual": ("b",)}
WIDE, ANSWERS = {"radius": Normal(8, 0.5)}, {"individual": ("gamma",)}
SCORES = {"scale": STANDARDISED}
REFUSED = (
    (cells, {"scale": AGGREGATED, "resolution": 1.0}, "means of several raters need exact numbers with normal errors"),
    (cells, {"scale": AGGREGATED, **OWN}, "individual"),
    (cells, {"scale": AGGREGATED, "load_cv": 0.1}, "errors of loads .load_cv. are not modelled for aggregated ratings"),
    (experiment, {"priors": WIDE, "finger": finger_of({"radius_mm": 7.5})}, "radius is given both a prior and a value"),
    (experiment, {"priors": DEPTH, "finger": finger_of({"receptor_depth_mm": 0.6})}, "both a prior and a value of the"),
    (experiment, {"individual": ("b", "alpha")}, "expected some of b, m, sigma_0, gamma, varsigma, each once"),
    (experiment, {"individual": ("b", "gamma")}, "own fingers .* and their own answers .* cannot be combined"),
    (pressed_too, {"priors": WIDE}, "radius is given a prior, but the model of compression data"),
    (alone, OWN, "one participant only"),
    (alone, ANSWERS, "one participant only, whose exponents cannot be distinguished from the typical one's"),
    (experiment, OWN | {"priors": {"omega": HalfNormal(0.3)}}, "omega: the model of these data has no such parameter"),
    (experiment, OWN | {"priors": WIDE}, "a prior of radius cannot be combined"),
    (experiment, ANSWERS | {"load_cv": 0.05}, "own exponents and errors of loads .* cannot be combined"),
    (lambda: experiment(standardised=True), OWN | SCORES, "need magnitude estimates"),
    (experiment, {"fix": HELD | {"tau_b": 0.3}}, "tau_b: the model of these data has no such parameter"),
    (experiment, {"fix": {}, "priors": {"c_K": HalfNormal(1.0)}}, "prior of c_K: halfnormal"),
    (experiment, {"fix": {}, "noise": 1.0}, "fix c_Na, c_K, c_L, c_A"),
)


@pytest.mark.parametrize(("data", "options", "said"), REFUSED)
def test_what_cannot_be_combined_is_refused(data, options, said):
    with quickly(), pytest.raises(InputError, match=said):
        build(data(), ModelOptions(**{"fix": HELD, "discretisation": COARSE} | options))
