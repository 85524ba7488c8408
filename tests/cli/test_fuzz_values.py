"""Values of parameters on the command line, computed: a finite table, or a refusal that has a message."""

import numpy as np
import pytest
from click.testing import CliRunner

from softness_bayes.cli import main
from softness_bayes.parameters.declared import EVERY_PARAMETER
from support.paths import ROOT
from support.randomness import SEED

NASTY = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e308",
        "5e-324",
        "-1",
        "0",
        "-0",
        "1e-300",
        "1e999",
        "",
        "=",
        "b=1",
        "0x10",
        "1_0",
        "1,5",
    ),
    *("１２", "٣", "--", "\u202e5", "9" * 400, " 3 ", "+4", "true", "1e-12", "1e12", "1e100", "1e-100"),
)
NAMES = (*EVERY_PARAMETER, "q", "B", "b ", "σ", "c_na", "", ",", ";", "load")
DATA = ("--data", str(ROOT / "data" / "ratings.csv"))
PREDICT = ("predict", "--fabrics", str(ROOT / "data" / "fabrics.csv"), "--accuracy", "0.01", "--force-n", "1")
VERBS = {"--set": (PREDICT,), "--fix": (("check", *DATA), ("check", "--cost", *DATA, "--accuracy", "0.01"))}
REFUSED, NO_NUMBERS = 2, 4


def value(random):
    """One that broke something, or a number of any size."""
    if random.random() < 0.4:
        return str(random.choice(NASTY))
    return repr(float(10.0 ** random.uniform(*[(-12, 12), (-1, 2.5)][random.integers(2)])))


def line_of(random):
    """A command line with one to four values, some of them given twice."""
    option = str(random.choice([*VERBS]))
    verb = VERBS[option][random.integers(len(VERBS[option]))]
    given = [f"{random.choice(NAMES)}={value(random)}" for _ in range(random.integers(1, 5))]
    given += given[:1] if random.random() < 0.1 else []
    return [*verb, *(word for each in given for word in (option, each))]


@pytest.mark.parametrize("cases", [12, pytest.param(400, marks=pytest.mark.slow)])
def test_values_of_parameters_give_numbers_or_a_message(cases):
    random, runner, codes = np.random.default_rng([SEED, 21]), CliRunner(), set()
    for line in (line_of(random) for _ in range(cases)):
        said = runner.invoke(main, line)
        codes.add(said.exit_code)
        assert said.exit_code in (0, REFUSED, NO_NUMBERS), (line, said.output, said.exception)
        assert said.exception is None or isinstance(said.exception, SystemExit), (line, said.exception)
        if said.exit_code:
            assert said.output.strip(), line
        elif line[0] == "predict":
            assert not {"nan", "inf", "-inf"} & set(said.output.lower().replace("|", " ").split()), line
    assert REFUSED in codes
