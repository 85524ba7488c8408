"""Figures of a run: no file that was drawn before is left as it was, and each shows the result in the directory."""

from softness_bayes.plotting.figures import figures_of
from softness_bayes.runs import drawing
from softness_bayes.runs.drawing import RUN_FIGURES, RUN_FORMATS, draw_run_figures
from softness_bayes.sampler.workers import Workers


def test_a_run_draws_anew_what_was_drawn_before(report_run, tmp_path, monkeypatch):
    result, drawn = report_run("ratings"), {}
    result.save(tmp_path)
    (tmp_path / "figures").mkdir()
    for name in ("rating.png", "rating.csv", "corner.pdf", "trace.svg"):
        (tmp_path / "figures" / name).touch()

    def noted(shown, name, asked):
        drawn[name] = shown.summary(), asked
        return {f"{name}.txt": b"1"}

    monkeypatch.setattr(drawing, "drawn", noted)
    with Workers(None, 1) as workers:
        paths = draw_run_figures(result, tmp_path, workers, ["tests.own:figure", "membrane"])
    usual = [name for name in figures_of(result) if name in (*RUN_FIGURES, "trace", "membrane")]
    assert {path.stem for path in paths} == {*drawn} == {*usual, "tests.own:figure"}
    assert all(asked == (*RUN_FORMATS, "pdf", "svg") for _, asked in drawn.values())
    assert all(summary.equals(result.summary()) for summary, _ in drawn.values())
