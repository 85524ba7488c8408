"""Legal but extreme numbers of `--prior`: refused with a range, or computed without a warning, an error here."""

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal, Normal
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.parameters.priors import LAWS, parse_prior

EXTREME = ("0", "1e300", "1e-300", "1.7e308", "5e-324", "-1e300")


def number(rng):
    """Return a number as somebody may type it: of an everyday size, within 1e±120, or at an end of floating point."""
    if rng.random() < 0.05:
        return str(rng.choice(EXTREME))
    exponent = rng.choice([rng.uniform(-120, 120), rng.uniform(-7, 7), rng.uniform(-2, 3)])
    return f"{rng.choice([1, 1, 1, -1]) * 10.0**exponent:.6g}"


def typed(rng):
    """Return a prior in its written form."""
    law = str(rng.choice([*LAWS]))
    numbers = [number(rng) for _ in range(1 if law == "halfnormal" else 2)]
    if law == "lognormal" and rng.random() < 0.7:
        numbers = [numbers[0].lstrip("-"), f"{10 ** rng.uniform(-6.2, 0.75):.4g}"]
    return f"{law}({','.join(sorted(numbers, key=float) if 'uniform' in law else numbers)})"


def answered(seed):
    """Return whether a prior of a parameter, both by chance, is taken; then all that a walk asks of it is asked."""
    rng = np.random.default_rng(seed)
    name, text = str(rng.choice([*PARAMETERS])), typed(rng)
    try:
        space = parameter_space(priors={name: parse_prior(text)})
    except InputError as error:
        if "expected" in str(error):
            return False
        raise
    theta = space.draw_prior(rng, 30)
    assert np.isfinite(theta).all(), (name, text)
    assert np.isfinite(space.log_prior(theta)).all(), (name, text)
    z = space.coordinates(theta)
    # where proposals may reach: far out, and beyond floating point
    far = np.concatenate([z, 3 * z, 50 * z, z + rng.normal(0, 30, z.shape), rng.normal(0, 1e3, z.shape)])
    assert not np.isnan(space.log_prior(space.natural(far))).any(), (name, text)
    space.log_jacobian(far)
    return True


@pytest.mark.parametrize("seeds", [range(150), pytest.param(range(150, 6000), marks=pytest.mark.slow)], ids=len)
def test_a_typed_prior_is_refused_with_what_was_expected_or_answers_everywhere(seeds):
    taken = sum(map(answered, seeds))
    assert 0.1 * len(seeds) < taken < 0.5 * len(seeds)


def test_a_prior_beyond_the_firing_rate_surface_is_refused_before_anything_is_drawn():
    beyond = {"alpha": parse_prior("loguniform(66.3,74)")}
    with pytest.raises(InputError, match=r"alpha: median of loguniform.* to 60 µA/cm², the range of the firing-rate"):
        parameter_space(priors=beyond)
    space = parameter_space(priors=beyond, fix=dict.fromkeys(("c_Na", "c_K", "c_L", "c_A"), 1.0))
    assert space.draw_prior(np.random.default_rng(1), 5)[:, space.names.index("alpha")].min() > 66


@pytest.mark.parametrize("law", [HalfNormal(0.02), Normal(0.0, 0.02)], ids=str)
def test_a_density_near_the_largest_number_is_zero(law):
    assert law.log_density(np.array([1.7e308])).tolist() == [-np.inf]
    assert law.cumulative(np.array([1.7e308])).tolist() == [1.0]
