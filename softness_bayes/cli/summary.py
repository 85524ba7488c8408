"""Printed summary of a finished run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.readable import number, percent

if TYPE_CHECKING:
    from softness_bayes.people.ruler import Fit
    from softness_bayes.results.result import Result


def print_result(result: Result, out: Path, times: str = "", verbose: bool = True) -> None:
    """Print what was read and how it ended, and the conclusion; with `verbose` also summary, turning points and checks.

    The closing lines of a run under up to three loads are at most about fifteen.
    """
    from softness_bayes.people.sentences import silence_note
    from softness_bayes.report.conclusion import conclude, facts_of, subject

    fit = result.fit if result.has_ratings else None
    lines = [f"the fit failed: {fault}" for fault in result.faults]
    lines += _details(result, fit) if verbose else []
    lines += [f"{subject(result)}; {times}" if times else subject(result), result.provenance.verdict]
    if fit is not None:
        silence = result.provenance.silence
        lines.append(
            f"in the model's range: receptors fire in {percent(1.0 - fit.silent_conditions)} of draws and conditions, "
            f"and Hertz's geometry holds (contact below R/2) in {percent(1.0 - silence.contact_beyond_half_radius)}"
        )
        lines += [silence_note(fit)] if verbose else []
    lines += [f"written to {out}; 'softness-bayes report {out}' makes a one-page report"]
    lines += ["\n".join(["", *conclude(facts_of(result), str(out)).lines])]
    click.echo("\n".join(filter(None, lines)))


def _details(result: Result, fit: Fit | None) -> list[str]:
    """Return the summary, what was learnt, turning points and checks."""
    from softness_bayes.checking.sentences import plate_sentence

    summary = result.summary()
    left_out = ("contraction", "psens_prior_mcse", "psens_likelihood_mcse")  # printed as text or only stored
    shown = summary.drop(columns=[*left_out])
    shown.insert(list(shown).index("prior_sd") + 1, "sd/prior_sd", summary["sd"] / summary["prior_sd"])
    lines = [f"{shown.to_string(float_format=lambda x: f'{x:.4g}', na_rep='–')}\n", *result.learnt()]
    lines += [f"\n{plate_sentence(result.provenance.plate)}"] if result.has_compression else []
    lines += ["", *result.recorded_findings.sentences] if result.has_afferents else []
    return [*lines, *([] if fit is None else [f"\n{_turning(result)}\n", *_about_ratings(result, fit)])]


def _turning(result: Result) -> str:
    """Return the table of turning points with their definition, prior probabilities and sampling errors."""
    from softness_bayes.checking.inflection import with_errors

    columns = ["p_interior", "prior_p_interior", "p_inside", "p_none", "p_silent"]
    columns += ["e_fab_kpa_low", "e_fab_kpa", "e_fab_kpa_high"]
    table, groups = result.inflection(), result.load_groups
    grouped = f"\n({groups.sentence}; each row is at the middle load of its group)" if groups.merged else ""
    low, *_, high = (f"{float(f'{end:.3g}'):,.10g}" for end in result.group("predictions")["e_fab_kpa"].values)
    return (
        "turning point of the response: a maximum (the paper's inflection) from which the response falls by "
        f"at least\n{percent(result.least_drop)} towards both ends of the range, {low} and {high} kPa. "
        "Columns: probability of a turning point (p_interior)\nand its prior probability; probabilities of "
        "one within the range of the fabrics' moduli (p_inside), of none, and\nof no firing; E_fab at the "
        "turning point [kPa], median and 90 % limits. Each number ± Monte-Carlo standard "
        f"error.\n{with_errors(table, columns).to_string()}{grouped}"
    )


def _about_ratings(result: Result, fit: Fit) -> Iterator[str]:
    """Yield sentences on the checks of the ratings, and on numerical errors."""
    from softness_bayes.checking.check_table import doubts
    from softness_bayes.checking.sentences import check_sentences, residual_sentences
    from softness_bayes.people.sentences import untestable_sentence
    from softness_bayes.provenance import NOT_ASKED

    provenance = result.provenance
    errors, silence, model = provenance.errors, provenance.silence, provenance.rating_model
    checks = result.tables["predictive_checks"]
    yield from (untestable_sentence(fit), provenance.direction.said, *check_sentences(checks))
    if not fit.direction.against_data:
        yield from (*residual_sentences(provenance.findings, doubts(checks)), *result.said_of_moduli())
    if result.load_cv.any() or result.shared_load_cv or result.said_of_force():
        yield result.said_of_loads()
    yield from (model.rating_note, model.rating_errors_note)
    yield (
        f"no receptor fires in any condition: {percent(silence.prior_silent_everywhere, 1)} of prior draws, "
        f"{percent(silence.posterior_silent_everywhere, 1)} of posterior draws; in an average condition: "
        f"{percent(silence.prior_silent_conditions)} and {percent(silence.posterior_silent_conditions)}"
    )
    if silence.contact_beyond_half_radius:
        yield (
            f"contact radius above R/2, where Hertz's geometry is questionable: "
            f"{percent(silence.contact_beyond_half_radius)} of draws and conditions; above R, where it is "
            f"meaningless: {percent(silence.contact_beyond_radius)}"
        )
    yield provenance.held_eps
    yield (
        f"numerical error of the response: at most {number(errors.numerical_error, 2)} of its peak over the draws; "
        f"accuracy: {NOT_ASKED if model.accuracy is None else model.accuracy}"
    )
    yield (
        f"error of the firing rates: at most {number(errors.firing_error, 2)} of the peak, if every receptor had the "
        f"largest interpolation error; effect on the posterior:\n{errors.exactness}"
    )
