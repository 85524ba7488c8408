"""Pages of the reference that are made from declarations: commands, tables, parameters, readings, claims, Python names.

The configuration of the site writes them into ``docs/reference`` whenever the site is built.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from inspect import cleandoc
from itertools import groupby
from pathlib import Path
from typing import Any

import click
import pandas as pd

import softness_bayes
from softness_bayes.base import errors
from softness_bayes.base.defaults import SIGNALS
from softness_bayes.base.files.run_files import FILES
from softness_bayes.claims import CLAIMS
from softness_bayes.cli import GROUPS, VERBS, main
from softness_bayes.data.columns import (
    AFFERENTS,
    FABRICS,
    FORCES_OF_A_PLATE,
    LABELS,
    NAMES,
    NUMBERS,
    OF_CELLS,
    RATINGS,
    SYNONYMS,
)
from softness_bayes.likelihood.scales import RATING_SCALES
from softness_bayes.parameters.declared import EVERY_PARAMETER, HELD, PRIOR_SETS
from softness_bayes.parameters.priors import LAWS, form_of
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.touch.readings import ALTERNATIVES, NAMED_READINGS

TOPICS = {
    "runs": "Runs",
    "data": "Tables",
    "results": "Results",
    "model": "The model",
    "parameters": "Parameters",
    "likelihood": "Scales, errors and directions of ratings",
    "touch": "Touch and neuron",
    "experiments": "The next experiment",
    "plotting": "Figures",
    "claims": "The paper's claims",
    "base": "Prior laws and errors",
}
"""Titles of the groups of public names, by the folder that they are from, in the order of the page."""

COLUMNS = {
    "Ratings": RATINGS.columns,
    "Means of several raters": OF_CELLS,
    "Fabrics": FABRICS.columns,
    "Forces of a plate": FORCES_OF_A_PLATE.columns,
    "Recorded afferents": AFFERENTS.columns,
}
"""Columns of each kind of table, by the title of their section."""

SHARED = 3
"""Number of commands from which an option with one meaning is described once."""

STORED = Path(__file__).parents[1] / "notebooks" / "results"
MEASURED = {
    "Calibration of every observation model": "ranks.csv",
    "The likelihood, and programs of other kinds": "bench/work_precision.csv",
    "Whole runs on growing tables": "bench/whole_runs.csv",
}
"""Stored results by the title of their table."""


def write_pages(directory: Path) -> None:
    """Write all pages of the reference into a directory, which is made if it does not exist."""
    directory.mkdir(exist_ok=True)
    pages = {
        "commands": _commands(),
        "tables": _tables(),
        "parameters": _parameters(),
        "readings": _readings(),
        "claims": _claims(),
        "measured": _measured(),
        "names": _names(),
    }
    for name, lines in pages.items():
        text = "\n".join(lines) + "\n"
        path = directory / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:  # an unchanged page is not read again
            path.write_text(text, encoding="utf-8")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table."""
    for row in (head, ["---"] * len(head), *rows):
        yield f"| {' | '.join(' '.join(cell.replace('|', chr(92) + '|').split()) for cell in row)} |"
    yield ""


def _commands() -> Iterator[str]:
    """Yield the page of commands: the text and the options of each, as `--help` prints them; and the exit codes."""
    yield "# Commands\n"
    group = click.Context(main, info_name="softness-bayes", **main.context_settings)
    contexts = {verb: click.Context(main.get_command(group, verb), info_name=verb, parent=group) for verb in VERBS}
    texts: dict[str, dict[str, str]] = {}
    for verb, context in contexts.items():
        records = (one.get_help_record(context) for one in context.command.params)
        texts[verb] = {f"`{name}`": text for name, text in filter(None, records) if text}
    uses = Counter(record for records in texts.values() for record in records.items())
    for title, verbs in GROUPS.items():
        yield f"## {title.capitalize()}\n"
        for verb in verbs:
            command = contexts[verb].command
            yield f"### {verb}\n\n```text\n{command.get_usage(contexts[verb])}\n```\n"
            yield f"{_paragraphs(command.help or '')}\n"
            own = [record for record in texts[verb].items() if uses[record] < SHARED]
            yield from _table(["option", "meaning"], own) if own else ()
            if shared := [name for name, text in texts[verb].items() if uses[name, text] >= SHARED]:
                yield f"[Shared options](#shared-options): {', '.join(shared)}.\n"
    yield "## Shared options\n"
    yield from _table(["option", "meaning"], (record for record, count in uses.items() if count >= SHARED))
    yield "## Exit codes\n"
    kinds = [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, errors.SoftnessError)]
    codes = sorted((one.exit_code, str(one.__doc__).partition("\n")[0]) for one in kinds[1:])
    yield from _table(["code", "meaning"], [("0", "Done."), *((str(code), text) for code, text in codes)])
    endings = ", ".join(f"{128 + number} by {number.name}" for number in sorted(SIGNALS))
    yield f"A command that a signal ends has the code {endings}.\n"


def _tables() -> Iterator[str]:
    """Yield the page of tables: columns that are read, their other names, scales of ratings, files of a run."""
    yield "# Tables and files\n"
    for title, columns in COLUMNS.items():
        yield f"## {title}\n"
        yield from _table(
            ["column", "what it holds", "values"],
            (
                (f"`{name}`", NUMBERS[name].label, NUMBERS[name].expected())
                if name in NUMBERS
                else (f"`{name}`", LABELS[name], "a name")
                for name in NAMES
                if name in columns
            ),
        )
    yield "## Other names of columns\n"
    yield "Case, spaces and punctuation do not matter; units may follow, as in `Kraft [N]`.\n"
    yield from _table(
        ["column", "recognised as"], ((f"`{name}`", ", ".join(words)) for name, words in SYNONYMS.items())
    )
    yield "## Scales of ratings\n"
    yield from _table(["`--ratings`", "ratings"], ((f"`{name}`", one.meaning) for name, one in RATING_SCALES.items()))
    yield "## Files of a run\n"
    yield from _table(["file", "what it holds"], ((f"`{name}`", holds) for name, holds in FILES.items()))


def _claims() -> Iterator[str]:
    """Yield the page of the paper's claims and their criteria."""
    yield "# The paper's claims\n"
    yield from _table(
        ["claim", "the paper says", "criterion"], [(f"`{one.name}`", one.statement, one.criterion) for one in CLAIMS]
    )


def _paragraphs(text: str) -> str:
    """Return a help text as Markdown, in which `<` begins no tag."""
    return cleandoc(text).replace("\b", "").replace("<", "&lt;")


def _parameters() -> Iterator[str]:
    """Yield the page of parameters, prior distributions and sets of priors."""
    yield "# Parameters and priors\n"
    rows = (
        (
            f"`{name}`",
            one.meaning,
            one.unit,
            f"`{one.prior}`",
            str(one.range),
            f"{HELD[name]:g}" if name in HELD else "",
        )
        for name, one in EVERY_PARAMETER.items()
    )
    yield from _table(["name", "meaning", "unit", "prior", "values", "held at, unless given a prior"], rows)
    yield "## Prior distributions\n"
    laws = ((f"`{form_of(law)}`", str(law.__doc__).strip().partition("\n")[0]) for law in LAWS.values())
    yield from _table(["`--prior NAME=…`", "meaning"], laws)
    yield "## Sets of priors\n"
    sets = (
        (f"`{name}`", f"`{skin.name}`", ", ".join(f"`{at}={law}`" for at, law in laws.items()))
        for name, of in PRIOR_SETS.items()
        for skin, laws in of.items()
    )
    yield from _table(["`--priors`", "`skin_displacement`", "priors that differ from those above"], sets)


def _readings() -> Iterator[str]:
    """Yield the page of readings of the model's equations, and of figures."""
    yield "# Readings and figures\n"
    yield "The first reading of each place is the default.\n"
    for place, readings in ALTERNATIVES.items():
        yield f"## {place}\n"
        yield from _table(["reading", "meaning"], [(f"`{name}`", one.meaning) for name, one in readings.items()])
    yield "## Sets of readings\n"
    sets = ((f"`{name}`", ", ".join(f"`{k}={v}`" for k, v in of.names.items())) for name, of in NAMED_READINGS.items())
    yield from _table(["`--readings`", "readings"], sets)
    yield "## Figures\n"
    yield from _table(["figure", "shows"], [(f"`{name}`", one.shows) for name, one in FIGURES.items()])


def _measured() -> Iterator[str]:
    """Yield the page of measurements, from the stored results that the page on results explains."""
    yield "# Measured\n"
    for title, file in MEASURED.items():
        table = pd.read_csv(STORED / file)
        yield f"## {title}\n"
        cells = ([_shown(one) for one in row] for row in table.values)
        yield from _table([str(name).replace("_", " ") for name in table.columns], cells)


def _shown(value: Any) -> str:
    """Return a cell of a stored result: numbers to two digits, or as whole numbers from 100 on."""
    if isinstance(value, str):
        return value
    return "" if pd.isna(value) else f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def _names() -> Iterator[str]:
    """Yield the page of the public Python names, by topic."""
    yield "# Python names\n"
    homes = {name: home.split(".")[1] for name, home in softness_bayes._HOMES.items()}
    order = list(TOPICS)
    ordered = sorted(homes, key=lambda name: order.index(homes[name]))
    for topic, names in groupby(ordered, key=homes.__getitem__):
        yield f"## {TOPICS[topic]}\n"
        for name in names:
            value = getattr(softness_bayes, name)
            kind = "class" if isinstance(value, type) else "function" if callable(value) else "data"
            yield f"```{{eval-rst}}\n.. auto{kind}:: softness_bayes.{name}\n```\n"
