"""HTML page of a result: a template filled by the other modules, with all figures and scripts embedded."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import require_outputs, write_outputs
from softness_bayes.base.files.run_files import FABRIC_RATINGS
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.readable import chance, number, sentence
from softness_bayes.checking.check_table import doubts
from softness_bayes.checking.sentences import unreproduced_sentence
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.plotting.figures import announced, figure_named, figures_of, file_of, require_figures
from softness_bayes.plotting.panels import TINTS
from softness_bayes.plotting.style import USUAL, files_of
from softness_bayes.report import tables
from softness_bayes.report.cards import cards
from softness_bayes.report.charts import AXES, TURN_TINT, ChartData, chart_data, charts
from softness_bayes.report.conclusion import conclude, facts_of, subject
from softness_bayes.results.result import Result

RESOLUTION = 150
"""Resolution of the figures on the page [dots per inch]: sharp on a screen, with small files."""

GENERATOR = '<meta name="generator" content="softness-bayes">'
"""Element of the HTML head that names the program."""

TITLE = "Report of a run"

REPORT = "report"
"""Command under which the page is listed in the record of written files."""

SECTIONS = {
    **dict.fromkeys(("rating", "response"), "charts"),
    **dict.fromkeys(("predictive_checks", "category_counts", "psychometric", "loo_pit"), "checks"),
    **dict.fromkeys(("trace", "rank"), "sampler"),
}
"""Sections of figures that replace the interactive charts in print and without scripts, of checks, of the sampler."""

LEFT_OUT = ("rating_ratio", "response_ratio", "touch", "membrane", "trace")
"""Figures that are shown only on request: they take long, and their findings are in others or in tables."""

PEOPLE = ("participant", "finger")
"""Axes and columns with names of people."""


class Picture(NamedTuple):
    """A figure, ready to be embedded."""

    name: str
    source: str
    caption: str
    alternative: str
    """Alternative text for screen readers."""
    section: str
    """Section of the page, from `SECTIONS`; by default what was learnt."""


def write_report(
    result: Result,
    path: str | Path,
    requested: Sequence[str] = (),
    title: str = "",
    author: str = "",
    progress: Callable[[str, int], None] = lambda name, of: None,
) -> Path:
    """Write the report of a run in one atomic step, replacing an earlier report.

    Parameters
    ----------
    result
        A finished run.
    path
        Path of the file; missing parent directories are created.
    requested
        Names of further figures, built-in or custom.
    title, author
        Heading of the page, by default "Report of a run", and its author.
    progress
        Called with the name of each figure before it is drawn, and with the number of all figures.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the path is a directory, a file that is not a report, or a report that was changed after it was written.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a directory, expected a file for the report")
    require_outputs(path.parent, [path.name], REPORT)
    write_outputs(path.parent, {path.name: report_page(result, requested, title, author, progress)}, REPORT)
    return path


def report_page(
    result: Result,
    requested: Sequence[str] = (),
    title: str = "",
    author: str = "",
    progress: Callable[[str, int], None] = lambda name, of: None,
) -> str:
    """Return the report of a run as one self-contained HTML document; arguments as in `write_report`."""
    require_figures(requested)
    shown = [*dict.fromkeys([*(name for name in figures_of(result) if name not in LEFT_OUT), *requested])]
    environment = Environment(
        loader=PackageLoader("softness_bayes.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=unbroken,
    )
    environment.filters["opening"] = lambda said: f"{said[:1].upper()}{said[1:]}"
    return environment.get_template("report.html").render(
        generator=GENERATOR,
        title=title or TITLE,
        author=author,
        subject=subject(result),
        ending=result.provenance.ending,
        faults=result.faults,
        conclusion=conclude(facts_of(result)),
        findings=cards(result),
        has_ratings=result.has_ratings,
        **(_of_ratings(result) if result.has_ratings else {}),
        pictures=[picture(result, name) for name in announced(shown, progress)],
        further=[name for name in figures_of(result) if name not in shown],
        parameters=tables.of_parameters(result),
        directions=tables.of_directions(result),
        provenance=tables.of_provenance(result),
        repetition=tables.repetition(result),
        command=result.provenance.asked.command,
    )


def anonymous(result: Result) -> Result:
    """Return a result in which participants are called P1, P2 and so on, in their order.

    A person with both ratings and plate forces has the same name in both. Names of fabrics and files are kept.
    """
    groups = [group.to_dataset() for group in result.tree.children.values()]
    stored = [group[what].values for what in PEOPLE for group in groups if what in group.coords]
    names = dict.fromkeys(str(name) for values in stored for name in values)
    return renamed(result, {name: f"P{k}" for k, name in enumerate(names, 1)})


def renamed(result: Result, names: Mapping[str, str]) -> Result:
    """Return a result with all names of people replaced, by their present names."""
    import xarray as xr

    groups = {}
    for label, child in result.tree.children.items():
        group = child.to_dataset()
        axes = {what: [names.get(str(one), str(one)) for one in group[what].values] for what in PEOPLE if what in group}
        groups[f"/{label}"] = group.assign_coords({what: (what, values) for what, values in axes.items()})
    kept = dict(result.tables)
    for label, table in kept.items():
        for what in PEOPLE:
            if what in table.index.names:
                kept[label] = table = table.rename(index=dict(names), level=what)
            if what in table:
                kept[label] = table = table.assign(**{what: [names.get(str(one), one) for one in table[what]]})
    return replace(
        result, tree=xr.DataTree.from_dict({"/": xr.Dataset(attrs=result.tree.attrs), **groups}), tables=kept
    )


def picture(result: Result, name: str) -> Picture:
    """Return a figure by its name, drawn and embedded."""
    drawing = figure_named(name)
    (drawn,) = files_of(drawing(result, USUAL), name, ("png",), USUAL, RESOLUTION).values()
    source, caption, section = _as_link("image/png", drawn), sentence(drawing.shows), SECTIONS.get(name, "learnt")
    return Picture(file_of(name), source, caption, " ".join([caption, *shown_by(result, name)]), section)


def _as_link(kind: str, content: bytes) -> str:
    """Return a content of some MIME type as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _of_ratings(result: Result) -> dict[str, Any]:
    """Return tables of ratings, the interactive charts, the options of their switches, and the data of all options."""
    every = chart_data(result)
    flat = [one for loads in every.values() for one in loads]
    drawn = charts(every[AXES[0].name][0], flat, result.scale)
    return {
        "inflection": tables.of_turning_points(result),
        "checks": tables.of_checks(result),
        "rated": tables.of_fabrics(result),
        "rated_data": _as_link("text/csv;charset=utf-8", csv_of(result.tables[FABRIC_RATINGS]).encode()),
        "charts": drawn,
        "style": USUAL,
        "tints": TINTS,
        "turn_tint": TURN_TINT,
        "axes": AXES,
        "loads": [one.title for one in every[AXES[0].name]],
        "sentence": every[AXES[0].name][0].sentence,
        "payload": {
            "labels": {axis.name: axis.label for axis in AXES},
            "shown": {name: [_json(one) for one in loads] for name, loads in every.items()},
        },
    }


def _json(one: ChartData) -> dict[str, Any]:
    """Return the contents of a chart in a form suitable for JSON, with None for NaN and infinity."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(key): plain(inner) for key, inner in value.items()}
        if isinstance(value, (list, tuple)):
            return [plain(inner) for inner in value]
        return None if isinstance(value, float) and not np.isfinite(value) else value

    contents: dict[str, Any] = plain(one._asdict())
    return contents


def unbroken(value: Any) -> Any:
    """Return a text with a space before each per-cent sign that no line breaks at, and other values as they are."""
    return re.sub(r"(?<=\d) (?=%)", "\u00a0", value) if type(value) is str else value


def shown_by(result: Result, name: str) -> Iterator[str]:
    """Yield sentences on what a figure shows of this run; none for a custom one."""
    if name in ("response", "response_ratio", "inflection"):
        for load, row in result.inflection().iterrows():
            place = f", at {number(row['e_fab_kpa'])} kPa" if np.isfinite(row["e_fab_kpa"]) else ""
            yield f"{load}: turning point with probability {chance(row['p_interior'])}{place}."
    elif name in ("rating", "rating_ratio") and FABRIC_RATINGS in result.tables:
        for load, rows in result.tables[FABRIC_RATINGS].groupby(level="load", sort=False):
            rated = rows["rated"].droplevel("load").dropna()
            ends = [f"{number(rated.iloc[k])} ({rated.index[k]})" for k in (int(rated.argmin()), int(rated.argmax()))]
            yield f"{load}: mean ratings from {' to '.join(ends)}."
    elif name == "predictive_checks":
        yield sentence(unreproduced_sentence(doubts(result.tables["predictive_checks"])))
    elif name in ("corner", "corner_all", "prior", "trace", "rank"):
        known = [parameter for parameter in EVERY_PARAMETER if parameter in result.group("posterior")]
        yield f"Sampled parameters: {', '.join(known)}."
