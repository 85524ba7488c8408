"""`softness-bayes report`: one page about a finished run."""

from __future__ import annotations

from pathlib import Path

import click

from softness_bayes.cli.options.run import own_figures, trust_code
from softness_bayes.cli.progress import Figures
from softness_bayes.cli.running import reading

REPORT = "report.html"


@click.command()
@click.argument("directory", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help=f"File to write; by default {REPORT} in DIR. An earlier report by this command is replaced, unless "
    "the file has been edited.",
)
@click.option(
    "--anonymous",
    "nameless",
    is_flag=True,
    help="Call participants P1, P2 and so on everywhere on the page. Names of fabrics and files remain.",
)
@click.option("--title", default="", metavar="TEXT", help="Heading of the page, in place of 'Report of a run'.")
@click.option("--author", default="", metavar="TEXT", help="Author of the page, shown below its heading.")
@own_figures
@trust_code
def command(
    directory: Path, out: Path | None, nameless: bool, title: str, author: str, own_figures: tuple[str, ...]
) -> None:
    """Write a one-page report of a finished run, to read, print or send.

    The page begins with three sentences: whether to trust the run, what was learnt, and what to do next. The verdict
    follows: whether the run has converged, whether it is accurate enough, whether the model reproduces the turning
    point under each load, and which parameters the data informed. Then come interactive charts of response and
    rating, figures, tables, the settings of the run, and the command that repeats it. The file is a single HTML page
    that needs no network. DIR is a run of 'sample'; nothing is computed again.
    """
    from softness_bayes.report.anonymity import anonymous
    from softness_bayes.report.page import write_report

    home = directory if directory.is_dir() else directory.parent
    with Figures() as progress, reading(directory) as (result,):
        shown = anonymous(result) if nameless else result
        path = write_report(shown, out or home / REPORT, own_figures, title, author, progress.show)
    click.echo(f"written to {path} ({path.stat().st_size / 1e6:.1f} MB)")
    click.echo(result.provenance.verdict)
