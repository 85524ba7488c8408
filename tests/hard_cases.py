"""Hard cases of the forward model and the likelihood, each against a reference that shares no code with them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import mpmath
import numpy as np

from oracles import plain_chain
from oracles.plain_chain import RootLaw, Touch
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import LogRatings
from softness_bayes.touch.contact import Finger, Force, Indentation, solve_contact
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS_KINETICS, HODGKIN_HUXLEY_KINETICS, Gating
from softness_bayes.touch.neuron.rate_curve import CurveError, RateCurve
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.receptors import receptor_current
from softness_bayes.touch.scene import Scene
from softness_bayes.touch.stress import ATTENUATED, HERTZ, stress
from support.points import rated

MEDIANS = {"b": 1e5, "m": 2.0, "alpha": 20.3, "beta": 0.6e-3, "sigma_0": 9e3}
LAW = RootLaw()


class Errors(NamedTuple):
    """Largest errors of a case: as the program runs, and resolved more finely (the same where nothing is resolved)."""

    usual: float
    fine: float


@dataclass(frozen=True)
class Case:
    """One case: what it covers, its errors, and the errors that are allowed."""

    name: str
    covers: str
    measure: Callable[[], Errors]
    allowed: Errors
    slow: bool = False


# the whole chain


@dataclass(frozen=True)
class OneLaw:
    """The package's curve of a law written out in plain_chain."""

    law: RootLaw = LAW
    noise: float = 0.0

    def curves(self, channels, alpha):
        law = self.law
        unmeasured = CurveError(*np.zeros(len(CurveError._fields)))
        return RateCurve(
            np.array(law.rheobase), np.array(law.jump), np.array(law.coefficients), law.largest, unmeasured
        )


def touch_parameters(**changed):
    return TouchParameters(*({**MEDIANS, **changed}).values(), 1.05, 1.16, 1.0, 1.5)


def scene_of(touches, law=LAW):
    """The scene whose conditions are these touches of one finger."""
    one = touches[0]
    finger = Finger(one.radius, one.skin_poisson, one.depth, one.length, one.width, one.centre)
    loads = [Indentation(t.indentation) if t.force is None else Force(t.force) for t in touches]
    distinct = sorted(set(loads), key=str)
    return Scene(
        [t.fabric_modulus for t in touches],
        [t.fabric_poisson for t in touches],
        distinct,
        OneLaw(law),
        np.arange(len(touches)),
        [distinct.index(load) for load in loads],
        finger=finger,
        readings=Readings(pressure={p.name: p for p in (ATTENUATED, HERTZ)}[one.pressure]),
    )


def chain(scenes, changes, law=LAW):
    """Errors of the total rate relative to each vector's largest; `scenes` lists the touches of each scene."""
    usual = fine = 0.0
    for touches in scenes:
        scene = scene_of(touches, law)
        finer = scene.refined()
        for changed in changes:
            exact = np.array([plain_chain.total_rate(t, **{**MEDIANS, **changed}, law=law) for t in touches])
            scale = max(exact.max(), 1e-12)
            found, better = (s.total_rate(touch_parameters(**changed)) for s in (scene, finer))
            usual = max(usual, float(np.abs(found - exact).max() / scale))
            fine = max(fine, float(np.abs(better - exact).max() / scale))
    return Errors(usual, fine)


def touches(fabrics, loads, **finger):
    return [Touch(float(f), **load, **finger) for load in loads for f in fabrics]


MILLIMETRE, NEWTON = {"indentation": 1e-3}, {"force": 1.0}
CLOTH = (1e4, 1e5, 1e7)


def stiff_and_soft_fabrics():
    return chain(
        [touches(np.geomspace(1e-2, 1e12, 8), [MILLIMETRE, NEWTON])],
        [{}, {"b": 1e3, "sigma_0": 500.0}],
    )


def stiffening_skin():
    # the largest strain is that of the rigid fabric: a / R
    scenes = [touches(CLOTH, [MILLIMETRE], pressure=pressure) for pressure in ("attenuated", "hertz")]
    return chain(scenes, [{"m": mu / math.sqrt(1e-3 / 8e-3)} for mu in (1.0, 10.0, 50.0)])


def indentations():
    depths = (1e-6, 1e-5, 1e-4, 4e-3, 8e-3, 12e-3)
    return chain([touches((1e5, 1e7), [{"indentation": d} for d in depths])], [{}, {"sigma_0": 50.0, "beta": 2e-3}])


def depths():
    scenes = [touches((1e5, 1e7), [{"indentation": 2e-3}], depth=z) for z in (1e-6, 1e-5, 1e-4, 1e-2)]
    return chain(scenes, [{}, {"sigma_0": 500.0}])


def edges():
    centres = [(0.0, 10e-3), (0.0, 0.0), (30e-3, 20e-3), (1e-6, 10e-3), (27e-3, 19.9e-3)]
    scenes = [touches((1e5, 1e7), [{"indentation": 2e-3}], centre=c) for c in centres]
    return chain(scenes, [{}, {"sigma_0": 500.0}])


def larger_than_the_pad():
    scene = touches(
        (1e5, 1e7), [{"indentation": 12e-3}, {"force": 50.0}], length=10e-3, width=6e-3, centre=(2e-3, 1e-3)
    )
    return chain([scene], [{"sigma_0": 300.0}, {"sigma_0": 4e3}, {"alpha": 50.0}])


def flat_and_step():
    changes = [{"beta": 1e-12, "alpha": 50.0}, {"beta": 1e-6, "alpha": 35.9}, {"beta": 0.02}, {"beta": 1.0}]
    return chain([touches(CLOTH, [MILLIMETRE, NEWTON])], changes)


def peak_of(touch):
    state = plain_chain.contact(touch, MEDIANS["b"], MEDIANS["m"])
    return float(plain_chain.stress(np.zeros(1), touch, state)[0])


def half_response_at_the_peak():
    touch = Touch(1e5, **MILLIMETRE)
    offsets = (-0.5, -1e-9, 0.0, 1e-9, 0.5)
    return chain([[touch]], [{"sigma_0": peak_of(touch) * (1 + off), "alpha": 40.0} for off in offsets])


def onset_at_the_peak():
    """The threshold stress just below the peak, at it and just above, beside a fabric that fires."""
    touch, lead = Touch(1e5, **MILLIMETRE), math.log(MEDIANS["alpha"] / LAW.rheobase - 1) / MEDIANS["beta"]
    offsets = (1e-2, 1e-4, 1e-6, 1e-12, -1e-12, -1e-6)
    changes = [{"sigma_0": peak_of(touch) * (1 - off) + lead} for off in offsets]
    return chain([[touch, Touch(1e7, **MILLIMETRE)]], changes)


def current_at_the_rheobase():
    near = [{"alpha": LAW.rheobase * (1 + sign * 1e-9), "sigma_0": 2e3} for sign in (1, -1)]
    return chain([touches(CLOTH, [MILLIMETRE, NEWTON])], [*near, {"alpha": LAW.rheobase}])


def onset_with_a_jump():
    return chain([touches(CLOTH, [MILLIMETRE, NEWTON])], [{}, {"beta": 0.02}], RootLaw(jump=12.0))


# its stages


def both(error):
    return Errors(error, error)


def relative(found, exact):
    return float(np.max(np.abs(np.asarray(found, float) / np.asarray(exact, float) - 1)))


def skin_and_contact():
    worst = 0.0
    for load in (
        {"indentation": 1e-6},
        {"indentation": 1e-3},
        {"indentation": 2e-2},
        {"force": 1e-6},
        {"force": 100.0},
    ):
        held = Indentation(load["indentation"]) if "indentation" in load else Force(load["force"])
        for fabric in np.geomspace(1e-2, 1e12, 8):
            touch = Touch(float(fabric), **load)
            rigid = plain_chain.contact(touch, 1e5, 0.0, 20).radius / touch.radius
            for mu in (0.0, 2.0, 50.0):
                exact = plain_chain.contact(touch, 1e5, mu / rigid)
                found = solve_contact(fabric, 0.3, held, 1e5, mu / rigid)
                worst = max(worst, relative([found.skin_modulus, found.reduced_modulus, found.radius], exact))
    return both(worst)


def stresses():
    worst = 0.0
    for depth in (1e-6, 1e-4, 0.7e-3, 1e-2):
        for fabric in (1e-2, 1e5, 1e12):
            touch = Touch(fabric, indentation=2e-3, depth=depth)
            state = plain_chain.contact(touch, 1e5, 2.0)
            rho = np.array([0.0, 1e-5, 1e-3, 3.9e-3, 4e-3, 4.1e-3, 3e-2])
            exact = plain_chain.stress(rho, touch, state, step=0.05)
            found = stress(rho, state.reduced, state.radius, Finger(receptor_depth=depth))
            worst = max(worst, float(np.abs(found - exact).max() / exact.max()))
    return both(worst)


def currents():
    worst = 0.0
    with mpmath.workdps(60):
        for sigma in (-1e308, -1e3, 0.0, 9e3, 9e3 * (1 + 1e-15), 1e308):
            for sigma_0 in (-1e308, -1.0, 9e3, 1e308):
                for beta in (1e-308, 0.6e-3, 1.0, 1e308):
                    u = mpmath.mpf(beta) * (mpmath.mpf(sigma) - mpmath.mpf(sigma_0))
                    exact = 20.3 / (1 + mpmath.exp(-u)) if abs(u) < 1e6 else mpmath.mpf(20.3 if u > 0 else 0)
                    found = float(receptor_current(sigma, 20.3, beta, sigma_0))
                    worst = max(worst, float(abs(found - exact) / 20.3))
    return both(worst)


def exact_linear_rate(rate, voltage):
    """scale (V + offset) / (1 - exp(-(V + offset) / width)) and its derivative, by their limits at V = -offset."""
    with mpmath.workdps(60):
        gap, width = mpmath.mpf(float(voltage)) + mpmath.mpf(rate.offset), mpmath.mpf(rate.width)
        if gap == 0:
            return mpmath.mpf(rate.scale) * width, mpmath.mpf(rate.scale) / 2
        y = gap / width
        closed = -mpmath.expm1(-y)
        return rate.scale * gap / closed, rate.scale * (1 / closed - y * mpmath.exp(-y) / closed**2)


def removable_singularities():
    worst = 0.0
    for kinetics in (CONNOR_STEVENS_KINETICS, HODGKIN_HUXLEY_KINETICS):
        gating = Gating(kinetics)
        for rate, row in ((kinetics.m_open, 0), (kinetics.n_open, -1)):
            gaps = np.array([0.0, *(s * 10.0**k for k in range(-14, 2) for s in (1, -1))])
            voltage = gaps - rate.offset
            found = gating.rates_and_slopes(voltage)
            for k, v in enumerate(voltage):
                value, slope = exact_linear_rate(rate, v)
                worst = max(worst, float(abs(found.opening[row, k] / value - 1)))
                worst = max(worst, float(abs(found.opening_slope[row, k] / slope - 1)))
    return both(worst)


# the likelihood


def dense_log_density(ratings, participant, drive, tau, varsigma, digits=60):
    """log density of the ratings by the Cholesky factor of their logarithms' whole covariance."""
    with mpmath.workdps(digits):
        n = len(ratings)
        log_y = [mpmath.log(mpmath.mpf(float(r))) for r in ratings]
        covariance = mpmath.matrix(n, n)
        for i in range(n):
            for j in range(n):
                covariance[i, j] = 9 + (mpmath.mpf(tau) ** 2 if participant[i] == participant[j] else 0)
            covariance[i, i] += mpmath.mpf(varsigma) ** 2
        centred = [mpmath.mpf(float(d)) for d in drive]
        mean = sum(centred) / n
        residual = mpmath.matrix([y - mpmath.log(20) - d + mean for y, d in zip(log_y, centred, strict=True)])
        root = mpmath.cholesky(covariance)
        white = mpmath.lu_solve(root, residual)
        value = -sum(w**2 for w in white) / 2 - sum(mpmath.log(root[i, i]) for i in range(n))
        return value - n * mpmath.log(2 * mpmath.pi) / 2 - sum(log_y)


def likelihoods(designs):
    worst = 0.0
    for ratings, participant, condition in designs:
        rate = np.array([0.0, 3.0, 12.0])
        design = Design(np.array(condition), np.array(participant), np.arange(3), max(participant) + 1)
        for tau, varsigma in ((0.5, 0.3), (1e-3, 2.0), (300.0, 100.0)):
            given = rated(1.2, tau, varsigma)
            found = float(LogRatings(np.array(ratings), design).log_likelihood(rate, given))
            drive = 1.2 * np.log(rate[condition] + 0.1)
            exact = dense_log_density(ratings, participant, drive, tau, varsigma)
            worst = max(worst, float(abs(found - exact) / max(abs(exact), 1)))
    return both(worst)


def extreme_ratings():
    return likelihoods(
        [
            ([1e-300, 1e300, 20.0, 3.0], [0, 0, 1, 1], [0, 1, 2, 0]),
            ([1e300] * 3, [0, 1, 2], [0, 1, 2]),
            ([5e-324, 1.7e308], [0, 1], [1, 1]),
        ]
    )


def lonely_ratings():
    return likelihoods(
        [([20.0], [0], [1]), ([20.0, 30.0, 10.0], [0, 0, 0], [0, 1, 2]), ([7.0] * 4, [0, 0, 1, 1], [1] * 4)]
    )


def single_precision():
    scene = scene_of(touches(CLOTH, [MILLIMETRE, NEWTON]))
    rounded = TouchParameters(*(np.float32(v) for v in touch_parameters()))
    changed = {name: float(value) for name, value in rounded._asdict().items() if name in MEDIANS}
    exact = np.array([plain_chain.total_rate(t, **changed) for t in touches(CLOTH, [MILLIMETRE, NEWTON])])
    return Errors(*(float(np.abs(s.total_rate(rounded) - exact).max() / exact.max()) for s in (scene, scene.refined())))


CHAIN = Errors(2e-4, 2e-6)
EXACT = both(1e-12)

CASES = (
    Case("stiff and soft fabrics", "E_fab 1e-2 to 1e12 Pa", stiff_and_soft_fabrics, CHAIN, slow=True),
    Case("stiffening skin", "m u to 50, both pressures", stiffening_skin, CHAIN),
    Case("indentations", "1 µm to 1.5 R", indentations, CHAIN, slow=True),
    Case("depths", "1 µm to 1 cm", depths, CHAIN, slow=True),
    Case("contact centre", "on the pad's edges and corners", edges, CHAIN, slow=True),
    Case("large contacts", "larger than the pad", larger_than_the_pad, CHAIN, slow=True),
    Case("transduction", "from beta = 0 to a step, 1e3 per kPa", flat_and_step, CHAIN),
    Case("half response", "sigma_0 at the peak stress, above and below", half_response_at_the_peak, CHAIN),
    Case("threshold", "firing starts at the peak stress, ± 1e-12 of it", onset_at_the_peak, CHAIN),
    Case("current", "alpha at the rheobase, ± 1e-9 of it", current_at_the_rheobase, CHAIN),
    Case("onset", "firing starts with a jump", onset_with_a_jump, CHAIN),
    Case("single precision", "float32 input", single_precision, CHAIN),
    Case("skin and contact", "E_fab 1e-2 to 1e12 Pa, m u to 50", skin_and_contact, EXACT),
    Case("stress field", "depth 1 µm to 1 cm, on, in and off the contact", stresses, EXACT),
    Case("receptor current", "any finite stress and beta", currents, EXACT),
    Case("gating", "at the removable singularities, with slopes", removable_singularities, EXACT),
    Case("likelihood", "ratings from 5e-324 to 1.7e308", extreme_ratings, EXACT),
    Case("few ratings", "one rating, one participant, one fabric", lonely_ratings, EXACT),
)
