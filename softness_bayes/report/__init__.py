"""Report page of a finished run: verdict, figures, tables, provenance, and the command to repeat it.

Everything is read from the result, without evaluating the model. The page is a single HTML file that works offline.
Only `page` imports Bokeh, which takes a second: a run prints its conclusion without it.
"""
