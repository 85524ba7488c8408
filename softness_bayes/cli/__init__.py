"""The command line: commands are made from functions, and imported when they are called."""

from __future__ import annotations

import ast
import difflib
import importlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from softness_bayes import __version__
from softness_bayes.base.errors import InputError, NumericalError, ResourceError, SoftnessError
from softness_bayes.cli.advice import of_input, of_usage
from softness_bayes.cli.interrupts import guarded, tell_kept
from softness_bayes.cli.terminal import open_closed_streams, tolerant_streams

GROUPS: Mapping[str, Mapping[str, str]] = {
    "Start": {"demo": "start", "new": "start", "check": "check", "list": "start"},
    "Fit": {"sample": "sample", "status": "sample", "resume": "sample", "study": "study"},
    "Answers": {
        **dict.fromkeys(("report", "plot"), "report"),
        "predict": "predict",
        **dict.fromkeys(("rank", "target"), "rank"),
        "design": "design",
        "explore": "report",
    },
    "Trust": {"compare": "trust", "simulate": "predict", "calibrate": "trust", "bench": "trust"},
    "Paper": {"claims": "claims"},
}
"""Commands by the question that they answer, with their modules."""

VERBS: Mapping[str, str] = {verb: module for verbs in GROUPS.values() for verb, module in verbs.items()}
"""Command -> its module."""

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


def short_help(verb: str) -> str:
    """Return the first line of a command's docstring, without importing the command."""
    tree = ast.parse(Path(__file__).with_name(f"{VERBS[verb]}.py").read_text(encoding="utf-8"))
    functions = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.rstrip("_") == verb)
    return (ast.get_docstring(next(functions)) or "").partition("\n")[0]


class VerbGroup(click.Group):
    """A command group that imports commands on demand and converts errors to a message and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of their table."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import a command."""
        if name not in VERBS:
            return None
        module = importlib.import_module(f"{__name__}.{VERBS[name]}")
        verb: click.Command = getattr(module, f"{name}_" if name == "list" else name)
        return verb

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
                formatter.write_dl([(verb, short_help(verb)) for verb in verbs], col_max=12)

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> Any:
        """Run the command line; handle signals, closed output streams and invisible characters."""
        open_closed_streams()
        with guarded(last=args is None), tolerant_streams() as out:
            try:
                return super().main(args, *more, **extra)
            except SystemExit as end:
                if not out.lost:
                    raise
                words = sys.argv[1:] if args is None else args
                verb = next((word for word in words if word in VERBS), None)
                to_file = any(word.partition("=")[0] == "--out" for word in words)
                printed = verb is None or "--help" in words or "-h" in words or (verb in PRINTING and not to_file)
                failed = not end.code and printed
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
            if advice := of_usage(error, ctx.meta[TYPED]):
                raise click.UsageError(f"{error.format_message()}\n{advice}", error.ctx) from None
            raise
        except (SoftnessError, MemoryError, OSError) as error:
            message = str(error)
            code = getattr(error, "exit_code", InputError.exit_code)
            if isinstance(error, MemoryError):
                message, code = f"memory ran out ({error or 'no more is available'}); {LESS_MEMORY}", 6
            elif isinstance(error, OSError):
                message = f"{error.filename or 'file'}: {error.strerror or error}"
            if isinstance(error, (NumericalError, ResourceError, MemoryError, OSError)):
                tell_kept()
            click.echo(f"error: {message}", err=True)
            hints = getattr(error, "candidates", ())
            if code == InputError.exit_code and (advice := of_input(message, ctx.meta[TYPED], hints, _reads)):
                click.echo(advice, err=True)
            ctx.exit(code)


def _reads(words: Sequence[str]) -> bool:
    """Return whether a command can read its tables and finds nothing that looks wrong; True if it reads none."""
    from softness_bayes.results.run_options import DataFiles

    command = main.get_command(click.Context(main), words[0])
    if words[0] not in ("check", "sample") or command is None:
        return True
    try:
        values = command.make_context(words[0], [*words[1:]]).params
        read = DataFiles(**{one.name: values[one.name] for one in fields(DataFiles) if one.name in values}).read()
    except (SoftnessError, OSError, click.ClickException):
        return False
    return not any("looks wrong" in note for note in read.notes)


@click.group(cls=VerbGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="softness-bayes")
def main() -> None:
    """Infer how skin and touch receptors turn fabrics into softness, from ratings.

    Exit codes: 0 done, 2 input, 3 not converged, 4 numerical stop, 5 locked by another run, 6 memory ran out, 7
    worker processes were killed, 130 interrupted (Ctrl-C), 143 terminated.
    """
