"""The command line in a process of its own, cheap runs for it, and how it must refuse."""

import io
import os
import re
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout

import pytest

from softness_bayes.cli import main
from support.paths import DATA, ROOT

TOUCH = ["--fabrics", DATA / "fabrics.csv", "--indentation-mm", "2"]
# two parameters of the rating alone: no run is cheaper; the paper's channels, whose rate curve all tests share
HELD = {
    "b": 80,
    "m": 2.2,
    "alpha": 21.5,
    "beta": 0.5,
    "sigma_0": 8,
    "c_Na": 1.05,
    "c_K": 1.16,
    "c_L": 1.0,
    "c_A": 1.5,
    "tau": 0.6,
    "eps": 0.1,
}
QUICK = ["--accuracy", "0.01", "--max-steps", "20", "--processes", "1", "--no-figures"]
FIXED = [part for name, value in HELD.items() for part in ("--fix", f"{name}={value}")]


def run(*arguments, cwd=ROOT, timeout=240):
    program = "from softness_bayes.cli import main; main(prog_name='softness-bayes')"
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", program, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUTF8": "1"},
        timeout=timeout,
        check=False,
    )


def call(*arguments, cwd="."):
    """Call a verb in this process, which does not take the second that a new one takes to start."""
    out, err = io.StringIO(), io.StringIO()
    with chdir(cwd), redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments], prog_name="softness-bayes")
    return subprocess.CompletedProcess(arguments, end.value.code or 0, out.getvalue(), err.getvalue())


def refused(done, *expected):
    """Assert that a verb ended as bad input does: exit code 2, one message, no traceback."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert re.search("^(error|Error): ", done.stderr, re.MULTILINE)
    for text in expected:
        assert text in done.stderr


def few_ratings(directory):
    """Write the shipped ratings of three participants under one load, of which a run is quick."""
    header, *rows = (DATA / "ratings.csv").read_text().splitlines(keepends=True)
    few = [row for row in rows if row[:3] in ("P01", "P02", "P03") and row.split(",")[2] == "3"]
    (directory / "ratings.csv").write_text("".join([header, *few]))
