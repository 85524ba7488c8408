"""Figures of a run: no file that was drawn before is left as it was, and none waits for more than it shows."""

import pandas as pd
import pytest
import xarray as xr

from softness_bayes.plotting.data import data_of
from softness_bayes.plotting.figures import FIGURES, figures_of
from softness_bayes.plotting.style import USUAL
from softness_bayes.runs import drawing
from softness_bayes.runs.drawing import RUN_FORMATS, formats_in
from softness_bayes.sampler.workers import Workers


@pytest.mark.parametrize(
    ("there", "more"),
    [([], ()), (["rating.png", "rating.csv"], ()), (["rating.png", "corner.pdf"], ("pdf",)), (["a.svg"], ("svg",))],
)
def test_a_run_draws_anew_what_was_drawn_before(tmp_path, there, more):
    for name in there:
        (tmp_path / name).touch()
    assert formats_in(tmp_path) == (*RUN_FORMATS, *more)
    assert formats_in(tmp_path / "nowhere") == RUN_FORMATS


def test_figures_that_begin_early_show_what_the_whole_result_shows(report_run, tmp_path, monkeypatch):
    """A group that is not there is an error, so that none of those left out is shown."""
    result, seen = report_run("ratings"), {}
    (tmp_path / "trace.svg").touch()  # drawn before: it would show an old result
    monkeypatch.setattr(drawing, "drawn", lambda part, name, _: seen.update({name: part}) or {f"{name}.csv": b"1"})
    walk = xr.DataTree(children={"posterior": xr.DataTree(result.tree["posterior"].to_dataset())})
    with Workers(None, 1) as workers:
        figures = drawing.FiguresUnderWay(workers, tmp_path, ["tests.own:figure", "membrane"])
        figures.begin_walk(walk)
        figures.begin_usual(result.tree)
        paths = figures.write(result)
    usual = [name for name in figures_of(result) if name in (*drawing.RUN_FIGURES, "trace", "membrane")]
    assert {"corner", "trace", "membrane"} < {*usual} < {*figures_of(result)}
    assert {path.stem for path in paths} == {*usual, "tests.own:figure"}
    assert seen["tests.own:figure"] is result
    for name in drawing.OF_THE_WALK:
        assert [*seen[name].tree.children] == ["posterior"]
    for name in usual:
        assert not {"prior_predictive", "log_likelihood_loo"} & {*seen[name].tree.children}
        shown = FIGURES[name](seen[name], USUAL)
        if name in drawing.OF_THE_WALK:
            pd.testing.assert_frame_equal(data_of(shown), data_of(FIGURES[name](result, USUAL)))
