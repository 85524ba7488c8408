"""A module of somebody who uses the toolkit: readings, a prior law and figures of their own."""

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import gamma

from softness_bayes.base.laws import Law
from softness_bayes.likelihood.scales import STANDARDISED
from softness_bayes.likelihood.z_scores import StandardisedModel
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS
from softness_bayes.touch.stress import ATTENUATED, HERTZ, LINE, Pressure


def _half(modulus, a, finger):
    return 0.5 * ATTENUATED.decay(modulus, a, finger)


MILD = Pressure("mild", HERTZ.amplitude, _half, "half of the paper's attenuation")
OWN_LINE = replace(LINE, name="own-line")
LEAKY = replace(CONNOR_STEVENS, name="leaky", g_l=0.31)


@dataclass(frozen=True)
class Gamma(Law):
    """Gamma law of a shape and a rate."""

    shape: float
    rate: float

    @property
    def support(self):
        return 0.0, np.inf

    @property
    def median(self):
        return float(self.quantile(0.5))

    def log_density(self, x):
        return gamma.logpdf(x, self.shape, scale=1.0 / self.rate)

    def cumulative(self, x):
        return gamma.cdf(x, self.shape, scale=1.0 / self.rate)

    def quantile(self, p):
        return gamma.ppf(p, self.shape, scale=1.0 / self.rate)


class Unnormalised(Gamma):
    """A law whose density lacks a factor."""

    def log_density(self, x):
        return super().log_density(x) + 1.0


def b_sorted(result, style):
    """Skin modulus in the order of its draws."""
    figure = Figure()
    figure.subplots().plot(np.sort(result.group("posterior")["b"].values.ravel()))
    return figure


def failing(result, style):
    """A figure that fails."""
    raise KeyError("nothing")


NOT_A_FIGURE = 3


def agreement_model(direction):
    return AgreementModel(direction)


AGREEMENT = replace(
    STANDARDISED, name="agreement", meaning="agreement with 'this is soft'", label="agreement", model=agreement_model
)


@dataclass(frozen=True)
class AgreementModel(StandardisedModel):
    """A line in the response with wide errors; the likelihood is that of z-scores."""

    scale = AGREEMENT
    needs = ("varsigma",)


def without_residuals(direction):
    return Lacking(direction)


LACKING = replace(AGREEMENT, name="lacking", model=without_residuals)


@dataclass(frozen=True)
class Lacking(AgreementModel):
    scale = LACKING

    def typical(self, effects, drive):
        raise ZeroDivisionError("no idea")


NOT_A_MODEL = replace(AGREEMENT, name="nothing", model=lambda direction: 3)
