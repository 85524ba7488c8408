"""What the shell completes, what misspelt commands suggest, and the lists of readings, priors and figures."""

import pytest
from click.shell_completion import ShellComplete

from softness_bayes.cli import main
from softness_bayes.parameters.declared import EVERY_PARAMETER, PRIOR_SETS
from softness_bayes.parameters.priors import LAWS
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.touch.readings import ALTERNATIVES
from support.command_line import call, refused


@pytest.mark.parametrize(
    ("typed", "begun", "expected"),
    [
        ((), "cal", ["calibrate"]),
        (("sample", "--reading"), "pressure=", [f"pressure={name}" for name in ALTERNATIVES["pressure"]]),
        (("sample", "--reading"), "pre", ["pressure="]),
        (("sample", "--readings"), "he", ["hertz"]),
        (("sample", "--priors"), "", [*PRIOR_SETS]),
        (("sample", "--prior"), "b=", [f"b={law}(" for law in LAWS]),
        (("sample", "--fix"), "c_", [f"{name}=" for name in EVERY_PARAMETER if name.startswith("c_")]),
        (("sample", "--finger"), "receptor", ["receptor_depth_mm="]),
        (("sample", "--errors"), "st", ["student"]),
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


def test_the_lists_come_from_the_tables():
    said = call("list", "readings").stdout
    for place, values in ALTERNATIVES.items():
        assert f"{place}:\n" in said
        for name, value in values.items():
            assert value.meaning, (place, name)
            assert value.meaning[:40] in said
    assert "hertz" in call("list", "readings", "pressure").stdout
    refused(call("list", "readings", "presure"), "no place 'presure'; expected one of fabric_modulus")
    said = call("list", "priors").stdout
    for name, parameter in EVERY_PARAMETER.items():
        assert f"  {name} " in said
        assert str(parameter.prior) in said
    assert all(law in said for law in LAWS)
    said = " " + " ".join(call("list", "figures").stdout.split())  # long lines are wrapped
    assert all(f" {name} {drawing.shows}" in said for name, drawing in FIGURES.items())
