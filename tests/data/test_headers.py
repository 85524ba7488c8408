"""Titles of columns from elsewhere: units in headers, names in several languages, and what is refused."""

from fractions import Fraction

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics, Ratings, read_experiment
from softness_bayes.data.columns import NAMES, SYNONYMS
from softness_bayes.data.titles import UNITS, analysed, key, unit_named
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.readings import MENDED
from support.refusals import refusal


def ratings(file, load, value="1", **options):
    return Ratings.read(file(f"participant,fabric,{load},rating\nP1,a,{value},5\n"), **options)


def cloth(file, title, value, **options):
    return Fabrics.read(file(f"fabric,{title}\na,{value}\n", "fabrics.csv"), **options)


# units


@pytest.mark.parametrize(
    ("title", "value", "load"),
    [
        ("Indentation [mm]", "2", Indentation(0.002)),
        ("indentation (µm)", "1500", Indentation(0.0015)),
        ("depth_um", "700", Indentation(0.0007)),
        ('"depth, cm"', "0.3", Indentation(0.003)),
        ("Depth in mm", "3", Indentation(0.003)),
        ("Depth [in]", "0.1", Indentation(0.00254)),
        ("押し込み量 [mm]", "1", Indentation(0.001)),
        ("force_gf", "100", Force(0.980665)),
        ("Contact force [g]", "100", Force(0.980665)),
        ("Normalkraft (N)", "1.5", Force(1.5)),
    ],
)
def test_loads_are_read_in_the_unit_of_their_header(file, title, value, load):
    read = ratings(file, title, value)
    assert read.loads == (load,)
    (note,) = read.notes
    assert "is read as indentation_mm" in note or "is read as force_n" in note
    converted = not any(unit in title for unit in ("mm", "(N)"))
    assert ("converted, 1 " in note) == converted


@pytest.mark.parametrize(
    ("title", "value", "field", "found"),
    [
        ("Young's modulus [GPa]", "0.25", "tensile_modulus", 2.5e8),
        ("E-Modul (N/mm²)", "3", "tensile_modulus", 3e6),
        ("youngs_modulus_Pa", "821000", "tensile_modulus", 821e3),
        ("thickness [µm]", "250", "thickness", 250e-6),
        ("厚さ(mm)", "0.25", "thickness", 250e-6),
    ],
)
def test_properties_are_read_in_the_unit_of_their_header(file, title, value, field, found):
    rest = "thickness_mm,0.3" if field == "tensile_modulus" else "tensile_modulus_mpa,2"
    name, other = rest.split(",")
    read = cloth(file, f"{title},{name}", f"{value},{other}")
    assert getattr(read, field).tolist() == [found]


def test_a_header_unit_beside_a_rename_is_converted_or_refused(file):
    columns = {"thickness_mm": "Thickness [µm]"}
    read = cloth(file, "Thickness [µm],tensile_modulus_mpa", "250,2", columns=columns)
    assert read.thickness.tolist() == [250e-6]
    assert "fabrics.csv: column 'Thickness [µm]': converted, 1 µm = 0.001 mm" in read.notes
    for unit in ("N", "furlong", "gf.cm2/cm"):
        title = f"Thickness [{unit}]"
        with pytest.raises(InputError, match=r"row 1, column 'Thickness \[.*\]': thickness_mm has the unit '.*' in"):
            cloth(file, f"{title},tensile_modulus_mpa", "250,2", columns={"thickness_mm": title})
    read = cloth(file, "Thickness (KES),tensile_modulus_mpa", "0.2,2", columns={"thickness_mm": "Thickness (KES)"})
    assert read.thickness.tolist() == [0.2e-3]
    assert any(
        "'KES' is not a unit, so the numbers are read in the unit of thickness_mm" in note for note in read.notes
    )


def test_cells_with_a_percent_sign_are_percentages(file):
    for title in ("effective_modulus_cv", "effective modulus cv (%)"):
        read = cloth(file, f"effective_modulus_kpa,{title}", "10,12.5 %")
        assert read.effective_modulus_cv.tolist() == [0.125]
    with pytest.raises(InputError, match="expected a finite number, got '5%'"):
        Ratings.read(file("fabric,force_n,rating\na,1,5%\n"))


def test_factors_are_exact():
    inch, pound = Fraction("0.0254"), Fraction("4.4482216152605")
    psi = unit_named("psi", "pressure")
    assert abs(Fraction(psi.factor) / (pound / inch**2) - 1) < Fraction(1, 10**40)
    gram = Fraction("9.80665e-3")
    for text, exact in (("gf·cm²/cm", gram / 100), ("mg·cm", gram / 10**5), ("gf.cm2/cm", gram / 100)):
        assert Fraction(unit_named(text, "rigidity").factor) == exact
    for quantity, units in UNITS.items():
        spelt = [text for texts in units.values() for text in texts]
        assert len(set(spelt)) == len(spelt)
        for texts in units.values():
            assert {unit_named(text, quantity).name for text in texts} == {texts[0]}
    assert unit_named("mpa", "pressure").name == "MPa"
    assert unit_named("nm", "length").name == "nm"
    assert unit_named("Nm", "rigidity").name == "N·m"


@pytest.mark.parametrize("title", ["E_bar", "depth_in", "trial 1", "m", "E" * 3000, "(" * 150 + " " * 40])
def test_words_that_are_no_units(title):
    assert analysed(title).unit is None


# names


def test_every_name_stands_for_one_column():
    assert set(SYNONYMS) <= {*NAMES}
    standard = {key(analysed(name).stem): name for name in NAMES}
    owner: dict[str, str] = {}
    for name, others in SYNONYMS.items():
        for other in others:
            assert owner.setdefault(key(other), name) == name, other
            assert standard.get(key(other), name) == name, other


@pytest.mark.parametrize(
    "header",
    [
        "subject;material;softness;Indentation [mm]",
        "Versuchsperson;Stoff;Weichheit;Eindringtiefe [mm]",
        "被験者;布;柔らかさ;押し込み量 (mm)",
        "subject_id;sample;Rating (0-100);depth_mm",
    ],
)
def test_tables_in_several_languages_are_read_and_every_name_is_said(file, header):
    read = Ratings.read(file(f"{header}\n01;b;5;1\n2;a;6;2\n"))
    assert read.participants == ("01", "2")
    assert read.fabrics == ("a", "b")
    assert read.rating.tolist() == [5, 6]
    assert read.loads == (Indentation(0.001), Indentation(0.002))
    assert [note.rpartition(" ")[2] for note in read.notes] == ["participant", "fabric", "indentation_mm", "rating"]


def test_two_columns_that_may_be_the_same_are_refused_with_what_decides(file):
    path = file("fabric,force_n,softness,magnitude\na,1,2,3\n")
    assert refusal(Ratings.read, path) == (
        f"{path}: row 1: columns 'softness', 'magnitude' may each be 'rating'; choose one with "
        "--column rating='softness' or --column rating='magnitude'"
    )
    assert Ratings.read(path, columns={"rating": "magnitude"}).rating.tolist() == [3]


def test_the_proper_name_comes_first_and_other_columns_stay_unused(file):
    read = Ratings.read(file("fabric,force_n,rating,softness,depth [mm],subject\na,1,2,9,1,P1\n"))
    assert (read.rating.tolist(), read.loads, read.participants) == ([2], (Force(1.0),), ("P1",))
    assert read.notes[1] == "ratings.csv: unused columns: softness, depth [mm]"


def test_of_two_loads_in_every_row_the_user_takes_one(file):
    path = file("fabric,depth [mm],force [N],rating\na,1,2,5\nb,2,3,6\n")
    assert refusal(Ratings.read, path) == (
        f"{path}: every row has an indentation and a force, expected one load; remove the column that was measured "
        "rather than controlled ('depth [mm]' or 'force [N]')"
    )
    assert Ratings.read(path, columns={"force_n": "force [N]"}).loads == (Force(2.0), Force(3.0))


def test_a_title_without_a_unit_is_not_guessed(file):
    message = refusal(ratings, file, "Indentation")
    assert "no load column" in message
    assert message.endswith(
        "; column 'Indentation' is not read: it has no unit known here; write one, as in 'Indentation (mm)'"
    )
    assert ratings(file, "Indentation", columns={"indentation_mm": "Indentation"}).loads == (Indentation(0.001),)


def test_a_measured_modulus_by_its_own_name_leaves_others_unread(file):
    read = cloth(file, "effective_modulus_kpa,B (gf.cm2/cm),E (MPa)", "10,0.1,2")
    assert read.basis == ("effective_modulus_kpa",)
    assert np.isnan(read.bending_rigidity).all()
    assert any("unused columns" in note for note in read.notes)


def test_properties_in_ratings_are_sought_where_there_is_no_other_table(file):
    path = file("subject,fabric,force_n,rating,E (MPa),Dicke [mm]\nP1,a,1,2,3,0.4\n")
    found = read_experiment(path).fabrics
    assert (found.tensile_modulus.tolist(), found.thickness.tolist()) == ([3e6], [0.4e-3])
    file("fabric,effective_modulus_kpa\na,10\n", "fabrics.csv")
    assert read_experiment(path).fabrics.basis == ("effective_modulus_kpa",)


def test_a_rigidity_by_another_name_goes_before_a_tensile_modulus_too(tmp_path):
    made = []
    for title, row in (("bending_rigidity_n_m", "a,2,0.2,0.2,1.96e-6"), ("B (gf.cm2/cm)", "a,2,0.2,0.2,0.02")):
        (tmp_path / "f.csv").write_text(f"fabric,tensile_modulus_mpa,thickness_mm,poisson_ratio,{title}\n{row}\n")
        made.append(Fabrics.read(tmp_path / "f.csv"))
    named, spelt = (one.modulus(MENDED.fabric_modulus) for one in made)
    np.testing.assert_allclose(spelt, named, rtol=1e-2)
    assert "B (gf.cm2/cm)" in " ".join(made[1].notes)
