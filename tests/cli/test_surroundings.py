"""What surrounds the toolkit: encodings of the terminal, scripts without a guard, tables of pandas."""

import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics
from softness_bayes.model.scenes import usual_values
from softness_bayes.touch.readings import Readings
from support.paths import DATA, ROOT
from support.report_runs import LOADS, quickly

SCRIPT = """
from softness_bayes import read_experiment, sample
sample(read_experiment({data!r}), processes=2, quick=True)
"""


def python(words, text=None, **environment):
    """Run Python with the package on its path."""
    return subprocess.run(
        [sys.executable, *words],
        input=text,
        capture_output=True,
        text=True,
        errors="replace",
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
        timeout=120,
        check=False,
    )


def test_a_terminal_that_lacks_letters_ends_nothing(tmp_path):
    encoding = "ascii"
    (tmp_path / "ratings.csv").write_text(
        (DATA / "ratings.csv").read_text(encoding="utf-8").replace("P08", "Zoë 触"), encoding="utf-8"
    )
    words = ["-m", "softness_bayes", "check", "--data", str(tmp_path / "ratings.csv")]
    done = python(words, PYTHONIOENCODING=encoding)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    table = tmp_path / "rates.csv"
    touch = ["--fabrics", str(DATA / "fabrics.csv"), "--force-n", "1", "--out", str(table)]
    done = python(["-m", "softness_bayes", "predict", *touch], PYTHONIOENCODING=encoding)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert len(pd.read_csv(table)) == 12


@pytest.mark.parametrize("from_file", [True, False])
def test_a_script_without_a_guard_ends_in_a_sentence(from_file, tmp_path):
    script = SCRIPT.format(data=str(DATA / "ratings.csv"))
    (tmp_path / "analysis.py").write_text(script)
    done = python([str(tmp_path / "analysis.py")]) if from_file else python(["-"], script)
    assert done.returncode != 0
    last = done.stderr.strip().splitlines()[-1]
    assert "__main__" in last
    assert "processes=1" in last
    assert "BrokenPipeError" not in done.stderr


def test_usual_values_take_arrays():
    values = usual_values(Readings(), given={"b": np.array([50.0, 80.0])})
    np.testing.assert_array_equal(values["b"], [50.0, 80.0])


def test_fabrics_to_predict_may_be_a_table_of_pandas(report_run):
    result = report_run("ratings")
    table = pd.DataFrame({"fabric": ["felt", "mesh"], "effective_modulus_kpa": [20.0, 300.0]})
    with quickly():
        named = result.predict(table, LOADS, draws=20)
        same = result.predict(Fabrics(("felt", "mesh"), effective_modulus=np.array([2e4, 3e5])), LOADS, draws=20)
    pd.testing.assert_frame_equal(named, same)
    with pytest.raises(InputError, match="effective_modulus"):
        result.predict(pd.DataFrame({"fabric": ["felt"], "effective_modulus_kpa": [-1.0]}), LOADS)
