"""One page about a finished run: verdict, figures, tables, provenance, and the command that repeats it.

Everything is read from the result; nothing runs the model. The page is a single HTML file that needs no network.
"""

from softness_bayes.report.anonymity import anonymous
from softness_bayes.report.page import report_page, write_report

__all__ = ["anonymous", "report_page", "write_report"]
