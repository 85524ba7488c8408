"""`softness-bayes report`, `plot` and `explore`: pages and figures of a finished run."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import click

from softness_bayes.base.errors import InputError
from softness_bayes.base.options import Number
from softness_bayes.base.ranges import PORTS
from softness_bayes.cli.options import (
    FIGURES,
    Directory,
    Given,
    OwnFigures,
    Several,
    Touches,
    TrustCode,
    Words,
    command,
    typed,
)
from softness_bayes.cli.running import reading, warn_of_unconverged
from softness_bayes.cli.terminal import drawing
from softness_bayes.model.options import ModelOptions

REPORT = "report.html"


@command
def report(
    directory: Path,
    *,
    out: Path | None = None,
    anonymous: bool = False,
    title: str = "",
    author: str = "",
    figure: OwnFigures = (),
    trust_code: TrustCode = False,
) -> None:
    """Write a one-page report of a finished run, to read, print or send.

    The page begins with three sentences: whether to trust the run, what was learnt, and what to do next. The verdict
    follows: whether the run has converged, whether it is accurate enough, whether the model reproduces the turning
    point under each load, and which parameters the data informed. Then come interactive charts of response and
    rating, figures, tables, the settings of the run, and the command that repeats it. The file is a single HTML page
    that needs no network. DIR is a run of 'sample'; nothing is computed again.

    Parameters
    ----------
    directory : DIR
    out : FILE
        File to write; by default report.html in DIR. An earlier report by this command is replaced, unless the file has
        been edited.
    anonymous
        Call participants P1, P2 and so on everywhere on the page. Names of fabrics and files remain.
    title
        Heading of the page, in place of 'Report of a run'.
    author
        Author of the page, shown below its heading.
    """
    from softness_bayes.report.page import anonymous as nameless
    from softness_bayes.report.page import write_report

    home = directory if directory.is_dir() else directory.parent
    with drawing() as show, reading(directory, trust_code=trust_code) as (result,):
        shown = nameless(result) if anonymous else result
        page = write_report(shown, out or home / REPORT, figure, title, author, show)
    click.echo(f"written to {page} ({page.stat().st_size / 1e6:.1f} MB)")
    click.echo(result.provenance.verdict)


@command
def plot(
    directory: Path,
    *,
    figures: Annotated[tuple[str, ...], FIGURES] = (),
    all_: bool = False,
    format_: Annotated[tuple[str, ...], Several(Words(metavar="FORMAT"))] = ("png", "pdf", "csv"),
    style: Path | None = None,
    out: Annotated[Path | None, Directory()] = None,
    trust_code: TrustCode = False,
) -> None:
    """Draw the figures of a finished run.

    All data for the figures are stored in DIR: the model is not run, and DIR may come from another machine. A note
    names figures for which the run has no data.

    Parameters
    ----------
    directory : DIR
    figures
        Draw only this figure: one that 'list figures' shows, or a custom one such as mymodule:mine. By default all
        figures for which the run has data.
    all_
        Also draw the posterior of all pairs of parameters.
    format_
        Format of the files: png, pdf or svg, or csv for the data that a figure shows.
    style
        Style file of matplotlib (.mplstyle), applied on top of the default style. The width in its figure.figsize is
        the width of the page: 'figure.figsize: 3.4, 3' for one column.
    out
        Directory to write to; by default DIR/figures.
    """
    from softness_bayes.plotting.figures import draw_figures, every_figure, figure_named, figures_of, require_figures
    from softness_bayes.plotting.style import USUAL, Style, require_formats

    require_figures(figures)
    require_formats(format_)
    chosen_style = USUAL if style is None else Style.read(style)
    folder = out or (directory if directory.is_dir() else directory.parent) / "figures"
    with drawing() as show, reading(directory, trust_code=trust_code) as (result,):
        chosen = [*dict.fromkeys(figures)] or figures_of(result, all_)
        files = draw_figures(result, folder, chosen, tuple(dict.fromkeys(format_)), chosen_style, told=show)
    for file in files:
        click.echo(str(file))
    for name in () if figures else every_figure():
        if reason := figure_named(name).lacks(result):
            click.echo(f"note: no {name}: {reason}", err=True)


@command
def explore(
    directory: Path | None = None,
    *,
    touches: Touches,
    model: Annotated[ModelOptions, Given("fix", "priors", "prior_set", "readings", "finger")],
    port: Annotated[int, Number(PORTS, "N")] = 0,
    show: bool = False,
    trust_code: TrustCode = False,
) -> None:
    """Open an interactive page that shows how the response depends on each parameter.

    Without DIR the parameters start at the medians of their priors. With the DIR of a finished run they start at the
    posterior medians; the page then uses the finger, fabrics and loads of the run, and draws its data and credible
    bands behind the curves. Sliders cover the central 98 % of each prior. The page shows the command that repeats its
    numbers. It is served only on 127.0.0.1, until Ctrl-C, and writes nothing.

    Parameters
    ----------
    directory : [DIR]
    fabrics
        Fabric table (CSV, Excel or Parquet); by default six example fabrics.
    indentation_mm
        Indentation [mm] of the touch; by default indentations of 1, 2 and 3 mm.
    force_n
        Contact force [N] of the touch; by default indentations of 1, 2 and 3 mm.
    port
        Port on the loopback address of this machine; 0 for any free port.
    show
        Open the page in the browser.
    """
    from softness_bayes.report.explore.picture import picture
    from softness_bayes.report.explore.server import listening, serve
    from softness_bayes.report.explore.subject import EXAMPLE_LOADS, example_fabrics, of_priors, of_run

    def show_address(address: str) -> None:
        click.echo(address)
        click.echo("Ctrl-C ends it", err=True)
        if show:
            webbrowser.open(address)

    with listening(port) as opened:
        if directory is None:
            subject = of_priors(*touches.among(example_fabrics(), EXAMPLE_LOADS), model)
        else:
            if typed(*Touches.declared, *ModelOptions.declared):
                raise InputError(
                    "DIR has its own fabrics, loads, priors, readings and finger: omit the options for these, or DIR"
                )
            with reading(directory, trust_code=trust_code) as (result,):
                warn_of_unconverged(result)
                subject = of_run(result)
        picture(subject, subject.start)  # compiles the scene, and refuses now what the page could not draw
        serve(subject, opened, show_address)
