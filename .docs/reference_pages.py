"""Pages of the reference that are made from declarations: commands, parameters, readings, figures, Python names.

The configuration of the site writes them into ``docs/reference`` whenever the site is built.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from inspect import cleandoc
from itertools import groupby
from pathlib import Path

import click

import softness_bayes
from softness_bayes import errors
from softness_bayes.cli import GROUPS, main
from softness_bayes.parameters.declared import EVERY_PARAMETER, HELD, PRIOR_SETS
from softness_bayes.parameters.priors import LAWS, form_of
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.touch.contact import STRAIN
from softness_bayes.touch.readings import ALTERNATIVES, NAMED_READINGS

TOPICS = {
    "runs": "Runs",
    "data": "Tables",
    "results": "Results",
    "model": "The model",
    "parameters": "Parameters and priors",
    "likelihood": "Scales, errors and directions of ratings",
    "touch": "Touch and neuron",
    "experiments": "The next experiment",
    "plotting": "Figures",
    "claims": "The paper's claims",
    "errors": "Errors",
}
"""Titles of the groups of public names, by the folder that they are from, in the order of the page."""


def write_pages(directory: Path) -> None:
    """Write all pages of the reference into a directory, which is made if it does not exist."""
    directory.mkdir(exist_ok=True)
    pages = {"commands": _commands(), "parameters": _parameters(), "readings": _readings(), "names": _names()}
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
    group = click.Context(main, info_name="softness-bayes")
    for title, verbs in GROUPS.items():
        yield f"## {title.capitalize()}\n"
        for verb in verbs:
            command = main.get_command(group, verb)
            assert command is not None  # a verb of the table
            context = click.Context(command, info_name=verb, parent=group)
            yield f"### {verb}\n\n```text\n{command.get_usage(context)}\n```\n\n{_paragraphs(command.help or '')}\n"
            records = [one.get_help_record(context) for one in command.params]
            options = [(f"`{name}`", text) for name, text in filter(None, records) if text]
            yield from _table(["option", "meaning"], options) if options else ()
    yield "## Exit codes\n"
    kinds = [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, errors.SoftnessError)]
    codes = sorted((one.exit_code, str(one.__doc__).partition("\n")[0]) for one in kinds[1:])
    yield from _table(["code", "meaning"], [("0", "Done."), *((str(code), text) for code, text in codes)])


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
        (f"`{name}`", ", ".join(f"`{at}={law}`" for at, law in of[STRAIN].items())) for name, of in PRIOR_SETS.items()
    )
    yield from _table(["`--priors`", "priors that differ from those above"], sets)


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
