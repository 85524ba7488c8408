"""Parameters of rating models, for tests."""

from softness_bayes.likelihood.contract import Parameters


def rated(gamma, tau, varsigma, omega=0.0, eps=0.1, **more):
    """Return the parameters of ratings in the order of `RatingModel.needs`, and any others."""
    return Parameters(gamma=gamma, tau=tau, varsigma=varsigma, omega=omega, eps=eps, **more)


def densities(observed, rate, points):
    """What a likelihood says of all rows, of each row and of each participant given the others, by name."""
    rows, below = observed.left_out(rate, points)
    whole, participants = (of(rate, points) for of in (observed.log_likelihood, observed.log_likelihood_participants))
    return {"all": whole, "rows": rows, "below": below, "participants": participants}
