"""A calibration goes on from a stored one: its replicates are kept, and those of another problem are refused."""

import json
import shutil
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from softness_bayes.errors import InputError
from softness_bayes.results.request import Request
from softness_bayes.runs import calibration_files
from softness_bayes.runs.calibrate import calibrate
from softness_bayes.runs.calibrated import StoredReplicates
from softness_bayes.runs.calibration_files import EARLIER, MANIFEST, earlier_of
from softness_bayes.runs.calibration_scene import CalibrationScene
from softness_bayes.runs.replicate import replicate, true_values
from softness_bayes.sampler.sampling import Settings
from support.command_line import call, refused
from support.fake_scene import fake_posterior

CHAIN = {"b": 100.0, "m": 2.0, "alpha": 20.3, "beta": 0.6, "sigma_0": 9.0, "tau": 0.5, "varsigma": 0.3}
SHORT = Settings(ensembles=2, pilot=(10,), optima=1, round_steps=10, max_steps=30, processes=1)
LONGER = replace(SHORT, max_steps=40)


@dataclass(frozen=True)
class FakeCalibration(CalibrationScene):
    prior: str = ""

    def model(self, options):
        priors = {"gamma": self.prior} if self.prior else {}
        return SimpleNamespace(options=options, posterior=fake_posterior(fix=CHAIN, priors=priors))


def run(directory, count, settings=SHORT, scene=FakeCalibration(), earlier=None, seed=0):
    fitted = []
    request = Request().with_options(processes=1, seed=seed)
    show = lambda n, one: fitted.append(n)  # noqa: E731
    done = calibrate(scene, *request, count, directory, show, settings, earlier=earlier)
    done.save(directory)
    return done, len(fitted)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Four replicates in one go."""
    return run(tmp_path_factory.mktemp("whole") / "out", 4)[0]


@pytest.fixture
def stored(tmp_path):
    """The first two of them, as a stored result has them: settings and ranks alone."""
    run(tmp_path / "first", 2)
    (tmp_path / "stored").mkdir()
    for name in (MANIFEST, "ranks.csv"):
        shutil.copy(tmp_path / "first" / name, tmp_path / "stored")
    return tmp_path / "stored"


def test_a_stored_calibration_goes_on(stored, whole, tmp_path):
    """To the same replicates as without an interruption, although only the missing ones are fitted."""
    before = {path.name: path.read_bytes() for path in stored.iterdir()}
    done, fitted = run(tmp_path / "out", 4, earlier=stored)
    assert fitted == 2
    assert done.replicates == whole.replicates
    assert (done.earlier, "earlier" in done.sentence()) == ((), False)
    assert {path.name: path.read_bytes() for path in stored.iterdir()} == before
    # more of it than is asked for is kept as well
    fewer, fitted = run(tmp_path / "fewer", 1, earlier=stored)
    assert (fitted, [*fewer.replicates]) == (0, [0])
    assert run(tmp_path / "fewer", 2)[1] == 0


def test_replicates_of_other_fits_are_named_in_the_verdict(stored, whole, tmp_path):
    done, fitted = run(tmp_path / "out", 3, LONGER, earlier=stored)
    assert fitted == 1
    assert [done.replicates[k] for k in (0, 1)] == [whole.replicates[k] for k in (0, 1)]
    assert done.replicates[2] != whole.replicates[2]
    assert done.earlier == (StoredReplicates((0, 1), {"max_steps": "30"}),)
    said = "; 2 were fitted earlier with other settings of max_steps)"
    assert said in done.sentence()
    # neither a second call nor a third calibration forgets it
    again, fitted = run(tmp_path / "out", 3, LONGER, earlier=stored)
    assert (fitted, again.earlier) == (0, done.earlier)
    third, fitted = run(tmp_path / "third", 4, LONGER, earlier=tmp_path / "out")
    assert (fitted, third.earlier) == (1, done.earlier)
    fourth, _ = run(tmp_path / "fourth", 4, replace(LONGER, max_steps=50), earlier=tmp_path / "out")
    assert fourth.earlier == (
        StoredReplicates((0, 1), {"max_steps": "30"}),
        StoredReplicates((2,), {"max_steps": "40"}),
    )
    fifth, _ = run(tmp_path / "fifth", 3, SHORT, earlier=tmp_path / "out")
    assert fifth.earlier == (StoredReplicates((2,), {"max_steps": "40"}),)
    # without --from, other settings are refused as before, and the way out is named
    with pytest.raises(InputError, match=r"max_steps was 40 and is now 30.*--from"):
        run(tmp_path / "out", 3)


@pytest.mark.parametrize("written", [0, 1])
def test_a_crash_while_replicates_are_taken(stored, whole, tmp_path, monkeypatch, written):
    """Replicates that were listed but not written are fitted here, and no longer count as earlier ones."""
    write, left = calibration_files.write_replicate, [written]

    def killed(folder, index, one):
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        write(folder, index, one)

    monkeypatch.setattr(calibration_files, "write_replicate", killed)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "out", 3, LONGER, earlier=stored)
    monkeypatch.undo()
    assert earlier_of(tmp_path / "out") == (StoredReplicates((0, 1), {"max_steps": "30"}),)
    done, fitted = run(tmp_path / "out", 3, LONGER)
    assert fitted == 3 - written
    assert done.earlier == ((StoredReplicates((0,), {"max_steps": "30"}),) if written else ())
    assert (done.replicates[0] == whole.replicates[0]) == bool(written)
    # a call that takes them again instead
    again, fitted = run(tmp_path / "again", 3, LONGER, earlier=stored)
    assert (fitted, [one.replicates for one in again.earlier]) == (1, [(0, 1)])


def test_another_problem_is_refused(stored, tmp_path):
    for options, said in (
        ({"seed": 1}, r"seed was 0 and is now 1, so its replicates are of another problem"),
        ({"scene": FakeCalibration(participants=3)}, "participants was 20 and is now 3"),
        # the manifest of the fake scene does not show its prior: the true values do
        ({"scene": FakeCalibration(prior="lognormal(3,0.5)")}, "the true gamma of replicate 0 was"),
    ):
        with pytest.raises(InputError, match=said):
            run(tmp_path / said[:6], 3, earlier=stored, **options)
    settings = json.loads((stored / MANIFEST).read_text())
    (stored / MANIFEST).write_text(json.dumps({**settings, "noise": 7.0}))
    with pytest.raises(InputError, match=r"noise was 7\.0"):
        run(tmp_path / "noise", 3, earlier=stored)


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("ranks.csv", lambda text: text.replace("\n0,", "\nx,"), r"ranks\.csv, row 2: not a replicate"),
        ("ranks.csv", lambda text: text.replace("False", "perhaps", 1), r"ranks\.csv, row 2: not a replicate"),
        ("ranks.csv", lambda text: text.splitlines()[0] + "\n", "contains no finished replicate"),
        (MANIFEST, lambda text: text[:20], "not the file of a calibration"),
    ],
)
def test_damaged_results_are_refused(stored, tmp_path, name, change, said):
    (stored / name).write_text(change((stored / name).read_text()))
    with pytest.raises(InputError, match=said):
        run(tmp_path / "out", 3, earlier=stored)


def test_a_rank_beyond_the_draws_is_refused(stored, tmp_path):
    lines = (stored / "ranks.csv").read_text().splitlines()
    cells = lines[1].split(",")
    cells[lines[0].split(",").index("gamma")] = "100"
    (stored / "ranks.csv").write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]) + "\n")
    with pytest.raises(InputError, match="rank 100, expected 0 to 99"):
        run(tmp_path / "out", 3, earlier=stored)


def test_a_damaged_list_of_earlier_replicates(tmp_path):
    (tmp_path / EARLIER).write_text('[{"replicates": 3}]')
    with pytest.raises(InputError, match="not the list of earlier replicates"):
        earlier_of(tmp_path)


def test_true_values_are_those_of_the_fit():
    posterior = fake_posterior(fix=CHAIN)
    one = replicate(posterior, SHORT, 4, 7)
    assert true_values(posterior, 4, 7) == dict(zip(one.names, one.truth, strict=True))
    truths = posterior.space.draw_prior(np.random.default_rng(1), 5)
    like = replicate(posterior, SHORT, 4, 7, truths=truths)
    assert true_values(posterior, 4, 7, truths) == dict(zip(like.names, like.truth, strict=True))


def test_on_the_command_line(tmp_path):
    refused(call("calibrate", "--from", tmp_path / "no", "--out", tmp_path / "out"), "contains no calibration")
    refused(call("calibrate", "--from", tmp_path, "--finished", "--out", tmp_path / "out"), "--finished")
