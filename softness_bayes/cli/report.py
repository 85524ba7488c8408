"""`softness-bayes report` and `softness-bayes plot`: one page about a finished run, and its figures."""

from __future__ import annotations

from pathlib import Path

import click

from softness_bayes.cli.options import FILE, complete_figures, own_figures, path, trust_code
from softness_bayes.cli.progress import drawing
from softness_bayes.cli.running import reading

REPORT = "report.html"


@click.command()
@click.argument("directory", type=FILE, metavar="DIR")
@path(
    "--out",
    "FILE",
    f"File to write; by default {REPORT} in DIR. An earlier report by this command is replaced, unless "
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
    with drawing() as show, reading(directory) as (result,):
        shown = anonymous(result) if nameless else result
        page = write_report(shown, out or home / REPORT, own_figures, title, author, show)
    click.echo(f"written to {page} ({page.stat().st_size / 1e6:.1f} MB)")
    click.echo(result.provenance.verdict)


@click.command()
@click.argument("directory", type=FILE, metavar="DIR")
@click.option(
    "--figures",
    "names",
    multiple=True,
    shell_complete=complete_figures,
    metavar="NAME",
    help="Draw only this figure: one that 'list figures' shows, or a custom one such as mymodule:mine. Repeatable. "
    "By default all figures for which the run has data.",
)
@click.option("--all", "every", is_flag=True, help="Also draw the posterior of all pairs of parameters.")
@click.option(
    "--format",
    "formats",
    multiple=True,
    default=("png", "pdf", "csv"),
    show_default=True,
    metavar="FORMAT",
    help="Format of the files: png, pdf or svg, or csv for the data that a figure shows. Repeatable.",
)
@path(
    "--style",
    "FILE",
    "Style file of matplotlib (.mplstyle), applied on top of the default style. The width in its "
    "figure.figsize is the width of the page: 'figure.figsize: 3.4, 3' for one column.",
    "style_file",
)
@path("--out", "DIR", "Directory to write to; by default DIR/figures.")
@trust_code
def plot(
    directory: Path,
    names: tuple[str, ...],
    every: bool,
    formats: tuple[str, ...],
    style_file: Path | None,
    out: Path | None,
) -> None:
    """Draw the figures of a finished run.

    All data for the figures are stored in DIR: the model is not run, and DIR may come from another machine. A note
    names figures for which the run has no data.
    """
    from softness_bayes.plotting.figures import draw_figures, every_figure, figure_named, figures_of, require_figures
    from softness_bayes.plotting.style import USUAL, Style, require_formats

    require_figures(names)
    require_formats(formats)
    style = USUAL if style_file is None else Style.read(style_file)
    folder = out or (directory if directory.is_dir() else directory.parent) / "figures"
    with drawing() as show, reading(directory) as (result,):
        chosen = [*dict.fromkeys(names)] or figures_of(result, every)
        files = draw_figures(result, folder, chosen, tuple(dict.fromkeys(formats)), style, told=show)
    for file in files:
        click.echo(str(file))
    for name in () if names else every_figure():
        if reason := figure_named(name).lacks(result):
            click.echo(f"note: no {name}: {reason}", err=True)
