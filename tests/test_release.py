"""The wheel: what it holds, and a run of it with the oldest and the newest libraries that are allowed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import venv
import zipfile

import pytest

import softness_bayes
from support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LARGEST = 1_500_000
"""Size of the wheel [bytes]."""
ROOMS = ("data/test_data.py", "results", "plotting/test_plotting.py", "runs/test_checkpoint.py")
"""Tests of what reads and writes by other libraries."""

pytestmark = pytest.mark.slow


def run(*arguments, cwd=ROOT):
    """Run a program, which must succeed; return its output."""
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([*map(str, arguments)], cwd=cwd, env=own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of this version."""
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, ROOT)
    (path,) = folder.glob("*.whl")
    return path


def test_the_wheel_is_small_and_holds_the_package_alone(wheel):
    assert wheel.name.startswith(f"softness_bayes-{softness_bayes.__version__}-")
    assert wheel.stat().st_size <= LARGEST
    names = zipfile.ZipFile(wheel).namelist()
    assert "softness_bayes/py.typed" in names
    assert {name.split("/")[0].partition("-")[0] for name in names} == {"softness_bayes"}
    assert not [name for name in names if re.match(r"softness_bayes/(tools|tests|studies|docs/reference)/", name)]


def test_one_version_and_one_entry_of_changes():
    version = softness_bayes.__version__
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changes = (ROOT / "softness_bayes" / "docs" / "changelog.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", changes, re.MULTILINE)[0] == version


@pytest.mark.parametrize("libraries", ["lowest", "newest"])
def test_the_wheel_runs_in_an_empty_environment(wheel, tmp_path, libraries):
    limits = tmp_path / "limits.txt"
    named = PROJECT["dependencies"] + PROJECT["optional-dependencies"]["tables"] if libraries == "lowest" else []
    limits.write_text("\n".join(name.replace(">=", "==") for name in named), encoding="utf-8")
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / "bin" / "python"
    run(python, "-m", "pip", "install", "--quiet", "--constraint", limits, f"{wheel}")
    empty = tmp_path / "empty"
    empty.mkdir()
    run(tmp_path / "venv" / "bin" / "softness-bayes", "demo", "shown", cwd=empty)
    assert (empty / "shown" / "results" / "report.html").stat().st_size > 100_000
    tools = ["pytest", "pytest-xdist", "hypothesis", "mpmath", f"{wheel}[tables]"]
    run(python, "-m", "pip", "install", "--quiet", "--constraint", limits, *tools)
    # older libraries warn of newer ones
    options = ["-W", "default", "--quiet", "--numprocesses", "0", "-p", "no:cacheprovider"]
    run(python, "-W", "default", "-m", "pytest", *options, *(f"tests/{room}" for room in ROOMS))
