"""JSON that anyone may have written: nested a million deep, it is refused wherever it is read."""

import os
import subprocess
import sys

import numpy as np
import pytest

from softness_bayes.base.files.records import as_json, parse_json
from support.command_line import call, refused
from support.paths import DATA, ROOT

DEEP = "[" * 10**6 + "]" * 10**6
LIMITED = (
    "import resource; from softness_bayes.cli import main; "
    "resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30)); resource.setrlimit(resource.RLIMIT_CPU, (10, 10)); "
    "main(prog_name='softness-bayes')"
)


def within_limits(*arguments):
    """Run a verb with 2 GB of memory and 10 s of processor time."""
    return subprocess.run(
        [sys.executable, "-c", LIMITED, *map(str, arguments)],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=False,
    )


@pytest.mark.parametrize("text", [DEEP, '{"a":' * 10**6 + "1" + "}" * 10**6, "[" * 10**6, b"\xff", "9" * 10**5, "nope"])
def test_what_is_not_json_is_a_value_error(text):
    with pytest.raises(ValueError, match=r"nested too deeply|utf-8|digits|Expecting"):
        parse_json(text)


def test_what_cannot_be_json_is_named():
    deep = []
    for _ in range(10**5):
        deep = [deep]
    with pytest.raises(ValueError, match="options: cannot be stored"):
        as_json({"fix": deep}, "options")
    with pytest.raises(ValueError, match=r"options: 'fix'.*cannot be stored"):
        as_json({"seed": np.int64(3), "fix": object()}, "options")
    assert as_json({"seed": np.int64(3)}, "options") == '{"seed": 3}'


@pytest.mark.parametrize("run", [within_limits, call])
def test_a_deep_record_of_a_calibration(tmp_path, run):
    (tmp_path / "manifest.json").write_text(DEEP)
    (tmp_path / "asked.json").write_text(DEEP)
    refused(run("status", tmp_path), "asked.json")


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        (".softness-bayes.json", ("simulate", "--fabrics", DATA / "fabrics.csv", "--out")),
        ("manifest.json", ("calibrate", "--replicates", "1", "--out")),
        ("asked.json", ("status",)),
        ("scheduler.json", ("calibrate", "--replicates", "1", "--dask", "scheduler.json", "--out", "made")),
    ],
)
def test_other_deep_files(tmp_path, monkeypatch, name, arguments):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(DEEP)
    if name == "asked.json":
        (tmp_path / "runs").mkdir()
    done = call(*arguments, *([] if name == "scheduler.json" else [tmp_path]))
    refused(done, path.name)
    assert path.read_text() == DEEP
