"""What the commands print and write for small tables, line by line, against texts that are stored.

`SOFTNESS_BAYES_GOLDEN=write python -m pytest tests/cli/test_golden_commands.py` writes `tests/golden/*.txt` again. A
commit whose texts differ keeps them or says which line changed, and why. Numbers that come from sampling or from a
clock stand as `#`; of the tables that are written, names, columns and numbers of rows are stored.
"""

from __future__ import annotations

import html
import re

import numpy as np
import pandas as pd
import pytest

from softness_bayes.results.result import Result
from support.command_line import FIXED, call
from support.golden import GOLDEN, Form, masked, of_table, require, rounded, verbatim
from support.report_runs import quickly

FABRICS = {"silk": 2e1, "lawn": 9e1, "drill": 3e2, "felt": 7e2}
RATERS = {"Ada": 0.5, "Bo": -0.4, "Cy": 0.1, "Di": 0.3}
MM = "indentation_mm"


def noise(size, seed):
    """Numbers like errors, the same for ever."""
    return 1.2 * np.sin(7919.0 * (seed + np.arange(size)) ** 1.5)


def latent(seed=1, column=MM, loads=(1, 2)):
    """Touches, and a latent log softness of each that falls with the modulus."""
    rows = [(rater, fabric, load) for rater in RATERS for load in loads for fabric in FABRICS]
    table = pd.DataFrame(rows, columns=["participant", "fabric", column])
    firmness = np.log(table["fabric"].map(FABRICS)) / 4.0
    table["latent"] = firmness.mean() - firmness + 0.2 * noise(len(table), seed)
    return table


def tables(directory):
    """Write a dozen small tables, each odd in another way."""
    touch = latent()
    own = np.exp(touch["latent"] + touch["participant"].map(RATERS))

    def write(name, rating, of=touch, **more):
        table = of.assign(rating=rating, **more).drop(columns="latent")
        table.to_csv(directory / name, index=False)

    write("exact.csv", (12.0 * own).round(3))
    write("whole.csv", (3.0 * own).round(), trial=1)
    write("slider.csv", (100.0 / (1.0 + np.exp(-1.5 * touch["latent"]))).round())
    write("likert.csv", np.clip(np.round(4.0 + 2.0 * touch["latent"]), 1, 7).astype(int))
    by_list = [touch["participant"], touch[MM]]
    write("ranks.csv", touch["latent"].groupby(by_list).rank().astype(int))
    pair = np.arange(len(touch)) // 2
    write("pairs.csv", touch["latent"].groupby(pair).rank().astype(int), list=pair + 1)
    write("scores.csv", (touch["latent"] / touch["latent"].std()).round(3))
    forces = latent(2, "force_n", (0.52, 1.49))
    write("forces.csv", (9.0 * np.exp(forces["latent"])).round(2), of=forces, load_cv=0.05)
    cells = touch[touch["participant"] == "Bo"].drop(columns="participant")
    cells = cells.assign(geometric_mean=(12.0 * np.exp(cells["latent"])).round(2), geometric_sd=1.6, n=12)
    cells.drop(columns="latent").to_csv(directory / "cells.csv", index=False)
    wide = touch[touch[MM] == 1].assign(rating=(10.0 * own).round(1)).pivot_table(
        index="participant", columns="fabric", values="rating"
    )  # fmt: skip
    wide.to_csv(directory / "wide.csv")
    german = pd.read_csv(directory / "exact.csv").rename(columns={"participant": "Teilnehmer", "rating": "Urteil"})
    german.to_csv(directory / "german.csv", index=False, sep=";", decimal=",")
    missing = pd.read_csv(directory / "exact.csv", dtype=str)
    missing.loc[[3, 7], "rating"] = ["", "n/a"]
    missing.to_csv(directory / "missing.csv", index=False)
    cloth = pd.DataFrame({"fabric": list(FABRICS), "effective_modulus_kpa": list(FABRICS.values())})
    cloth.to_csv(directory / "fabrics.csv", index=False)
    cloth["effective_modulus_kpa"] = [20.0, 90.0, np.nan, np.nan]
    cloth["effective_modulus_cv"] = [np.nan, 0.2, np.nan, np.nan]
    cloth["effective_modulus_low_kpa"] = [np.nan, np.nan, 200.0, np.nan]
    cloth["effective_modulus_high_kpa"] = [np.nan, np.nan, 500.0, np.nan]
    cloth.to_csv(directory / "vague.csv", index=False)
    order = pd.DataFrame({"fabric": list(FABRICS), "rank": [1, 2, 3, 4]})
    order.to_csv(directory / "order.csv", index=False)
    rows = [(who, depth) for who in ("Ada", "Di", "Eve") for depth in (0.5, 1.0, 1.6)]
    plate = pd.DataFrame(rows, columns=["participant", MM])
    plate["force_n"] = (0.05 * np.exp(1.9 * plate[MM] + 0.2 * noise(len(plate), 5))).round(3)
    plate.to_csv(directory / "plate.csv", index=False)
    faults(directory)


def faults(directory):
    """Write tables that must be refused."""
    good = (directory / "exact.csv").read_text().splitlines()
    broken = {
        "no_rating.csv": [line.rpartition(",")[0] for line in good],
        "word.csv": [*good[:3], good[3].rpartition(",")[0] + ",soft", *good[4:]],
        "negative.csv": [*good[:5], good[5].rpartition(",")[0] + ",-3.5", *good[6:]],
        "unknown_fabric.csv": [*good[:4], good[4].replace("felt", "velvet"), *good[5:]],
        "no_load.csv": [",".join(part for k, part in enumerate(line.split(",")) if k != 2) for line in good],
        "empty.csv": [],
        "header.csv": good[:1],
    }
    for name, lines in broken.items():
        (directory / name).write_text("".join(f"{line}\n" for line in lines))


BRIEF = [*FIXED, "--seed", "3", "--accuracy", "0.01", "--max-steps", "300", "--processes", "1"]
EXACT = ["--data", "exact.csv", "--direction", "falls-with-firing"]
CHECKS = (
    ["check", "--data", "exact.csv"],
    ["check", "--data", "whole.csv"],
    ["check", "--data", "whole.csv", "--drop-zeros"],
    ["check", "--data", "slider.csv", "--ratings", "slider", "--slider", "0,100"],
    ["check", "--data", "likert.csv", "--ratings", "categories", "--categories", "7"],
    ["check", "--data", "ranks.csv", "--ratings", "ranks"],
    ["check", "--data", "pairs.csv", "--ratings", "pairs"],
    ["check", "--data", "scores.csv", "--ratings", "standardised"],
    ["check", "--data", "forces.csv", "--round-load", "0.5"],
    ["check", "--data", "cells.csv", "--ratings", "aggregated"],
    ["check", "--data", "wide.csv", "--indentation-mm", "1"],
    ["check", "--data", "german.csv", "--column", "rating=Urteil", "--column", "participant=Teilnehmer"],
    ["check", "--data", "missing.csv", "--fabrics", "vague.csv"],
    ["check", "--data", "exact.csv", "--compression", "plate.csv", "--readings", "hertz"],
    ["check", "--compression", "plate.csv"],
    ["check", "--fabrics", "vague.csv", "--reading", "fabric_modulus=plate"],
)
LISTS = (
    ["--help"],
    ["list", "readings"],
    ["list", "priors"],
    ["list", "figures"],
    ["list", "colours"],
    ["readings"],
    ["plan"],
)
SIMULATED = (
    ["simulate", "--fabrics", "fabrics.csv", "--indentation-mm", "1", "--participants", "3", "--fingers", "2",
     "--seed", "2", "--out", "simulated"],
    ["simulate", "--fabrics", "fabrics.csv", "--force-n", "0.5", "--force-n", "1.5", "--ratings", "slider",
     "--participants", "2", "--resolution", "0.05", "--set", "b=80", "--out", "sliders"],
    ["check", "--data", "simulated/ratings.csv", "--compression", "simulated/compression.csv"],
    ["predict", "--fabrics", "fabrics.csv", "--indentation-mm", "1", "--set", "b=80", "--accuracy", "0.01"],
    ["predict", "--fabrics", "fabrics.csv", "--force-n", "1", "--accuracy", "0.01", "--out", "predicted.csv"],
    ["sample", *EXACT, "--accuracy", "0.01", *FIXED, "--fix", "gamma=0.8", "--fix", "varsigma=0.3"],
)  # fmt: skip
ERRORS = (
    ["check", "--data", "no_rating.csv"],
    ["check", "--data", "word.csv"],
    ["check", "--data", "negative.csv"],
    ["check", "--data", "unknown_fabric.csv"],
    ["check", "--data", "no_load.csv"],
    ["check", "--data", "empty.csv"],
    ["check", "--data", "header.csv"],
    ["check", "--data", "nowhere.csv"],
    ["check"],
    ["check", "--data", "exact.csv", "--indentation-mm", "2"],
    ["check", "--data", "exact.csv", "--column", "rating=softness"],
    ["check", "--data", "exact.csv", "--ratings", "likert"],
    ["check", "--data", "exact.csv", "--ratings", "slider"],
    ["check", "--data", "exact.csv", "--ratings", "standardised"],
    ["check", "--data", "exact.csv", "--reading", "pressure=soft"],
    ["check", "--data", "slider.csv", "--ratings", "slider", "--slider", "0,50"],
    ["sample", "--data", "exact.csv", "--fix", "stiffness=2", "--out", "never"],
    ["sample", "--data", "exact.csv", "--fix", "b=-2", "--out", "never"],
    ["sample", "--data", "exact.csv", "--prior", "b=gaussian(1,2)", "--out", "never"],
    ["sample", "--data", "exact.csv", "--prior", "b=lognormal(100)", "--out", "never"],
    ["sample", "--data", "exact.csv", "--priors", "narrow", "--out", "never"],
    ["sample", "--data", "exact.csv", "--individual", "colour", "--out", "never"],
    ["sample", "--data", "slider.csv", "--ratings", "slider", "--slider", "0,100", "--load-cv", "0.1",
     "--out", "never"],
    ["sample", "--data", "exact.csv", "--load-cv", "0.1", "--errors", "student", "--out", "never"],
    ["sample", "--data", "exact.csv", "--finger", "nail=2", "--out", "never"],
    ["sample", "--data", "exact.csv", "--max-steps", "0", "--out", "never"],
    ["predict", "--fabrics", "fabrics.csv"],
    ["predict", "--fabrics", "fabrics.csv", "--indentation-mm", "1", "--posterior", "nowhere"],
    ["plot", "nowhere"],
    ["report", "nowhere"],
    ["rank", "nowhere"],
    ["target", "nowhere", "--rating", "3"],
    ["compare", "nowhere"],
    ["resume", "nowhere"],
    ["status", "nowhere"],
    ["simulate", "--fabrics", "fabrics.csv", "--indentation-mm", "1", "--set", "colour=2"],
    ["softness"],
)  # fmt: skip
COST = (["check", "--cost", *EXACT, "--accuracy", "0.01", *FIXED],)
RUN = (
    ["sample", *EXACT, *BRIEF, "--quick", "--no-figures", "--out", "out"],
    ["sample", *EXACT, *BRIEF, "--quick", "--out", "out"],
    ["status", "out"],
    ["plot", "out", "--format", "csv", "--out", "drawn"],
    ["plot", "out", "--figures", "corners"],
    ["report", "out", "--anonymous", "--title", "A first look", "--out", "page.html"],
    ["rank", "out", "--against", "order.csv"],
    ["target", "out", "--rating", "10", "--out", "target.csv"],
    ["target", "out", "--rating", "-10"],
    ["predict", "--fabrics", "fabrics.csv", "--indentation-mm", "1", "--posterior", "out", "--out", "touches.csv"],
    ["compare", "out", "out"],
    ["sample", *EXACT, *BRIEF, "--fix", "varsigma=0.5", "--quick", "--no-figures", "--out", "other"],
    ["compare", "out", "other"],
    ["sample", "--compression", "plate.csv", "--seed", "3", "--max-steps", "20", "--processes", "1", "--quick",
     "--no-figures", "--out", "skin"],
    ["report", "skin", "--out", "skin.html"],
)  # fmt: skip


def of_page(path):
    """Return the text of a report page, a line for each block, with numbers masked."""
    page = re.sub(r"(?s)<(script|style|svg)\b.*?</\1>", "", path.read_text(encoding="utf-8"))
    lines = re.sub(r"</(p|h\d|li|tr|caption|summary|title|div|dd|dt)>", "\n", page)
    text = masked(html.unescape(re.sub(r"(?s)<[^>]*>", " ", lines)))
    text = re.sub(r"Original command: .*", "Original command: that of the tests", text)
    return "".join(f"    {line.strip()}\n" for line in text.splitlines() if line.strip())


def of_result(directory):
    """Return the groups of a result, their variables and dimensions, and the names of the attributes."""
    tree = Result.load(directory).tree
    for node in tree.subtree:
        yield from (f"{node.path} has {name}" for name in sorted(node.attrs) if not name.startswith("version_"))
        for name, values in node.data_vars.items():
            yield f"{node.path}: {name} ({', '.join(map(str, values.dims))})"


def written(directory, before):
    """Return names of all new files; of tables, their columns and numbers of rows; of pages, their text."""
    found = ""
    for path in sorted(directory.rglob("*")):
        if not path.is_file() or path in before or path.parent.name == "checkpoint":
            continue
        before.add(path)
        found += f"wrote {path.relative_to(directory).as_posix()}\n"
        lines = of_table(pd.read_csv(path)) if path.suffix == ".csv" else ()
        lines = of_result(path.parent) if path.name == "posterior.nc" else lines
        found += "".join(f"    {line}\n" for line in lines)
        found += of_page(path) if path.suffix == ".html" else ""
    return found


def said(directory, commands, form: Form = verbatim):
    """Run commands one after another, and return all that they print, their exit codes and what they write."""
    before, found = {path for path in directory.rglob("*") if path.is_file()}, ""
    for command in commands:
        done = call(*command, cwd=directory)
        out, err = form(done.stdout), form(done.stderr.replace("\r", "\n"))
        found += f"$ softness-bayes {' '.join(command)}\n"
        found += "".join(f"  {line.rstrip()}\n" if line.strip() else "\n" for line in out.splitlines())
        # how often the progress is shown depends on the time
        lines = (line.rstrip() for line in err.splitlines() if line.strip() and not line.startswith("sampling: "))
        found += "".join(f"! {line}\n" for line in lines)
        found += f"exit code {done.returncode}\n{written(directory, before)}\n"
    return found.replace(str(directory), "DIRECTORY")


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A directory with all tables."""
    monkeypatch.setenv("COLUMNS", "80")
    tables(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("name", "commands"), [("check", CHECKS), ("list", LISTS), ("errors", ERRORS)])
def test_commands_print_what_is_stored(name, commands, desk):
    require(name, said(desk, commands))


def test_simulations_and_predictions_print_what_is_stored(desk):
    with quickly():
        require("simulate", said(desk, SIMULATED, rounded))


def test_a_first_look_and_what_follows_print_what_is_stored(desk, few_pictures):
    with quickly():
        require("cost", said(desk, COST, masked))
        require("run", said(desk, RUN, masked))


def test_a_changed_word_is_noticed(desk):
    """Negative control: a word that differs, and a column that is not written."""
    text = said(desk, CHECKS[:1])
    stored = (GOLDEN / "check.txt").read_text(encoding="utf-8")
    assert text in stored
    assert text.replace("ratings", "answers", 1) not in stored
