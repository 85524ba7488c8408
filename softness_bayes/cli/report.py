"""`softness-bayes report`: one page about a finished run."""

from __future__ import annotations

from pathlib import Path

import click

from softness_bayes.cli.options.run import own_figures
from softness_bayes.cli.running import reading

REPORT = "report.html"


@click.command()
@click.argument("directory", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help=f"File to write; by default {REPORT} in DIR. A report that this command wrote there is replaced, "
    "unless it was changed since.",
)
@click.option(
    "--anonymous",
    "nameless",
    is_flag=True,
    help="Call participants P1, P2 and so on, everywhere on the page; names of fabrics and files stay.",
)
@click.option("--title", default="", metavar="TEXT", help="Heading of the page, in place of 'Report of a run'.")
@click.option("--author", default="", metavar="TEXT", help="Who stands for the page, below its heading.")
@own_figures
def command(
    directory: Path, out: Path | None, nameless: bool, title: str, author: str, own_figures: tuple[str, ...]
) -> None:
    """Write one page about a finished run, to read, print or send.

    Three sentences come first: whether to trust the run, what was learnt, what to do next. Then the verdict: converged
    or not, exact enough or not, whether the model reproduces the turning point under each load, which parameters the
    data informed. Then charts of response and rating (switch load and axis, point at
    a curve for its values), figures, tables, how the run was made, and the command that repeats it. The file is a
    single HTML page that needs no network. Reads what 'sample' left in DIR; runs nothing.
    """
    from softness_bayes.report import anonymous, write_report

    home = directory if directory.is_dir() else directory.parent
    with reading(directory) as (result,):
        shown = anonymous(result) if nameless else result
        path = write_report(shown, out or home / REPORT, own_figures, title, author)
    click.echo(f"written to {path} ({path.stat().st_size / 1e6:.1f} MB)")
    click.echo(result.provenance.verdict)
