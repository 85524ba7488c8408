"""Style of figures and their file formats: one frozen value that a user can replace."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, wraps
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ParamSpec, Self

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.ranges import require_kind
from softness_bayes.plotting.data import data_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE, SKY, YELLOW, BLACK = "#CC79A7", "#56B4E9", "#F0E442", "#000000"

PLOT = "plot"
"""Command under which figures are listed in the record of written files."""

METADATA: Mapping[str, Mapping[str, str | None]] = MappingProxyType(
    {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
        "svg": {"Date": None, "Creator": None},
    }
)
"""Metadata of each image format, without date and program, so that equal figures give identical files."""

COMPRESSION = 1
"""Compression level of PNG files, from 1 to 9; level 3 takes 5 % longer for a whole figure and saves 3 %."""

DATA = "csv"
"""File format of the table of a figure's data."""

USUAL_FORMATS = ("png", "pdf", DATA)
"""Formats of a run's figures."""

OTHER_SCRIPTS = (
    *("Noto Sans CJK JP", "Noto Sans CJK SC", "Noto Sans CJK KR", "Noto Sans JP", "Noto Sans SC", "Noto Sans KR"),
    *("Hiragino Sans", "PingFang SC", "Apple SD Gothic Neo", "Yu Gothic", "Microsoft YaHei", "Malgun Gothic"),
    *("Source Han Sans", "IPAexGothic", "WenQuanYi Zen Hei", "Noto Sans Devanagari", "Arial Unicode MS"),
)
"""Font families for letters that the default font lacks; only the installed ones are used."""

RC: Mapping[str, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # included in matplotlib, so that figures are the same on all machines
    "mathtext.fontset": "dejavusans",
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.title_fontsize": 7,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 1.2,
    "hatch.linewidth": 0.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # matplotlib would look at all tick labels to find a place, in a fifth of the time of a figure
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "figure.dpi": 150,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # keep text as text, as journals require
    "svg.hashsalt": "softness-bayes",
}
"""matplotlib settings of the default style, which override matplotlib's defaults."""


@dataclass(frozen=True)
class Style:
    """Colours, widths and matplotlib settings of all figures; `dataclasses.replace` makes a modified style.

    Parameters
    ----------
    posterior, prior, data, inflection, absent
        Colours of the posterior, the prior, the data, the turning point, and the absence of a turning point.
    ensembles
        Colours of the independent ensembles, taken in turn.
    column, page
        Width of a figure of one column and of a full page [in].
    small
        Font size of text inside panels [pt].
    rc
        matplotlib settings that override its defaults.
    """

    posterior: str = BLUE
    prior: str = "#8C8C8C"
    data: str = VERMILION
    inflection: str = GREEN
    absent: str = "#8C8C8C"
    ensembles: Sequence[str] = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY)
    column: float = 3.5
    page: float = 7.2
    small: float = 7.0
    rc: Mapping[str, Any] = field(default_factory=lambda: RC)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Return the default style with the settings of a matplotlib style file.

        The settings in the file replace the default ones. Its ``axes.prop_cycle`` gives the colours of posterior, data
        and inflection, in that order, and those of the ensembles. The width of its ``figure.figsize`` becomes the page
        width; if it is narrower than a column, it becomes the column width too.

        Parameters
        ----------
        path
            A ``.mplstyle`` file.

        Raises
        ------
        InputError
            If there is no such file, or it has a setting that matplotlib does not know.
        """
        from matplotlib import rc_params_from_file

        require_kind("path", path, (str, Path), "a path")
        if not Path(path).is_file():
            raise InputError(f"{path}: no such file; expected a style file of matplotlib (.mplstyle)")
        with _complaints("matplotlib") as complaints:
            try:
                chosen = dict(rc_params_from_file(path, use_default_template=False))
            except UnicodeDecodeError:
                complaints.append("is not text")
        if complaints:
            raise InputError(f"{path}: not a style file of matplotlib: {' '.join(complaints[0].split())}")
        usual = cls()
        changed: dict[str, Any] = {"rc": {**RC, **chosen}}
        if "axes.prop_cycle" in chosen:
            cycle = chosen["axes.prop_cycle"].by_key().get("color", [])
            changed |= dict(zip(("posterior", "data", "inflection"), cycle, strict=False))
            changed |= {"ensembles": tuple(cycle)} if cycle else {}
        if "figure.figsize" in chosen:
            width = float(chosen["figure.figsize"][0])
            changed |= {"page": width, "column": min(usual.column, width)}
        return replace(usual, **changed)

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Apply this style to matplotlib inside a ``with`` block."""
        from matplotlib import rcParams, style

        with style.context(["default", dict(self.rc)]):
            rcParams["font.family"] = [*rcParams["font.family"], *_other_families()]
            yield

    def tint(self, colour: str, strength: float) -> tuple[float, float, float]:
        """Return a colour mixed with white; it is opaque, so that every format shows it in the same way."""
        from matplotlib.colors import to_rgb

        red, green, blue = (1.0 - strength * (1.0 - channel) for channel in to_rgb(colour))
        return red, green, blue


@cache
def _other_families() -> tuple[str, ...]:
    """Return the installed families of `OTHER_SCRIPTS`, which are used only for letters that the default font lacks."""
    from matplotlib.font_manager import fontManager

    installed = set(fontManager.get_font_names())
    return tuple(name for name in OTHER_SCRIPTS if name in installed)


@contextmanager
def _complaints(logger: str) -> Iterator[list[str]]:
    """Collect a logger's warnings instead of showing them."""
    heard: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: heard.append(record.getMessage())  # type: ignore[method-assign]
    source = logging.getLogger(logger)
    propagated, source.propagate = source.propagate, False
    source.addHandler(handler)
    try:
        yield heard
    finally:
        source.removeHandler(handler)
        source.propagate = propagated


USUAL = Style()
"""The default style of all figures."""

Drawn = ParamSpec("Drawn")


def styled(draw: Callable[Drawn, Figure]) -> Callable[Drawn, Figure]:
    """Return a function that draws a figure with its keyword argument ``style`` applied to matplotlib."""

    @wraps(draw)
    def draw_in_style(*args: Drawn.args, **kwargs: Drawn.kwargs) -> Figure:
        style: Any = kwargs.get("style", USUAL)
        with style.applied():
            return draw(*args, **kwargs)

    return draw_in_style


def require_formats(formats: Sequence[str]) -> None:
    """Raise an error for unknown formats of figures.

    Raises
    ------
    InputError
        Naming the first unknown format, and the known ones.
    """
    known = (*METADATA, DATA)
    unknown = [name for name in formats if name not in known]
    if unknown:
        raise InputError(f"figure: unknown format {unknown[0]!r}, expected one of {', '.join(known)}")


def save(figure: Figure, path: str | Path, formats: Sequence[str] = ("png", "pdf"), style: Style = USUAL) -> list[Path]:
    """Write a figure in each format, replacing an earlier figure; equal figures give identical files.

    Parameters
    ----------
    figure
        The figure to write.
    path
        Path of the files, without a suffix.
    formats
        Suffixes in `METADATA`, or `DATA`.
    style
        Resolution and fonts of the files.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        If a format is unknown, or the path belongs to an unrelated file.
    """
    path = Path(path)
    return write_outputs(path.parent, files_of(figure, path.name, formats, style), PLOT)


def files_of(
    figure: Figure,
    stem: str,
    formats: Sequence[str] = ("png", "pdf"),
    style: Style = USUAL,
    dpi: float | None = None,
) -> dict[str, bytes]:
    """Return the contents of the files that `save` writes, by file name (stem and suffix).

    Their resolution [dots per inch] is that of the style unless another is given.
    """
    require_formats(formats)
    contents: dict[str, bytes] = {}
    resolution: dict[str, Any] = {} if dpi is None else {"dpi": dpi}
    engine = figure.get_layout_engine()
    with style.applied():
        if engine is not None:
            for axes in figure.axes:  # the frame is the panel itself, and to find its ticks takes a tenth of the time
                axes.spines[:].set_in_layout(False)
            engine.execute(figure)
        figure.set_layout_engine(None)  # each file would be laid out again, and drawn twice for it
        try:
            for name in formats:
                if name == DATA:
                    contents[f"{stem}.{name}"] = csv_of(data_of(figure), index=False).encode()
                    continue
                more: dict[str, Any] = {"pil_kwargs": {"compress_level": COMPRESSION}} if name == "png" else {}
                figure.savefig(drawn := io.BytesIO(), format=name, metadata=dict(METADATA[name]), **more, **resolution)
                contents[f"{stem}.{name}"] = drawn.getvalue()
        finally:
            figure.set_layout_engine(engine)
    return contents
