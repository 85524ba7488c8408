"""Code that a stored file names is run only for a user who trusts the file."""

import json
import os
import subprocess
import sys
from importlib.metadata import EntryPoint, EntryPoints

import pytest
import xarray as xr

from softness_bayes.base.errors import InputError
from softness_bayes.base.files import records
from softness_bayes.base.files.records import require_trusted
from softness_bayes.checking.individual import MODULUS_LAW, modulus_laws
from softness_bayes.checking.provenance import Provenance
from softness_bayes.results import stored
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import Request
from softness_bayes.runs.saved import read_record
from support.command_line import FIXED, QUICK, call, few_ratings, refused
from support.faults import rewritten
from support.paths import ROOT
from support.report_runs import quickly

CODE = "evil:NAME"
EVIL = "from pathlib import Path\nPath('ran').touch()\nNAME = None\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with a module that leaves a trace when it is run, as an archive of a run could have."""
    (tmp_path / "evil.py").write_text(EVIL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    sys.modules.pop("evil", None)


def has_run():
    """Return whether the module was run since the last call, and forget it."""
    sys.modules.pop("evil", None)
    ran = os.path.exists("ran")
    if ran:
        os.remove("ran")
    return ran


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A short run of the command line, with its result and its checkpoint."""
    home = tmp_path_factory.mktemp("finished")
    few_ratings(home)
    with quickly():
        done = call("sample", "--data", "ratings.csv", "--out", "run", *FIXED, *QUICK, cwd=home)
    assert done.returncode == 3, done.stderr
    return home / "run"


def text_places(tree):
    """Return the path of every text in the attributes, in their JSON, and in variables of a result."""

    def inside(value, path):
        if isinstance(value, str):
            yield path
        elif isinstance(value, (dict, list)):
            items = value.items() if isinstance(value, dict) else enumerate(value)
            for key, one in items:
                yield from inside(one, (*path, key))

    for name, value in tree.attrs.items():
        yield from inside(json.loads(value) if name == "options" else value, ("attribute", name))
    for group, node in tree.children.items():
        for name, variable in node.data_vars.items():
            if variable.dtype.kind not in "biufc":
                yield "variable", group, name


def poisoned(tree, place, text):
    """Return a copy of a result with another text in one place."""
    copy = tree.copy()
    kind, name, *path = place
    if kind == "variable":
        copy[name][path[0]] = xr.full_like(copy[name][path[0]], text, dtype=object)
    elif path:
        options = json.loads(copy.attrs[name])
        inner = options
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = text
        copy.attrs[name] = json.dumps(options)
    else:
        copy.attrs[name] = text
    return copy


def use(tree):
    """Look up everything that the program looks up by a name in a result."""
    found = Provenance(tree.attrs)
    for look in (
        lambda: found.readings,
        lambda: found.priors,
        lambda: found.rating_model,
        lambda: found.asked.unknown_modulus,
        lambda: modulus_laws(tree["constant_data"].to_dataset()),
        lambda: Request.from_record(found.asked.options),
    ):
        try:
            look()
        except (InputError, KeyError):  # None is no reading
            continue


@pytest.fixture(scope="module")
def texts(report_run):
    """The texts of a result with laws of moduli, without its draws."""
    tree = report_run("ratings").tree
    constant = xr.Dataset({MODULUS_LAW: ("uncertain_fabric", ["normal(1,2)"])}, {"uncertain_fabric": ["felt"]})
    options = json.loads(tree.attrs["options"]) | {
        "unknown_modulus": "lognormal(100,1)",
        "priors": {"b": "normal(1,2)"},
    }
    small = {"/posterior": xr.Dataset({"b": ("draw", [1.0])}), "/constant_data": constant}
    small["/"] = xr.Dataset(attrs=tree.attrs | {"options": json.dumps(options)})
    return xr.DataTree.from_dict(small)


def test_every_name_in_a_result_is_refused_that_a_reader_would_import(texts, here, report_run):
    table = report_run("ratings").table
    imported = []
    for place in text_places(texts):
        for text in (CODE, f"{CODE}(1, 2)", f" ±{CODE}(1)"):
            tree = poisoned(texts, place, text)
            use(tree)
            if not has_run():
                continue  # no reader imports what stands here
            imported.append(place)
            Result(tree, table).save("run")
            with pytest.raises(InputError, match=r"names code, 'evil:NAME'.*--trust-code"):
                Result.load("run")
            assert not has_run()
    # the control: without the refusal, names of all these kinds run the module
    assert {place[:3] for place in imported} >= {
        ("attribute", "reading_pressure"),
        ("attribute", "prior_b"),
        ("attribute", "rating_scale"),
        ("attribute", "options", "readings"),
        ("attribute", "options", "priors"),
        ("attribute", "options", "scale"),
        ("attribute", "options", "unknown_modulus"),
        ("variable", "constant_data", MODULUS_LAW),
    }


TOUCH = ["--fabrics", "fabrics.csv", "--indentation-mm", "2"]
READERS = [
    ["rank", "run", *TOUCH],
    ["explore", "run"],
    ["report", "run"],
    ["plot", "run"],
    ["calibrate", "--like", "run"],
]


@pytest.fixture
def tampered(finished, here):
    """The finished run, with a reading of the module, in a working directory with this module."""
    result = Result.load(finished)
    result.tree.attrs["reading_pressure"] = CODE
    result.save("run")
    (here / "fabrics.csv").write_text("fabric,effective_modulus_kpa\nfelt,300\n")
    return here


def test_no_command_runs_the_code_that_a_result_names(tampered, monkeypatch):
    for words in READERS:
        refused(call(*words), f"names code, '{CODE}'", "--trust-code")
        assert not has_run(), words
    # trusted, but not searched for in the working directory
    refused(call(*READERS[0], "--trust-code"), "there is no module 'evil'", "PYTHONPATH")
    assert not has_run()
    with monkeypatch.context() as patch:  # the control: as before there was a refusal
        patch.setattr(stored, "require_trusted", lambda *_: None)
        call(*READERS[0])
        assert has_run()
    monkeypatch.syspath_prepend(tampered)
    monkeypatch.setenv("PYTHONPATH", str(tampered))
    refused(call(*READERS[0], "--trust-code"), "expected a Pressure")
    assert has_run()
    assert not [path for path in os.listdir() if path not in ("run", "evil.py", "fabrics.csv", "__pycache__")]


def test_a_working_directory_on_pythons_path_is_not_searched(tampered):
    """`python -m` begins its path with the working directory."""
    words = [sys.executable, "-m", "softness_bayes", *READERS[0], "--trust-code"]
    done = subprocess.run(
        words, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False
    )
    refused(done, "evil")
    assert not has_run()


@pytest.mark.parametrize(
    "place", [("options", "readings", "pressure"), ("options", "scale"), ("options", "priors", "m"), ("own_figures",)]
)
def test_resume_runs_no_code_that_a_checkpoint_names(finished, here, place, monkeypatch):
    request = read_record(finished).request
    inner = request
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = [CODE] if place == ("own_figures",) else f"{CODE}(1)" if "priors" in place else CODE
    if place == ("own_figures",):
        request["figures"] = True
    (here / "run").mkdir()
    for path in finished.rglob("*"):
        target = here / "run" / path.relative_to(finished)
        target.mkdir(exist_ok=True) if path.is_dir() else target.write_bytes(path.read_bytes())
    rewritten(here / "run", request=request)
    (here / "ratings.csv").write_bytes((finished.parent / "ratings.csv").read_bytes())
    before = (here / "run" / "posterior.nc").read_bytes()
    refused(call("resume", "run"), f"names code, '{CODE}'", "--trust-code")
    refused(call("resume", "run", "--trust-code"), "there is no module 'evil'")
    assert not has_run()
    monkeypatch.setattr(records, "require_trusted", lambda *_: None)
    call("resume", "run", "--more-steps", "1")
    assert has_run()
    assert (here / "run" / "posterior.nc").read_bytes() == before


def test_short_names_of_installed_packages_are_names_of_code(here, monkeypatch):
    points = [EntryPoint("mild", CODE, "softness_bayes.pressure"), EntryPoint("mild2", CODE, "other.pressure")]
    monkeypatch.setattr(records, "entry_points", lambda: EntryPoints(points))
    records._every_entry_point.cache_clear()
    try:
        require_trusted("file", {"reading_pressure": "mild2"}, False)
        with pytest.raises(InputError, match="names code, 'mild'"):
            require_trusted("file", {"reading_pressure": "mild"}, False)
    finally:
        records._every_entry_point.cache_clear()


@pytest.mark.parametrize("depth", [500, 100_000])
def test_no_depth_hides_a_name(depth):
    deep = f'{{"a": {"[" * depth}{"]" * depth}, "b": ["{CODE}"]}}'
    with pytest.raises(InputError, match=r"names code|nested too deeply"):
        require_trusted("file", {"options": deep}, False)


def test_sentences_and_imported_modules_are_no_question(here):
    require_trusted(
        "file", {"said": "loads: exact, as stated", "time": "10:30", "known": "json:dumps", "n": [1, None]}, False
    )
    assert not has_run()
