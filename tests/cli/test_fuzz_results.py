"""Damaged results and checkpoints: every verb that reads a run ends well, and changes no file but its own."""

import hashlib
import shutil
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from softness_bayes.cli import main
from softness_bayes.runs import run
from support.command_line import FIXED, few_ratings
from support.faults import DAMAGES, damage
from support.paths import DATA
from support.randomness import SEED
from support.report_runs import quickly

ASKED = [*FIXED, "--seed", "3", "--no-figures", "--max-steps", "40", "--processes", "1"]
SENTINELS = {"thesis.tex": b"\\documentclass{thesis}\n", "notes.csv": b"a,b\n1,2\n", ".git_config": b"[core]\n"}
KINDS = (*DAMAGES, "separator", "directory")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run that has ended, with its data and another such run beside it to compare it with."""
    directory = tmp_path_factory.mktemp("finished")
    few_ratings(directory)
    with quickly():
        done = CliRunner().invoke(
            main, ["sample", "--data", str(directory / "ratings.csv"), "--out", str(directory / "out"), *ASKED]
        )
    assert done.exit_code == 3, done.output
    shutil.copytree(directory / "out", directory / "whole")
    return directory


@pytest.fixture
def no_walk(monkeypatch):
    """`resume` reads all that it needs, and stops where it would walk."""

    def stop(*_arguments, **_options):
        raise click.exceptions.Exit(0)

    monkeypatch.setattr(run, "walk", stop)


def spoil(path: Path, how: str, others: list[Path], random: np.random.Generator) -> None:
    """Spoil one file of a run."""
    match how:
        case "separator":
            path.write_bytes(path.read_bytes().replace(b",", b";").replace(b".", b","))
        case "directory":
            path.unlink()
            path.mkdir()
            (path / "inside.txt").write_text("somebody's")
        case _:
            damage(path, how, others, random)


def files_of(folder: Path) -> dict[str, str]:
    """Digest of each file below a folder."""
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in found}


def fuzz_results(finished: Path, folder: Path, random: np.random.Generator, cases: int) -> list[tuple[str, int]]:
    """Read a run with one damaged file through one verb in each case; return verb and exit code."""
    seen, touched = [], ["--fabrics", DATA / "fabrics.csv", "--indentation-mm", "2"]
    kinds = sorted(p.relative_to(finished / "out") for p in (finished / "out").rglob("*") if p.is_file())
    # most of what is read is read of two files
    kinds += [kind for kind in kinds if kind.name == "posterior.nc" or kind.suffix == ".npz"] * 2
    for case in range(cases):
        here = folder / str(case)
        shutil.copytree(finished, here)
        out = here / "out"
        for place in (here, out):
            for name, content in SENTINELS.items():
                (place / name).write_bytes(content)
        target, how = kinds[int(random.integers(0, len(kinds)))], str(random.choice(KINDS))
        spoil(out / target, how, [out / kind for kind in kinds if (out / kind) != out / target], random)
        verbs = {
            "status": ["status", out],
            "resume": ["resume", out, "--no-figures"],
            "plot": ["plot", out, "--figures", "trace", "--format", "svg", "--out", here / "made"],
            "compare": ["compare", here / "whole", out, "--out", here / "made"],
            "predict": ["predict", "--posterior", out, *touched, "--out", here / "predicted.csv"],
            "report": ["report", out, "--out", here / "made.html"],
            "rank": ["rank", out, *touched, "--out", here / "made"],
            "target": ["target", out, "--rating", "20", "--out", here / "target.csv"],
        }
        verb = list(verbs)[case % len(verbs)]
        before = files_of(here)
        with quickly():
            done = CliRunner().invoke(main, [str(word) for word in verbs[verb]])
        told = (case, verb, str(target), how, done.output[-600:])
        assert done.exception is None or isinstance(done.exception, SystemExit), (told, done.exc_info)
        assert done.exit_code in (0, 2, 3, 4, 5), told
        assert "Traceback" not in done.output, told
        after = files_of(here)
        # a lock notes who held it; nothing else that stood there is touched
        changed = [name for name in before if after.get(name) != before[name] and not name.endswith("lock")]
        assert not changed, (told, changed)
        seen.append((verb, done.exit_code))
        shutil.rmtree(here)
    return seen


def test_a_damaged_run_is_read_or_refused(finished, tmp_path, no_walk, few_pictures):
    seen = fuzz_results(finished, tmp_path, np.random.default_rng([SEED, 5]), 8)
    assert {verb for verb, _ in seen} == {"status", "resume", "plot", "compare", "predict", "report", "rank", "target"}
    assert {0, 2} <= {code for _, code in seen}  # else nothing was spoilt, or everything


@pytest.mark.slow
@pytest.mark.parametrize("part", range(6))
def test_a_hundred_damaged_runs_are_read_or_refused(finished, tmp_path, no_walk, part):
    fuzz_results(finished, tmp_path, np.random.default_rng([SEED, 6, part]), 100)
