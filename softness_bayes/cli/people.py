"""People's own answers on the terminal, and tables of which nothing else is known."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import click

from softness_bayes.errors import InputError

if TYPE_CHECKING:
    from softness_bayes.data import Experiment, Measurements, Ratings
    from softness_bayes.model.options import ModelOptions
    from softness_bayes.people.free_means import FreeMeans
    from softness_bayes.results.run_options import DataFiles

MOST_ROWS = 40
"""Largest number of rows of means that are printed."""


def read_or_answer(files: DataFiles, model: ModelOptions) -> Experiment | Measurements | None:
    """Return the data of an experiment; of ratings whose fabrics nobody measured, show people's answer instead."""
    try:
        return files.read()
    except InputError as error:
        try:
            ratings = files.answers()
        except InputError:
            raise error from None
        if ratings is None:
            raise
        from softness_bayes.people.free_means import free_means
        from softness_bayes.people.sentences import needed_sentences

        for note in ratings.notes:
            click.echo(f"note: {note}", err=True)
        show_people(free_means(ratings, model))
        click.echo()
        for line in needed_sentences(ratings.fabrics, bool(ratings.loads)):
            click.echo(line)
        return None


def show_pairs(ratings: Ratings, modulus: Sequence[float], guess: str | None) -> None:
    """Print thresholds of pairs with a reference, for E_fab [kPa] and a known guess rate if given, and cautions.

    Raises
    ------
    InputError
        If the guess rate is no number from 0 to below 1, or the table has no pairs.
    """
    import numpy as np

    from softness_bayes.people.psychometric import comparison_cautions, psychometric_table, threshold_sentences

    try:
        rate = None if guess is None else float(Fraction(guess))
    except (ValueError, ZeroDivisionError):
        rate = -1.0
    if rate is not None and not (0.0 <= rate < 1.0 and ratings.paired):
        raise InputError(f"--guess {guess}: expected a rate from 0 to below 1, such as 1/3, for a table of pairs")
    if ratings.paired:
        found = psychometric_table(ratings, np.array(modulus, float), guess=rate)
        for line in (*threshold_sentences(found), *(f"caution: {said}" for said in comparison_cautions(ratings))):
            click.echo(line)


def show_people(found: FreeMeans) -> None:
    """Print people's own means, and what is decided by them."""
    from softness_bayes.people.sentences import highest_sentences, pair_sentences
    from softness_bayes.readable import chance

    table = found.table()
    click.echo("What do people say? (means of these raters, without skin and receptors; 90 % intervals)")
    for line in (*highest_sentences(table, found.word, found.scale), *pair_sentences(found)):
        click.echo(line)
    if len(table) <= MOST_ROWS:
        shown = table if any(found.loads) else table.drop(columns="load")
        words = dict.fromkeys(("p_highest", "p_higher_than_next"), chance)
        click.echo(shown.to_string(index=False, float_format="{:.3g}".format, na_rep="–", formatters=words))
