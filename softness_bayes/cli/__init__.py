"""The command line: one module per command, imported when the command is called."""

from __future__ import annotations

import difflib
import importlib
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import click

from softness_bayes import __version__
from softness_bayes.cli.advice import of_input, of_usage
from softness_bayes.cli.interrupts import guarded, tell_kept
from softness_bayes.cli.streams import open_closed_streams, tolerant_streams
from softness_bayes.errors import InputError, NumericalError, ResourceError, SoftnessError

STARTED = time.monotonic()
"""Time [s] at which the command began, after Python itself had started."""

GROUPS: Mapping[str, Mapping[str, str]] = {
    "Start": {
        "demo": "Run a complete small example, from tables to a report, in seconds.",
        "new": "Write tables and scripts to start from into DIR.",
        "check": "Validate data files and show how they are read, how precise the design is and what a run costs.",
        "list": "List and explain readings, priors or figures.",
    },
    "Fit": {
        "sample": "Sample the posterior of skin, transduction and rating parameters given ratings.",
        "status": "Show the progress of a run without disturbing it.",
        "resume": "Continue a run that was interrupted or has ended.",
        "study": "Fit many tables separately, then pool parameters across them.",
    },
    "Answers": {
        "report": "Write a one-page report of a finished run, to read, print or send.",
        "plot": "Draw the figures of a finished run.",
        "predict": "Predict contact, stress, firing and ratings for fabrics under loads.",
        "rank": "Rank fabrics by predicted softness: the typical rater rates softer fabrics higher.",
        "target": "Find the effective moduli that give a desired rating, and the probability that one exists.",
        "explore": "Open an interactive page that shows how the response depends on each parameter.",
    },
    "Trust": {
        "compare": "Rank finished runs by how well they predict held-out data.",
        "simulate": "Simulate ratings of fabrics from given parameters.",
        "calibrate": "Test the inference by simulation: whether credible intervals have their stated coverage.",
        "bench": "Measure time and error of the likelihood on this machine, and of other ways to compute the response.",
    },
    "Paper": {
        "claims": "Test which of the paper's claims hold under which readings of its equations.",
    },
}
"""Commands and their one-line helps, by the question that they answer."""

VERBS: Mapping[str, str] = {verb: text for group in GROUPS.values() for verb, text in group.items()}
"""Command -> its one-line help."""

HOMES: Mapping[str, str] = {
    "demo": "start.demo",
    "new": "start.new",
    "list": "listing.command",
    "status": "resume.status",
    "plot": "report.plot",
    "target": "rank.target",
}
"""Verb -> place of its click command, for those that are not `softness_bayes.cli.<verb>.command`."""

FORMER: Mapping[str, str] = {
    "plan": "check --cost",
    "readings": "list readings",
    "priors": "list priors",
    "figures": "list figures",
}
"""Commands that had another name -> what does the same now."""

PRINTING = ("check", "status", "list", "predict", "target")
"""Commands that print their result unless --out is given; the others write files."""

TYPED = f"{__name__}.typed"
"""Key under which the words of the command line are stored."""
LESS_MEMORY = "try fewer --processes, because each needs memory"
"""Advice when memory is exhausted."""


class VerbGroup(click.Group):
    """A command group that imports commands on demand and converts errors to a message and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of their table."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import a command."""
        if name not in VERBS:
            return None
        module, command = HOMES.get(name, f"{name}.command").split(".")
        found: click.Command = getattr(importlib.import_module(f"{__name__}.{module}"), command)
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command and its arguments; the error for an unknown command suggests the closest name."""
        if args and args[0] in FORMER:
            ctx.fail(f"No such command '{args[0]}'. It is now '{ctx.command_path} {FORMER[args[0]]}'.")
        if args and args[0] not in VERBS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], VERBS, n=1)
            advice = (
                f"Did you mean '{ctx.command_path} {near[0]}'?" if near else f"'{ctx.command_path} --help' lists all."
            )
            ctx.fail(f"No such command '{args[0]}'. {advice}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands and their one-line helps, by group."""
        for group, verbs in GROUPS.items():
            with formatter.section(group):
                formatter.write_dl(list(verbs.items()), col_max=12)

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> Any:
        """Run the command line; handle signals, closed output streams and invisible characters."""
        open_closed_streams()
        with guarded(last=args is None), tolerant_streams() as out:
            try:
                return super().main(args, *more, **extra)
            except SystemExit as end:
                if not out.lost:
                    raise
                failed = not end.code and _prints(sys.argv[1:] if args is None else args)
                lost = f"standard output: {out.lost}; the printed output is incomplete"
                click.echo(f"{'error' if failed else 'warning'}: {lost}", err=True)
                if failed:
                    raise SystemExit(2) from None
                raise

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the words of the command line and store them for later advice."""
        ctx.meta[TYPED] = list(args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except click.UsageError as error:
            if said := of_usage(error, ctx.meta[TYPED]):
                raise click.UsageError(f"{error.format_message()}\n{said}", error.ctx) from None
            raise
        except SoftnessError as error:
            if isinstance(error, (NumericalError, ResourceError)):
                tell_kept()
            click.echo(f"error: {error}", err=True)
            if isinstance(error, InputError):
                _advise(str(error), ctx)
            ctx.exit(error.exit_code)
        except MemoryError as error:
            tell_kept()
            click.echo(f"error: memory ran out ({error or 'no more is available'}); {LESS_MEMORY}", err=True)
            ctx.exit(ResourceError.exit_code)
        except OSError as error:
            tell_kept()
            message = f"{error.filename or 'file'}: {error.strerror or error}"
            click.echo(f"error: {message}", err=True)
            _advise(message, ctx)
            ctx.exit(2)


def _prints(words: Sequence[str]) -> bool:
    """Return True if a command line prints its result instead of writing files."""
    verb = next((word for word in words if word in VERBS), None)
    helped = verb is None or "--help" in words or "-h" in words
    to_file = any(word.partition("=")[0] == "--out" for word in words)
    return helped or (verb in PRINTING and not to_file)


def _advise(message: str, ctx: click.Context) -> None:
    if said := of_input(message, ctx.meta[TYPED]):
        click.echo(said, err=True)


@click.group(cls=VerbGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="softness-bayes")
def main() -> None:
    """Infer how skin and touch receptors turn fabrics into softness, from ratings.

    Exit codes: 0 done, 2 input, 3 not converged, 4 numerical stop, 5 locked by another run, 6 memory ran out, 7
    worker processes were killed, 130 interrupted (Ctrl-C), 143 terminated.
    """
