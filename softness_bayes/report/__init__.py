"""Report page of a finished run: verdict, figures, tables, provenance, and the command to repeat it.

Everything is read from the result, without evaluating the model. The page is a single HTML file that works offline.
"""

from softness_bayes.report.anonymity import anonymous
from softness_bayes.report.page import report_page, write_report

__all__ = ["anonymous", "report_page", "write_report"]
