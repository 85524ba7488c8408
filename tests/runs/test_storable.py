"""What a result's file cannot hold is refused before the first step; what it can is found again."""

import json
import os
import shlex
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from softness_bayes.base.arviz_bridge import require_storable
from softness_bayes.base.errors import InputError
from softness_bayes.base.files.command_line import storable
from softness_bayes.base.files.records import as_json
from softness_bayes.checking.provenance import Provenance
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression
from softness_bayes.report.tables import repetition
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.runs import run
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.run import requested, sample
from softness_bayes.touch.readings import MENDED
from support.command_line import call, refused
from support.paths import DATA
from support.report_runs import OPTIONS, experiment, quickly

LARGE = 2**127 + 1
FOREIGN = os.fsdecode(b"caf\xe9 it's $x\\1.csv")


def test_attributes_and_names_are_tried_on_a_file():
    require_storable({"seed": 2**63, "sd": 0.5, "command": "naïve ½", "participant": ("P1", "Änne"), "finger": ()})
    for value in (2**64, None, "a\0b", "\udce9"):
        with pytest.raises(InputError, match=r"second .*the file of a result cannot hold it; expected UTF-8"):
            require_storable({"first": 1, "second": value})
    with pytest.raises(InputError, match=r"participant 'B\\x00o': the file"):
        require_storable({"fabric": ("felt",), "participant": ("Al", "B\0o")})


def test_json_takes_scalars_of_numpy_and_names_what_it_cannot_hold():
    assert json.loads(as_json({"seed": np.int64(3), "fix": {"b": np.float32(0.5)}}, "x")) == {
        "seed": 3,
        "fix": {"b": 0.5},
    }
    with pytest.raises(InputError, match="options of the run: 'fix': "):
        as_json({"seed": 3, "fix": {"b": {1, 2}}}, "options of the run")


def test_a_shell_takes_a_command_again_whatever_its_bytes():
    words = ["--data", FOREIGN, "it's", "--out", "plain", '"', "--x=ü"]
    command = storable(shlex.join(words))
    command.encode()
    told = subprocess.run(["bash", "-c", f"printf '%s\\0' {command}"], capture_output=True, check=True).stdout
    assert told.split(b"\0")[:-1] == [os.fsencode(word) for word in words]
    # one without such bytes stays as it is
    assert storable(plain := shlex.join(["--data", "it's ü.csv", '"'])) == plain


def test_a_run_of_a_large_seed_is_stored_and_repeated(tmp_path):
    command = shlex.join(["softness-bayes", "sample", "--data", FOREIGN])
    with quickly():
        sample(experiment(), **OPTIONS | {"seed": LARGE, "max_steps": 4, "command": command}).save(tmp_path)
    result = Result.load(tmp_path)
    assert Request.of(result).run.seed == int(result.attributes["seed"]) == LARGE
    assert result.attributes["command"] == storable(command)
    (again,) = repetition(result).commands
    assert f"--seed {LARGE}" in again
    told = subprocess.run(["bash", "-c", f"printf '%s\\0' {again}"], capture_output=True, check=True).stdout
    assert os.fsencode(FOREIGN) in told.split(b"\0")


def test_a_seed_is_stored_as_a_number_while_a_float_holds_it():
    """As a float, which ArviZ can write as JSON; as text from the first integer that a float would round."""
    with quickly():
        asked = Request(ModelOptions(), RunOptions()).with_options(**OPTIONS)
        model = build(experiment(), asked.model)
    for seed, kind in ((3, float), (np.int64(3), float), (2**53, float), (2**53 + 1, str), (2**63, str)):
        stored = requested(model, asked.with_options(seed=seed).run)
        assert type(stored["seed"]) is kind
        assert Provenance(stored).asked.seed == seed
    assert int(float(2**53 + 1)) != 2**53 + 1  # negative control: as a number it would be another seed


def test_nothing_is_computed_or_left_of_a_run_that_could_not_be_stored(tmp_path, monkeypatch):
    def never(*_):
        raise AssertionError("walked")

    monkeypatch.setattr(run, "walked", never)
    data = experiment()
    named = replace(data.ratings, participants=("A\0", *data.ratings.participants[1:]))
    fabrics = replace(data.ratings, fabrics=("A\0", *data.ratings.fabrics[1:]))
    plate = simulate_compression(np.random.default_rng(4), usual_values(MENDED, n_fingers=4), fingers=4).compression
    fingers = replace(plate, participants=("A\0", *plate.participants[1:]))
    cases = {
        r"participant 'A\\x00'": (data._replace(ratings=named), OPTIONS),
        r"fabric 'A\\x00'": (data._replace(ratings=fabrics), OPTIONS),
        r"finger 'A\\x00'": (data._replace(compression=fingers), OPTIONS),
        r"command 'a\\x00b'": (data, OPTIONS | {"command": "a\0b"}),
        "max_steps is 1j, expected a whole number from 1 to 1000000000": (data, OPTIONS | {"max_steps": 1j}),
    }
    for said, (asked, options) in cases.items():
        with quickly(), pytest.raises(InputError, match=said):
            sample(asked, **options)
    with pytest.raises(InputError, match=r"finger 'A\\x00'"):
        sample(fingers)
    # negative control: what is well walks
    with quickly(), pytest.raises(AssertionError, match="walked"):
        sample(data, **OPTIONS)
    kept = Checkpoint.create(tmp_path / "out")
    kept.request = {"files": {1, 2}}
    with kept, pytest.raises(InputError, match="request: 'files'"):
        kept.begin({"model": "any"})
    assert list(tmp_path.iterdir()) == []


def test_a_table_whose_name_is_not_utf8_is_read(tmp_path):
    (tmp_path / FOREIGN).write_bytes((DATA / "ratings.csv").read_bytes())
    done = call("check", "--data", FOREIGN, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "1059" in done.stdout


def test_a_name_with_nul_is_refused_at_the_command_line(tmp_path):
    header, row, *rows = (DATA / "ratings.csv").read_text().splitlines(keepends=True)
    wide = "".join([header, row.replace("P01", "P\x0001"), *rows])
    (tmp_path / "wide.csv").write_bytes(wide.encode("utf-16"))
    done = call("sample", "--data", "wide.csv", "--out", "out", "--processes", 1, cwd=tmp_path)
    refused(done, "wide.csv: not a text file, expected a table saved as CSV: control character '\\x00' in line 2")
    assert not (tmp_path / "out").exists()
