"""Bad input of every kind: exit code 2, one message that names the place, no traceback, and no file touched.

`KINDS` are tried here, each by a command in a folder that holds somebody's results. `ELSEWHERE` names kinds that need
more (a process of their own, a full disk, a run under way) and the tests that try them.
"""

import ast
import errno
import os
import stat
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import h5py
import pytest

from softness_bayes.data import delimited
from softness_bayes.results import result_file
from support.command_line import call
from support.paths import ROOT
from support.small_result import small_result

RATINGS = "participant,fabric,indentation_mm,rating\nP1,voile,1,5.5\nP1,denim,1,8\nP2,voile,1,3\nP2,denim,1,7\n"
FABRICS = "fabric,tensile_modulus_mpa,thickness_mm\nvoile,3.2,0.22\ndenim,33,0.68\n"
FORCES = "participant,indentation_mm,force_n\nP1,1,0.5\nP1,2,1.5\n"
CHECK = ("check", "--data", "ratings.csv")
SAMPLE = ("sample", *CHECK[1:], "--max-steps", "5", "--no-figures", "--out", "new")

Make = Callable[[Path], object]


@dataclass(frozen=True)
class Kind:
    """One kind of bad input: how it is made, the command that meets it, and words that its message must have."""

    name: str
    make: Make
    words: tuple[str, ...]
    typed: tuple[str, ...] = CHECK


def text(content: str | bytes, name: str = "ratings.csv") -> Make:
    """A file of some content in the place of another."""
    return lambda folder: (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)


def cell(old: str, new: str, name: str = "ratings.csv") -> Make:
    """One change in a table."""
    table = {"ratings.csv": RATINGS, "fabrics.csv": FABRICS, "forces.csv": FORCES}[name]
    assert old in table
    return text(table.replace(old, new, 1), name)


def nothing(folder: Path) -> None:
    """The fault is in the command."""


def in_place_of(name: str, make: Callable[[Path], object]) -> Make:
    def made(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        make(folder / name)

    return made


def result(change: Callable[[Path], object]) -> Make:
    """A result in a folder `old`, changed."""

    def made(folder: Path) -> None:
        small_result().save(folder / "old")
        change(folder / "old" / "posterior.nc")

    return made


def of_a_later_version(path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(result_file, "SCHEMA", 99)
        small_result().save(path.parent)


def rewritten(change: Callable[[h5py.File], object]) -> Callable[[Path], None]:
    def made(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            change(file)

    return made


def damaged(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)


def looped(path: Path) -> None:
    path.symlink_to(path)


REPORT = ("report", "old")
COMPRESSION = ("check", "--compression", "forces.csv")
WHERE = "ratings.csv: row 2, column 'rating'"
DEPTH = "ratings.csv: row 2, column 'indentation_mm': expected a number from 1e-06 to 8"
CLOTH = "fabrics.csv: row 2, column"

KINDS = (
    # files
    Kind("no such file", in_place_of("ratings.csv", lambda path: None), ("ratings.csv", "No such file")),
    Kind("a directory where a table belongs", in_place_of("ratings.csv", Path.mkdir), ("ratings.csv", "directory")),
    Kind(
        "a table in a folder that is not there",
        nothing,
        ("none/a.csv", "No such file"),
        ("check", "--data", "none/a.csv"),
    ),
    Kind(
        "a link that leads nowhere", in_place_of("ratings.csv", lambda p: p.symlink_to("x")), ("ratings.csv", "No such")
    ),
    Kind("a link to itself", in_place_of("ratings.csv", looped), ("ratings.csv", "symbolic links")),
    Kind(
        "a pipe without data",
        in_place_of("ratings.csv", os.mkfifo),
        ("ratings.csv: is a pipe without data",),
    ),
    Kind(
        "a huge file",
        lambda folder: os.truncate(folder / "ratings.csv", 2**30),
        ("ratings.csv: is larger than 256 MB",),
    ),
    Kind("a device without end", nothing, ("/dev/zero: is larger than 256 MB",), ("check", "--data", "/dev/zero")),
    Kind("an empty device", nothing, ("/dev/null", "empty"), ("check", "--data", "/dev/null")),
    Kind("an empty file", text(""), ("ratings.csv", "the file is empty, expected a header")),
    Kind("blank lines alone", text("\n \n"), ("ratings.csv", "the file is empty")),
    Kind("a byte-order mark alone", text("\ufeff"), ("ratings.csv", "the file is empty")),
    Kind("a header alone", text(RATINGS.splitlines()[0]), ("ratings.csv", "no row below the header")),
    Kind("NUL bytes", text(RATINGS.replace("5.5", "5\0").encode()), ("ratings.csv", "not a text file")),
    Kind("random bytes", text(bytes(range(256))), ("ratings.csv", "not a text file")),
    Kind("an escape sequence", cell("P1", "P\x1b[31m"), ("ratings.csv", "control character")),
    Kind("UTF-16 cut in a letter", text(RATINGS.encode("utf-16")[:-1]), ("ratings.csv", "UTF-16")),
    Kind(
        "UTF-16 without a mark", text(RATINGS.encode("utf-16-le")), ("ratings.csv", "UTF-16 without a byte-order mark")
    ),
    Kind(
        "Shift-JIS",
        text("参加者,布,押し込み量 [mm],評価\nA,生地,1,5\n".encode("shift-jis")),
        ("ratings.csv", "Shift-JIS"),
    ),
    Kind(
        "a workbook by the name of a text file",
        text(b"PK\x03\x04\0\0"),
        ("ratings.csv", "give it a name that ends in .xlsx"),
    ),
    Kind("a Parquet file by that name", text(b"PAR1\0"), ("ratings.csv", "this is a Parquet file")),
    Kind("an old workbook", text(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0"), ("ratings.csv", "save it as .xlsx")),
    Kind("a damaged workbook", text(b"PK\x03\x04\0\0", "a.xlsx"), ("a.xlsx",), ("check", "--data", "a.xlsx")),
    Kind("a damaged Parquet file", text(b"PAR1", "a.parquet"), ("a.parquet",), ("check", "--data", "a.parquet")),
    Kind("a quotation mark that is never closed", cell("P2,voile", '"P2,voile'), ("ratings.csv", "quotation mark")),
    Kind("a title above the header", text("Study 1\n" + RATINGS), ("ratings.csv", "is 'Study 1' a title")),
    Kind("bars between cells", text(RATINGS.replace(",", "|")), ("ratings.csv", "unused columns: participant|fabric")),
    Kind(
        "two columns of one name",
        text(RATINGS.replace("participant", "rating")),
        ("row 1", "2 columns are called 'rating'"),
    ),
    Kind("a row that is too long", cell("5.5", "5.5,9"), ("ratings.csv: row 2", "'9' is beyond the 4 columns")),
    Kind("a cell of a million letters", cell("5.5", "x" * 10**6), ("ratings.csv", "row 2")),
    Kind(
        "a row of ten thousand cells", cell("5.5", "5" + ",1" * 10**4), ("ratings.csv: row 2", "beyond the 4 columns")
    ),
    Kind("a path longer than a name may be", nothing, ("File name too long",), ("check", "--data", "a" * 300)),
    Kind(
        "a path with spaces and other scripts",
        text(RATINGS.replace("5.5", "fünf"), "meine Daten 柔 .csv"),
        ("meine Daten 柔 .csv: row 2, column 'rating'", "'fünf'"),
        ("check", "--data", "meine Daten 柔 .csv", "--fabrics", "fabrics.csv"),
    ),
    # values of ratings
    Kind("a word for a rating", cell("5.5", "five"), (WHERE, "expected a finite number, got 'five'")),
    Kind("an infinite rating", cell("5.5", "inf"), (WHERE, "expected a finite number, got 'inf'")),
    Kind("a rating beyond floating point", cell("5.5", "1e999"), (WHERE, "expected a finite number, got '1e999'")),
    Kind("an underlined number", cell("5.5", "1_0"), (WHERE, "got '1_0'")),
    Kind("a number in other digits", cell("5.5", "٣"), (WHERE, "got '٣'")),
    Kind("a formula for a rating", cell("5.5", "=1+1"), (WHERE, "got '=1+1'")),
    Kind("HTML for a rating", cell("5.5", "<b>5</b>"), (WHERE, "got '<b>5</b>'")),
    Kind(
        "a date for a rating",
        cell("5.5", "2026-11-23"),
        (WHERE, "did a spreadsheet program turn a number into a date?"),
    ),
    Kind("a decimal comma between commas", cell("5.5", '"5,5"'), (WHERE, "--decimal ,")),
    Kind(
        "a number of two meanings",
        text(RATINGS.replace(",", ";").replace("5.5", "1,234")),
        ("'1,234' may be 1.234 or 1234", "--decimal"),
    ),
    Kind("a negative rating", cell("5.5", "-5.5"), (WHERE, "0 or above, got '-5.5'"), SAMPLE),
    Kind(
        "a code for a missing rating",
        text(RATINGS + "".join(f"P{k},voile,1,{k}\n" for k in range(3, 20)) + "P3,denim,1,999\n"),
        ("999 looks like a code for a missing rating",),
    ),
    Kind(
        "no rating in any row",
        text(RATINGS.replace("5.5", "").replace(",8", ",NA").replace(",3", ",-").replace(",7", ",.")),
        ("there is no rating in any row",),
    ),
    Kind(
        "ratings of 0 alone",
        text("participant,fabric,indentation_mm,rating\nP1,voile,1,0\nP1,denim,1,0\n"),
        ("expected ratings above 0, got none",),
        SAMPLE,
    ),
    Kind(
        "no name of a participant",
        cell("P1", " "),
        ("ratings.csv: row 2, column 'participant'", "expected a name, got ''"),
    ),
    Kind("no name of a fabric", cell("voile", ""), ("ratings.csv: row 2, column 'fabric'", "expected a name, got ''")),
    Kind(
        "an unknown fabric",
        cell("voile", "viole"),
        ("row 2, column 'fabric': 'viole' is not a fabric of", "did you mean 'voile'?"),
    ),
    Kind(
        "a fabric whose name is HTML",
        cell("voile", "<script>alert(1)</script>"),
        ("row 2, column 'fabric': '<script>alert(1)</script>' is not",),
    ),
    Kind(
        "a fabric whose name is a formula",
        cell("voile", "=HYPERLINK(1)"),
        ("row 2, column 'fabric': '=HYPERLINK(1)' is not",),
    ),
    Kind("a fabric whose name is not seen", cell("voile", "voile\u200b"), ("row 2, column 'fabric'", "\\u200b")),
    Kind(
        "no load", cell("voile,1", "voile,"), ("ratings.csv: row 2, column 'indentation_mm': expected a load, got ''",)
    ),
    Kind("a load of 0", cell("voile,1", "voile,0"), (DEPTH, "got '0'")),
    Kind("a negative load", cell("voile,1", "voile,-1"), (DEPTH, "got '-1'")),
    Kind("an indentation beyond the fingertip", cell("voile,1", "voile,1000"), (DEPTH, "got '1000'")),
    Kind(
        "a force that no finger bears",
        text(RATINGS.replace("indentation_mm", "force_n").replace(",1,5.5", ",2000,5.5")),
        ("row 2, column 'force_n': expected a number from 1e-09 to 100", "got '2000'"),
    ),
    Kind(
        "two loads in a row",
        text("participant,fabric,indentation_mm,force_n,rating\nP1,voile,1,1,5\nP1,denim,1,,6\n"),
        ("row 2, column 'force_n': expected one load",),
    ),
    Kind(
        "a relative error of a load of 9",
        text("fabric,force_n,load_cv,rating\nvoile,1,9,5\ndenim,1,0.1,5\n"),
        ("row 2, column 'load_cv'", "got '9'"),
    ),
    Kind(
        "a negative resolution",
        text("fabric,force_n,resolution,rating\nvoile,1,-1,5\ndenim,1,1,5\n"),
        ("row 2, column 'resolution'", "got '-1'"),
    ),
    # columns and units
    Kind(
        "no column of ratings",
        text(RATINGS.replace("rating", "feel")),
        ("no column 'rating', and no --column rating=...", "feel"),
    ),
    Kind("no column of fabrics", text(RATINGS.replace("fabric", "thing")), ("no column 'fabric'", "thing")),
    Kind(
        "no column of loads",
        text(RATINGS.replace("indentation_mm", "x")),
        ("no load column", "--indentation-mm", "--force-n"),
    ),
    Kind(
        "columns that may each be the rating",
        text(RATINGS.replace("participant,fabric", "softness,fabric").replace("rating", "score")),
        ("may each be 'rating'", "--column rating='score'"),
    ),
    Kind(
        "a unit of another quantity",
        text(RATINGS.replace("indentation_mm", "depth [kPa]")),
        ("depth [kPa]", "indentation_mm"),
    ),
    Kind(
        "a name of a column that is none",
        nothing,
        ("no column is called 'ratng' here", "did you mean 'rating'?"),
        (*CHECK, "--column", "ratng=rating"),
    ),
    Kind(
        "a column that the file has not",
        nothing,
        ("there is no column 'softness' in",),
        (*CHECK, "--column", "rating=softness"),
    ),
    Kind("a load beside a column of loads", nothing, ("tables without a load column",), (*CHECK, "--force-n", "1")),
    Kind(
        "a long table that is called wide",
        nothing,
        ("--wide expects a table with one column per fabric",),
        (*CHECK, "--wide"),
    ),
    Kind(
        "a wide table with a misspelt fabric",
        text("participant,voile,demin\nP1,1,2\n"),
        ("column 'demin'", "did you mean 'denim'?"),
        (*CHECK, "--wide", "--force-n", "1"),
    ),
    Kind(
        "pairs that are called magnitudes",
        text("participant,fabric,fabric_2,force_n,rating\nP1,voile,denim,1,1\n"),
        ("fabric_2", "--ratings pairs"),
        SAMPLE,
    ),
    # fabrics
    Kind(
        "fabrics without properties",
        in_place_of("fabrics.csv", lambda path: None),
        ("ratings.csv", "the fabrics have no properties", "--fabrics"),
    ),
    Kind(
        "a fabric without a modulus",
        cell("33,0.68", "33,", "fabrics.csv"),
        ("fabrics.csv: row 3, fabric 'denim': expected effective_modulus_kpa",),
    ),
    Kind(
        "a fabric in two rows",
        cell("denim", "voile", "fabrics.csv"),
        ("fabrics.csv", "row 3, column 'fabric': 'voile' is already in row 2"),
    ),
    Kind(
        "a modulus of 0",
        cell("3.2", "0", "fabrics.csv"),
        (f"{CLOTH} 'tensile_modulus_mpa': expected a finite number above 0, got '0'",),
    ),
    Kind(
        "a negative thickness",
        cell("0.22", "-0.22", "fabrics.csv"),
        (f"{CLOTH} 'thickness_mm': expected a finite number above 0, got '-0.22'",),
    ),
    Kind("a word for a thickness", cell("0.22", "thin", "fabrics.csv"), (f"{CLOTH} 'thickness_mm'", "got 'thin'")),
    Kind(
        "a modulus with which nothing can be computed",
        text("fabric,effective_modulus_kpa\nvoile,1e-300\ndenim,5\n", "fabrics.csv"),
        ("fabrics.csv", "row 2"),
    ),
    Kind(
        "a Poisson ratio of no stable solid",
        text(
            "fabric,tensile_modulus_mpa,thickness_mm,poisson_ratio\nvoile,3,0.2,0.6\ndenim,3,0.2,0.2\n", "fabrics.csv"
        ),
        (f"{CLOTH} 'poisson_ratio'", "at most 0.5, got '0.6'"),
    ),
    Kind(
        "a relative error of 900 %",
        text("fabric,effective_modulus_kpa,effective_modulus_cv\nvoile,3,9\ndenim,5,0.1\n", "fabrics.csv"),
        (f"{CLOTH} 'effective_modulus_cv': expected a number from 0 to 3, got '9'",),
    ),
    Kind(
        "a bracket upside down",
        text("fabric,effective_modulus_low_kpa,effective_modulus_high_kpa\nvoile,9,1\ndenim,1,2\n", "fabrics.csv"),
        ("fabrics.csv", "row 2"),
    ),
    Kind(
        "fabrics that contradict in the ratings",
        text("fabric,force_n,rating,effective_modulus_kpa\nvoile,1,5,3\nvoile,1,6,4\n"),
        ("row 3, column 'effective_modulus_kpa': 'voile' has '4' here and '3' in row 2",),
    ),
    # forces of a plate
    Kind(
        "a negative force of a plate",
        cell("0.5", "-0.5", "forces.csv"),
        ("forces.csv: row 2, column 'force_n'", "got '-0.5'"),
        COMPRESSION,
    ),
    Kind(
        "forces without indentations",
        text("participant,force_n\nP1,1\n", "forces.csv"),
        ("forces.csv", "no column 'indentation_mm'"),
        COMPRESSION,
    ),
    # flags
    Kind("an unknown verb", nothing, ("No such command 'chek'", "check"), ("chek",)),
    Kind("an unknown option", nothing, ("No such option", "--dta"), ("check", "--dta", "ratings.csv")),
    Kind("an option without a value", nothing, ("--data",), ("check", "--data")),
    Kind("a stray word", nothing, ("unexpected extra argument", "x" * 99), (*SAMPLE, "x" * 300)),
    Kind("no table at all", nothing, ("--data",), ("sample", "--out", "new")),
    Kind("a decimal mark that is none", nothing, ("--decimal", "x"), (*CHECK, "--decimal", "x")),
    Kind("steps that are no number", nothing, ("--max-steps", "many"), (*SAMPLE, "--max-steps", "many")),
    Kind("no steps", nothing, ("--max-steps", "0"), (*SAMPLE, "--max-steps", "0")),
    Kind("no processes", nothing, ("--processes", "0"), (*SAMPLE, "--processes", "0")),
    Kind("a seed that is no number", nothing, ("--seed", "x"), (*SAMPLE, "--seed", "x")),
    Kind("an unknown parameter", nothing, ("no parameter 'bee'",), (*SAMPLE, "--fix", "bee=1")),
    Kind("a parameter out of range", nothing, ("b is 0.0, expected a number from",), (*SAMPLE, "--fix", "b=0")),
    Kind(
        "a parameter both held and free",
        nothing,
        ("b is both fixed and given a prior",),
        (*SAMPLE, "--fix", "b=80", "--prior", "b=lognormal(80,0.5)"),
    ),
    Kind("an unknown law", nothing, ("cauchy",), (*SAMPLE, "--prior", "b=cauchy(1)")),
    Kind("a law with a wrong number of arguments", nothing, ("lognormal",), (*SAMPLE, "--prior", "b=lognormal(1)")),
    Kind("a prior that allows what cannot be", nothing, ("b", "negative"), (*SAMPLE, "--prior", "b=normal(100,10)")),
    Kind(
        "an unknown reading",
        nothing,
        ("pressure has no 'round'; expected one of",),
        (*SAMPLE, "--reading", "pressure=round"),
    ),
    Kind("an unknown place of a reading", nothing, ("no place 'stress'",), (*SAMPLE, "--reading", "stress=flat")),
    Kind("an unknown scale of ratings", nothing, ("--ratings", "likert"), (*SAMPLE, "--ratings", "likert")),
    Kind(
        "magnitudes that are called z-scores",
        text(RATINGS.replace("8", "800")),
        ("expected standardised ratings, of mean 0",),
        (*SAMPLE, "--ratings", "standardised"),
    ),
    Kind(
        "a place beyond a slider",
        nothing,
        ("row 2, column 'rating': expected a place on a slider from 0 to 1",),
        (*SAMPLE, "--ratings", "slider"),
    ),
    Kind(
        "a category that is no whole number",
        nothing,
        ("row 2, column 'rating': expected the number of a category",),
        (*SAMPLE, "--ratings", "categories"),
    ),
    Kind("a slider upside down", nothing, ("--slider", "expected the lower end first"), (*SAMPLE, "--slider", "1,0")),
    Kind("a load given twice", nothing, ("--indentation-mm", "--force-n"), ("predict", "--fabrics", "fabrics.csv")),
    Kind(
        "a module that is not there", nothing, ("nosuchmodule",), (*SAMPLE, "--reading", "pressure=nosuchmodule:MILD")
    ),
    # results
    Kind("a result that is not there", nothing, ("nowhere",), ("report", "nowhere")),
    Kind("a folder without a result", lambda folder: (folder / "bare").mkdir(), ("bare",), ("report", "bare")),
    Kind("a result of another program", nothing, ("results/posterior.nc",), ("report", "results")),
    Kind(
        "a result of a later version",
        result(of_a_later_version),
        ("posterior.nc", "99"),
        REPORT,
    ),
    Kind(
        "a result without its version",
        result(rewritten(lambda file: file.attrs.__delitem__("schema_version"))),
        ("posterior.nc",),
        REPORT,
    ),
    Kind(
        "a truncated result", result(lambda path: path.write_bytes(path.read_bytes()[:999])), ("posterior.nc",), REPORT
    ),
    Kind("a result with a damaged byte", result(damaged), ("posterior.nc",), REPORT),
    Kind(
        "a result without a group",
        result(rewritten(lambda file: file.__delitem__("posterior"))),
        ("posterior.nc",),
        REPORT,
    ),
    Kind("an empty result", result(lambda path: path.write_bytes(b"")), ("posterior.nc",), REPORT),
    Kind(
        "a figure that there is not",
        result(lambda path: None),
        ("ratng", "rating"),
        ("plot", "old", "--figures", "ratng"),
    ),
    Kind(
        "results without a name",
        nothing,
        ("posterior.nc: no such file; expected the posterior.nc of a run",),
        ("compare", ""),
    ),
    Kind("a run that was never begun", nothing, ("nowhere",), ("resume", "nowhere")),
    # places to write to
    Kind(
        "results of somebody in the way",
        nothing,
        ("results: is not empty; choose another --out, or --force",),
        (*SAMPLE[:-1], "results"),
    ),
    Kind("a file where a folder is to be", nothing, ("notes.txt",), (*SAMPLE[:-1], "notes.txt")),
    Kind("a folder below a file", nothing, ("notes.txt",), (*SAMPLE[:-1], "notes.txt/new")),
    Kind("a folder that cannot be made", nothing, ("/proc/none",), (*SAMPLE[:-1], "/proc/none/new")),
    Kind(
        "a folder where a file is to be",
        nothing,
        ("results",),
        ("predict", "--fabrics", "fabrics.csv", "--force-n", "1", "--out", "results"),
    ),
    Kind("a place that is not ours, with --force", nothing, ("results",), (*SAMPLE[:-1], "results", "--force")),
)

ELSEWHERE = {
    "a path with a NUL": "data/test_decimals.py::test_paths_that_cannot_be_read_are_refused",
    "a table that may not be read": "cli/test_bad_input.py::test_what_may_not_be_read_or_written_is_named",
    "a folder that may not be written to": "cli/test_bad_input.py::test_what_may_not_be_read_or_written_is_named",
    "a full disk, of a run": "cli/test_cli_runs.py::test_a_full_disk_says_how_to_go_on",
    "a full disk, of tables": "files/test_outputs.py::test_simulate_on_a_full_disk_keeps_the_old_files",
    "a limit on the size of files": "files/test_outputs.py::test_a_limit_on_files_keeps_the_old_ones",
    "a full standard output": "cli/test_interrupts.py::test_a_full_output_is_told",
    "a run that another process holds": "cli/test_cli_runs.py::test_a_run_in_use_is_refused_with_5",
    "a run whose data have changed": "cli/test_cli_runs.py::test_what_changed_is_named",
    "a damaged checkpoint": "checkpoints/test_checkpoint.py::test_a_damaged_checkpoint_is_refused",
    "a result that was edited": "results/test_integrity.py::test_a_change_is_refused_and_can_be_accepted",
    "a file changed since it was written": "files/test_outputs.py::test_force_replaces_a_run_and_what_belongs_to_it",
    "an input that is also the output": "files/test_outputs.py::test_no_verb_replaces_its_own_input",
    "many problems at once": "data/test_faults.py::test_the_first_twenty_are_shown_and_all_are_counted",
    "a table without the engine that reads it": "data/test_workbooks.py::test_without_the_engine_the_remedy_is_named",
}
"""Kind of bad input -> the test that tries it, as `file::name` below `tests`."""


def snapshot(folder: Path) -> dict[str, object]:
    """Everything below a folder: content, what a link points to, of others their kind and size."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        if stat.S_ISLNK(mode):
            found[str(path)] = os.readlink(path)
        else:
            size = path.lstat().st_size
            found[str(path)] = path.read_bytes() if stat.S_ISREG(mode) and size < 10**7 else (stat.S_IFMT(mode), size)
    return found


def desk(folder: Path) -> Path:
    """A folder with tables, somebody's notes, and somebody's results."""
    for name, table in (("ratings.csv", RATINGS), ("fabrics.csv", FABRICS), ("forces.csv", FORCES)):
        (folder / name).write_text(table)
    (folder / "notes.txt").write_text("mine")
    (folder / "results").mkdir()
    (folder / "results" / "posterior.nc").write_bytes(b"of another program")
    return folder


def require_refusal(done, *words: str) -> None:
    """Exit code 2, one error with these words, no traceback."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert sum(line.lower().startswith("error:") for line in done.stderr.splitlines()) == 1, done.stderr
    for word in words:
        assert word in done.stderr, done.stderr
    # a screen's worth, whatever the input is
    assert len(done.stderr) < 3000


def test_the_tables_as_they_are_are_read(tmp_path):
    for typed in (CHECK, COMPRESSION):
        assert call(*typed, cwd=desk(tmp_path) if typed is CHECK else tmp_path).returncode == 0


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    """A pipe is waited for in `test_pipes_are_read` alone."""
    monkeypatch.setattr(delimited, "PATIENCE", 0.0)


def test_pipes_are_read(tmp_path, monkeypatch):
    """Also one whose writer begins later than its reader."""
    monkeypatch.setattr(delimited, "PATIENCE", 30.0)
    desk(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Timer(0.1, lambda: (tmp_path / "pipe").write_text(RATINGS))
    writer.start()
    done = call("check", "--data", "pipe", "--fabrics", "fabrics.csv", cwd=tmp_path)
    writer.join()
    assert done.returncode == 0, done.stderr
    assert "4, from 3 to 8" in done.stdout


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name.replace(" ", "_"))
def test_bad_input_is_refused_in_one_message(kind, tmp_path):
    kind.make(desk(tmp_path))
    before = snapshot(tmp_path)
    done = call(*kind.typed, cwd=tmp_path)
    require_refusal(done, *kind.words)
    assert done.stdout == ""
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("place", ["ratings.csv", "new"])
def test_what_may_not_be_read_or_written_is_named(place, tmp_path, monkeypatch):
    """As the system refuses it to all but root, who may run the tests."""
    desk(tmp_path)

    def forbidden(call):
        def tried(path, *arguments, **options):
            if os.path.basename(path) == place:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return call(path, *arguments, **options)

        return tried

    monkeypatch.setattr(os, "open", forbidden(os.open))
    monkeypatch.setattr(os, "mkdir", forbidden(os.mkdir))
    before = snapshot(tmp_path)
    require_refusal(call(*SAMPLE, cwd=tmp_path), place, "Permission denied")
    assert snapshot(tmp_path) == before


@cache
def names_in(path: Path) -> set[str]:
    return {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)}


def test_eighty_kinds_are_tried():
    names = [*(kind.name for kind in KINDS), *ELSEWHERE]
    assert len(names) == len(set(names))
    assert len(names) >= 80
    for place in ELSEWHERE.values():
        file, _, test = place.partition("::")
        assert test in names_in(ROOT / "tests" / file), place
