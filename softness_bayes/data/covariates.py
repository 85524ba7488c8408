"""Covariates of participants: further columns of a table of ratings that are constant within each participant."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from softness_bayes.data.columns import LABELS, NUMBERS
from softness_bayes.data.names import listing
from softness_bayes.data.tables import MISSING, Table, unused_note
from softness_bayes.errors import quoted
from softness_bayes.files.spreadsheet import unescaped

OWN_COLUMNS = frozenset(
    {*LABELS, *NUMBERS, "finger", "ratings", "effect", "effect_low", "effect_high", "quantity", "median", "low", "high"}
    | {"ratio"}
)
"""Names of columns next to covariates in the tables of a run, and names of columns in tables of ratings."""


def covariates_in(table: Table, participants: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """Return the covariates of a table by name, each with one text per participant, and the notes of the table.

    A column is a covariate if no participant has two different texts in it (ignoring empty cells and codes for missing
    numbers) and some participant has several rows; with one row each, any column would be constant. Texts are as
    written, and empty if all cells are. Notes list the columns that are covariates, and those that were renamed.

    Parameters
    ----------
    table
        All rows of the table, including those without a rating.
    participants
        Names of the participants to keep.
    """
    if "participant" not in table or not table.others:
        return {}, [*table.notes]
    by = table.cells["participant"]
    if len(set(by)) == len(by):
        return {}, [*table.notes]
    found, varying = {}, []
    for title, texts in table.others.items():
        told: dict[str, dict[str, None]] = {name: {} for name in by}
        for name, text in zip(by, texts, strict=True):
            told[name].setdefault(text)
        known = {name: [text for text in own if text.casefold() not in MISSING] for name, own in told.items()}
        several = [name for name, own in known.items() if len(own) > 1]
        if not any(known.values()):
            continue  # an empty column
        if several:
            varying += [(title, several[0])] if 2 * len(several) < len(known) else []
            continue
        found[title] = tuple((known[name] or [*told[name]])[0] for name in participants)
    return _named(found, table.others), _noted(table, found, varying)


def _named(found: Mapping[str, tuple[str, ...]], titles: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    others = {title.casefold() for title in titles}
    return {kept_name(title, others): texts for title, texts in found.items()}


def kept_name(title: str, others: Collection[str]) -> str:
    """Return the name under which a covariate is stored, changed only if a table of a run has a column of that name.

    The titles of all `others` are in small letters.
    """
    own = name = unescaped(title)
    while name.casefold() in OWN_COLUMNS or (name != own and name.casefold() in others):
        name += " (covariate)"
    return name


def _noted(table: Table, found: Mapping[str, tuple[str, ...]], varying: Sequence[tuple[str, str]]) -> list[str]:
    """Return the notes of a table, without covariates among the unused columns."""
    left = unused_note([title for title in table.others if title not in found])
    notes = [note for note in table.notes if note not in unused_note([*table.others])] + left
    if found:
        notes.append(f"copied to the results as covariates of participants (no model uses them): {listing([*found])}")
    others = {title.casefold() for title in table.others}
    for title in found:
        if (name := kept_name(title, others)) != unescaped(title):
            notes.append(
                f"covariate {quoted(title)} is renamed {quoted(name)}, because tables of the run have a column "
                "of that name"
            )
    notes += [f"column {quoted(title)} is not a covariate: it varies within {quoted(name)}" for title, name in varying]
    return notes
