"""Signals at any instant, dead workers, little memory and streams nobody reads: how a command ends."""

import logging
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

from softness_bayes.__main__ import quieten_libraries
from softness_bayes.base.errors import WorkersLostError
from softness_bayes.cli import VERBS
from softness_bayes.results.result import Result
from softness_bayes.runs.saved import read_status, saved_states
from softness_bayes.sampler.workers import RENEWALS, Workers
from support.command_line import FIXED, call, few_ratings
from support.paths import DATA, ROOT

PROGRAM = (
    # a shell that runs the tests in the background has interrupts ignored, by its children too
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"
    "from softness_bayes.__main__ import heed_signals, run\n"
    "heed_signals()\n"
    "print('begun', flush=True)\n"
    "{before}\n"
    "run()"
)
QUICKLY = (
    "import sys\n"
    f"sys.path.append({str(ROOT / 'tests')!r})\n"
    "from support.report_runs import quickly\n"
    "from softness_bayes.runs import calibrate\n"
    "import functools\n"
    "calibrate.Settings = functools.partial(calibrate.Settings, pilot=(20,), optima=1)\n"
    "made = quickly()\n"
    "made.__enter__()\n"
)
"""What comes before a run whose draws nobody judges."""
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUTF8": "1"}
SAMPLE = [*FIXED, "--accuracy", "0.01", "--seed", "3", "--processes", "2", "--max-steps", "300"]


def began(directory, *arguments, before=""):
    """Start a verb in a process group of its own; return it when the command line is about to take over."""
    process = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", PROGRAM.format(before=before), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=directory,
        env=ENVIRONMENT,
        start_new_session=True,
    )
    assert process.stdout.readline() == "begun\n"
    return process


def members(group):
    """Numbers of the living processes of a group."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of = path.read_text().rpartition(")")[2].split()[:3]
        except OSError:
            continue
        if int(of) == group and state != "Z":
            found.append(int(path.parent.name))
    return found


def stopped(process, number, whole=True, refuses=False):
    """Send a signal, to the whole group as a terminal does; return what was said, or None if it had ended before.

    A verb that refuses its words may end with its message before the signal arrives.
    """
    since = time.monotonic()
    if process.poll() is None:
        (os.killpg if whole else os.kill)(process.pid, number)
    _, said = process.communicate(timeout=120)
    seconds = time.monotonic() - since
    assert "Traceback" not in said, said
    assert "Exception" not in said, said
    assert "leaked" not in said, said
    for _ in range(200):
        if not (left := members(process.pid)):
            break
        time.sleep(0.05)
    assert not left
    if process.returncode in (0, 3):
        return None
    if refuses and process.returncode in (1, 2):
        assert said.startswith(("error: ", "Usage: ")), said
        return None
    assert process.returncode == 128 + number, (process.returncode, said)
    assert "interrupted" in said
    assert seconds < 20  # two on an idle machine; tests share theirs
    return said


def sent(directory, delay, number=signal.SIGINT, whole=True):
    """Sample into a new directory and send a signal after some seconds."""
    few_ratings(directory)
    process = began(directory, "sample", "--data", "ratings.csv", "--out", "out", *SAMPLE)
    time.sleep(delay)
    said = stopped(process, number, whole)
    if said is None:
        return "finished"
    if saved_states(directory / "out"):
        while_drawing = "the results are written to out: 'softness-bayes plot out' draws the figures;"
        before = r"the run is saved (up to step \d+|in its pilot phase):"
        assert re.search(f"({before}|{while_drawing}) 'softness-bayes resume out' continues it", said), said
        if while_drawing in said:
            assert Result.load(directory / "out").provenance.ending.steps > 0
        assert not read_status(directory / "out").running
        return "kept"
    assert "resume" not in said
    assert not (directory / "out").exists()  # nothing was kept, nothing is left
    return "nothing"


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.3, 2.5])
def test_an_interrupt_ends_a_run_quietly_at_its_start(tmp_path, delay):
    sent(tmp_path, delay)


def test_a_closed_terminal_is_told_what_is_kept(tmp_path):
    few_ratings(tmp_path)
    process = began(tmp_path, "sample", "--data", "ratings.csv", "--out", "out", *SAMPLE)
    while process.poll() is None and not saved_states(tmp_path / "out"):
        time.sleep(0.02)
    said = stopped(process, signal.SIGHUP)  # to the workers too, which must not count as lost
    assert "the run is saved" in said
    assert "'softness-bayes resume out' continues it" in said


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_an_interrupt_ends_a_run_quietly_at_any_time(tmp_path, seed):
    """Start-up, walk, what follows it and figures: some 20 s on an idle machine."""
    rng = random.Random(seed)
    delay = rng.choice([rng.uniform(0, 3), rng.uniform(0, 25)])
    sent(tmp_path, delay, rng.choice([signal.SIGINT, signal.SIGINT, signal.SIGTERM]))


@pytest.mark.parametrize(
    "place",
    [
        "softness_bayes.results.assembly:replicated_groups",  # all that follows the walk
        pytest.param("softness_bayes.runs.drawing:draw_run_figures", marks=pytest.mark.slow),  # workers are drawing
        "softness_bayes.model.build:choose",
    ],
)
def test_an_interrupt_ends_a_run_at_a_place(tmp_path, place):
    """The process interrupts itself where a stage begins; one that swallows the interrupt is ended all the same."""
    few_ratings(tmp_path)
    module, name = place.split(":")
    before = QUICKLY + (
        f"import {module} as module, os, time\n"
        "def stop(*_, **__):\n"
        "    try:\n"
        "        os.killpg(0, signal.SIGINT); time.sleep(60)\n"
        "    except BaseException:\n"
        "        time.sleep(60)\n"
        f"module.{name} = stop"
    )
    arguments = ["sample", "--data", "ratings.csv", "--out", "out", *FIXED, "--max-steps", "20", "--processes", "2"]
    arguments += ["--accuracy", "0.01"]
    process = began(tmp_path, *arguments, before=before)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert "interrupted" in said
    assert ("resume out" in said) == (not place.endswith(":choose")), said


def test_calibrate_ends_at_once_and_says_how_to_go_on(tmp_path):
    brief = ["--accuracy", "0.01", "--max-steps", "20", "--replicates", "2000", "--processes", "2"]
    process = began(tmp_path, "calibrate", *FIXED, *brief, "--out", "out")
    while process.poll() is None and not (tmp_path / "out" / "ranks.csv").exists():
        time.sleep(0.05)
    said = stopped(process, signal.SIGINT)
    assert re.search(r"\d+ of 2000 replicates (is|are) saved in out: the same command runs the others", said)


RATED = ["--data", "ratings.csv"]
CLOTH = ["--fabrics", DATA / "fabrics.csv", "--indentation-mm", "2"]
ALL_VERBS = {
    "check": ["--design", "--cost", *RATED],
    "sample": [*RATED, "--out", "out", *SAMPLE],
    "resume": ["run", "--more-steps", "200"],
    "status": ["run"],
    "plot": ["run", "--out", "figures"],
    "simulate": [*CLOTH, "--out", "simulated"],
    "report": ["run", "--out", "page.html"],
    "list": ["readings"],
    "compare": ["run", "run-2", "--out", "compared"],
    "predict": ["--posterior", "run", *CLOTH],
    "rank": ["run", "--out", "ranked"],
    "target": ["run", "--rating", "9"],
    "design": ["--given", "run", "--out", "planned"],
    "explore": ["run"],
    "claims": ["--out", "claims"],
    "bench": ["--out", "bench"],
    "study": ["tables", "--out", "study", *SAMPLE[:-2], "--max-steps", "20"],
    "calibrate": [*FIXED, "--out", "calibration", "--replicates", "4", "--max-steps", "60"],
    "demo": ["shown"],
    "new": ["begun"],
}
"""Words after every verb, with which it works for a while."""


def test_every_verb_is_interrupted_somewhere():
    assert {*ALL_VERBS} == {*VERBS}


@pytest.mark.parametrize(
    ("verb", "delay"),
    [
        ("rank", 0.8),
        *(pytest.param(verb, delay, marks=pytest.mark.slow) for verb in ALL_VERBS for delay in (0.5, 2.0, 5.0)),
    ],
)
def test_an_interrupt_ends_any_verb_quietly(verb, delay, report_run, tmp_path):
    """What was there stays whole, and nothing half-written is left."""
    few_ratings(tmp_path)
    (tmp_path / "tables").mkdir()
    for table in ("first", "second"):
        shutil.copy(tmp_path / "ratings.csv", tmp_path / "tables" / f"{table}.csv")
    for name in ("run", "run-2"):
        report_run("ratings").save(tmp_path / name)
    process = began(tmp_path, verb, *ALL_VERBS[verb])
    time.sleep(delay)
    stopped(process, signal.SIGINT, refuses=True)
    for name in ("run", "run-2"):
        assert Result.load(tmp_path / name).provenance
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".part", ".tmp")]


def test_libraries_are_quiet_unless_python_is_asked(monkeypatch, capsys):
    monkeypatch.delenv("PYTHONWARNINGS", raising=False)
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    for asked in ([], ["error"]):
        monkeypatch.setattr(sys, "warnoptions", asked)
        monkeypatch.setattr(logging, "lastResort", logging.StreamHandler(sys.stderr))
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            quieten_libraries()
            warnings.warn("a glyph is missing", UserWarning, stacklevel=1)
            logging.Logger("of a library").warning("few draws")  # a logger without a handler, as ArviZ has one
        assert ("few draws" in capsys.readouterr().err) == bool(asked)
        assert len(heard) == len(asked)
        assert logging.getLogger().handlers
        assert os.environ.pop("PYTHONWARNINGS", None) == (None if asked else "ignore")


# workers


def _die_once(resident, path, value):
    if value == 2 and not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return value * resident


def _die(resident, value):
    os.kill(os.getpid(), signal.SIGKILL)


WAYS = {
    "map": lambda workers, tasks: workers.map(_die_once, tasks),
    "as_finished": lambda workers, tasks: sorted(workers.as_finished(_die_once, tasks)),
    "later": lambda workers, tasks: [wait() for wait in [workers.later(_die_once, *task) for task in tasks]],
}


@pytest.mark.parametrize("way", WAYS)
def test_a_worker_that_dies_is_replaced_and_its_task_done_again(tmp_path, way):
    tasks = [(str(tmp_path / "died"), k) for k in range(5)]
    with Workers(10, 2) as workers:
        found = WAYS[way](workers, tasks)
    assert (tmp_path / "died").exists()
    assert found == [0, 10, 20, 30, 40]


def test_workers_that_die_again_and_again_are_given_up():
    assert RENEWALS > 0
    with Workers(10, 2) as workers, pytest.raises(WorkersLostError, match="its replacement died too") as error:
        workers.map(_die, [(1,)])
    assert error.value.exit_code == 7


def test_a_run_that_lost_its_memory_says_how_to_go_on(tmp_path, brief_pilot, monkeypatch):
    from softness_bayes.results import assembly

    few_ratings(tmp_path)
    asked = ["--data", tmp_path / "ratings.csv", *FIXED, "--max-steps", "20", "--processes", "1", "--no-figures"]
    for error, words, code in (
        (MemoryError("no 2 GB"), "memory ran out (no 2 GB)", 6),
        (WorkersLostError("a worker"), "a worker", 7),
    ):
        monkeypatch.setattr(assembly, "replicated_groups", lambda *_, error=error: (_ for _ in ()).throw(error))
        done = call("sample", *asked, "--out", tmp_path / words[:6])
        assert done.returncode == code
        assert words in done.stderr
        assert f"'softness-bayes resume {tmp_path / words[:6]}' continues it" in done.stderr


# streams

VERBS_THAT_PRINT = {
    "--help": ["--help"],
    "check": ["check", "--data", DATA / "ratings.csv", "--fabrics", DATA / "fabrics.csv"],
    "predict": ["predict", "--fabrics", DATA / "fabrics.csv", "--indentation-mm", "2"],
    "simulate": ["simulate", "--fabrics", DATA / "fabrics.csv", "--indentation-mm", "2", "--out", "simulated"],
    "nothing": ["status", "nowhere"],
}


def into(directory, stream, *arguments):
    program = "from softness_bayes.cli import main; main(prog_name='softness-bayes')"
    command = [sys.executable, "-W", "error", "-c", program, *map(str, arguments)]
    return subprocess.run(
        command, stdout=stream, stderr=subprocess.PIPE, text=True, cwd=directory, env=ENVIRONMENT, timeout=120
    )


@pytest.mark.parametrize("verb", VERBS_THAT_PRINT)
def test_a_closed_output_is_quiet_and_no_failure(tmp_path, verb):
    reading, writing = os.pipe()
    os.close(reading)
    done = into(tmp_path, writing, *VERBS_THAT_PRINT[verb])
    os.close(writing)
    if verb == "nothing":  # an error stays one
        assert done.returncode == 2
        assert done.stderr.startswith("error: nowhere: no run")
    else:
        said = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
        assert (done.returncode, said) == (0, [])
    if verb == "simulate":
        assert (tmp_path / "simulated" / "ratings.csv").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize(("verb", "code", "kind"), [("predict", 2, "error"), ("simulate", 0, "warning")])
def test_a_full_output_is_told(tmp_path, verb, code, kind):
    """It is no failure of files that are written."""
    with open("/dev/full", "w") as full:
        done = into(tmp_path, full, *VERBS_THAT_PRINT[verb])
    assert done.returncode == code
    assert f"{kind}: standard output: No space left on device; the printed output is incomplete\n" in done.stderr
    assert (tmp_path / "simulated" / "ratings.csv").exists() == (verb == "simulate")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="closes streams as a shell does")
@pytest.mark.parametrize(("verb", "code"), [("simulate", 0), ("nothing", 2)])
def test_streams_that_were_closed_before_the_start_change_no_exit_code(tmp_path, verb, code):
    """Otherwise the next files that are opened take their numbers, and what is printed goes into these."""
    command = [sys.executable, "-m", "softness_bayes", *map(str, VERBS_THAT_PRINT[verb])]
    closed = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *command]
    done = subprocess.run(closed, cwd=tmp_path, env=ENVIRONMENT, timeout=120, check=False)
    assert done.returncode == code
    if verb == "simulate":
        assert (tmp_path / "simulated" / "ratings.csv").read_text().startswith("participant,")
