"""The declaration of the parameters and the space of the sampled ones."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal, LogNormal, LogUniform, Normal, Uniform
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.coordinates import Bent, Interval, Scaled, walked
from softness_bayes.parameters.declared import HELD, PARAMETERS, SHAPE_PARAMETERS
from softness_bayes.touch.neuron.membrane import HODGKIN_HUXLEY, PAPER_CHANNELS
from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT
from softness_bayes.touch.neuron.surface import DESIGNS
from softness_bayes.touch.parameters import TouchParameters

EVERYTHING = parameter_space(priors={name: PARAMETERS[name].prior for name in HELD})


def test_names_and_order_are_those_of_the_files():
    contract = "b m alpha beta sigma_0 c_Na c_K c_L c_A gamma tau varsigma omega eps"
    assert " ".join(PARAMETERS) == contract
    assert EVERYTHING.names == tuple(PARAMETERS)
    assert parameter_space().names == tuple(name for name in PARAMETERS if name != "omega")
    assert set(TouchParameters._fields) < {*PARAMETERS, *SHAPE_PARAMETERS, "touch_force"}


def test_alpha_ends_where_its_rate_curves_end():
    def largest(space):
        return next(p.largest for p in space.sampled if p.name == "alpha")

    assert largest(parameter_space()) == DESIGNS["connor-stevens"].max_current
    channels = PAPER_CHANNELS._asdict()
    wide = parameter_space(fix=channels, priors={"alpha": LogNormal(100, 1)})
    assert largest(wide) == LARGEST_CURRENT
    assert wide.draw_prior(np.random.default_rng(0), 500)[:, 2].max() < LARGEST_CURRENT
    beyond = LogNormal(140, 0.01)
    with pytest.raises(InputError, match="the range of the firing-rate surface"):
        parameter_space(priors={"alpha": beyond})
    sampled = tuple(replace(p, prior=beyond) if p.name == "alpha" else p for p in parameter_space().sampled)
    with pytest.raises(InputError, match="the range of the model"):
        replace(parameter_space(), sampled=sampled).draw_prior(np.random.default_rng(0), 5)


def test_a_current_that_the_membrane_lacks_is_held():
    space = parameter_space(membrane=HODGKIN_HUXLEY)
    assert space.held["c_A"] == PAPER_CHANNELS.c_A
    assert {"c_Na", "c_K", "c_L"} <= {*space.names}
    assert "c_A" not in space.names
    assert parameter_space(fix={"c_A": 1.4}, membrane=HODGKIN_HUXLEY).held["c_A"] == 1.4
    with pytest.raises(InputError, match="c_A cannot be sampled: the membrane hodgkin-huxley has no such current"):
        parameter_space(priors={"c_A": LogNormal(1.5, 0.03, 0.1)}, membrane=HODGKIN_HUXLEY)
    assert "c_A" in parameter_space().names


def test_every_prior_ends_where_firing_begins_at_a_jump():
    space = parameter_space()
    theta = np.tile(space.median, (3, 1))
    theta[1, 5:9] = 0.945, 1.276, 0.9, 1.35
    density = space.log_prior(theta)
    assert np.isneginf(density[1, 5:9]).all()
    assert np.isfinite(density[[0, 2]]).all()
    wide = parameter_space(priors={"c_K": Uniform(1.2, 1.276), "c_A": Uniform(1.35, 1.4), "c_Na": Uniform(0.945, 1)})
    drawn = wide.draw_prior(np.random.default_rng(0), 500)
    assert np.isfinite(wide.log_prior(drawn)).all()
    unlimited = replace(wide, firing=None).draw_prior(np.random.default_rng(0), 500)
    assert np.isneginf(wide.log_prior(unlimited)).any()
    held = parameter_space(fix={"c_Na": 0.945, "c_K": 1.276, "c_L": 0.9, "c_A": 1.35})
    assert np.isfinite(held.log_prior(held.median)).all()


def test_choices_of_the_user():
    space = parameter_space(fix={"b": 80}, priors={"omega": HalfNormal(0.5), "eps": LogNormal(0.2, 0.5)})
    assert space.names == tuple(name for name in PARAMETERS if name != "b")
    assert space.held["b"] == 80
    assert space.sampled[-1].prior == LogNormal(0.2, 0.5)
    assert parameter_space(n_participants=1).held["tau"] == 0
    assert parameter_space(n_participants=1, fix={"tau": 0.3}).held["tau"] == 0.3
    assert "tau" in parameter_space(n_participants=2).names
    nothing = parameter_space(fix=dict.fromkeys(PARAMETERS, 1.0))
    assert (nothing.dimension, nothing.draw_prior(np.random.default_rng(0), 3).shape) == (0, (3, 0))


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"fix": {"B": 1}}, "no parameter 'B'; expected one of b, m"),
        ({"priors": {"kappa": LogNormal(1, 1)}}, "no parameter 'kappa'"),
        ({"priors": {"betta": HalfNormal(1)}}, "no parameter 'betta'"),
        ({"fix": {"b": -1}}, r"b is -1, expected a number from 1e-06 to 1e\+06 kPa"),
        ({"fix": {"varsigma": 0}}, "varsigma is 0, expected a number from 0.0001 to 100"),
        ({"fix": {"m": float("nan")}}, r"m is nan, expected 0, or a number from 1e-06 to 1e\+06$"),
        ({"fix": {"eps": 1}, "priors": {"eps": LogNormal(1, 1)}}, "eps is both fixed"),
        ({"priors": {"b": Normal(100, 50)}}, "allows negative values"),
        ({"prior_set": "in-vitro"}, "expected one of default, in-vivo"),
        ({"n_participants": 1, "priors": {"tau": HalfNormal(1)}}, "one participant"),
        ({"fix": {"alpha": 151}}, "alpha is 151, expected a number from 1e-06 to 150 µA/cm²"),
        ({"fix": {"alpha": 61}}, "alpha is 61, expected at most 60 µA/cm², the range of the firing-rate surface"),
        ({"priors": {"c_K": LogNormal(1.16, 0.1)}}, r"prior of c_K: .* reaches beyond 1\.044 to 1\.276"),
    ],
)
def test_wrong_choices_are_refused(choice, message):
    with pytest.raises(InputError, match=message):
        parameter_space(**choice)


def test_a_bracket_of_many_powers_of_ten_is_walked_as_a_normal_law():
    """A law uniform in the logarithm has standard normal coordinates, at whose ends nothing crowds."""
    rng, law = np.random.default_rng(8), LogUniform(1e-3, 1e8)
    coordinate = walked(law)
    z = coordinate.coordinate(law.quantile(rng.uniform(size=4000)))
    assert stats.kstest(z, "norm").pvalue > 1e-3
    at = np.linspace(-6.0, 6.0, 25)
    np.testing.assert_allclose(
        law.log_density(coordinate.natural(at)) + coordinate.log_slope(at), stats.norm.logpdf(at), atol=1e-9
    )
    np.testing.assert_allclose(coordinate.coordinate(coordinate.natural(at)), at, atol=1e-6)
    # in log odds of the interval itself most of the law lies in one tail
    odds = Interval(*law.support).coordinate(law.quantile(rng.uniform(size=4000)))
    assert np.median(odds) < -10.0


SPACES = {
    "default": parameter_space(),
    "everything": EVERYTHING,
    "other priors": parameter_space(priors={"b": Uniform(20, 300), "m": HalfNormal(2), "c_K": Uniform(1.1, 1.2)}),
    "bent about the rheobase": replace(parameter_space(), bent={"alpha": Bent(17.99, 0.3)}),
    "alpha held": replace(parameter_space(fix={"alpha": 21.0}), bent={"alpha": Bent(17.99, 0.3)}),
    "sigma_0 along the threshold": replace(
        parameter_space(), bent={"alpha": Bent(17.99, 0.3), "sigma_0": Scaled(9.0)}, rheobase=17.99
    ),
    "sigma_0 along the threshold of held channels, alpha and beta": replace(
        parameter_space(fix={**PAPER_CHANNELS._asdict(), "alpha": 21.0, "beta": 0.6}),
        bent={"sigma_0": Scaled(9.0)},
        rheobase=17.99,
    ),
    "bent about a held rheobase": replace(
        parameter_space(fix=PAPER_CHANNELS._asdict()), bent={"alpha": Bent(17.99, 0.3)}
    ),
}


@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_coordinates_invert_and_have_the_stated_jacobian(space):
    rng = np.random.default_rng(3)
    theta = space.draw_prior(rng, 50)
    z = space.coordinates(theta)
    np.testing.assert_allclose(space.natural(z), theta, rtol=1e-12)
    step = 1e-6
    columns = np.eye(space.dimension) * step
    numerical = sum(
        np.log((space.natural(z + h)[:, k] - space.natural(z - h)[:, k]) / (2 * step)) for k, h in enumerate(columns)
    )
    np.testing.assert_allclose(space.log_jacobian(z), numerical, rtol=1e-6, atol=1e-6)
    # negative control: without the logarithms' part the Jacobian is far off
    assert np.abs(numerical).max() > 1


def test_values_by_name_in_natural_units_and_si():
    space = parameter_space(fix={"m": 2.5})
    theta = np.stack([space.median, 2 * space.median])
    values = space.values(theta)
    assert list(values) == list(PARAMETERS)
    assert values["m"] == 2.5
    np.testing.assert_array_equal(values["b"], [100, 200])
    touch = space.touch(theta)
    np.testing.assert_allclose(touch.b, [1e5, 2e5])
    np.testing.assert_allclose(touch.beta, [6e-4, 12e-4])
    np.testing.assert_allclose(touch.sigma_0, [9e3, 18e3])
    assert touch.m == 2.5
    np.testing.assert_allclose(touch.c_K, [1.16, 2.32])
