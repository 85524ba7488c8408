"""The front page and the guide: short enough to read, and what they tell to type does what they say."""

from __future__ import annotations

import inspect
import re
import shlex
import shutil
from pathlib import Path

import pandas as pd
import pytest

import softness_bayes
from softness_bayes.cli import main
from softness_bayes.parameters.declared import EVERY_PARAMETER
from support.command_line import FIXED, QUICK
from support.pages import PAGES
from support.paths import DATA

README = PAGES["README.md"]
BRIEF = {
    "sample": [*QUICK, *FIXED],
    "claims": ["--readings", "mended", "--priors", "default", "--draws", "0"],
}
"""What is added to a command to make it brief."""


def block(page, mark):
    """Return the code that follows a mark."""
    return re.search(rf"<!-- {mark} -->\n```\w+\n(.*?)```", page, re.DOTALL)[1]


def brief_run(verb, rest):
    """Run a command of the page, made brief."""
    with pytest.raises(SystemExit) as end:
        main([verb, *rest, *BRIEF.get(verb, [])], prog_name="softness-bayes")
    return end.value.code or 0


@pytest.fixture(scope="module")
def ended(tmp_path_factory, brief_pilot, few_pictures):
    """A directory with the shipped data in which the commands ran one after another; each line with its exit code."""
    directory = tmp_path_factory.mktemp("clone")
    shutil.copytree(DATA, directory / "data")
    codes = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(directory)
        for line in block(README, "command-line").splitlines():
            program, verb, *rest = shlex.split(line, comments=True)
            assert program == "softness-bayes"
            codes[verb] = brief_run(verb, rest)
    return directory, codes


@pytest.fixture
def finished(ended, monkeypatch):
    """Stand where the commands ran; `sample` checks its arguments and returns their run."""
    monkeypatch.chdir(ended[0])
    signature = inspect.signature(softness_bayes.sample)

    def sample(*args, **kwargs):
        given = signature.bind(*args, **kwargs).arguments
        for name, value in given.items():  # each where it belongs
            annotation = str(signature.parameters[name].annotation)
            assert annotation == "Any" or type(value).__name__ in annotation
        return softness_bayes.Result.load("mine")

    monkeypatch.setattr(softness_bayes, "sample", sample, raising=False)


def test_the_commands_run_one_after_another(ended):
    directory, codes = ended
    # the brief run has not converged, and says so
    assert codes == {"check": 0, "sample": 3, "report": 0, "predict": 0, "claims": 0}
    assert {"posterior.nc", "summary.csv", "report.html"} <= {path.name for path in (directory / "mine").iterdir()}
    assert unknown_columns([directory / "claims" / "claims.csv", *(directory / "mine").glob("*.csv")]) == []


def test_the_page_on_files_names_every_column(report_run, tmp_path):
    report_run("ratings").save(tmp_path)
    written = [*tmp_path.glob("*.csv")]
    assert len(written) > 5
    assert unknown_columns(written) == []


def unknown_columns(written):
    """Return the columns of tables that the page does not name; limits and errors have the name of what they are of."""
    rows = {
        name: {*re.findall(r"`(\w+)`", row), *re.findall(r"\w+", row.split("|")[2]), *EVERY_PARAMETER, "preliminary"}
        for row in PAGES["files.md"].splitlines()
        if row.startswith("| `")
        for name in re.findall(r"`([\w.]+)`", row.split("|")[1])
    }
    columns = {path: pd.read_csv(path, nrows=1).columns for path in written}
    return [
        f"{path.name}: {name}"
        for path, names in columns.items()
        for name in names
        if not {name, re.sub(r"_(low|high|mcse)$", "", name)} & rows.get(path.stem, rows.get(path.name, set()))
    ]


def test_the_python_runs(finished, capsys):
    exec(compile(block(README, "python"), "README.md", "exec"), {"__name__": "__main__"})
    assert Path("rating.png").stat().st_size > 0
    assert "p_interior" in capsys.readouterr().out


@pytest.mark.parametrize("mark", ["forward", "backward"])
def test_the_python_of_the_guide_runs(finished, mark, capsys, tmp_path):
    page = PAGES["python.md"].replace('save("results")', f"save({str(tmp_path)!r})")
    exec(compile(block(page, mark), "python.md", "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out
    if mark == "backward":
        assert softness_bayes.Result.load(tmp_path).summary().index.tolist() == ["gamma", "varsigma", "mu"]
