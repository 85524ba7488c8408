"""A module of somebody who uses the toolkit: readings, a prior law and figures of their own."""

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import gamma

from softness_bayes.parameters.law import Law
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
