"""Declarations of all parameters, and named sets of their priors (model.md 10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal, LogNormal, Normal, Prior, Truncated, Uniform
from softness_bayes.base.ranges import CATEGORIES_RANGE, FREE_FORCES, GUESSES, Range
from softness_bayes.parameters.joint import JOINT_LAWS
from softness_bayes.touch.contact import DISPLACEMENT, STRAIN, SkinDisplacement
from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT

_POSITIVE = Range(1e-6, 1e6)
_MULTIPLIER = Range(0.1, 10.0)
_FROM_ZERO = Range(1e-6, 1e6, zero=True)
_SPREAD = Range(1e-6, 100.0, zero=True)
# with less noise the posterior is nearly a surface, on which sampling does not converge
_NOISE = Range(1e-4, 100.0)

CUT_OFF = 1e-3
"""Largest share of a prior allowed outside the range of a parameter whose priors are truncated at both ends."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of the model, with the names used in chains, files, plots, tables and help.

    Parameters
    ----------
    name, symbol, unit, meaning
        Name in files and options, LaTeX symbol, natural unit, and meaning in words.
    si
        Number of SI units (or units of the neuron model) in one natural unit.
    prior
        Default prior, in natural units.
    range
        Allowed fixed values, in natural units; every prior is truncated at the upper end.
    cut_below
        Whether every prior is also truncated at the lower end, so that laws with values below 0 may be given.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    prior: Prior
    si: float = 1.0
    range: Range = _POSITIVE
    cut_below: bool = False

    @property
    def largest(self) -> float:
        """Largest value allowed in the model, at which every prior is truncated."""
        return self.range.high

    def cut(self, prior: Prior) -> Prior:
        """Return a prior truncated at both ends of the range, if `cut_below`."""
        return Truncated(prior, self.range.low, self.range.high) if self.cut_below else prior

    def suited(self, prior: Prior) -> Prior:
        """Return a prior as the parameter takes it (`cut`).

        Raises
        ------
        InputError
            If its support, or its median, lies outside the range of the parameter.
        """
        if self.cut_below:
            inside = float(np.diff(prior.cumulative((self.range.low, self.range.high)))[0])
            if inside < 1.0 - CUT_OFF:
                raise InputError(
                    f"prior of {self.name}: {1.0 - inside:.2g} of {prior} lies outside {self.range.low:g} to "
                    f"{self.range.high:g} {self.unit}, the range of the model; expected a narrower prior"
                )
        elif prior.support[0] < 0:
            raise InputError(
                f"prior of {self.name}: {prior} allows negative values, which {self.name} cannot take; "
                "expected lognormal, halfnormal or uniform above 0"
            )
        replace(self.range, unit=self.unit).require(f"prior of {self.name}: median of {prior}", prior.median)
        return self.cut(prior)

    @property
    def label(self) -> str:
        """Symbol with its unit, for an axis."""
        return f"{self.symbol} [{self.unit}]" if self.unit != "–" else self.symbol


def _by_name(*parameters: Parameter) -> Mapping[str, Parameter]:
    return MappingProxyType({parameter.name: parameter for parameter in parameters})


PARAMETERS: Mapping[str, Parameter] = _by_name(
    Parameter("b", r"$b$", "kPa", "skin modulus at rest", LogNormal(100, 0.5), si=1e3),
    Parameter("m", r"$m$", "–", "stiffening of the skin", LogNormal(2, 0.3), range=_FROM_ZERO),
    Parameter(
        "alpha",
        r"$\alpha$",
        "µA/cm²",
        "largest receptor current",
        LogNormal(20.3, 0.1),
        range=Range(1e-6, LARGEST_CURRENT),
    ),
    Parameter("beta", r"$\beta$", "1/kPa", "steepness of transduction", LogNormal(0.6, 0.3), si=1e-3),
    Parameter("sigma_0", r"$\sigma_0$", "kPa", "stress at half current", LogNormal(9, 0.4), si=1e3),
    Parameter("c_Na", r"$c_{Na}$", "–", "sodium conductance multiplier", LogNormal(1.05, 0.03, 0.1), range=_MULTIPLIER),
    Parameter("c_K", r"$c_K$", "–", "potassium conductance multiplier", LogNormal(1.16, 0.03, 0.1), range=_MULTIPLIER),
    Parameter("c_L", r"$c_L$", "–", "leak conductance multiplier", LogNormal(1.0, 0.03, 0.1), range=_MULTIPLIER),
    Parameter("c_A", r"$c_A$", "–", "A-current conductance multiplier", LogNormal(1.5, 0.03, 0.1), range=_MULTIPLIER),
    Parameter("gamma", r"$\gamma$", "–", "exponent of the rating", LogNormal(1, 0.3), range=Range(1e-3, 1e3)),
    Parameter("tau", r"$\tau$", "–", "spread of participants", HalfNormal(1), range=_SPREAD),
    Parameter("varsigma", r"$\varsigma$", "–", "spread of a participant's ratings", HalfNormal(0.5), range=_NOISE),
    Parameter("omega", r"$\omega$", "–", "spread between fabrics", HalfNormal(0.5), range=_SPREAD),
    Parameter("eps", r"$\epsilon$", "Hz", "rate added to a silent fabric's", LogNormal(0.1, 1)),
)
"""Parameters by name, in the order of files and tables."""

SHAPE_PARAMETERS: Mapping[str, Parameter] = _by_name(
    Parameter("radius", "$R$", "mm", "fingertip radius", Normal(8, 1), si=1e-3, range=Range(1, 100), cut_below=True),
    Parameter(
        "receptor_depth",
        "$z$",
        "mm",
        "depth of the receptors",
        Uniform(0.5, 0.9),
        si=1e-3,
        range=Range(0.05, 5),
        cut_below=True,
    ),
)
"""Parameters of the fingertip, fixed at the finger's values unless they are freed or given a prior."""

FINGER_PARAMETERS: Mapping[str, Parameter] = _by_name(
    Parameter("tau_b", r"$\tau_b$", "–", "spread of fingers' log b", HalfNormal(0.5), range=_SPREAD),
    Parameter("tau_m", r"$\tau_m$", "–", "spread of fingers' m", HalfNormal(1), range=_FROM_ZERO),
    Parameter("tau_sigma", r"$\tau_\sigma$", "–", "spread of fingers' log sigma_0", HalfNormal(0.3), range=_SPREAD),
    Parameter("varsigma_f", r"$\varsigma_F$", "–", "spread of a finger's log forces", HalfNormal(0.3), range=_NOISE),
)
"""Parameters of individual fingers and of compression data: spreads between fingers and of single forces."""


def _recorded(name: str, meaning: str, prior: Prior) -> Parameter:
    """Return a parameter of recorded afferents, in the unit and range of that of the raters' skin."""
    one = PARAMETERS[name]
    return replace(one, name=f"{name}_rec", symbol=f"{one.symbol[:-1]}_r$", meaning=meaning, prior=prior)


RECORDING_PARAMETERS: Mapping[str, Parameter] = _by_name(
    _recorded("b", "modulus at rest of the recorded skin", LogNormal(7.5, 0.25)),
    _recorded("m", "stiffening of the recorded skin", LogNormal(3.9, 0.1)),
    _recorded("alpha", "largest current of recorded receptors", LogNormal(30, 0.5)),
    _recorded("beta", "steepness of the recorded transduction", LogNormal(0.1, 1.5)),
    Parameter("rest_rec", r"$I_0/I_{th}$", "–", "current at rest over the rheobase", Uniform(0, 1), range=Range(0, 1)),
    Parameter("spread_rec", r"$w$", "mm", "spread of a receptive field", LogNormal(1, 0.5), si=1e-3),
    Parameter("radius_rec", "$R_r$", "mm", "radius of the recorded fingertip", LogNormal(8, 0.15), si=1e-3),
    Parameter("depth_rec", "$z_r$", "mm", "depth of the recorded receptors", LogNormal(0.7, 0.2), si=1e-3),
    Parameter("sd_rate", r"$\varsigma_r$", "Hz", "spread of mean rates", HalfNormal(10), range=Range(1e-3, 1e3)),
    Parameter("tau_afferent", r"$\tau_a$", "–", "spread of afferents' log rates", HalfNormal(0.5), range=_SPREAD),
    Parameter("fano", "$F$", "–", "variance of spike counts over their mean", LogNormal(1, 0.5), range=_MULTIPLIER),
)
"""Parameters of recorded afferents. Spread, radius and depth are sampled if given a prior: otherwise receptive fields
are points, and the finger has its own values."""

RECORDED = "afferents"
"""Name of recorded afferents among the terms of a posterior."""

SHAREABLE = ("b", "m", "alpha", "beta", "sigma_0")
"""Parameters that recorded afferents may share with ratings and plates."""

OPTIONAL_RECORDING = ("spread_rec", "radius_rec", "depth_rec")
"""Those that are absent unless given a prior."""

PLATE_PARAMETERS = ("tau_b", "tau_m", "varsigma_f")
"""Those used for compression data."""

ANSWER_PARAMETERS: Mapping[str, Parameter] = _by_name(
    Parameter("tau_gamma", r"$\tau_\gamma$", "–", "spread of raters' log gamma", HalfNormal(0.3), range=_SPREAD),
    Parameter(
        "tau_varsigma",
        r"$\tau_\varsigma$",
        "–",
        "spread of raters' log varsigma",
        HalfNormal(0.5),
        range=_SPREAD,
    ),
)
"""Spreads of individual exponents and noise."""

ERROR_PARAMETERS: Mapping[str, Parameter] = _by_name(
    Parameter(
        "nu",
        r"$\nu$",
        "–",
        "degrees of freedom of Student's t errors",
        LogNormal(8, 0.8),
        range=Range(0.5, 1e12),
    ),
    Parameter("guess", r"$\pi_0$", "–", "guess rate of pairs", HalfNormal(0.1), range=GUESSES),
    Parameter("lapse", r"$\lambda$", "–", "share of lapses", HalfNormal(0.05), range=Range(1e-6, 0.5, zero=True)),
    *(
        Parameter(f"gap_{k}", f"$w_{{{k}}}$", "–", f"width of category {k}", LogNormal(0.5, 1.0))
        for k in range(2, CATEGORIES_RANGE.high)
    ),
)
"""Parameters of error laws other than normal, and of the thresholds of categories."""

MODULUS_SCALE = "modulus_scale"
"""Name of the factor between true and stated moduli that all fabrics share, or those of the first batch."""

MODULUS_SCALES: Mapping[str, Parameter] = _by_name(
    *(
        Parameter(name, symbol, "–", f"common factor of moduli{of}", LogNormal(1, 0.15), range=_MULTIPLIER)
        for name, symbol, of in (
            (MODULUS_SCALE, "$k_E$", ""),
            *((f"{MODULUS_SCALE}_{k}", f"$k_{{E{k}}}$", f", batch {k}") for k in range(2, 10)),
        )
    )
)
"""Factors between true and stated moduli that the fabrics of a batch share: the error of one tester."""

TOUCH_FORCE = "touch_force"
"""Name of the force of free touches, which all ratings share."""

EVERY_PARAMETER: Mapping[str, Parameter] = MappingProxyType(
    {
        **PARAMETERS,
        **SHAPE_PARAMETERS,
        **ERROR_PARAMETERS,
        **ANSWER_PARAMETERS,
        **FINGER_PARAMETERS,
        **RECORDING_PARAMETERS,
        **MODULUS_SCALES,
        TOUCH_FORCE: Parameter(
            TOUCH_FORCE, "$F$", "N", "force of free touches", LogNormal(1, 0.7), range=FREE_FORCES, cut_below=True
        ),
    }
)
"""All parameters that a run may sample, by name."""

HELD: Mapping[str, float] = MappingProxyType({"omega": 0.0})
"""Parameters that are fixed unless they are freed or given a prior."""

_DISPLACED: Mapping[str, Prior] = {
    "tau_m": HalfNormal(354),
    "b_rec": LogNormal(15.8, 0.2),
    "m_rec": LogNormal(630, 0.1),
}

PRIOR_SETS: Mapping[str, Mapping[SkinDisplacement, Mapping[str, Prior]]] = MappingProxyType(
    {
        "default": {STRAIN: {}, DISPLACEMENT: {"m": LogNormal(707, 0.3), **_DISPLACED}},
        "in-vivo": {
            STRAIN: {"b": LogNormal(7.5, 0.25), "m": LogNormal(3.9, 0.1)},
            DISPLACEMENT: {"b": LogNormal(15.8, 0.2), "m": LogNormal(630, 0.1), **_DISPLACED},
        },
        # for compression data alone: the other sets already assume what such data measure
        "wide": {
            STRAIN: {"b": LogNormal(30, 1), "m": LogNormal(3, 0.5)},
            DISPLACEMENT: {"b": LogNormal(30, 1), "m": LogNormal(1060, 0.5), **_DISPLACED},
        },
        "recorded": {STRAIN: JOINT_LAWS["recorded"].marginals},
    }
)
"""Named prior sets: differences from the default priors, for each reading of the skin."""


UNKNOWN_MODULUS = LogNormal(100, 2)
"""Prior law of a modulus about which nothing is known [kPa]: 90 % within 4 to 2700 kPa, which includes most cloth."""

KPA = 1e3
"""Number of pascals in the unit of the laws."""

FABRIC_MODULUS = "fabric_modulus"
"""Name of the sampled moduli in files; one of them is `FABRIC_MODULUS`[fabric]."""


def shareable(names: Sequence[str]) -> tuple[str, ...]:
    """Return parameters that recorded afferents share, in the order of `SHAREABLE`, each once.

    Raises
    ------
    InputError
        For a name that is not among them.
    """
    if unknown := [one for one in names if one not in SHAREABLE]:
        raise InputError(f"shared: no {unknown[0]!r} can be shared, expected some of {', '.join(SHAREABLE)}")
    return tuple(one for one in SHAREABLE if one in names)
