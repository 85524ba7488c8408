"""Tables in the shapes of laboratories' exports, beside the project: the numbers of the clean one, or a reason."""

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Compression, Fabrics, read_experiment
from softness_bayes.data.texts import identity
from support.paths import SHARED

CASES = SHARED / "cases"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="the cases lie beside the project only")

REFUSED = {
    "04/kes_pow_followed.csv": "are its numbers to be multiplied by 10^-4, or divided?",
    "04/kes_pow_times.csv": "are its numbers to be multiplied by 10^4, or divided?",
    "04/kes_pow_title.csv": "are its numbers to be multiplied by 10^-4, or divided?",
    "04/kes_x100.csv": "under 'Bending rigidity (10^-2 gf.cm2/cm)', 3 means 0.03",
    "04/kes_row2_deleted.csv": "it has no unit known here; write one, as in 'B (gf·cm²/cm)'",
    "10/ratings.feather": "not a Feather file that can be read",
    "10/ratings.pkl": "this is a pickle, which could run code",
    "10/ratings.sav": "SPSS",
    "12/bluehill_nounits.csv": "column 'Extension' is not read: it has no unit known here; write one",
    "14/no_trial.csv": "rows are copies of other rows",
    "14/no_trial_no_rt.csv": "rows are copies of other rows",
    "16/resolution_0.5.csv": "is no multiple of 0.5",
    "16/resolution_10.csv": "is no multiple of 10",
    "16/resolution_50.csv": "is no multiple of 50",
    "16/resolution_60.csv": "is no multiple of 60",
    "16/resolution_num.csv": "is no multiple of 1080",
    "18/custom_ids.xlsx": "got '#DIV/0!'; did a spreadsheet program turn a number into a date, or its formula fail?",
}
"""Case -> words of the reason for which it is refused."""

OTHER_NUMBERS = {"17/zscores.csv", "18/custom_ids_ok.xlsx"}
"""Cases with other numbers than those of the clean table."""


def files(*kinds):
    found = [path for path in sorted(CASES.glob("*/*")) if path.name != "fabrics.csv" and path.suffix != ".md"]
    return [pytest.param(path, id=f"{path.parent.name}/{path.name}") for path in found if kind(path) in kinds]


def kind(path):
    if path.name == "ratings.csv":
        return "ratings"
    folder = path.parent.name
    pressed = folder == "12" or path.name == "compression.csv"
    return "forces" if pressed else "fabrics" if folder in ("04", "05") or "fabrics" in path.name else "ratings"


def people(experiment):
    """What each person rated, whatever the person's name."""
    y, by = experiment.ratings, {}
    for p, f, k, value in zip(y.participant, y.fabric, y.load, y.rating, strict=True):
        by.setdefault(p, []).append((identity(y.fabrics[f]), round(y.loads[k].depth, 9), float(value)))
    return sorted(sorted(own) for own in by.values())


def reason(path):
    return REFUSED.get(f"{path.parent.name}/{path.name}")


@pytest.mark.parametrize("path", files("ratings"))
def test_ratings_are_those_of_the_clean_table_or_refused_with_the_reason(path):
    cloth = path.with_name("fabrics_num.csv" if path.name.startswith("fabric_") else "fabrics.csv")
    bare = path.parent.name == "02" or path.name == "google_forms.csv"
    given = {"indentation_mm": 1.0} if bare else {}
    if words := reason(path):
        with pytest.raises(InputError) as refusal:
            read_experiment(path, cloth, **given)
        assert words in str(refusal.value)
        return
    read = read_experiment(path, cloth, **given)
    clean = people(read_experiment(CASES / "00/ratings.csv", CASES / "00/fabrics.csv"))
    if path.name.startswith("fabric_"):
        names = dict(zip(read_experiment(CASES / "00/ratings.csv").fabrics.names, "123456", strict=True))
        clean = [sorted((identity(names[f[0]]), *rest) for f, *rest in own) for own in clean]
    if f"{path.parent.name}/{path.name}" in OTHER_NUMBERS:
        assert len(read.ratings) == sum(map(len, clean))
        return
    found = people(read)
    assert len(found) in (6, 3)
    # some cases hold one trial, one load or three people of the clean table
    for own in found:
        assert any(not remainder(own, whole) for whole in clean)


def remainder(some, whole):
    """What is left of some rows without those of a table, each as often as it is there."""
    left = list(whole)
    return [row for row in some if row not in left or left.remove(row)]


@pytest.mark.parametrize("path", files("fabrics"))
def test_rigidities_are_those_of_the_clean_table_or_refused_with_the_reason(path):
    if words := reason(path):
        with pytest.raises(InputError) as refusal:
            Fabrics.read(path)
        assert words in str(refusal.value)
        return
    if path.name == "fabrics_num.csv":
        return
    cloth = Fabrics.read(path)
    assert cloth.names == ("velvet", "jersey", "poplin", "twill", "denim", "canvas")
    mean = np.array([0.03, 0.06, 0.12, 0.2, 0.5, 1.1]) * 9.80665e-5
    both = any("geometric means over directions" in note for note in cloth.notes)
    np.testing.assert_allclose(cloth.bending_rigidity, mean * (np.sqrt(1.2 * 0.8) if both else 1.0), rtol=2e-3)


@pytest.mark.parametrize("path", files("forces"))
def test_forces_are_those_of_pressing_in(path):
    if words := reason(path):
        with pytest.raises(InputError) as refusal:
            Compression.read(path)
        assert words in str(refusal.value)
        return
    press = Compression.read(path)
    by = [np.diff(press.indentation[press.participant == k]) for k in range(len(press.participants))]
    assert all((step > 0).all() for step in by)
    if path.name.startswith("loop"):
        only = Compression.read(CASES / "12/loading_only.csv")
        np.testing.assert_array_equal(press.force, only.force)
