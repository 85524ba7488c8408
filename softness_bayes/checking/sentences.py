"""Findings of checks in words: the only sentences about a run's checks, for terminal, report and notebook."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from softness_bayes.base.defaults import shown_of
from softness_bayes.base.readable import number, percent
from softness_bayes.checking.check_table import doubts
from softness_bayes.checking.checks import (
    ALONG,
    CONDITIONS,
    DEVIATIONS,
    DRIFT,
    EXPONENTS,
    FABRICS,
    LEVEL,
    LOADS,
    NOISE,
    NOTICED,
    READINGS,
    SKINS,
)
from softness_bayes.checking.exactness import HARMLESS, Exactness
from softness_bayes.checking.identifiability import DETERMINED, INFORMED, SENSITIVE, SURPRISING
from softness_bayes.checking.individual import FAR, POPULATION
from softness_bayes.checking.modulus_errors import ERROR, LINEAR, clear_shifts
from softness_bayes.checking.provenance import Agreement, Finding, PlateData, RecordedData
from softness_bayes.checking.quantities import (
    DOUBTFUL,
    FALL,
    LARGEST_RATIO,
    NEEDED,
    PLACE,
    TURNS_OVER,
    Reproduction,
    turns_reproduced,
)
from softness_bayes.parameters.declared import PARAMETERS

MUCH_WORSE = 1.5
"""Ratio of residual sds of recorded rates above which the model is much worse than the table of effects."""

FEW_FORCES = 10
"""Number of forces per finger below which the check of their exponent is called weak."""

HERTZ_EXPONENT = 1.5
"""Exponent of force against indentation for skin that does not stiffen."""


# checks of residuals


class Wording(NamedTuple):
    """Words about one check of residuals."""

    subject: str
    unknown: str
    """Reason for comparing nothing."""
    agrees: str
    deviates: str
    """With the place of the estimate."""
    remedy: str
    beyond: str = ""
    """Remedy if the model includes such deviations already."""
    caution: str = ""
    """Added if nothing deviates."""


WORDINGS = {
    EXPONENTS: Wording(
        "participants",
        "exponents cannot be compared, because the response varies for fewer than two participants",
        "no evidence that their exponents differ",
        "their exponents differ by about {size} (standard deviation)",
        "the model assumes one exponent for all",
    ),
    NOISE: Wording(
        "noise",
        "the raters' scatter cannot be compared, because fewer than two gave three ratings or more",
        "no evidence that raters' noise differs",
        "some raters scatter more than others, by about {size} (sd of its log)",
        "the model treats their ratings as equally reliable, and single outliers look the same",
        "look for single outliers",
    ),
    DRIFT: Wording(
        "drift",
        "the table has no order of trials, or no two ratings by one rater in that order",
        "the ratings do not drift with the order of trials",
        "ratings drift by {size} over the trials of a rater",
        "the model has no drift, and mistakes it for effects of loads and fabrics that came late",
        "a smooth drift remains: divide sessions more finely (a column session)",
    ),
    ALONG: Wording(
        "moduli",
        "where no receptor fires, the ratings do not show errors of the moduli",
        "the ratings show no errors of the moduli",
        "mean ratings deviate along the response as if moduli were wrong",
        "give the errors of your measurement",
        "they may be larger than stated, or the response may be wrong",
        ". This check has little power, because the fit absorbs most effects of wrong moduli",
    ),
    SKINS: Wording(
        "fingers",
        "cannot be compared, because the response depends on the skin for fewer than two raters",
        "the ratings do not show that the raters' skin differs",
        "raters deviate as if their skin differed",
        "the model has one skin for all",
        "add more of b, m and sigma_0 to --individual",
    ),
    DEVIATIONS: Wording(
        "spreads",
        "the cells' standard deviations cannot be compared",
        "the cells' standard deviations differ no more than they should",
        "the cells' standard deviations scatter {size} times as much as they should",
        "noise may depend on the fabric or the load, or n may differ between cells",
    ),
}
"""Words about the checks of residuals, in the order in which they are printed; those of fabrics follow them."""


def residual_sentences(findings: Mapping[str, Finding], doubted: Collection[str]) -> tuple[str, ...]:
    """Describe what the residuals of raters and fabrics show, one line for each check that was made.

    Parameters
    ----------
    findings
        Findings by quantity.
    doubted
        Quantities that the model does not reproduce, from `doubts`.
    """
    lines = [residual_sentence(findings[name], doubted) for name in WORDINGS if name in findings]
    if CONDITIONS in findings:
        lines.append(_fabrics(findings[CONDITIONS], findings[FABRICS], findings[LOADS], doubted))
    return tuple(lines)


def residual_sentence(one: Finding, doubted: Collection[str]) -> str:
    """Describe one finding of a check of residuals; arguments as for `residual_sentences`."""
    words = WORDINGS[one.quantity]
    if np.isnan(one.p_value):
        return f"{words.subject}: {words.unknown}"
    p, beyond = f"(p = {one.p_value:.2g})", " more than the model allows" * one.modelled
    if one.quantity not in doubted:
        power = ""
        if np.isfinite(one.noticed):
            power = f"; {one.noticed:.1g} (sd in the {one.unit}) would be detected in {percent(NOTICED)} of such tables"
        return f"{words.subject}: {words.agrees}{beyond} {p}{power}{words.caution}"
    add = f": add {' or '.join(one.advice)}" if one.advice else ""
    remedy = words.beyond if one.modelled and words.beyond else words.remedy + add
    return f"{words.subject}: {words.deviates.format(size=f'{one.estimate:.2g}')}{beyond} {p}; {remedy}"


def _fabrics(conditions: Finding, fabrics: Finding, loads: Finding, doubted: Collection[str]) -> str:
    unit = conditions.unit
    if not {CONDITIONS, FABRICS} & {*doubted}:
        return (
            "fabrics: no mean rating deviates from the response by more than noise explains (p = "
            f"{conditions.p_value:.2g}, {conditions.groups} means; power: deviations of about "
            f"{conditions.noticed:.1g} (sd) in the {unit} would be detected in {percent(NOTICED)} of such tables)"
        )
    if loads.p_value < LEVEL or READINGS in conditions.advice:
        alike = (
            "are similar for similar moduli"
            if READINGS in conditions.advice
            else "differ between the loads of a fabric"
        )
        remedy = f"they {alike}, so the response may be wrong: try other readings"
    else:
        add = f": add {fabrics.advice[0]}" if fabrics.advice else f", and {unit}s have none"
        alone = "" if np.isfinite(loads.p_value) else " (with one load per fabric the response may be wrong instead)"
        remedy = f"without an effect per fabric the intervals are too narrow{add}{alone}"
    if CONDITIONS not in doubted:
        return (
            f"fabrics: deviate from the response alike under every load, by about {fabrics.estimate:.2g} (sd) in the "
            f"{unit}, more than noise explains (p = {fabrics.p_value:.2g}); {remedy}"
        )
    side = "above" if conditions.worst_estimate > 0 else "below"
    return (
        f"fabrics: mean ratings deviate from the response by about {conditions.estimate:.2g} (sd) in the "
        f"{unit}, more than noise explains (p = {conditions.p_value:.2g}); most of all {conditions.worst}, "
        f"{abs(conditions.worst_estimate):.2g} {side} it ({abs(conditions.worst_errors):.1f} standard errors); {remedy}"
    )


# predictive checks


def check_sentences(table: pd.DataFrame) -> list[str]:
    """Describe whether the model reproduces the turning point under each load, and which other quantities it does not.

    Parameters
    ----------
    table
        From `check_table`.
    """
    words = {True: "yes", False: "no", None: "not shown by the ratings"}
    head = (
        "does the model reproduce the turning point (maximum)? The answer is yes only if the check has the "
        f"power to reject a response that levels off at its peak in at least {percent(NEEDED)} of simulated "
        "tables"
    )
    found = turns_reproduced(table)
    shown = shown_of(len(found))
    lines = [f"{found[k].load}: {words[found[k].reproduced]}; {turn_sentence(found[k])}" for k in shown]
    if len(shown) < len(found):
        counts = ", ".join(f"{word} {sum(one.reproduced is answer for one in found)}" for answer, word in words.items())
        by_chance = f"for a correct model, at most about {DOUBTFUL * len(found):.1g} would be no by chance"
        lines.insert(0, f"of {len(found)} loads: {counts} ({by_chance}); {len(shown)} of them:")
    return [head, *lines, unreproduced_sentence(doubts(table))]


def unreproduced_sentence(names: Sequence[str]) -> str:
    """Describe quantities, other than the turning point, that the model does not reproduce; names from `doubts`."""
    if not names:
        return "predictive checks: the model reproduces all other test quantities"
    return f"predictive checks: the model does not reproduce {', '.join(names)} (see predictive_checks.csv)"


def turn_sentence(one: Reproduction) -> str:
    """Describe the turn in the ratings, in tables that the model simulates, and the power of the check."""
    row, place, beyond = one.checks[TURNS_OVER], one.checks[PLACE], one.checks[FALL]
    if np.isnan(row["observed"]):
        return "too few fabrics or ratings"
    share = percent(row["replicated"])
    if row["observed"]:
        where = f", at {number(place['low'])} to {number(place['high'])} kPa" if np.isfinite(place["low"]) else ""
        said = f"the ratings turn over at {number(place['observed'])} kPa (so do {share} of simulated tables{where})"
    else:
        said = f"the ratings show no clear turning point ({share} of simulated tables show one)"
    if np.isfinite(beyond["observed"]):
        said += f"; {_fall(beyond)}"
    if np.isnan(beyond["replicated"]):
        return f"{said}; the model's response does not fall within the range of the fabrics"
    power = f"{100 * beyond['power']:.3g} ± {100 * beyond['power_mcse']:.1g}%"
    return f"{said}; a response that levels off would fail in {power} of simulated tables"


def _fall(beyond: pd.Series) -> str:
    """Describe the fall of the ratings beyond the peak of the response, in units of the predicted one."""
    low, high, ratio = beyond["low"], beyond["high"], beyond["observed"]
    if max(abs(low), abs(high)) > LARGEST_RATIO:
        return "the fall that is predicted beyond the peak is too small to compare with noise"
    way = "fall" if ratio >= 0 else "rise"
    return (
        f"beyond the peak they {way} by {abs(ratio):.2g} times the predicted fall "
        f"(simulated tables: {low:.2g} to {high:.2g})"
    )


# the fast model, and plate forces


def exactness_sentence(exactness: Exactness | None) -> str:
    """Describe the difference between fast and exact log-likelihood and its effect on the posterior."""
    if exactness is None:
        return "Not checked: a first look (--quick) does not compare the fast model with the exact one."
    most = ""
    if exactness.shift.size:
        moved = int(np.abs(exactness.shift).argmax())
        most = f"; no mean moves by more than {np.abs(exactness.shift[moved]):.1g} sd ({exactness.names[moved]})"
    error = f" ± {exactness.sd_error:.1g}" if np.isfinite(exactness.sd_error) else ""
    tail = f", Pareto k {exactness.pareto_k:.2f}" if exactness.sd > HARMLESS else ""
    verdict = "Exact enough" if exactness.exact_enough else "Not exact enough"
    return (
        f"{verdict}: compared with {exactness.rates} and a finer quadrature, the log-likelihood of "
        f"{exactness.difference.size} draws differs by {exactness.sd:.1g} (sd{error}), {exactness.largest:.1g} at "
        f"most; importance weights keep {percent(exactness.efficiency, 1)} of the effective sample size{tail}{most}."
    )


def plate_sentence(plate: PlateData) -> str:
    """Describe the growth of plate forces with indentation beside that of the fitted skin."""
    if not np.isfinite(plate.force_exponent):
        return "compression: no finger was pressed to two indentations, so the growth of force cannot be checked"
    steeper = "steeper than" if plate.force_exponent > HERTZ_EXPONENT else "no steeper than"
    weak = ""
    if plate.forces_per_finger < FEW_FORCES:
        weak = f"; with {plate.forces_per_finger:.2g} forces per finger this check has little power"
    return (
        f"compression: force grows as indentation to the power {plate.force_exponent:.2f} ({steeper} Hertz's "
        f"{HERTZ_EXPONENT}); replicated: {plate.force_exponent_low:.2f} to {plate.force_exponent_high:.2f} (90 %), "
        f"p = {plate.force_p_value:.2g}{weak}"
    )


def recorded_sentences(found: RecordedData) -> list[str]:
    """Describe how well the model follows recorded rates, how far it is from the paper, and how sources agree."""
    additive = (
        f"; a table of effects of load, curvature and distance, without skin or receptors, leaves "
        f"{number(found.rate_additive_sd)} Hz"
    )
    moved = ", ".join(f"{name} {value:+.1f}" for name, value in found.rate_shifts.items())
    return [
        f"recorded rates: the model leaves a residual sd of {number(found.rate_residual_sd)} Hz"
        f"{additive if np.isfinite(found.rate_additive_sd) else ''}",
        f"recorded afferents against the paper's values, in sd of their priors: {moved}",
        f"current at rest: {number(found.rest)} of the rheobase ({number(found.rest_low)} to "
        f"{number(found.rest_high)}, 90 %); firing at rest in {percent(found.fires_at_rest)} of draws",
        *map(agreement_sentence, found.agreements),
    ]


def agreement_sentence(one: Agreement) -> str:
    """Describe whether two sources agree about the parameters that they share, or could share."""
    found = f"chi-square {number(one.chi_square)} on {', '.join(one.about)}; p = {one.p_value:.2g}"
    if not one.contradicts:
        return f"{one.first} and {one.second} do not contradict each other ({found})"
    advice = "do not pool them" if one.shared else "the run keeps these apart, and they should not be shared"
    return f"{one.first} and {one.second} contradict each other under this model ({found}): {advice}"


def recorded_faults(found: RecordedData) -> tuple[str, ...]:
    """Name what the model does not reproduce in recorded rates, and sources that contradict what it lets them share."""
    worse = found.rate_residual_sd > MUCH_WORSE * found.rate_additive_sd  # NaN is not
    apart = (f"{one.first} and {one.second} together" for one in found.agreements if one.contradicts and one.shared)
    return (*(("the recorded rates as well as a table of effects does",) if worse else ()), *apart)


# what was learnt


def information_sentences(summary: pd.DataFrame) -> list[str]:
    """Describe which parameters the data determine, partly inform or leave open, and which depend on the prior.

    Parameters
    ----------
    summary
        A table with the columns of `information_table`.
    """
    width = np.sqrt((1.0 - summary["contraction"]).clip(lower=0.0))
    lines = [surprise_sentence(summary)] if surprises(summary).size else []
    groups = {
        "determined by the data (posterior sd at most 1/3 of the prior sd)": width <= DETERMINED,
        f"partly informed by the data (posterior sd at most {INFORMED:g} of the prior sd)": (width > DETERMINED)
        & (width <= INFORMED),
        "weakly identified (posteriors nearly as wide as the priors)": width > INFORMED,
    }
    near = ~width.index.isin(surprises(summary).index)
    for words, there in groups.items():
        named = ", ".join(f"{name} {value:.2g}" for name, value in width[there & near].items())
        lines.append(f"{words}: {named or 'none'}")
    pull = summary["psens_prior"][width <= INFORMED]
    error = 2.0 * summary["psens_prior_mcse"].reindex(pull.index).fillna(0.0)
    moved, unclear = pull > SENSITIVE + error, (pull - SENSITIVE).abs() <= error
    if moved.any():
        named = ", ".join(f"{name} ({pull[name]:.2g})" for name in pull.index[moved])
        lines.append(
            f"informed, but prior-sensitive (power-scaling sensitivity above {SENSITIVE} by two standard errors): "
            f"{named}. Another prior would change these posteriors: justify these priors, or compare runs with other "
            "priors (--prior). Weakly identified parameters follow their priors in any case"
        )
    if unclear.any():
        named = ", ".join(f"{name} ({pull[name]:.3f} ± {error[name] / 2:.1g})" for name in pull.index[unclear])
        lines.append(f"prior sensitivity unclear (within two standard errors of {SENSITIVE}): {named}")
    return lines


def surprises(summary: pd.DataFrame) -> pd.Series:
    """Return the distances of posterior means that are far from their priors, in prior standard deviations, by name."""
    shift = summary["prior_shift"]
    return shift[shift.abs() >= SURPRISING]


def surprise_sentence(summary: pd.DataFrame) -> str:
    """Describe the parameters whose posterior mean is far from the prior, whatever the width of their posteriors."""
    far = surprises(summary)
    named = [
        f"{name} ({number(mean)}, {abs(shift):.1f} prior standard deviations {'above' if shift > 0 else 'below'} the "
        "prior's median)"
        for name, mean, shift in zip(far.index, summary.loc[far.index, "mean"], far, strict=True)
    ]
    causes = "guesses and outliers" if only_noisy(summary) else "a wrong direction, unit, modulus or reading"
    return f"data and prior disagree about {', '.join(named)}: look for {causes} before anything else is believed"


def only_noisy(summary: pd.DataFrame) -> bool:
    """Return whether the spread of ratings is all that is far from its prior: no error of the chain's input shows."""
    return [*surprises(summary).index] == ["varsigma"]


def direction_sentences(directions: pd.DataFrame) -> list[str]:
    """Describe the combinations of parameters that the data determine, partly inform, or leave open.

    Parameters
    ----------
    directions
        Table from `direction_table`.
    """
    width = directions["width"].astype(float)
    names = [*directions.columns[1 : directions.columns.get_loc("product")]]
    lines = []
    for words, there in {
        "combinations determined by the data (90 % interval at most 1/3 as wide as under the prior)": (
            width <= DETERMINED
        ),
        f"combinations partly informed by the data (at most {INFORMED:g} as wide)": (
            (width > DETERMINED) & (width <= INFORMED)
        ),
    }.items():
        if there.any():
            lines.append(f"{words}:")
            lines += [f"  {row['meaning'].partition(': ')[2]}" for _, row in directions[there].iterrows()]
    open_ = directions[~(width <= INFORMED)]
    if len(open_):
        share = (open_[names] ** 2).sum().sort_values(ascending=False, kind="stable")
        of = ", ".join(share.index[share >= min(0.5, share.max())])
        lines.append(
            f"weakly identified: {len(open_)} further combination{'s' * (len(open_) > 1)} of {of}, nearly as wide as "
            "under the prior. Many values of these fit the data equally well. To learn more, measure one of them "
            "directly; until then report results under several priors (--prior)"
        )
    return lines


def modulus_sentences(table: pd.DataFrame) -> list[str]:
    """Describe the moduli that the ratings narrow, and those that they move away from the measured values.

    Parameters
    ----------
    table
        From `modulus_table`.
    """
    if len(table) > 1 and table["law"].nunique() == 1:
        return [
            "fabric moduli: nothing was known that tells these fabrics apart, so their moduli follow from the ratings "
            "and from the direction taken, and tell nothing beyond people's own order"
        ]
    width = (1.0 - table["contraction"]).clip(lower=0.0) ** 0.5
    narrowed = [f"{name} (to {share:.2g} of its error)" for name, share in width.items() if share <= INFORMED]
    which = f": {', '.join(narrowed)}" if narrowed else ""
    said = [f"fabric moduli: the ratings narrow {len(narrowed)} of {len(table)}{which}"]
    for name, row in table[table["shift"].abs() >= FAR].iterrows():
        side = "above" if row["shift"] > 0 else "below"
        said.append(
            f"  {name}: {row['median']:.3g} kPa ({row['low']:.3g} to {row['high']:.3g}), "
            f"{abs(row['shift']):.1f} standard errors {side} the {row['law_median']:.3g} kPa that were "
            "measured; repeat the measurement"
        )
    return said


def rater_sentences(table: pd.DataFrame) -> list[str]:
    """Describe how much raters' fingers or answers differ, without names, which a report may hide.

    Parameters
    ----------
    table
        From `deviation_table`.
    """
    said = []
    for name, part in table.groupby(level="quantity", sort=False):
        rows = part.droplevel("quantity")
        anyone, raters = rows.loc[POPULATION], rows.drop(POPULATION)
        unit, median = PARAMETERS[str(name)].unit, raters["median"]
        pressed = int(raters["pressed"].sum()) if "pressed" in raters else 0
        forces = f"; plate forces are available for {pressed} of {len(raters)} raters" if pressed else ""
        said.append(
            f"{name} of single raters: medians from {median.min():.3g} to "
            f"{median.max():.3g}{'' if unit == '–' else f' {unit}'}; 90 % of new raters lie between "
            f"{anyone['low']:.3g} and {anyone['high']:.3g}{forces}"
        )
    return said


def shift_sentences(table: pd.DataFrame) -> list[str]:
    """Describe how far conclusions would shift if moduli taken as exact were wrong.

    Parameters
    ----------
    table
        From `shift_table`; quantities with Monte-Carlo errors of the same size are left out.
    """
    clear = clear_shifts(table)
    if clear.empty:
        return []
    return [
        f"if the moduli had independent errors of {percent(ERROR)}, posterior means would move by these numbers of "
        "posterior standard deviations (to first order, in proportion to the errors; larger shifts than "
        f"{LINEAR:g} are only a rough guide: repeat the run with the errors)",
        *(
            f"  {name}: "
            + (f"{row['shift_10']:.2g} ± {row['shift_10_mcse']:.1g}" if row["shift_10"] <= LINEAR else "more than 1")
            for name, row in clear.iterrows()
        ),
    ]
