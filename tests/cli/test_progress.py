"""Early word of a long run: what it needs, as soon as its chains have been looked at."""

import io
import sys

import numpy as np

from oracles.autoregressive import autoregressive
from softness_bayes.cli.terminal import LONG, Bar, drawing
from softness_bayes.plotting.figures import draw_figures
from softness_bayes.sampler.diagnostics import look
from softness_bayes.sampler.sampling import Progress


def shown(capsys, seconds_per_step, tau):
    """What a bar writes on a walk of 300 steps that is looked at after 300 and at each of ten states after that."""
    verdict = look(("b", "log posterior"), autoregressive(np.random.default_rng(1), (4, 300, 80, 2), tau))
    bar = Bar()
    for steps in (0, 100, 200, 300, *range(310, 400, 10)):
        seconds = 7.0 + seconds_per_step * steps  # seven for the pilot
        bar.show(Progress(steps, verdict.more_steps, seconds, verdict if steps >= 300 else None))
    bar.clear()
    return verdict, [line for line in capsys.readouterr().err.replace("\r", "\n").splitlines() if "needs" in line]


def test_a_long_run_says_once_what_it_needs_and_at_most(capsys):
    verdict, (line,) = shown(capsys, 0.8, 32.0)
    steps, most = verdict.foreseen
    left = 0.8 * (steps - 300)
    assert left > LONG
    assert f"after 300 steps: the run needs about {steps} steps in total ({left / 60:.0f} minutes more)" in line
    assert f"probably at most {most:.0f} ({0.8 * (most - 300) / 60:.0f} minutes more)" in line


def test_a_walk_that_is_too_short_gives_no_bound(capsys):
    _, (line,) = shown(capsys, 0.5, 60.0)
    assert "at least about" in line
    assert "too short for an upper limit" in line


def test_a_slow_pilot_announces_when_the_first_check_comes(capsys):
    bar = Bar()
    for pilot, seconds in ((300, 5.0), (290, 15.0), (280, 25.0), (0, 305.0)):
        bar.show(Progress(0, 200, seconds, None, pilot=pilot))
        said = capsys.readouterr().err
        assert ("490 steps away, the pilot run's included, about 8 minutes" in said) == (pilot == 290)
        assert ("pilot run, 290 steps left" in said) == (pilot == 290)
    bar.clear()


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_each_figure_is_named_while_it_is_drawn_on_a_terminal_only(monkeypatch, tmp_path, report_run):
    result, home = report_run("skin"), tmp_path / "run"
    result.save(home)
    for stream, names in ((Terminal(), ["figure 1 of 2: trace", "figure 2 of 2: rank"]), (io.StringIO(), [])):
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("COLUMNS", "100")
        with drawing() as show:
            draw_figures(result, tmp_path / "figures", ["trace", "rank"], ("png",), told=show)
        said = [line.strip() for line in stream.getvalue().split("\r") if line.strip()]
        assert said == (["reading the results", *names] if names else [])
