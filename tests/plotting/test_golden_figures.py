"""Data of all figures of three runs, by artist: numbers of points, which columns they fill, and labels of axes.

Stored in `tests/golden/figures_*.txt`, which `SOFTNESS_BAYES_GOLDEN=write` in the environment writes again.
"""

import matplotlib.pyplot as plt
import pytest

from softness_bayes.plotting.data import data_of
from softness_bayes.plotting.figures import FIGURES, figures_of
from support.golden import of_table, require


def lines_of(result):
    """Yield the data's columns and artists of all figures for which a result has data."""
    for name in figures_of(result, every=True):
        figure = FIGURES[name](result)
        yield f"{name}"
        yield from (f"  {line}" for line in of_table(data_of(figure)))
        plt.close(figure)


@pytest.mark.parametrize("name", ["ratings", "z-scores", "skin"])
def test_figures_show_the_stored_artists(name, report_run):
    require(f"figures_{name.replace('-', '_')}", "".join(f"{line}\n" for line in lines_of(report_run(name))))
