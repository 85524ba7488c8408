"""`softness-bayes plot`: the figures of a finished run."""

from __future__ import annotations

from pathlib import Path

import click

from softness_bayes.cli.options.completion import figures
from softness_bayes.cli.options.run import trust_code
from softness_bayes.cli.progress import Figures
from softness_bayes.cli.running import reading

_PATH = click.Path(path_type=Path)


@click.command()
@click.argument("directory", type=_PATH, metavar="DIR")
@click.option(
    "--figures",
    "names",
    multiple=True,
    shell_complete=figures,
    metavar="NAME",
    help="Draw only this figure: one that 'figures' lists, or a custom one such as mymodule:mine. Repeatable. "
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
@click.option(
    "--style",
    "style_file",
    type=_PATH,
    metavar="FILE",
    help="Style file of matplotlib (.mplstyle), applied on top of the default style. The width in its "
    "figure.figsize is the width of the page: 'figure.figsize: 3.4, 3' for one column.",
)
@click.option("--out", type=_PATH, metavar="DIR", help="Directory to write to; by default DIR/figures.")
@trust_code
def command(
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
    if out is None:
        out = (directory if directory.is_dir() else directory.parent) / "figures"
    with Figures() as progress, reading(directory) as (result,):
        chosen = [*dict.fromkeys(names)] or figures_of(result, every)
        paths = draw_figures(result, out, chosen, tuple(dict.fromkeys(formats)), style, told=progress.show)
    for path in paths:
        click.echo(str(path))
    for name in () if names else every_figure():
        if reason := figure_named(name).lacks(result):
            click.echo(f"note: no {name}: {reason}", err=True)
