"""Mutated tables and command lines: nothing ends in a traceback, no file of anybody is touched.

The seeds are in `tests/fuzz`: tables, and in lines.txt command lines, that broke something once, with plain ones
beside them. Computing is stubbed: what is tried is all that comes before it.
"""

import shlex
from collections import Counter
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from softness_bayes import claims
from softness_bayes.base.errors import InputError
from softness_bayes.cli import VERBS, main, sample, trust
from softness_bayes.data import (
    Compression,
    Fabrics,
    Ratings,
    compression_csv,
    fabrics_csv,
    ratings_csv,
    read_experiment,
)
from softness_bayes.data.tables import SHOWN
from softness_bayes.model import build
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.report.explore import subject
from softness_bayes.results import fitted
from softness_bayes.runs import calibrate
from softness_bayes.touch import accuracy
from support.paths import DATA
from support.randomness import SEED

SEEDS = Path(__file__).with_name("fuzz")
TABLES = {path.name: path.read_bytes() for path in sorted(SEEDS.glob("*.csv"))}
LINES = [line for line in (SEEDS / "lines.txt").read_text().splitlines() if not line.startswith("#")]
SENTINELS = {"thesis.tex": b"\\documentclass{thesis}\n", ".git_config": b"[core]\n", "results.nc": b"\x89HDF\r\n"}
NASTY = (
    *("1,234", "0,82", "1.234", "1.234,5", "nan", "inf", "-inf", "1e308", "5e-324", "1e999999999", "9" * 400, "-0"),
    *("=1+1", "@x", "\x1b[31m", "\x00", "\u202e", "\u200b", "\u00a0", "e\u0301", "\x85", "\ud7ff", "1_0", "x" * 300),
    *(",", ";", "\t", '"', "'", "\n", "\r\n", "\r", "=", "--", "(", ")", "," * 3000, "100000000000000000000000"),
    *("b=80", "q=1", "varsigma=1e-8", "c_Na=1e308", "b=lognormal(80,0.3,1e-300)", "m=uniform(0,1e308)"),
    *("b=normal(1,1)", "pressure=hertz", "rating=fabric", "\U0001f9f5"),
    *("ratings.csv", "fabrics.csv", "forces.csv", "thesis.tex", "results", "new", ".", ""),
)
REFUSED = {"empty.csv", "extremes.csv", "never_closed.csv", "saved_again.csv", "utf16_escape.csv"}
"""Seeds that are no good tables, of which mutations need not make one."""
READERS = ("ratings", "fabrics", "forces", "experiment")


# tables


def mutated(content: bytes, random: np.random.Generator) -> bytes:
    """Change bytes, spans or lines of a table, or its encoding."""
    for _ in range(random.integers(1, 3)):
        at = int(random.integers(0, len(content) + 1))
        end = at + int(random.geometric(0.1))
        match random.integers(0, 8):
            case 0:
                content = content[:at] + bytes([random.integers(0, 256)]) + content[at + 1 :]
            case 1:
                content = content[:at] + content[end:]
            case 2:
                content = content[:end] + content[at:end] + content[end:]
            case 3 | 4:
                content = content[:at] + str(random.choice(NASTY)).encode() + content[at:]
            case 5:
                content = b"\n".join(random.permutation(np.array(content.split(b"\n"), dtype=object)))
            case 6:
                content = content.replace(*random.choice([b",", b";", b"\t", b".", b'"'], 2))
            case 7:
                encoding = str(random.choice(["utf-16", "utf-8-sig", "latin-1"]))
                content = content.decode("utf-8", "replace").encode(encoding, "replace")
    return content


def kept(ratings):
    """What a table of ratings says, whatever its order."""
    cells = ratings.cells
    spread = [None] * len(ratings) if cells is None or cells.geometric_sd is None else cells.geometric_sd.tolist()
    table = zip(ratings.participant, ratings.fabric, ratings.load, ratings.rating, spread, strict=True)
    told = [
        (ratings.participants[p], ratings.fabrics[f], str(ratings.loads[k]), y.hex(), f"{s}") for p, f, k, y, s in table
    ]
    return [cells and cells.raters, *sorted(told)]


def reader_of(name: str, random: np.random.Generator) -> str:
    """The reader that a seed is meant for, mostly."""
    if random.random() < 0.2:
        return str(random.choice(READERS))
    meant = next((reader for reader in ("fabrics", "forces") if reader in name), "ratings")
    return "experiment" if name == "ratings_with_fabrics.csv" else meant


def read(path: Path, reader: str, random: np.random.Generator) -> None:
    """Read a table; one that is accepted must read back, when written here, to the same numbers."""
    decimal = [None, None, ",", "."][random.integers(0, 4)]
    columns = {str(random.choice(["rating", "fabric", "junk"])): "rating"} if random.random() < 0.1 else {}
    again = path.with_name("written.csv")
    match reader:
        case "ratings":
            held = {"force_n": 1.0} if random.random() < 0.2 else {}
            found = Ratings.read(path, columns=columns, decimal=decimal, **held)
            again.write_text(ratings_csv(found), encoding="utf-8", newline="")
            assert kept(Ratings.read(again)) == kept(found)
        case "fabrics":
            cloth = Fabrics.read(path, columns=columns, decimal=decimal)
            again.write_text(fabrics_csv(cloth), encoding="utf-8", newline="")
            assert Fabrics.read(again).names == cloth.names
            assert Fabrics.read(again).cells() == cloth.cells()
        case "forces":
            forces = Compression.read(path, columns=columns, decimal=decimal)
            again.write_text(compression_csv(forces), encoding="utf-8", newline="")
            for name in ("participants", "indentation", "force"):
                np.testing.assert_array_equal(getattr(Compression.read(again), name), getattr(forces, name))
        case "experiment":
            experiment = read_experiment(path, columns=columns, decimal=decimal)
            again.write_text(ratings_csv(experiment.ratings, experiment.fabrics), encoding="utf-8", newline="")
            back = read_experiment(again)
            assert kept(back.ratings) == kept(experiment.ratings)
            assert dict(zip(back.fabrics.names, back.fabrics.basis, strict=True)) == dict(
                zip(experiment.fabrics.names, experiment.fabrics.basis, strict=True)
            )


def fuzz_tables(folder: Path, random: np.random.Generator, cases: int) -> Counter[str]:
    """Read mutated tables; return how many of those that differ from their seed were accepted, by seed."""
    accepted: Counter[str] = Counter()
    longest, names = 0, list(TABLES)
    path = folder / "table.csv"
    for case in range(cases):
        name = names[case % len(names)]
        content = TABLES[name]
        path.write_bytes(mutated(content, random) if case >= len(names) else content)
        try:
            read(path, reader_of(name, random), random)
            accepted[name] += path.read_bytes() != content
        except InputError as refusal:
            lines = str(refusal).splitlines()
            assert len(lines) <= 1 + SHOWN
            longest = max(longest, *(len(line) - 3 * len(str(folder)) for line in lines))
        except Exception:  # pragma: no cover - what the test is there to find
            path.with_name("broke.csv").write_bytes(path.read_bytes())
            raise
    assert longest < 1500
    return accepted


# command lines


def options_of(verb: str) -> list[str]:
    command = main.get_command(click.Context(main), verb)
    assert command is not None
    return [name for p in command.params for name in p.opts if isinstance(p, click.Option)]


FLAGS = {verb: options_of(verb) for verb in VERBS}


def nasty(random: np.random.Generator) -> str:
    """A value: one that broke something, or a parameter at a random size."""
    if random.random() < 0.3:
        name = str(random.choice(list(EVERY_PARAMETER)))
        return f"{name}={10.0 ** random.uniform(-12, 12):.3g}"
    return str(random.choice(NASTY))


def mutated_line(line: str, random: np.random.Generator) -> list[str]:
    """Change, drop, double or add words of a command line; paths stay within the folder."""
    words = shlex.split(line)
    for _ in range(random.integers(1, 4)):
        at = int(random.integers(1, len(words) + 1))
        match random.integers(0, 5):
            case 0 | 1:
                words[at:at] = [str(random.choice(FLAGS.get(words[0]) or ["--out"])), nasty(random)]
            case 2:
                words[at : at + 1] = [nasty(random)]
            case 3:
                del words[at : at + 1]
            case 4:
                words[at:at] = words[at : at + 2]
    return [word.replace("/", "").replace("\x00", "") for word in words]


@pytest.fixture
def stubbed(monkeypatch):
    """No verb computes: each stops where it would begin to."""

    def stop(*_arguments, **_options):
        raise click.exceptions.Exit(0)

    for module, name in (
        (build, "build"),
        (build, "evidence_of"),
        (fitted, "build"),
        (accuracy, "choose"),
        (claims, "evaluate_claims"),
        (calibrate, "calibrate"),
        (trust, "_speed_and_error"),
        (sample, "_run"),
        (subject, "of_priors"),
        (subject, "of_run"),
    ):
        monkeypatch.setattr(module, name, stop)


def fuzz_lines(folder: Path, random: np.random.Generator, cases: int) -> set[int]:
    """Run mutated command lines in a folder of sentinels; return the exit codes seen."""
    sentinels = {**TABLES, **SENTINELS}
    for name, content in sentinels.items():
        (folder / name).write_bytes(content)
    (folder / "results").mkdir()
    (folder / "results" / "posterior.nc").write_bytes(b"of another program")
    runner, seen = CliRunner(), set()
    for case in range(cases):
        line = LINES[case % len(LINES)]
        words = mutated_line(line, random) if case >= len(LINES) else shlex.split(line)
        done = runner.invoke(main, words)
        assert done.exception is None or isinstance(done.exception, SystemExit), (words, done.exc_info)
        assert done.exit_code in (0, 2, 3, 4, 5), (words, done.output)
        assert "\x1b" not in done.output, words
        seen.add(done.exit_code)
        for name, content in sentinels.items():
            assert (folder / name).read_bytes() == content, (words, name)
        assert (folder / "results" / "posterior.nc").read_bytes() == b"of another program", words
    return seen


def test_mutated_tables_are_read_or_refused(tmp_path):
    accepted = fuzz_tables(tmp_path, np.random.default_rng([SEED, 1]), 2000)
    # a fifth to a sixth are read: with more, mutations would be too tame to break a reader, or it would refuse too
    # little; with fewer, or none of a seed that is a good table, nothing would be read back
    assert 200 < accepted.total() < 500
    assert {name for name in TABLES if not accepted[name]} <= REFUSED


def test_mutated_command_lines_end_well_and_touch_no_file(tmp_path, stubbed, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert {0, 2} <= fuzz_lines(tmp_path, np.random.default_rng([SEED, 2]), 200)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_ten_thousand_cases_end_well(tmp_path, stubbed, monkeypatch, part):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lines").mkdir()
    fuzz_tables(tmp_path, np.random.default_rng([SEED, 3, part]), 6000)
    monkeypatch.chdir(tmp_path / "lines")
    fuzz_lines(tmp_path / "lines", np.random.default_rng([SEED, 4, part]), 2000)


# values of parameters, computed

NUMBERS = (
    *("nan", "inf", "-inf", "1e308", "5e-324", "-1", "0", "-0", "1e-300", "1e999", "", "=", "b=1", "0x10", "1_0"),
    *("1,5", "１２", "٣", "--", "\u202e5", "9" * 400, " 3 ", "+4", "true", "1e-12", "1e12", "1e100", "1e-100"),
)
NAMES = (*EVERY_PARAMETER, "q", "B", "b ", "σ", "c_na", "", ",", ";", "load")
CHECK = ("check", "--data", str(DATA / "ratings.csv"))
PREDICT = ("predict", "--fabrics", str(DATA / "fabrics.csv"), "--accuracy", "0.01", "--force-n", "1")
COMPUTED = {"--set": (PREDICT,), "--fix": (CHECK, (*CHECK, "--cost", "--accuracy", "0.01"))}


def value(random: np.random.Generator) -> str:
    """One that broke something, or a number of any size."""
    if random.random() < 0.4:
        return str(random.choice(NUMBERS))
    return repr(float(10.0 ** random.uniform(*[(-12, 12), (-1, 2.5)][random.integers(2)])))


@pytest.mark.parametrize("cases", [12, pytest.param(400, marks=pytest.mark.slow)])
def test_values_of_parameters_give_numbers_or_a_message(cases):
    random, runner, codes = np.random.default_rng([SEED, 21]), CliRunner(), set()
    for _ in range(cases):
        option = str(random.choice([*COMPUTED]))
        verb = COMPUTED[option][random.integers(len(COMPUTED[option]))]
        given = [f"{random.choice(NAMES)}={value(random)}" for _ in range(random.integers(1, 5))]
        given += given[:1] if random.random() < 0.1 else []
        line = [*verb, *(word for each in given for word in (option, each))]
        said = runner.invoke(main, line)
        codes.add(said.exit_code)
        assert said.exit_code in (0, 2, 4), (line, said.output, said.exception)  # done, refused, or no numbers
        assert said.exception is None or isinstance(said.exception, SystemExit), (line, said.exception)
        if said.exit_code:
            assert said.output.strip(), line
        elif line[0] == "predict":
            assert not {"nan", "inf", "-inf"} & set(said.output.lower().replace("|", " ").split()), line
    assert 2 in codes
