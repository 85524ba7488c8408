from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from softness_bayes.cli import FORMER, VERBS, main
from softness_bayes.cli.options import flag, force, out, seed, set_values, touches
from softness_bayes.errors import InputError, SoftnessError
from softness_bayes.model.options import ModelOptions
from support.command_line import call, run
from support.paths import ROOT, SHARED

RATINGS = "participant,fabric,indentation_mm,rating\nP1,a,1,5\nP2,b,1,7\nP1,b,2,NA\nP2,a,1,8\n"
FABRICS = "fabric,effective_modulus_kpa\na,12.5\nb,80\nc,90\n"


@pytest.fixture
def files(tmp_path):
    (tmp_path / "ratings.csv").write_text(RATINGS)
    (tmp_path / "cloth.csv").write_text(FABRICS)
    return tmp_path / "ratings.csv", tmp_path / "cloth.csv"


# the group


def test_help_lists_the_verbs_without_importing_them():
    program = (
        "import sys; from softness_bayes.cli import main, VERBS\n"
        "main(['--help'], standalone_mode=False)\n"
        "heavy = {'numpy', 'pandas', *(f'softness_bayes.cli.{verb}' for verb in [*VERBS, 'options'])}\n"
        "print([m for m in sys.modules if m in heavy])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=True,
    )
    assert done.stdout.splitlines()[-1] == "[]"
    shown = " ".join(done.stdout.split())  # long lines are wrapped
    assert all(f"{verb} {text}" in shown for verb, text in VERBS.items())


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb_needs_no_heavy_library_and_agrees_with_the_list(verb):
    heavy = ("numpy", "pandas", "scipy", "xarray", "arviz", "emcee", "matplotlib", "corner")
    program = (
        "import sys; from softness_bayes.cli import main\n"
        f"main([{verb!r}, '--help'], standalone_mode=False)\n"
        f"print([m for m in {heavy} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=True,
    )
    assert done.stdout.splitlines()[-1] == "[]"
    command = main.get_command(None, verb)
    assert command.help.partition("\n")[0] == VERBS[verb]
    for option in command.params:
        if isinstance(option, click.Argument):
            assert option.make_metavar(click.Context(command)) in done.stdout
            continue
        assert option.help, option.name
        assert option.opts[0] in done.stdout


def test_version():
    from softness_bayes import __version__

    assert __version__ in run("--version").stdout


@pytest.mark.parametrize("arguments", [["chek"], ["check"], ["check", "--data", "x", "--column", "rating"]])
def test_wrong_usage_exits_with_2(arguments):
    done = run(*arguments)
    assert done.returncode == 2
    assert "Error: " in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("kind", [InputError, *SoftnessError.__subclasses__()])
def test_errors_become_exit_codes(kind, monkeypatch, capsys):
    @click.command()
    def failing() -> None:
        raise kind("what went wrong")

    monkeypatch.setattr(type(main), "get_command", lambda *_: failing)
    with pytest.raises(SystemExit) as stop:
        main(["check"])
    assert stop.value.code == kind.exit_code
    advice = "try: softness-bayes check --help\n" if issubclass(kind, InputError) else ""
    assert capsys.readouterr().err == f"error: what went wrong\n{advice}"


# check


def test_check_shows_moduli_in_the_reading_that_is_asked_for(files):
    """The printed rigidity divides by 1 - nu, that of a plate by 1 - nu²: they differ by 1 + nu."""
    ratings, cloth = files
    cloth.write_text("fabric,tensile_modulus_mpa,thickness_mm,poisson_ratio\na,10,0.5,0.25\nb,20,0.4,0.25\n")
    shown = []
    for reading in ("printed", "plate"):
        done = call("check", "--data", ratings, "--fabrics", cloth, "--reading", f"fabric_modulus={reading}")
        assert done.returncode == 0, done.stderr
        (line,) = (line for line in done.stdout.splitlines() if line.split()[:1] == ["a"])
        shown.append(float(line.split()[1]))
    assert shown[0] / shown[1] == pytest.approx(1.25, rel=1e-3)


def test_check_says_what_it_understood(files):
    ratings, cloth = files
    done = call("check", "--data", ratings, "--fabrics", cloth)
    assert done.returncode == 0, done.stderr
    lines = {line.partition(" ")[0]: line for line in done.stdout.splitlines()}
    assert "3, from 5 to 8; 1 missing" in lines["ratings"]
    assert "2 (P1 … P2), 1 to 2 ratings each" in lines["participants"]
    assert "2 (a … b), E_fab 12.5 to 80 kPa" in lines["fabrics"]
    assert "1 mm (3 ratings)" in lines["loads"]
    assert "2 of 2 pairs of fabric and load; 3 of 4 with each participant" in lines["conditions"]
    assert "can be estimated" in lines["tau"]
    assert lines["a"].split() == ["a", "12.5", "0.3", "2", "effective_modulus_kpa"]
    notes = [line for line in done.stdout.splitlines() if line.startswith("note: ")]
    assert any("fabrics without a rating, left out: c" in note for note in notes)
    assert any("1 of 4 ratings is missing" in note for note in notes)


def test_check_counts_many_loads_and_lists_few(tmp_path):
    path = tmp_path / "ratings.csv"
    forces = [f"P{k % 3},{'ab'[k % 2]},,{0.9 + k / 100:.2f},{5 + k % 4},{10 + 90 * (k % 2)}" for k in range(20)]
    rows = ["P1,a,1,,5,10", "P1,b,2,,6,100", *forces]
    head = "participant,fabric,indentation_mm,force_n,rating,effective_modulus_kpa"
    path.write_text("\n".join([head, *rows]) + "\n")
    shown = call("check", "--data", path).stdout
    assert "1 mm (1 rating), 2 mm (1 rating), 20 different forces, 0.9 N to 1.09 N (20 ratings)" in shown


def test_check_of_one_participant_without_loads(files):
    ratings, cloth = files
    ratings.write_text("fabric;softness\na;1,5\nb;2\n")
    without = call("check", "--data", ratings, "--fabrics", cloth, "--column", "rating=softness")
    assert without.returncode == 2
    assert "--indentation-mm" in without.stderr
    assert "--force-n" in without.stderr
    done = call("check", "--data", ratings, "--fabrics", cloth, "--column", "rating=softness", "--force-n", "0.5")
    assert done.returncode == 0, done.stderr
    assert "0.5 N (2 ratings)" in done.stdout
    assert "cannot be estimated" in done.stdout
    assert "from 1.5 to 2" in done.stdout


def test_check_names_the_place_of_a_fault(files):
    ratings, cloth = files
    ratings.write_text(RATINGS.replace("P2,b,1,7", "P2,b,one,7"))
    done = run("check", "--data", ratings, "--fabrics", cloth)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == (
        f"error: {ratings}: row 3, column 'indentation_mm': expected a number from 1e-06 to 8 "
        "(a fingertip's radius is 8 mm), got 'one'\ntry: softness-bayes check --help\n"
    )


def test_check_refuses_negative_ratings(files):
    ratings, cloth = files
    ratings.write_text(RATINGS.replace("P2,b,1,7", "P2,b,1,-1"))
    done = call("check", "--data", ratings, "--fabrics", cloth)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {ratings}: row 3, column 'rating': expected a magnitude estimate")
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data lie beside the project only")
def test_check_of_the_laboratory_ratings():
    done = call(
        "check", "--data", SHARED / "data" / "lab_ratings.csv", "--fabrics", SHARED / "data" / "lab_fabrics.csv"
    )
    assert done.returncode == 0, done.stderr
    assert "30 (P01 … P30)" in done.stdout


# options that other verbs share


def invoke(option, *arguments: str) -> dict:
    """Return what a verb with one shared option would receive."""
    received = {}
    command = click.command()(option(lambda **values: received.update(values)))
    command.main(list(arguments), standalone_mode=False)
    return received


FIX, PRIOR = flag(ModelOptions, "fix"), flag(ModelOptions, "priors")


def test_options_hand_over_values():
    assert invoke(set_values, "--set", "b=80", "--set", "m = 2e0") == {"values": {"b": 80.0, "m": 2.0}}
    assert invoke(FIX, "--fix", "b=80") == {"fix": {"b": 80.0}}
    assert invoke(seed, "--seed", "7") == {"seed": 7}
    assert invoke(out()) == {"out": Path("results")}
    assert invoke(force, "--force") == {"force": True}
    assert invoke(flag(ModelOptions, "prior_set")) == {"prior_set": "default"}
    assert invoke(PRIOR) == {"priors": {}}


@pytest.mark.parametrize(
    ("option", "arguments", "problem"),
    [
        (set_values, ["--set", "b"], "expected NAME=VALUE, got 'b'"),
        (set_values, ["--set", "=1"], "expected NAME=VALUE, got '=1'"),
        (set_values, ["--set", "b=high"], "b: expected a finite number, got 'high'"),
        (FIX, ["--fix", "b=nan"], "b: expected a finite number, got 'nan'"),
        (FIX, ["--fix", "b=1", "--fix", "b=2"], "'b' is given twice"),
        (seed, ["--seed", "-1"], "-1 is not in the range x>=0"),
        (PRIOR, ["--prior", "b=cauchy(1)"], "b: "),
    ],
)
def test_options_refuse_what_they_cannot_read(option, arguments, problem):
    with pytest.raises(click.BadParameter, match=problem):
        invoke(option, *arguments)


@pytest.mark.parametrize("former", FORMER)
def test_a_command_that_was_renamed_names_the_new_one(former):
    done = call(former, "--data", "x.csv")
    assert done.returncode == 2
    assert f"It is now 'softness-bayes {FORMER[former]}'." in done.stderr
    assert main.get_command(None, FORMER[former].split()[0]) is not None


def test_fabrics_and_loads(tmp_path):
    path = tmp_path / "cloth.csv"
    path.write_text(FABRICS.replace("fabric", "id"))
    arguments = ["--fabrics", str(path), "--column", "fabric=id", "--indentation-mm", "2", "--force-n", "1"]
    asked = invoke(touches(), *arguments, "--indentation-mm", "1")["touches"]
    fabrics, loads = asked.read()
    assert fabrics.names == ("a", "b", "c")
    assert [str(load) for load in loads] == ["1 mm", "2 mm", "1 N"]
    with pytest.raises(InputError, match="--indentation-mm or --force-n"):
        invoke(touches(), "--fabrics", str(path))["touches"].read()
