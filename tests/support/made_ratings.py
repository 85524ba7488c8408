"""Ratings and replicated tables of a small design, made at effects and rates that are known."""

import copy

import numpy as np

from softness_bayes.base import arviz_bridge
from softness_bayes.checking import checks
from softness_bayes.checking.check_table import NEW_PARTICIPANTS
from softness_bayes.checking.provenance import Finding, Findings, attributes_of
from softness_bayes.checking.quantities import EXCESS, excess_of_plateau, plateau
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.layout import Layout
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from support.points import rated

MODEL = RatingModel()
FABRICS, LOADS = 6, 2
RATE = np.array([0.0, 0.3, 1.2, 2.0, 2.4, 2.1, 0.0, 1.0, 1.9, 2.5, 2.3, 1.8])
PLAIN = rated(0.9, 0.6, 0.3)
MODULUS = np.tile(np.geomspace(3e3, 6e5, FABRICS), LOADS)
LOAD = np.repeat(np.arange(LOADS), FABRICS)
STEEP = np.array([0.0, 0.3, 1.2, 2.4, 1.6, 0.9, 0.0, 1.0, 2.2, 2.5, 1.5, 0.8])
"""Rates that clearly turn over under both loads."""
SHALLOW = np.tile([0.0, 0.3, 1.2, 2.4, 2.5, 2.4], 2)
"""Rates that turn over, but hardly."""
REPLICATES = 99
COUNT = 300


def design(participants=15):
    conditions = FABRICS * LOADS
    return Design(
        np.tile(np.arange(conditions), participants),
        np.repeat(np.arange(participants), conditions),
        np.tile(np.arange(FABRICS), LOADS),
        participants,
    )


def layout(participants=15):
    return Layout(design(participants), MODULUS, LOAD)


LAY = layout()


def ratings(rng, who, rate=RATE, truth=PLAIN, noise=None, own=0.0):
    """Ratings of new participants; with other noise, or with exponents of their own."""
    effects = MODEL.draw_effects(rng, truth, (), who.n_participants, who.n_fabrics)
    drive = MODEL.drive(who, rate, truth)
    log_rating = effects.mu + drive[who.condition] + effects.participant[who.participant]
    log_rating += own * rng.standard_normal(who.n_participants)[who.participant] * drive[who.condition]
    return np.exp(log_rating + truth.varsigma * (rng.standard_normal if noise is None else noise)(who.n_rows))


def replicates(rng, lay, filed, rate=RATE, assumed=PLAIN, new=False):
    """Replicated ratings at one draw of the effects, which the theory makes exchangeable with the data."""
    who = lay.design
    effects = LogRatings(filed, who, MODEL).draw_effects(rng, rate, assumed)
    effects = effects.each(lambda e: np.broadcast_to(e, (REPLICATES, *np.shape(e))))
    if new:
        sizes = who.n_participants, who.n_fabrics
        effects = MODEL.draw_effects(rng, assumed, (REPLICATES,), *sizes, {"mu": effects.mu})
    return MODEL.draw_ratings(
        rng, who, np.broadcast_to(MODEL.drive(who, rate, assumed), (REPLICATES, 12)), assumed, effects
    )


def tables(rng, lay, filed, assumed, count=COUNT):
    """Replicated tables at one draw of the effects, and the same with a response that levels off at its peak."""
    who = lay.design
    effects = LogRatings(filed, who, MODEL).draw_effects(rng, assumed, PLAIN)
    effects = effects.each(lambda e: np.broadcast_to(e, (count, *np.shape(e))))
    twin, level = copy.deepcopy(rng), plateau(lay, assumed)
    return tuple(
        MODEL.draw_ratings(noise, who, np.broadcast_to(drive, (count, drive.size)), PLAIN, effects)
        for noise, drive in (
            (rng, MODEL.drive(who, assumed, PLAIN)),
            (twin, MODEL.drive_at(level, who, assumed, PLAIN)),
        )
    )


CHECKED = (checks.CONDITIONS, checks.FABRICS, checks.LOADS, checks.EXPONENTS, checks.ALONG)
"""Checks of residuals in `tree`, all passed."""
BY_ROW = ("rating", NEW_PARTICIPANTS, "participant_index", "fabric_index", "load_index", "loo_pit", EXCESS)


def tree(rng, seen=STEEP, assumed=STEEP, direction="rises-with-firing"):
    """The groups of a result whose model assumes some rates, with data made at others."""
    filed = ratings(rng, LAY.design, seen)
    same, other = tables(rng, LAY, filed, assumed, REPLICATES)
    excess = excess_of_plateau(LAY, same, other)
    new = replicates(rng, LAY, filed, assumed, new=True)
    who = LAY.design
    return arviz_bridge.to_tree(
        {
            "log_likelihood_participant": {"ratings_of_participant": np.zeros((1, 1, 15))},
            "posterior_predictive": {"rating": same[None], NEW_PARTICIPANTS: new[None]},
            "prior_predictive": {"rating": np.exp(rng.normal(3, 3, (1, 50, who.n_rows)))},
            "observed_data": {"rating": filed},
            "constant_data": {
                "effective_modulus_kpa": MODULUS[:6] * 1e-3,
                "indentation_mm": np.array([1.0, 2.0]),
                "force_n": np.full(2, np.nan),
                "participant_index": who.participant,
                "fabric_index": who.fabric[who.condition],
                "load_index": LAY.load[who.condition],
                "loo_pit": rng.random(who.n_rows),
                EXCESS: excess[who.condition],
            },
        },
        dims={
            "ratings_of_participant": ["participant"],
            "effective_modulus_kpa": ["fabric"],
            "indentation_mm": ["load"],
            "force_n": ["load"],
            **{name: ["rating_row"] for name in BY_ROW},
        },
        coords={"participant": [f"P{k}" for k in range(15)], "fabric": [*"abcdef"], "load": ["1 mm", "2 mm"]},
        attrs={
            "direction": direction,
            "rating_scale": "magnitude",
            **attributes_of(Findings(tuple(Finding(name, 0.5, 0.5) for name in CHECKED))),
        },
    )
