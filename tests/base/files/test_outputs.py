"""Files of others: whatever a verb is asked, it replaces and removes nothing but what it wrote itself."""

from __future__ import annotations

import ast
import contextlib
import json
import os
import re
import shutil
import stat
import sys
from pathlib import Path

import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.base.files import whole
from softness_bayes.base.files.command_line import portable
from softness_bayes.base.files.outputs import LISTING, Listing, require_outputs, survey, write_outputs
from softness_bayes.base.files.run_files import FILES
from softness_bayes.base.files.whole import write_whole
from softness_bayes.cli import VERBS, main
from softness_bayes.results.run_options import DataFiles
from support.command_line import TOUCH, call, refused
from support.full_disk import fill_disk
from support.modules import MODULES
from support.paths import DATA

FORCES = DATA / "compression.csv"
SHORT = ["--max-steps", "20", "--no-figures", "--processes", "1"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory, brief_pilot):
    """A short run on forces alone, with its checkpoint."""
    from softness_bayes.cli import main

    directory = tmp_path_factory.mktemp("finished") / "run"
    typed = ["sample", "--compression", str(FORCES), *SHORT, "--out", str(directory)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["softness-bayes", *typed])
        with pytest.raises(SystemExit) as end:
            main(typed)
    assert end.value.code == 3
    return directory


# every verb that writes: its arguments, whether --out is a file, and the names that it writes
WRITERS = {
    "sample": (["--compression", FORCES, *SHORT], False, [*FILES, "checkpoint", "figures"]),
    "simulate": (
        [*TOUCH, "--participants", "2", "--fingers", "2"],
        False,
        ["ratings.csv", "fabrics.csv", "truth.json", "compression.csv"],
    ),
    "predict": (TOUCH, True, ["table.csv"]),
    "rank": (["RUN"], False, ["ranking.csv", "places.csv", "pairs.csv", "ranking.png"]),
    "target": (["RUN", "--rating", "20"], True, ["table.csv"]),
    "design": (["--given", "RUN"], False, ["design.csv", "gain.csv", "design.json", "design.png", "design.pdf"]),
    "claims": (["--draws", "0"], False, ["claims.csv", "claims.md", "claims_loads.csv"]),
    "compare": (["one", "two"], False, ["compare.csv"]),
    "bench": (
        ["--quick"],
        False,
        ["work_precision.csv", "summary.md", "work_precision.png", "work_precision.pdf"],
    ),
    "study": (
        ["TABLES", "--max-steps", "5"],
        False,
        ["tables.csv", "individual.csv", "population.csv", "forest.png", "study.md"],
    ),
    "calibrate": (["--replicates", "1", "--max-steps", "5"], False, ["ranks.csv", "coverage.csv", "ecdf.png"]),
    "plot": (["RUN", "--figures", "prior", "--format", "png"], False, ["prior.png"]),
    "report": (["RUN"], True, ["report.html"]),
}
WITHOUT = {"check", "status", "resume", "list", "new", "demo", "explore"}
"""Verbs that write nothing, or one figure (`check`); `resume`, which has no --out; `new` and `demo`, which replace
nothing (test_first_hour)."""


def options(verb):
    return {parameter.name for parameter in main.get_command(None, verb).params}


def test_every_verb_that_writes_has_a_row():
    assert {verb for verb in VERBS if "out" in options(verb)} == {*WRITERS}
    assert {*WRITERS} | WITHOUT == {*VERBS}


def snapshot(*places):
    """Everything below some places: kind, and content or what a link points to."""
    found = {}
    for place in places:
        for path in sorted([place, *place.rglob("*")]):
            kind = stat.S_IFMT(path.lstat().st_mode)
            held = os.readlink(path) if path.is_symlink() else path.read_bytes() if path.is_file() else None
            found[path] = (kind, held)
    return found


def sentinels(folder):
    """Fill a folder with what somebody would miss."""
    folder.mkdir()
    (folder / "thesis.docx").write_bytes(b"years of work")
    (folder / ".git" / "objects").mkdir(parents=True)
    (folder / ".git" / "objects" / "ab").write_bytes(b"\0history")
    for name in ("ratings.csv", "fabrics.csv", "compression.csv"):
        shutil.copy(DATA / name, folder / name)
    (folder / "posterior.nc").write_bytes(b"of another program")
    (folder / "posterior.nc.part").write_bytes(b"mine")
    (folder / "figures").mkdir()
    (folder / "figures" / "prior.png").write_bytes(b"a photograph")
    (folder / "checkpoint").mkdir()
    (folder / "checkpoint" / "states.json").write_text('{"format": 1}')
    (folder / "checkpoint" / "lock").write_text("combination")
    (folder / "checkpoint" / "weights.npz").write_bytes(b"of a network")
    return folder


def standing(place, kind, outside):
    """Let something stand at a place."""
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    place.unlink(missing_ok=True)
    if kind == "file":
        place.write_bytes(b"precious")
    elif kind == "link":
        outside.write_bytes(b"elsewhere")
        place.symlink_to(outside)
    elif kind == "dangling":
        place.symlink_to(outside.with_name("nowhere"))
    else:
        place.mkdir()
        (place / "inside").write_bytes(b"precious")


def called(verb, finished, target, *more):
    tables = finished.parent / "tables.csv"
    if verb == "study":
        tables.write_text(f"table,data\none,{DATA / 'ratings.csv'}\ntwo,{DATA / 'ratings.csv'}\n")
    named = {"RUN": finished, "TABLES": tables}
    arguments = [named.get(word, word) for word in WRITERS[verb][0]]
    return call(verb, *arguments, "--out", target, *more)


@pytest.mark.parametrize("kind", ["file", "link", "dangling", "directory"])
@pytest.mark.parametrize("verb", WRITERS)
def test_nothing_of_others_is_touched(verb, kind, finished, tmp_path):
    _, is_file, names = WRITERS[verb]
    folder, outside = sentinels(tmp_path / "folder"), tmp_path / "outside"
    for name in names:
        standing(folder / name, kind, outside)
    before = snapshot(tmp_path)
    for force in ([], ["--force"]) if "force" in options(verb) else ([],):
        done = called(verb, finished, folder / names[0] if is_file else folder, *force)
        refused(done, names[0] if is_file else str(folder))
        assert snapshot(tmp_path) == before, force


def test_a_run_in_a_folder_with_other_things_names_them(tmp_path):
    folder = sentinels(tmp_path / "folder")
    before = snapshot(tmp_path)
    done = call("sample", "--compression", folder / "compression.csv", *SHORT, "--out", folder, "--force")
    refused(done, ".git is a directory", "compression.csv is an input of this command", "; and ")
    assert snapshot(tmp_path) == before
    # the program of another's checkpoint is no run of ours, whatever its files
    for name in ("thesis.docx", ".git", "ratings.csv", "fabrics.csv", "compression.csv", "posterior.nc", "figures"):
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    (folder / "posterior.nc.part").unlink()
    for force in ([], ["--force"]):
        before = snapshot(tmp_path)
        done = call("sample", "--compression", FORCES, *SHORT, "--out", folder, *force)
        refused(done)
        assert snapshot(tmp_path) == before
    (folder / "checkpoint" / "states.json").unlink()
    before = snapshot(tmp_path)
    refused(call("sample", "--compression", FORCES, *SHORT, "--out", folder), "not empty")
    assert snapshot(tmp_path) == before


def test_force_replaces_a_run_and_what_belongs_to_it(finished, tmp_path):
    """The other side: files of ours do go, a report and figures among them, and an edited one stays."""
    out = tmp_path / "run"
    shutil.copytree(finished, out)
    assert call("report", out).returncode == 0
    assert call("plot", out, "--figures", "prior", "--format", "png").returncode == 0
    edited = (out / "summary.csv").read_bytes()
    (out / "summary.csv").write_bytes(edited + b"my note\n")
    again = ["sample", "--compression", FORCES, *SHORT, "--out", out, "--force"]
    before = snapshot(out)
    refused(call(*again), "summary.csv was changed since it was written")
    refused(call("resume", out, "--processes", "1"), "summary.csv was changed since it was written")
    refused(call("sample", "--compression", out / "directions.csv", *SHORT, "--out", out, "--force"))
    assert snapshot(out) == before
    (out / "summary.csv").write_bytes(edited)
    assert call(*again).returncode == 3
    names = {".softness-bayes.json", "checkpoint", "directions.csv", "posterior.nc", "summary.csv"}
    assert {path.name for path in out.iterdir()} == names


@pytest.mark.parametrize("verb", ["simulate", "predict"])
def test_force_replaces_what_the_verb_wrote_and_nothing_else(verb, finished, tmp_path):
    _, is_file, names = WRITERS[verb]
    folder = tmp_path / "new"
    target = folder / names[0] if is_file else folder
    assert called(verb, finished, target, "--set", "b=70").returncode == 0
    assert {path.name for path in folder.iterdir()} == {LISTING, *names}
    (folder / "thesis.docx").write_bytes(b"years of work")
    before = snapshot(folder)
    refused(called(verb, finished, target), "already holds", "--force")
    assert snapshot(folder) == before
    assert called(verb, finished, target, "--force").returncode == 0
    after = snapshot(folder)
    assert after[folder / "thesis.docx"] == before[folder / "thesis.docx"]
    assert after[folder / names[0]] != before[folder / names[0]]
    (folder / names[0]).write_bytes(b"edited")
    before = snapshot(folder)
    refused(called(verb, finished, target, "--force"), f"{names[0]} was changed since it was written")
    assert snapshot(folder) == before


def test_no_verb_replaces_its_own_input(tmp_path):
    arguments = ["--indentation-mm", "2", "--participants", "2", "--out", tmp_path / "made"]
    assert call("simulate", "--fabrics", DATA / "fabrics.csv", *arguments).returncode == 0
    before = snapshot(tmp_path)
    done = call("simulate", "--fabrics", tmp_path / "made" / "fabrics.csv", *arguments, "--force")
    refused(done, "fabrics.csv is an input of this command")
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("verb", [verb for verb in WRITERS if verb != "sample"])
def test_a_place_that_cannot_be_made_is_refused_before_anything_is_computed(verb, finished, tmp_path):
    (tmp_path / "file").write_bytes(b"mine")
    for place in (tmp_path / "file", tmp_path / "file" / "below", Path("/proc/none/of/it")):
        target = place / "x.csv" if WRITERS[verb][1] else place
        named = tmp_path / "file" if tmp_path in place.parents else place
        refused(called(verb, finished, target), str(named))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_files_are_written_in_one_place():
    """No module but `files.whole` opens a file to write, but for the programs in `tools`."""
    homes = {"to_csv": {"base.files.spreadsheet"}, "to_netcdf": {"base.arviz_bridge"}}
    never = {"write_text", "write_bytes", "rmtree", "copyfile", "move"}
    for name, tree in MODULES.items():
        if name.startswith("tools."):
            continue
        for made in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            word = made.func.attr if isinstance(made.func, ast.Attribute) else getattr(made.func, "id", "")
            texts = [part.value for part in (*made.args, *(k.value for k in made.keywords)) if is_text(part)]
            writes = word == "open" and any(re.fullmatch("[rwxab+t]+", text) and {*text} & {*"wxa+"} for text in texts)
            assert not (writes or word in never) or name == "base.files.whole", f"{name}: {ast.unparse(made)}"
            assert name in homes.get(word, {name}), f"{name}: {ast.unparse(made)}"


def is_text(part):
    return isinstance(part, ast.Constant) and isinstance(part.value, str)


def test_nothing_may_be_written(tmp_path):
    """A run without a figure of its kind still has a folder of figures."""
    assert write_outputs(tmp_path / "figures", {}, "plot") == []


# full disks


@pytest.mark.parametrize("room", range(6))
def test_a_full_disk_leaves_all_old_files_or_all_new_ones(tmp_path, monkeypatch, room):
    """Whichever write fails, what stands there is whole, of one time, and known to be ours."""
    old, new = ({name: f"{age} {name}" * 100 for name in ("a.csv", "b.csv")} for age in ("old", "new"))
    write_outputs(tmp_path, old, "simulate")
    fill_disk(monkeypatch, room)
    with contextlib.suppress(OSError):
        write_outputs(tmp_path, new, "simulate")
    monkeypatch.undo()
    found = {name: (tmp_path / name).read_text() for name in old}
    assert found in (old, new)
    assert {path.name for path in tmp_path.iterdir()} == {LISTING, *old}
    assert not survey(tmp_path, ["simulate"]).others
    write_outputs(tmp_path, new, "simulate")
    assert {name: (tmp_path / name).read_text() for name in new} == new


def test_what_killed_processes_left_is_removed_and_only_that(tmp_path):
    left = tmp_path / f".softness-bayes-{7:032x}.part"
    left.write_bytes(b"half")
    for name in ("a.part", ".softness-bayes-7.part", ".a.csv.part"):
        (tmp_path / name).write_bytes(b"mine")
    (tmp_path / f".softness-bayes-{8:032x}.part").symlink_to(tmp_path / "a.part")
    before = snapshot(tmp_path)
    write_outputs(tmp_path, {"a.csv": "1"}, "simulate")
    after = snapshot(tmp_path)
    assert {*before} - {*after} == {left}
    assert all(after[path] == before[path] for path in {*before} - {left, tmp_path})


def test_temporary_names_cannot_be_foreseen_and_nothing_is_written_through_links(tmp_path, monkeypatch):
    names = set()
    replace = os.replace
    monkeypatch.setattr(whole.os, "replace", lambda part, path: (names.add(part), replace(part, path)))
    for _ in range(20):
        write_whole(tmp_path / "a", b"1")
    assert len(names) == 20
    monkeypatch.undo()
    (tmp_path / "link").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match="symbolic link"):
        write_whole(tmp_path / "link", b"2")
    assert (tmp_path / "a").read_bytes() == b"1"


# the list


def test_a_list_that_is_none_is_refused_and_kept(tmp_path):
    for content in ("mine", "[]", '{"format": 2}', '{"format": 1, "made": false, "files": {"a": 3}}'):
        (tmp_path / LISTING).write_text(content)
        for act in (
            lambda: write_outputs(tmp_path, {"a": "1"}, "simulate"),
            lambda: require_outputs(tmp_path, ["a"], "simulate"),
            lambda: survey(tmp_path, ["simulate"]),
        ):
            with pytest.raises(InputError, match=r"not the list"):
                act()
        assert (tmp_path / LISTING).read_text() == content
        assert [path.name for path in tmp_path.iterdir()] == [LISTING]


def test_the_list_names_verbs_and_digests_and_no_place(tmp_path):
    write_outputs(tmp_path / "new", {"a": "1"}, "simulate")
    text = (tmp_path / "new" / LISTING).read_text()
    assert str(tmp_path) not in text
    assert json.loads(text)["made"] is True
    (entry,) = Listing.read(tmp_path / "new").files.values()
    assert entry == ("simulate", ("6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b",))
    write_outputs(tmp_path, {"b": "1"}, "simulate")
    assert not Listing.read(tmp_path).made  # it was there before


# no places


def test_paths_are_kept_from_the_run_on(tmp_path):
    """The run and its data move together; a linked table is found beside its own fabrics."""
    for name in ("study", "store"):
        (tmp_path / name).mkdir()
    (tmp_path / "store" / "v3.csv").write_text("table")
    (tmp_path / "study" / "ratings.csv").symlink_to(tmp_path / "store" / "v3.csv")
    (tmp_path / "study" / "out").symlink_to(tmp_path / "store")
    files = DataFiles(tmp_path / "study" / "ratings.csv")
    for out in (tmp_path / "study" / "run", tmp_path / "study" / "out"):
        record = files.record_in(out)
        assert not os.path.isabs(record["data"])
        assert DataFiles.recorded_in(out, json.loads(json.dumps(record))) == files
    record = files.record_in(tmp_path / "study" / "run")
    (tmp_path / "study").rename(tmp_path / "moved")
    assert DataFiles.recorded_in(tmp_path / "moved" / "run", record).data == tmp_path / "moved" / "ratings.csv"


@pytest.mark.parametrize(
    ("word", "kept"),
    [
        ("/home/jane/study/data/r.csv", "data/r.csv"),
        ("--data=/home/jane/study/r.csv", "--data=r.csv"),
        ("/srv/jane/r.csv", "r.csv"),
        ("--out=/srv/jane/", "--out=jane"),
        ("/home/jane/study", "."),
        ("/", "."),
        ("../r.csv", "../r.csv"),
        ("rating=/x", "rating=/x"),
        ("--seed", "--seed"),
    ],
)
def test_a_word_of_a_command_keeps_no_absolute_path(word, kept):
    assert portable(word, Path("/home/jane/study")) == kept
