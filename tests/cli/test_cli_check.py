import os
import re
import subprocess
import sys

import click
import pytest

from softness_bayes.base.errors import InputError, SoftnessError
from softness_bayes.cli import FORMER, VERBS, main, short_help
from support.command_line import HELD, call, run
from support.paths import ROOT

RATINGS = "participant,fabric,indentation_mm,rating\nP1,a,1,5\nP2,b,1,7\nP1,b,2,NA\nP2,a,1,8\n"
FABRICS = "fabric,effective_modulus_kpa\na,12.5\nb,80\nc,90\n"


@pytest.fixture
def files(tmp_path):
    (tmp_path / "ratings.csv").write_text(RATINGS)
    (tmp_path / "cloth.csv").write_text(FABRICS)
    return tmp_path / "ratings.csv", tmp_path / "cloth.csv"


# the group


def printed(program):
    """Return what a program prints in a process of its own."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True
    ).stdout


def test_help_lists_the_verbs_without_importing_them():
    said = printed(
        "import sys; from softness_bayes.cli import main, VERBS\n"
        "main(['--help'], standalone_mode=False)\n"
        "heavy = {'numpy', 'pandas', *(f'softness_bayes.cli.{home}' for home in [*VERBS.values(), 'options'])}\n"
        "print([m for m in sys.modules if m in heavy])"
    )
    assert said.splitlines()[-1] == "[]"
    shown = " ".join(said.split())  # long lines are wrapped
    assert all(f"{verb} {short_help(verb)}" in shown for verb in VERBS)


def test_help_of_every_verb_needs_no_heavy_library_and_agrees_with_the_list():
    heavy = ("numpy", "pandas", "scipy", "xarray", "arviz", "emcee", "matplotlib", "corner")
    said = printed(
        "import sys; from softness_bayes.cli import main, VERBS\n"
        "for verb in VERBS:\n"
        "    main([verb, '--help'], standalone_mode=False)\n"
        f"    print('imported:', verb, [m for m in {heavy} if m in sys.modules])"
    )
    helped = dict(zip(VERBS, said.split("imported: ")[:-1], strict=True))
    for verb, shown in helped.items():
        assert f"imported: {verb} []" in said
        command = main.get_command(None, verb)
        assert command.help.partition("\n")[0] == short_help(verb)
        for option in command.params:
            if isinstance(option, click.Argument):
                assert option.make_metavar(click.Context(command)) in shown
                continue
            assert option.help, option.name
            assert option.opts[0] in shown


@pytest.mark.parametrize("kind", [InputError, *SoftnessError.__subclasses__()])
def test_errors_become_exit_codes(kind, monkeypatch, capsys):
    @click.command()
    def failing() -> None:
        raise kind("what went wrong")

    monkeypatch.setattr(type(main), "get_command", lambda *_: failing)
    with pytest.raises(SystemExit) as stop:
        main(["check"])
    assert stop.value.code == kind.exit_code
    assert capsys.readouterr().err == "error: what went wrong\n"


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


# options that other verbs share


@pytest.mark.parametrize("former", FORMER)
def test_a_command_that_was_renamed_names_the_new_one(former):
    done = call(former, "--data", "x.csv")
    assert done.returncode == 2
    assert f"It is now 'softness-bayes {FORMER[former]}'." in done.stderr
    assert main.get_command(None, FORMER[former].split()[0]) is not None


# data that hardly say anything

HEADER = "participant,fabric,indentation_mm,rating,effective_modulus_kpa\n"
MODULI = {"a": 60, "b": 300, "c": 2000}
CHANNELS = [part for name in ("c_Na", "c_K", "c_L", "c_A") for part in ("--fix", f"{name}={HELD[name]}")]


def crossed(people, ratings):
    """Ratings of the three fabrics by some people, over and over."""
    cells = [(person, fabric) for person in people for fabric in MODULI]
    return HEADER + "".join(
        f"{person},{fabric},2,{ratings[k % len(ratings)]},{MODULI[fabric]}\n"
        for k, (person, fabric) in enumerate(cells)
    )


TABLES = {
    "one row": HEADER + "P1,a,2,20,100\n",
    "one participant": crossed(["P1"], ["20", "30", "25"]),
    "one fabric": HEADER + "P1,a,2,20,100\nP2,a,2,10,100\nP1,a,2,25,100\n",
    "identical": crossed(["P1", "P2"], ["20"]),
    "extreme": crossed(["P1", "P2"], ["1e-300", "1e300"]),
}


@pytest.mark.parametrize(
    ("name", "statement"),
    [
        ("one row", "one condition: the response does not vary"),
        ("one participant", "one participant: the spread of rating scales between participants (tau)"),
        ("one fabric", "one condition: the response does not vary"),
        ("identical", "all ratings are equal"),
        ("extreme", "from 1e-300 to 1e+300"),
    ],
)
def test_check_says_what_the_data_cannot_tell(tmp_path, name, statement):
    (tmp_path / "ratings.csv").write_text(TABLES[name])
    done = call("check", "--data", tmp_path / "ratings.csv")
    assert done.returncode == 0, done.stderr
    assert statement in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", ["one row", "one participant", "one fabric"])
def test_a_run_on_them_ends_with_a_verdict(tmp_path, name):
    """Warnings are errors in the process that runs; no number of the report is none."""
    (tmp_path / "ratings.csv").write_text(TABLES[name])
    brief = ("--max-steps", 20, "--processes", 1, *CHANNELS)
    done = run("sample", "--data", tmp_path / "ratings.csv", "--out", tmp_path / "out", *brief, timeout=900)
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert "Warning" not in done.stderr
    assert not re.search(r"\bnan\b", done.stdout), done.stdout
    assert (tmp_path / "out" / "figures" / "rating.png").stat().st_size > 0
