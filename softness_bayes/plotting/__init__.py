"""Figures: functions that draw what a finished run, or a table, holds and return a matplotlib ``Figure``.

The functions do not run the model. matplotlib is imported only when a figure is made. Each artist that shows data
has a ``gid`` of the form ``what/load``, for example ``median/1 mm``. `figures.FIGURES` lists those of a run.
"""
