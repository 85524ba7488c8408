"""Tails of residuals, which decide between normal and Student's t errors if no error law is requested (model.md 9)."""

from __future__ import annotations

import numpy as np

from softness_bayes.checking.layout import Layout, merge
from softness_bayes.data import Ratings
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import NORMAL, STUDENT, ErrorLaw
from softness_bayes.likelihood.scales import Scale
from softness_bayes.likelihood.stated import Stated
from softness_bayes.readable import counted
from softness_bayes.touch.load_groups import groups_of

HEAVY = 4.0
"""Number of standard errors by which the excess kurtosis must exceed 0 for Student's t errors to be the default."""

FEWEST = 30
"""Residual degrees of freedom below which normal errors are the default, as kurtosis is then too uncertain."""

LEAST_FREE = 1e-3
"""Standard deviation of a residual, relative to that of an error, below which it carries no information on the error
law."""


def law_of(ratings: Ratings, intervals: Stated, scale: Scale) -> tuple[ErrorLaw, str]:
    """Return Student's t if the residuals of participants and conditions have heavy tails, else normal; and why.

    Censored ratings have no residual: a 0 is some number below a limit, and any number in its place may lie far out.
    """
    conditions, known = ratings.conditions, ~intervals.censored
    left_out = "" if known.all() else f", without {counted(int((~known).sum()), 'censored rating')}"
    rated, of_row = np.unique(conditions.of_rating[known], return_inverse=True)
    values, fabric = intervals.values[known], conditions.fabric[rated]
    design = Design(of_row, ratings.participant[known], fabric, len(ratings.participants))
    layout = Layout(design, np.ones(design.n_conditions), conditions.load[rated], scale=scale)
    groups, within = groups_of(ratings.loads), ""
    if groups.merged and design.n_rows - design.n_conditions - design.n_participants < FEWEST:
        # exact loads hardly repeat; changes of the response within a group have light tails
        layout, within = merge(layout, groups.of)[0], f" within {counted(groups.at.size, 'group')} of loads"
        design = layout.design
    fit = layout.fit(values)
    if layout.residual_freedom < FEWEST or not fit.sd > 0:
        why = f"normal, because too few ratings repeat a condition{within} to test for heavier tails"
        return NORMAL, (f"{why}; --errors overrides{', --round-load STEP merges nearby loads' if within else ''}")
    participant = np.nan_to_num(fit.participant)[design.participant]
    residual = scale.additive(values) - fit.condition[design.condition] - participant
    # ratings that alone determine their condition have zero residuals, which would look like a narrow peak
    spread = np.sqrt(np.maximum(1.0 - layout.leverage, 0.0))
    residual = residual[spread > LEAST_FREE] / spread[spread > LEAST_FREE]
    kurtosis = float((residual**4).mean() / (residual**2).mean() ** 2 - 3.0)
    error = float(np.sqrt(24.0 / layout.residual_freedom))
    numbers = f"(excess kurtosis of the residuals{within}{left_out} {kurtosis:.2f} ± {error:.2f}); --errors overrides"
    if kurtosis > HEAVY * error:
        return STUDENT, f"{STUDENT.meaning}, because tails are heavier than normal {numbers}"
    return NORMAL, f"normal, because tails are no heavier than that {numbers}"
