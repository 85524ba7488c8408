"""`softness-bayes plot`: the figures of a finished run."""

from __future__ import annotations

from pathlib import Path

import click

from softness_bayes.cli.options.completion import figures
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
    help="Draw this figure only, one of those that 'figures' lists or one of your own, as in mymodule:mine. "
    "Repeatable. By default every figure that the run can fill.",
)
@click.option("--all", "every", is_flag=True, help="Draw also what is drawn on request only: all pairs of parameters.")
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
    help="Style file of matplotlib (.mplstyle) to lay over the usual style; the width of its figure.figsize is that "
    "of the page, as in 'figure.figsize: 3.4, 3' for one column.",
)
@click.option("--out", type=_PATH, metavar="DIR", help="Directory to write to; by default DIR/figures.")
def command(
    directory: Path,
    names: tuple[str, ...],
    every: bool,
    formats: tuple[str, ...],
    style_file: Path | None,
    out: Path | None,
) -> None:
    """Draw the figures of a finished run.

    All that they show is stored in DIR: the model is not run, and DIR may come from another machine. Figures that
    the run cannot fill are left out and named.
    """
    from softness_bayes.plotting.figures import draw_figures, every_figure, figure_named, figures_of, require_figures
    from softness_bayes.plotting.style import USUAL, Style, require_formats

    require_figures(names)
    require_formats(formats)
    style = USUAL if style_file is None else Style.read(style_file)
    if out is None:
        out = (directory if directory.is_dir() else directory.parent) / "figures"
    with reading(directory) as (result,):
        chosen = [*dict.fromkeys(names)] or figures_of(result, every)
        paths = draw_figures(result, out, chosen, tuple(dict.fromkeys(formats)), style)
    for path in paths:
        click.echo(str(path))
    for name in () if names else every_figure():
        if reason := figure_named(name).lacks(result):
            click.echo(f"note: no {name}: {reason}", err=True)
