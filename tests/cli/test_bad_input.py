"""Bad input of every kind: exit code 2, one message that names the place, no traceback, and no file touched.

Each of `KINDS` is tried by a command in a folder with somebody's results. What single cells of tables may not hold
is tested with the readers of tables, and whole messages are stored in `tests/golden/errors.txt`.
"""

import errno
import os
import shlex
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import h5py
import pytest

from softness_bayes.data import sheets
from softness_bayes.results import stored
from support.command_line import call
from support.small_result import small_result

RATINGS = "participant,fabric,indentation_mm,rating\nP1,voile,1,5.5\nP1,denim,1,8\nP2,voile,1,3\nP2,denim,1,7\n"
FABRICS = "fabric,tensile_modulus_mpa,thickness_mm\nvoile,3.2,0.22\ndenim,33,0.68\n"
FORCES = "participant,indentation_mm,force_n\nP1,1,0.5\nP1,2,1.5\n"
CHECK, COMPRESSION, REPORT = "check --data ratings.csv", "check --compression forces.csv", "report old"
RUN = "sample --data ratings.csv --max-steps 5 --no-figures"
SAMPLE = f"{RUN} --out new"

Make = Callable[[Path], object]


class Kind(NamedTuple):
    """One kind of bad input: the command that meets it, how it is made, and words that its message must have."""

    name: str
    typed: str
    make: Make
    words: tuple[str, ...]


def text(content: str | bytes, name: str = "ratings.csv") -> Make:
    """A file of some content in the place of another."""
    return lambda folder: (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)


def cell(old: str, new: str) -> Make:
    """One change in the table of ratings."""
    assert old in RATINGS
    return text(RATINGS.replace(old, new, 1))


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
        patch.setattr(stored, "SCHEMA", 99)
        small_result().save(path.parent)


def without(name: str, where: Callable[[h5py.File], object] = lambda file: file) -> Make:
    def made(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            del where(file)[name]

    return result(made)


def damaged(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)


WHERE = "ratings.csv: row 2, column 'rating'"
TABLE = "ratings.csv"
KINDS = (
    # files
    Kind("no such file", CHECK, in_place_of(TABLE, lambda path: None), (TABLE, "No such file")),
    Kind("a directory", CHECK, in_place_of(TABLE, Path.mkdir), (TABLE, "directory")),
    Kind("a link to itself", CHECK, in_place_of(TABLE, lambda p: p.symlink_to(p)), (TABLE, "symbolic links")),
    Kind("a huge file", CHECK, lambda f: os.truncate(f / TABLE, 2**30), ("ratings.csv: is larger than 256 MB",)),
    Kind("a device without end", "check --data /dev/zero", nothing, ("/dev/zero: is larger than 256 MB",)),
    Kind("a path that is too long", f"check --data {'a' * 300}", nothing, ("File name too long",)),
    Kind("blank lines alone", CHECK, text("\n \n"), (TABLE, "the file is empty")),
    Kind("an escape sequence", CHECK, cell("P1", "P\x1b[31m"), (TABLE, "control character")),
    Kind("UTF-16 cut in a letter", CHECK, text(RATINGS.encode("utf-16")[:-1]), (TABLE, "UTF-16")),
    Kind("a Parquet file by another name", CHECK, text(b"PAR1\0"), (TABLE, "not a Parquet file that can be read")),
    Kind("a damaged workbook", "check --data a.xlsx", text(b"PK\x03\x04\0\0", "a.xlsx"), ("a.xlsx",)),
    Kind("a damaged Parquet file", "check --data a.parquet", text(b"PAR1", "a.parquet"), ("a.parquet",)),
    Kind("a cell of a million letters", CHECK, cell("5.5", "x" * 10**6), (TABLE, "row 2")),
    Kind("ten thousand cells", CHECK, cell("5.5", "5" + ",1" * 10**4), ("row 2", "beyond the 4 columns")),
    # values and columns
    Kind("a formula for a rating", CHECK, cell("5.5", "=1+1"), (WHERE, "got '=1+1'")),
    Kind("a negative rating", SAMPLE, cell("5.5", "-5.5"), (WHERE, "0 or above, got '-5.5'")),
    Kind("HTML for a fabric", CHECK, cell("voile", "<b>v</b>"), ("row 2, column 'fabric': '<b>v</b>' is not",)),
    Kind("a load of 0", CHECK, cell("voile,1", "voile,0"), ("row 2, column 'indentation_mm'", "got '0'")),
    Kind("two columns of one name", CHECK, cell("participant", "rating"), ("2 columns are called 'rating'",)),
    Kind("a long table called wide", f"{CHECK} --wide", nothing, ("--wide expects a table with one column per",)),
    Kind("a bad force", COMPRESSION, text("participant,indentation_mm,force_n\nP1,1,-1\n", "forces.csv"), ("row 2",)),
    # options
    Kind("an unknown option", "check --dta ratings.csv", nothing, ("No such option", "--dta")),
    Kind("a stray word", f"{SAMPLE} {'x' * 300}", nothing, ("unexpected extra argument", "x" * 99)),
    Kind("steps that are no number", f"{SAMPLE} --max-steps many", nothing, ("--max-steps", "many")),
    Kind("a value given twice", f"{SAMPLE} --fix b=1 --fix b=2", nothing, ("'b' is given twice",)),
    Kind("no number for a value", f"{SAMPLE} --fix b=nan", nothing, ("b: expected a finite number, got 'nan'",)),
    Kind("a name alone", "predict --fabrics fabrics.csv --set b", nothing, ("expected NAME=VALUE, got 'b'",)),
    Kind("a seed below zero", f"{SAMPLE} --seed -1", nothing, ("expected a whole number from 0, got '-1'",)),
    Kind("both fixed and free", f"{SAMPLE} --fix b=80 --prior b=halfnormal(9)", nothing, ("b is both fixed and",)),
    Kind("a prior below zero", f"{SAMPLE} --prior b=normal(100,10)", nothing, ("b", "negative")),
    Kind("an unknown place", f"{SAMPLE} --reading stress=flat", nothing, ("no place 'stress'",)),
    Kind("a slider upside down", f"{SAMPLE} --slider 1,0", nothing, ("--slider", "expected the lower end first")),
    Kind("no rating at all", "simulate --fabrics fabrics.csv --force-n 1 --missing 1", nothing, ("--missing",)),
    Kind("a run's own readings", "predict --fabrics fabrics.csv --force-n 1 --posterior x --readings hertz", nothing,
         ("--posterior has its own readings",)),
    # results
    Kind("a folder without a result", "report bare", lambda folder: (folder / "bare").mkdir(), ("bare",)),
    Kind("a result of another program", "report results", nothing, ("results/posterior.nc",)),
    Kind("a result of a later version", REPORT, result(of_a_later_version), ("posterior.nc", "99")),
    Kind("a result without its version", REPORT, without("schema_version", lambda f: f.attrs), ("posterior.nc",)),
    Kind("a result without a group", REPORT, without("posterior"), ("posterior.nc",)),
    Kind("a result cut short", REPORT, result(lambda p: p.write_bytes(p.read_bytes()[:999])), ("posterior.nc",)),
    Kind("a result with a damaged byte", REPORT, result(damaged), ("posterior.nc",)),
    # places to write to
    Kind("results in the way", f"{RUN} --out results", nothing, ("is not empty; choose another --out, or --force",)),
    Kind("a file for a folder", f"{RUN} --out notes.txt", nothing, ("notes.txt",)),
    Kind("a folder that cannot be made", f"{RUN} --out /proc/none/new", nothing, ("/proc/none",)),
    Kind("a folder for a file", "predict --fabrics fabrics.csv --force-n 1 --out results", nothing, ("results",)),
    Kind("others' files, with --force", f"{RUN} --out results --force", nothing, ("results",)),
)  # fmt: skip


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


@pytest.fixture(autouse=True)
def desk(tmp_path, monkeypatch):
    """The working directory: tables, somebody's notes, and somebody's results."""
    for name, table in (("ratings.csv", RATINGS), ("fabrics.csv", FABRICS), ("forces.csv", FORCES)):
        (tmp_path / name).write_text(table)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "posterior.nc").write_bytes(b"of another program")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def require_refusal(typed: str, *words: str) -> None:
    """Exit code 2, one error with these words, no traceback, nothing printed or written."""
    before = snapshot(Path.cwd())
    done = call(*shlex.split(typed))
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert sum(line.lower().startswith("error:") for line in done.stderr.splitlines()) == 1, done.stderr
    for word in words:
        assert word in done.stderr, done.stderr
    assert len(done.stderr) < 3000  # a screen's worth, whatever the input is
    assert done.stdout == ""
    assert snapshot(Path.cwd()) == before


def test_the_tables_as_they_are_are_read():
    for typed in (CHECK, COMPRESSION):
        assert call(*typed.split()).returncode == 0


def test_pipes_are_read(desk):
    """Also one whose writer begins later than its reader."""
    os.mkfifo("pipe")
    writer = threading.Timer(0.1, lambda: Path("pipe").write_text(RATINGS))
    writer.start()
    done = call("check", "--data", "pipe", "--fabrics", "fabrics.csv")
    writer.join()
    assert done.returncode == 0, done.stderr
    assert "4, from 3 to 8" in done.stdout


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name.replace(" ", "_"))
def test_bad_input_is_refused_in_one_message(kind, desk):
    kind.make(desk)
    require_refusal(kind.typed, *kind.words)


@pytest.mark.parametrize("place", ["ratings.csv", "new"])
def test_what_may_not_be_read_or_written_is_named(place, monkeypatch):
    """As the system refuses it to all but root, who may run the tests."""

    def forbidden(call):
        def tried(path, *arguments, **options):
            if os.path.basename(path) == place:
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
            return call(path, *arguments, **options)

        return tried

    monkeypatch.setattr(sheets, "open", forbidden(open), raising=False)
    monkeypatch.setattr(os, "mkdir", forbidden(os.mkdir))
    require_refusal(SAMPLE, place, "Permission denied")
