"""Parameters of rating models, for tests."""

from softness_bayes.likelihood.contract import Parameters


def rated(gamma, tau, varsigma, omega=0.0, eps=0.1, **more):
    """Return the parameters of ratings in the order of `RatingModel.needs`, and any others."""
    return Parameters(gamma=gamma, tau=tau, varsigma=varsigma, omega=omega, eps=eps, **more)
