"""Figures of a run: no file that was drawn before is left as it was, and each shows the result in the directory."""

import pytest

from softness_bayes.plotting.figures import figures_of
from softness_bayes.runs import drawing
from softness_bayes.runs.drawing import RUN_FIGURES, RUN_FORMATS, draw_run_figures
from softness_bayes.sampler.workers import Workers


@pytest.mark.parametrize(
    ("there", "more", "formats"),
    [
        ([], (), ()),
        (["rating.png", "rating.csv"], (), ()),
        (["rating.png", "corner.pdf"], (), ("pdf",)),
        (["trace.svg"], ("trace",), ("svg",)),
    ],
)
def test_a_run_draws_anew_what_was_drawn_before(report_run, tmp_path, monkeypatch, there, more, formats):
    result, drawn = report_run("ratings"), {}
    result.save(tmp_path)
    (tmp_path / "figures").mkdir()
    for name in there:
        (tmp_path / "figures" / name).touch()
    monkeypatch.setattr(
        drawing,
        "drawn",
        lambda shown, name, asked: drawn.update({name: (shown.summary(), asked)}) or {f"{name}.txt": b"1"},
    )
    with Workers(None, 1) as workers:
        paths = draw_run_figures(result, tmp_path, workers, ["tests.own:figure", "membrane"])
    usual = [name for name in figures_of(result) if name in (*RUN_FIGURES, *more, "membrane")]
    assert {path.stem for path in paths} == {*drawn} == {*usual, "tests.own:figure"}
    assert all(asked == (*RUN_FORMATS, *formats) for _, asked in drawn.values())
    assert all(summary.equals(result.summary()) for summary, _ in drawn.values())
