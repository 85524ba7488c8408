"""Printed summary of a finished run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.readable import number, percent

if TYPE_CHECKING:
    from softness_bayes.checking.agreement import Fit
    from softness_bayes.results.result import Result


def print_result(result: Result, out: Path, times: str = "") -> None:
    """Print summary, turning points, checks and verdict, the time taken, and the conclusion in three lines."""
    from softness_bayes.checking.agreement import fit_of
    from softness_bayes.checking.sentences import fit_faults, plate_sentence, silence_note
    from softness_bayes.report.conclusion import conclude, facts_of

    found, summary = result.provenance, result.summary()
    fit = fit_of(result.tree) if result.has_ratings else None
    faults = [] if fit is None else [f"the fit failed: {fault}" for fault in fit_faults(fit)]
    for fault in faults:
        click.echo(fault)
    left_out = ("contraction", "psens_prior_mcse", "psens_likelihood_mcse")  # printed as text or only stored
    shown = summary.drop(columns=[*left_out])
    shown.insert(list(shown).index("prior_sd") + 1, "sd/prior_sd", summary["sd"] / summary["prior_sd"])
    click.echo(shown.to_string(float_format=lambda x: f"{x:.4g}", na_rep="–"))
    click.echo()
    for sentence in result.learnt():
        click.echo(sentence)
    if result.has_compression:
        click.echo(f"\n{plate_sentence(found.plate)}")
    if fit is not None:
        _print_ratings(result, fit)
    click.echo(f"written to {out}; 'softness-bayes report {out}' makes a one-page report")
    click.echo(found.verdict)
    if fit is not None and (note := silence_note(fit)):
        click.echo(note)
    if times:
        click.echo(times)
    click.echo()
    for line in conclude(facts_of(result), str(out)).lines:
        click.echo(line)


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


def _print_ratings(result: Result, fit: Fit) -> None:
    """Print the turning points and the checks of the ratings."""
    from softness_bayes.checking.sentences import check_sentences, fit_sentence, residual_sentences
    from softness_bayes.provenance import NOT_ASKED

    found = result.provenance
    errors, silence, model = found.errors, found.silence, found.rating_model
    click.echo(f"\n{_turning(result)}\n")
    for sentence in (
        fit_sentence(fit),
        *([found.direction.said] if found.direction.said else []),
        *check_sentences(result.tables["predictive_checks"]),
        *([] if fit.direction.against_data else residual_sentences(found.findings)),
        *([] if fit.direction.against_data else result.said_of_moduli()),
        *([result.said_of_loads()] if result.load_cv.any() or result.shared_load_cv else []),
        *(said for said in (found.rating_model.rating_note, found.rating_model.rating_errors_note) if said),
    ):
        click.echo(sentence)
    click.echo(
        f"no receptor fires in any condition: {percent(silence.prior_silent_everywhere, 1)} of prior draws, "
        f"{percent(silence.posterior_silent_everywhere, 1)} of posterior draws; in an average condition: "
        f"{percent(silence.prior_silent_conditions)} and {percent(silence.posterior_silent_conditions)}"
    )
    if silence.contact_beyond_half_radius:
        click.echo(
            f"contact radius above R/2, where Hertz's geometry is questionable: "
            f"{percent(silence.contact_beyond_half_radius)} of draws and conditions; above R, where it is "
            f"meaningless: {percent(silence.contact_beyond_radius)}"
        )
    if found.held_eps:
        click.echo(found.held_eps)
    click.echo(
        f"numerical error of the response: at most {number(errors.numerical_error, 2)} of its peak over the draws; "
        f"accuracy: {NOT_ASKED if model.accuracy is None else model.accuracy}"
    )
    click.echo(
        f"error of the firing rates: at most {number(errors.firing_error, 2)} of the peak, if every receptor had the "
        "largest interpolation error; effect on the posterior:"
    )
    click.echo(errors.exactness)
