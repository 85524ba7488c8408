"""Common parts of the commands about runs: reading of results, cautions, and the printed summary of a run."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.command_line import portable
from softness_bayes.base.readable import number, percent

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from softness_bayes.data import Fabrics
    from softness_bayes.people.ruler import Fit
    from softness_bayes.results.result import Result


def command_line() -> str:
    """Return the command line, quoted for a shell, without absolute paths."""
    return shlex.join(["softness-bayes", *(portable(word, Path.cwd()) for word in sys.argv[1:])])


@contextmanager
def executor_of(dask: str | None, shared: Path | None = None) -> Iterator[Executor | None]:
    """Connect to the requested cluster, if any; tasks write to the shared directory, if all workers see it."""
    if dask is None:
        yield None
        return
    from softness_bayes.runs.cluster import cluster

    with cluster(dask, shared) as executor:
        if not executor.shares_files:
            click.echo(
                f"note: {dask}: not all workers can read {shared}; their tasks return their files at their end, so the "
                "work of a killed one is lost",
                err=True,
            )
        yield executor


@contextmanager
def reading(*directories: Path, trust_code: bool) -> Iterator[list[Result]]:
    """Read results for a command; missing data in them raise an input error.

    Raises
    ------
    InputError
        If a result cannot be read, or lacks data that the command needs.
    """
    from softness_bayes.base.arviz_bridge import without

    with without("dask", "xarray"):
        from softness_bayes.results.result import Result

        results = [Result.load(directory, trust_code=trust_code) for directory in directories]
    try:
        yield results
    except KeyError as error:
        if isinstance(error, InputError):
            raise
        sources = " or ".join(result.source for result in results)
        raise InputError(f"{sources}: lacks {error}, which every run of this version has") from error


@contextmanager
def rated_run(directory: Path, trust_code: bool) -> Iterator[Result]:
    """Read the result of a run with ratings, and warn if its chains have not converged.

    Raises
    ------
    InputError
        If there is no such run, or it had no ratings.
    """
    with reading(directory, trust_code=trust_code) as (result,):
        warn_of_unconverged(result)
        if not result.has_ratings:
            raise InputError(f"{directory}: a run without ratings cannot predict ratings")
        yield result


def warn_of_cautions(result: Result, fabrics: Fabrics | None) -> None:
    """Warn before predictions of a run are carried to other cloth than was rated (`results.rating_table.cautions`)."""
    from softness_bayes.results.rating_table import cautions

    for said in cautions(result, fabrics):
        click.echo(f"CAUTION: {said}", err=True)


def warn_of_unconverged(result: Result) -> None:
    """Warn if the chains of a run have not converged, so that answers from its draws are preliminary."""
    if not result.provenance.ending.converged:
        kind = "a first look (--quick), whose chains have" if result.is_first_look else "the chains of this run have"
        click.echo(f"warning: {result.source}: {kind} not converged; all numbers below are preliminary", err=True)


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
            f"reach of the model: receptors fire in {percent(1.0 - fit.silent_conditions)} of draws and conditions, "
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
    lines += ["", *result.recorded_sentences] if result.has_afferents else []
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
    from softness_bayes.checking.provenance import NOT_ASKED
    from softness_bayes.checking.sentences import check_sentences, residual_sentences
    from softness_bayes.people.sentences import untestable_sentence

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
