"""Report page of a finished run: verdict, figures, tables, provenance, and the command to repeat it.

Everything is read from the result, without evaluating the model. The page is a single HTML file that works offline.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from softness_bayes.report.anonymity import anonymous
    from softness_bayes.report.page import report_page, write_report

__all__ = ["anonymous", "report_page", "write_report"]

# imported on first use: the page imports Bokeh, which takes a second, and a run prints its conclusion without it
_HOMES = {"anonymous": "anonymity", "report_page": "page", "write_report": "page"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
