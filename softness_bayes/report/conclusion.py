"""Conclusion of a run: the closing lines of the terminal and the top of its report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from softness_bayes.base.defaults import in_words
from softness_bayes.base.files.run_files import FABRIC_RATINGS, RULER
from softness_bayes.base.readable import chance, counted, number, with_error
from softness_bayes.checking.agreement import RATERS_OF_CELLS, HighestRated, highest_rated
from softness_bayes.checking.check_table import doubts
from softness_bayes.checking.checks import OMEGA, READINGS
from softness_bayes.checking.identifiability import INFORMED
from softness_bayes.checking.layout import PEOPLE_ORDERS, layout_of, ratings_in
from softness_bayes.checking.modulus_errors import LINEAR, MovedMost
from softness_bayes.checking.quantities import DOUBTFUL, turns_reproduced
from softness_bayes.checking.sentences import (
    agreement_sentence,
    only_noisy,
    recorded_faults,
    surprise_sentence,
    surprises,
)
from softness_bayes.data.oddities import few_raters_sentence
from softness_bayes.likelihood.scales import FALLS, PAIRS, RISES
from softness_bayes.model.direction import odd_raters
from softness_bayes.parameters.declared import EVERY_PARAMETER, MODULUS_SCALES, PARAMETERS, RECORDING_PARAMETERS
from softness_bayes.parameters.space import scales_of
from softness_bayes.people.free_means import word_of
from softness_bayes.people.ruler import UNKNOWN, Following, fit_of
from softness_bayes.people.sentences import highest_sentences, pairs_sentence, ruler_sentence
from softness_bayes.report.cards import input_errors_of
from softness_bayes.results.rating_table import rises_with_stiffness
from softness_bayes.results.result import Result

LIKELY = 0.9
"""Probability above which a turning point is reported; below one minus this, its absence is reported."""

_AGREE, _ENOUGH = 1.05, 200.0
"""Largest R-hat and smallest bulk effective sample size at which the findings of a first look are reported."""

_NARROWED = 1.0 - INFORMED**2
"""Contraction from which the interval of a parameter is clearly narrower than its prior's."""


class Turn(NamedTuple):
    """The turning point under one load."""

    load: str
    probability: float
    """Probability of a maximum inside the range of the response curve."""
    low: float
    middle: float
    high: float
    """5 %, 50 % and 95 % quantiles of E_fab at the maximum [kPa]; NaN without one."""
    ratio_low: float
    ratio_high: float
    """5 % and 95 % quantiles of E_fab / E_skin there."""
    reproduced: bool | None
    """Result of the predictive check; None if the ratings under this load do not decide."""

    @property
    def decided(self) -> bool:
        """True if the ratings decide whether the response turns over."""
        return self.probability <= 1.0 - LIKELY or (self.probability >= LIKELY and self.reproduced is not None)


class Learnt(NamedTuple):
    """The posterior of one parameter."""

    name: str
    low: float
    high: float
    """90 % interval, in natural units."""
    informed: bool
    """True if the interval is clearly narrower than the prior's."""
    unit: str = "–"
    of: str = ""
    """Batch of moduli that it belongs to."""

    @property
    def words(self) -> str:
        """Meaning of the parameter with its name, and whose it is."""
        return f"{EVERY_PARAMETER[self.name].meaning} ({self.name}{f': {self.of}' if self.of else ''})"

    @property
    def interval(self) -> str:
        """The parameter with its interval and unit."""
        unit = f" {self.unit}" if self.unit != "–" else ""
        return f"{self.words} {number(self.low)} to {number(self.high)}{unit}"


class Facts(NamedTuple):
    """The values behind a conclusion."""

    converged: bool
    steps: int
    other_direction: str | None = None
    """The direction supported by the data, if the run used the other one."""
    silent: bool = False
    """True if most of the posterior predicts no firing."""
    differ: bool = True
    """True if ratings differ between fabrics beyond noise."""
    exact: bool = True
    """Effect of the fast forward model on the posterior."""
    unreproduced: tuple[str, ...] = ()
    """Failed predictive checks other than the turning point."""
    turns: tuple[Turn, ...] = ()
    rated: bool = True
    """False for a run without ratings."""
    parameters: tuple[Learnt, ...] = ()
    """Parameters that the data inform or not."""
    fabrics: tuple[float, float] = (np.nan, np.nan)
    """Range of E_fab of the rated fabrics [kPa]."""
    moved: MovedMost | None = None
    """Largest shift due to errors of moduli assumed to be exact, if relevant."""
    quick: bool = False
    """True if this is a first look, which ended at the first check of the chains."""
    settled: bool = False
    """True if the ensembles of a first look agree well enough to report its findings."""
    people: tuple[str, ...] = ()
    """Sentences on people's own means with what the chain predicts, and on how much of them the chain keeps."""
    follows: Following = UNKNOWN
    """Answer to whether the chain follows the ratings, by its ruler."""
    odd: str = ""
    """Raters whose answers look reversed or copied, as a sentence."""
    copied: bool = False
    """True if some of them are copies, which no check of the model shows."""
    remedies: tuple[str, ...] = ()
    """Options that would include what failed checks show, with their estimated gain, the largest first."""
    direction: str = ""
    """Probability of either direction of the ratings, as a sentence, if both were sampled."""
    surprise: str = ""
    """Sentence on parameters whose posterior is far from their prior; empty if none is."""
    noisy: bool = False
    """True if these are the spread of ratings alone."""
    cautions: tuple[str, ...] = ()
    """Errors that no check of this run can show, and sources that contradict each other."""

    @property
    def failed(self) -> bool:
        """True if the model does not follow the ratings at all."""
        return self.other_direction is not None or self.follows.rejected

    @property
    def rejected(self) -> bool:
        """True if a check rejects a part of the model, or the fast model is not accurate enough."""
        return bool(self.contradicted or self.unreproduced or not self.exact or self.follows.keeps is False)

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Loads whose turning point the model does not reproduce."""
        return tuple(turn.load for turn in self.turns if turn.reproduced is False)


class Conclusion(NamedTuple):
    """Sentences for readers who do not know R-hat."""

    trust: str
    learnt: str
    next_step: str
    people: tuple[str, ...] = ()
    """Sentences on people's own answer; empty for a run without ratings."""
    cautions: tuple[str, ...] = ()

    @property
    def questions(self) -> dict[str, Sequence[str]]:
        """Questions of a reader, each with its answer in sentences or clauses."""
        return {
            "Can this result be trusted?": [self.trust],
            "What do people say?": self.people,
            "What was learnt?": self.learnt.split("; "),
            "What next?": [self.next_step],
        }

    @property
    def lines(self) -> tuple[str, ...]:
        """The sentences with their labels, as printed."""
        trust, people, learnt, next_step = self.questions.values()
        parts = {
            "People:": people,
            "Trust it?": trust,
            "Learnt:": learnt,
            "Caution:": self.cautions,
            "Next:": next_step,
        }
        return tuple(
            f"{label if k == 0 else '':11}{line}" for label, lines in parts.items() for k, line in enumerate(lines)
        )


def facts_of(result: Result) -> Facts:
    """Return the values on which the conclusion about a result is based."""
    ending, summary = result.provenance.ending, result.summary()
    settled = summary["r_hat"].max() <= _AGREE and summary["ess_bulk"].min() >= _ENOUGH
    recorded = recorded_faults(result.provenance.recorded) if result.has_afferents else ()
    facts = Facts(
        ending.converged,
        ending.steps,
        quick=bool(ending.quick),
        settled=bool(ending.quick and settled),
        surprise=surprise_sentence(summary) if surprises(summary).size else "",
        noisy=only_noisy(summary),
        rated=result.has_ratings,
        parameters=_parameters(result),
    )
    if not result.has_ratings:
        failed = result.has_compression and result.provenance.plate.force_p_value < DOUBTFUL  # NaN is not
        wrong = ("growth of the plate's force with indentation",) if failed else ()
        return facts._replace(unreproduced=(*wrong, *recorded), cautions=_contradictions(result))
    ruler = result.tables.get(RULER)
    fit, checks, inputs = fit_of(result.tree, ruler), result.tables["predictive_checks"], input_errors_of(result)
    other = next(one.name for one in (RISES, FALLS) if one is not fit.direction.direction)
    odd, copied = _odd(result)
    fabrics, speaks = result.fabrics, (ending.converged or settled) and not fit.failed
    reproduced = {one.load: one.reproduced for one in turns_reproduced(checks)}
    turns = result.inflection()[
        ["p_interior", "e_fab_kpa_low", "e_fab_kpa", "e_fab_kpa_high", "ratio_low", "ratio_high"]
    ]
    return facts._replace(
        other_direction=other if fit.direction.against_data else None,
        silent=fit.mostly_silent,
        direction=fit.direction.said,
        odd=odd,
        copied=copied,
        remedies=_remedies(result),
        differ=ruler is None or bool(ruler["low"]["gain"] > 0.0),
        exact=result.provenance.errors.exact_enough,
        unreproduced=(*doubts(checks), *recorded),
        turns=tuple(Turn._make((*row, reproduced.get(row[0]))) for row in turns.itertuples(name=None)),
        fabrics=(float(fabrics.effective_modulus.min()) / 1e3, float(fabrics.effective_modulus.max()) / 1e3),
        moved=inputs.largest if inputs.sensitive else None,
        people=_people(result, highest_rated(result.tree) if speaks else ()),
        follows=fit.follows if ending.converged or settled else UNKNOWN,
        cautions=(*_contradictions(result), *_cautions(result)),
    )


def _parameters(result: Result) -> tuple[Learnt, ...]:
    of = {name: batch for batch, name in scales_of(result.fabrics.batch).items()} if result.has_ratings else {}
    posterior, summary = result.group("posterior"), result.summary()
    rows = summary[summary.index.isin({**PARAMETERS, **RECORDING_PARAMETERS, **MODULUS_SCALES})]
    return tuple(
        Learnt(
            str(name),
            row.hdi_low,
            row.hdi_high,
            row.contraction >= _NARROWED,
            posterior[name].units,
            of.get(str(name), ""),
        )
        for name, row in rows.iterrows()
    )


def _remedies(result: Result) -> tuple[str, ...]:
    """Return the options that would include what failed checks of residuals show, with their gain, largest first."""
    doubted = {name.partition(" (")[0] for name in doubts(result.tables["predictive_checks"])}
    found = {
        " or ".join(one.advice): one.gain
        for name, one in result.provenance.findings.items()
        if name in doubted and one.advice and one.gain > 0
    }
    ranked = sorted(found, key=lambda option: -found[option])
    told = [f"{option} (estimated gain: {found[option]:.0f} in the log-likelihood)" for option in ranked]
    tails = [name for name in doubted if name.endswith(" residual / sd")]
    normal = result.provenance.rating_model.rating_errors == "normal"
    if tails and normal and not any("--errors" in option for option in found):
        told.append("--errors lapses or student, for guesses and outliers")
    return tuple(told)


def _odd(result: Result) -> tuple[str, bool]:
    """Return a question about raters whose answers look reversed or copied, if any, and whether some are copies."""
    names = result.group("log_likelihood_participant")["participant"].values.astype(str)
    found = odd_raters(layout_of(result.tree), ratings_in(result.tree))
    said = [f"the scale of {_listed([names[k] for k in found.against])} was reversed"] if found.against else []
    if found.copies:
        said.append(f"the answers of {_listed([names[k] for k in found.copies])} are copies of another rater's")
    return " and whether ".join(said), bool(found.copies)


def _contradictions(result: Result) -> tuple[str, ...]:
    """Return sentences on sources that contradict each other about what they share, whether chains converged or not."""
    every = result.provenance.recorded.agreements if result.has_afferents else ()
    return tuple(f"{agreement_sentence(one)}." for one in every if one.contradicts and one.shared)


def _cautions(result: Result) -> tuple[str, ...]:
    """Return what no check of a run can show: people who were not asked, a reversed scale, errors that moduli share."""
    raters = result.group("constant_data").get(RATERS_OF_CELLS)
    people = result.group("log_likelihood_participant").sizes["participant"] if raters is None else int(raters)
    scale = "stiffer fabrics get the higher ratings: does higher mean softer on this scale?"
    scale = scale if rises_with_stiffness(result) else ""
    common = (
        "an error common to all moduli (a tester that reads 20 % high) moves b, sigma_0 and beta together, and no "
        "rating shows it: state its size with --shared-modulus-cv (a column batch: one error for each laboratory); "
        "turning points as E_fab / E_skin do not depend on it"
    )
    common = "" if MODULUS_SCALES.keys() & result.group("posterior").keys() else common
    return tuple(one for one in (few_raters_sentence(people), result.said_of_force(), scale, common) if one)


def _people(result: Result, chain: Sequence[HighestRated]) -> tuple[str, ...]:
    """Return what people said under each load beside the chain, which pairs differ, and what it keeps of this."""
    if RULER not in result.tables:
        return ()  # a custom scale
    table, ruler, scale = result.tables[FABRIC_RATINGS].reset_index(), result.tables[RULER], result.scale
    word = word_of(result.provenance.rating_data.rating_column, scale)
    told = pairs_sentence(result.load_groups.names, result.group("constant_data")[PEOPLE_ORDERS].values)
    alike = ruler["value"].isna()["share"]  # which of fabrics that people do not tell apart is highest is chance
    beside = {}
    for one in chain:
        likely = with_error(100 * one.probability, 100 * one.error, " %") if one.error else chance(one.probability)
        beside[one.load] = f"{'' if one.clear else 'none clear, '}{one.fabric} ({likely})"
    highest = () if alike else highest_sentences(table, word, scale, beside)
    return (*highest, *filter(None, [told]), ruler_sentence(ruler, scale))


def subject(result: Result) -> str:
    """Return a one-line description of the data of the run."""
    parts = []
    if result.has_ratings:
        people = result.group("log_likelihood_participant").sizes["participant"]
        fabrics = result.group("constant_data").sizes["fabric"]
        loads = " and ".join(in_words(result.load_groups.names).rsplit(", ", 1))
        ratings = int(np.isfinite(result.group("observed_data")["rating"].values).sum())
        pairs = result.scale == PAIRS
        answers = counted(ratings // 2, "comparison") if pairs else counted(ratings, "rating")
        parts.append(f"{answers} of {counted(fabrics, 'fabric')} by {counted(people, 'participant')} under {loads}")
    if result.has_compression:
        forces, fingers = result.group("observed_data")["plate_force_n"].size, result.group("posterior").sizes["finger"]
        parts.append(f"{forces} forces of a rigid plate on {fingers} fingerpads")
    if result.has_afferents:
        parts.append(f"{result.group('observed_data')['recorded_rate_hz'].size} recorded responses of afferents")
    return "; ".join(parts)


def conclude(facts: Facts, directory: str | None = None) -> Conclusion:
    """Return the conclusion that follows from some facts.

    Parameters
    ----------
    facts
        As `facts_of` returns them.
    directory
        Directory of the run, as commands name it; None on the report's page, which knows of none.
    """
    return Conclusion(_trust(facts), _learnt(facts), _next(facts, directory), facts.people, facts.cautions)


def _trust(facts: Facts) -> str:
    if facts.other_direction is not None:
        return "No: ratings change with stiffness in the opposite direction to the one that the run assumes."
    if facts.follows.rejected:
        return "No: the chain certainly loses a part of what people agree on, so that it cannot speak for them."
    if facts.quick:
        missing = "" if facts.converged else " The chains have not converged."
        lost = " The chain loses some of what people agree on." if facts.follows.keeps is False else ""
        return (
            f"Not yet: this is a first look after {facts.steps} steps.{missing} The fast model was not compared with "
            f"the exact one.{lost}"
        )
    if not facts.converged:
        return f"Not yet: the chains have not converged after {facts.steps} steps. All numbers may still change."
    failed = [*(f"the turning point at {load}" for load in facts.contradicted), *facts.unreproduced]
    doubts_of_it = (
        (not facts.exact, "With care", "the fast approximation of the model is not accurate enough"),
        (bool(failed), "In part", f"the model does not reproduce {_listed(failed)}"),
        (facts.follows.keeps is False, "In part", "the chain loses some of what people agree on"),
        (bool(facts.surprise), "With care", facts.surprise),
        (facts.silent, "With care", "most of the posterior predicts that no receptor fires"),
    )
    for holds, word, reason in doubts_of_it:
        if holds:
            return f"{word}: the chains have converged, but {reason}."
    if facts.moved is not None:
        size = "more than one posterior standard deviation"
        if facts.moved.shift <= LINEAR:  # a shift to first order is a guide no further
            size = f"about {facts.moved.shift:.2g} posterior standard deviations"
        return (
            "With care: the chains have converged and no check found a difference between model and data, but "
            "the fabrics' moduli are treated as exact. The largest shift that errors of 10 % would cause "
            f"({facts.moved.name}) is {size}."
        )
    if facts.people and facts.follows.keeps is None:
        return (
            "As far as these ratings tell: the chains have converged and no check found a difference, but a loss of "
            "what people agree on would not have been seen."
        )
    return "Yes: the chains have converged and no check found a difference between model and data."


def _learnt(facts: Facts) -> str:
    if facts.failed:
        return "nothing about skin or receptors, because the model does not fit these ratings."
    if not facts.converged and not facts.settled:
        return "nothing yet. The draws so far are for inspection only."
    clauses = [_turned(turn, facts.rejected, facts.fabrics) for turn in facts.turns]
    if not facts.differ:
        clauses = [
            "the ratings do not differ between fabrics by more than noise, so they show little about the turning point"
        ]
    if facts.direction:
        clauses.insert(0, facts.direction)
    known = [one.interval for one in facts.parameters if one.informed]
    unknown = [one.words for one in facts.parameters if not one.informed]
    clauses += [f"learnt (90 % intervals): {', '.join(known)}"] if known else []
    clauses += [f"not learnt, as wide as their priors: {', '.join(unknown)}"] if unknown else []
    return f"{'preliminary: ' * facts.quick}{'; '.join(clauses)}."


def _turned(turn: Turn, rejected: bool, fabrics: tuple[float, float]) -> str:
    """Return a clause on the turning point under one load.

    It is qualified if checks reject a part of the model, and if it lies beyond the moduli of the `fabrics` [kPa].
    """
    said, at = chance(turn.probability), f"{'if the model holds, ' * rejected}at {turn.load} the response"
    if turn.reproduced is False and turn.probability <= 1.0 - LIKELY:
        return (
            f"at {turn.load} the ratings turn over, and the response does not (probability of a turning point: {said})"
        )
    if turn.reproduced is False:
        return f"at {turn.load} the ratings contradict the model's turning point"
    if turn.probability <= 1.0 - LIKELY:
        return f"{at} does not turn over (probability of a turning point: {said})"
    if turn.probability < LIKELY:
        return f"at {turn.load} the data do not show whether the response turns over (probability: {said})"
    limits = f"(90 % interval {number(turn.low)} to {number(turn.high)} kPa"
    limits += f", E_fab / E_skin {number(turn.ratio_low)} to {number(turn.ratio_high)})"
    alone = ", though the ratings at this load alone cannot show it" if turn.reproduced is None else ""
    if not fabrics[0] <= turn.middle <= fabrics[1]:
        alone += ", which is an extrapolation beyond the fabrics rated"
    return f"{at} turns over at E_fab = {number(turn.middle)} kPa {limits}{alone}"


def _next(facts: Facts, directory: str | None) -> str:
    if facts.other_direction is not None:
        return (
            f"repeat the run with --direction {facts.other_direction}, or check whether the rating scale was reversed."
        )
    if facts.odd and (facts.copied or facts.failed or facts.rejected):
        return f"check whether {facts.odd}, and leave these rows out or correct them."
    if facts.silent and (facts.converged or facts.failed):
        return "check the units of moduli and loads ('softness-bayes check'), then try --priors in-vivo."
    if facts.remedies and (facts.follows.rejected or facts.rejected) and (facts.converged or facts.settled):
        units = "check the units of moduli and loads; then " * (bool(facts.surprise) and not facts.noisy)
        return f"{units}repeat the run with {'; or with '.join(facts.remedies)}, and use 'softness-bayes compare'."
    if facts.follows.rejected:
        return (
            "look for fabrics, units and moduli that do not belong together ('softness-bayes check'); try "
            f"{READINGS} or {OMEGA}, and rank the runs with 'softness-bayes compare'."
        )
    if facts.quick:
        return f"'softness-bayes resume {directory or 'DIR'}' continues to the full run and repeats no step."
    if not facts.converged:
        return f"continue the run with 'softness-bayes resume {directory or 'DIR'}'."
    if (facts.contradicted or facts.unreproduced) and not facts.rated:
        return "look in the figures of the data for fingers or probes that differ from the others, and check units."
    if facts.noisy:
        return "look for guesses and outliers: try --errors lapses, and rank the runs with 'softness-bayes compare'."
    if facts.surprise and facts.rated:
        return (
            "check the units of moduli and loads; state an error common to all moduli (--shared-modulus-cv 0.3), or "
            f"try {READINGS}, and rank the runs with 'softness-bayes compare'."
        )
    if not facts.exact:
        return "repeat the run with --exact-reweight."
    if facts.contradicted or facts.unreproduced or facts.follows.keeps is False:
        return f"see predictive_checks.csv, try {READINGS}, and rank the runs with 'softness-bayes compare'."
    if facts.moved is not None:
        return (
            "if the moduli were measured with errors, repeat the run with these errors (--modulus-cv 0.1, or "
            "a column effective_modulus_cv). If they are exact, use --modulus-cv 0."
        )
    help_ = _helpful(facts)
    steps = [f"read the page that 'softness-bayes report {directory}' writes"] if directory else []
    return f"{'; '.join([*steps, *([help_] if help_ else [])]) or 'nothing more is needed'}."


def _helpful(facts: Facts) -> str:
    """Return which further data would help most; empty if every turning point is decided."""
    if not facts.rated:
        weak = [one.name for one in facts.parameters if not one.informed]
        if weak:
            return f"forces of more fingers, or rates under more probes and loads, would narrow {_listed(weak)}"
        return "ratings (--data) would show where the response turns over"
    undecided = [turn for turn in facts.turns if not turn.decided]
    if not undecided:
        return ""
    (softest, stiffest), places = facts.fabrics, [turn.middle for turn in undecided if np.isfinite(turn.middle)]
    if not places:
        which = "of stiffer fabrics or by more participants"
    elif max(places) > stiffest:
        which = f"of fabrics stiffer than {number(stiffest)} kPa"
    elif min(places) < softest:
        which = f"of fabrics softer than {number(softest)} kPa"
    else:
        which = f"of more fabrics around {number(float(np.median(places)))} kPa, or by more participants,"
    return f"ratings at {_listed([turn.load for turn in undecided])} {which} would help to decide"


def _listed(names: list[str]) -> str:
    """Return names as a sentence lists them."""
    return " and ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)
