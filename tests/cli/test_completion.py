"""What the shell completes, what misspelt commands suggest, and the lists of readings, priors and figures."""

import pytest
from click.shell_completion import ShellComplete

from softness_bayes.cli import main
from softness_bayes.parameters.declared import EVERY_PARAMETER, PRIOR_SETS
from softness_bayes.parameters.priors import LAWS
from softness_bayes.touch.readings import ALTERNATIVES
from support.command_line import call, refused


@pytest.mark.parametrize(
    ("typed", "begun", "expected"),
    [
        ((), "cal", ["calibrate"]),
        (("sample", "--reading"), "pressure=", [f"pressure={name}" for name in ALTERNATIVES["pressure"]]),
        (("sample", "--reading"), "pre", ["pressure="]),
        (("sample", "--priors"), "", [*PRIOR_SETS]),
        (("sample", "--prior"), "b=", [f"b={law}(" for law in LAWS]),
        (("sample", "--fix"), "c_", [f"{name}=" for name in EVERY_PARAMETER if name.startswith("c_")]),
        (("sample", "--finger"), "receptor", ["receptor_depth_mm="]),
        (("plot", "results", "--figures"), "rating", ["rating", "rating_ratio"]),
        (("list",), "pri", ["priors"]),
        (("list", "readings"), "mem", ["membrane"]),
    ],
)
def test_the_shell_completes_values(typed, begun, expected):
    found = ShellComplete(main, {}, "softness-bayes", "_SOFTNESS_BAYES_COMPLETE").get_completions(list(typed), begun)
    assert [item.value for item in found] == expected


def test_a_misspelt_command_names_the_nearest():
    refused(call("sampel"), "No such command 'sampel'. Did you mean 'softness-bayes sample'?")
    refused(call("xyz"), "'softness-bayes --help' lists all")
