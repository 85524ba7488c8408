"""Each rule for odd tables: a table that it understands, one that it refuses, and one like it that it leaves alone."""

import gzip
import json
import zipfile

import numpy as np
import pandas as pd
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Compression, Fabrics, Ratings, ratings_csv, read_experiment
from softness_bayes.data.columns import is_reversed
from softness_bayes.data.reading import COLUMNS, CONTENTS, ROWS
from softness_bayes.data.texts import identity
from softness_bayes.touch.contact import Indentation
from support.command_line import call
from support.refusals import refusal

HEAD = "participant,fabric,indentation_mm,trial,rating\n"
PLAIN = "".join(
    f"P{p},{f},1,{t},{p * (3 + k) + 0.25 * t}\n" for p in (1, 2, 3, 4) for k, f in enumerate("abc") for t in (1, 2)
)
BARE = "".join(f"P{p},{f},1,{p * (3 + k)}.5\n" for p in (1, 2, 3, 4) for k, f in enumerate("abc"))
CLOTH = "fabric,effective_modulus_kpa\na,20\nb,90\nc,300\n"
PRESS = "participant,indentation_mm,force_n\n"
LOOP = "".join(
    f"P1,{d},{f}\n" for d, f in [(0.5, 0.1), (1, 0.3), (1.5, 0.6), (2, 1), (1.5, 0.5), (1, 0.2), (0.5, 0.05)]
)


def wide(*more, names="abc"):
    rows = ["participant," + ",".join(f"{f} 1 mm" for f in names)]
    numbers = np.array([[3.1, 5.2, 9.4], [4.7, 4.4, 8.8], [2.2, 6.1, 7.3], [3.6, 7.9, 9.9]])
    rows += [f"P{k}," + ",".join(map(str, own)) for k, own in enumerate(numbers, 1)]
    return "\n".join([*rows, *more]) + "\n"


MEANS = "3.4,5.9,8.85"

RATED = {
    "lines above the header": (
        f"# lab A, 2024\nMade by,X\n# {HEAD}{PLAIN}",
        "lines above the header in row 3 are left out: '# lab A 2024', 'Made by X'",
    ),
    "remarks below": (f"{HEAD}{PLAIN}\nNote: P3 was ill\n", "lines below the table are left out: 'Note: P3 was ill'"),
    "several rows of titles": (
        f"{HEAD.replace('indentation_mm', 'Depth')},,(mm),#,0-100\n{PLAIN}",
        "the second row contains units",
    ),
    "repeated headers": (
        (HEAD + PLAIN).replace("P3,a,1,1", f"# a break\nSession 2\n{HEAD}P3,a,1,1"),
        "repeated headers, dashes and comments are left out: '# a break', 'Session 2', 'participant fabric",
    ),
    "units in cells": (
        (HEAD + PLAIN).replace("indentation_mm", "depth").replace(",1,1,", ",1 mm,1,").replace(",1,2,", ",1000 µm,2,"),
        "units are read in the cells of column 'depth'",
    ),
    "practice": (
        HEAD.replace("\n", ",phase\n") + f"P1,a,1,1,99,practice\n{PLAIN}".replace("5\n", "5,main\n"),
        "row 2: practice by column 'phase', left out",
    ),
    "several attributes or groups": (
        f"{HEAD[:-1]},attribute\n{PLAIN}".replace("5\n", "5,softness\n") + PLAIN.replace("5\n", "5,warmth\n"),
        "rows 26 to 49: column 'attribute' names another attribute than softness, left out",
    ),
    "JSON in cells": (
        HEAD.replace("rating", "response") + "".join(f'P1,{f},1,1,"{{""Q0"":""{y}""}}"\n' for f, y in ("a2", "b3")),
        "column 'response': its cells are JSON, of which 'Q0' is read",
    ),
    "percentages": ((HEAD + PLAIN).replace("5\n", "5%\n"), "ratings are percentages, so 3.25% is read as 3.25"),
    "people in columns": ("fabric,indentation_mm,P01,P02\na,1,2,3\nb,1,4,5\n", "one column per participant: P01, P02"),
    "fabrics in columns": ("participant,How soft? [a],How soft? [b]\nP1,2,3\nP2,4,5\n", "one column per fabric"),
    "choices": (
        "participant,indentation_mm,stim_left,stim_right,chosen\nP1,1,a,b,a\nP1,1,b,c,right\n",
        "columns 'stim_left', 'stim_right' are pairs of fabrics, of which 'chosen' names the softer one",
    ),
    "rows of a survey": (
        'PROLIFIC_PID,Q3_1,Q3_2\nWho?,How soft? - a,How soft? - b\n"{""ImportId"":""x""}","{""ImportId"":""y""}",z\n'
        "P1,2,3\nP2,4,5\n",
        "rows of questions and import codes below the header are left out",
    ),
    "rows of statistics": (wide(f"Mittelwert,{MEANS}", "SD,1,1,1"), "rows 6 to 7: statistics of other rows"),
    "names of one identity": ((HEAD + PLAIN).replace("P1,c,1,2", "p-01,c,1,2"), "'P1' and 'p-01' are read as the same"),
    "copied rows": (f"{HEAD}{PLAIN}{PLAIN}", "rows 26 to 49: copies of other rows, with the same trial, left out"),
    "marked rows": (
        f"{HEAD[:-1]},excluded\n{PLAIN}".replace("5\n", "5,no\n").replace("12.25,no", "12.25,yes"),
        "looks wrong: column 'excluded' marks rows 16, 20, which are read all the same",
    ),
    "copied people": (
        HEAD
        + PLAIN.partition("P4")[0]
        + PLAIN.partition("P4")[0].partition("P3")[2].join(("P3", "")).replace("P3", "Q"),
        "looks wrong: participant 'Q' has the ratings of participant 'P3': are rows copied?",
    ),
    "steps of other numbers": (
        HEAD.replace("\n", ",resolution\n") + PLAIN.replace("\n", ",1920x1080\n"),
        "column 'resolution' is not used: its cells, such as '1920x1080', are not numbers",
    ),
}
MADE = {
    "several rows of titles": (
        "fabric,B,T0 (mm)\n,µN·m,mm\na,3,1\nb,5,1\n",
        "the second row contains units",
        "bending_rigidity",
    ),
    "plus-minus": ("fabric,B (µN·m)\na,3 ± 1\nb,5 (± 0.2)\n", "the numbers behind ± are not used", "bending_rigidity"),
    "no title of names": (",E_fab (kPa)\na,3\nb,5\n", "the first column has no title", "effective_modulus"),
    "directions side by side": (
        "fabric,B-1 (µN·m),B-2 (µN·m)\na,9,1\nb,25,1\n",
        "of two directions",
        "bending_rigidity",
    ),
}
PRESSED = {
    "reversed signs": (PRESS + "1,-0.5,-0.1\n1,-1,-0.3\n1,-1.5,-0.6\n", "read with the sign reversed", 3),
    "noise about zero": (PRESS + "1,0.1,-0.002\n1,0.5,0.1\n1,1,0.3\n", "row 2: forces just below 0, noise", 2),
    "codes for missing numbers": (
        PRESS + "1,0.5,0.1\n1,1,0.3\n1,2,99\n",
        "99 looks like a code for a missing number",
        3,
    ),
    "copied measurements": (
        PRESS + "1,1,0.3\n1,1,0.3\n1,2,0.9\n1,2,0.9\n",
        "rows 2 to 5: every one is there again, equal in all columns: are rows copied?",
        4,
    ),
    "way back": (PRESS + LOOP, "rows 6 to 8: the plate moves back there", 4),
}
REFUSED = {
    "several attributes or groups": (
        f"{HEAD[:-1]},site\n{PLAIN}".replace("5\n", "5,A\n") + PLAIN.replace("5\n", "7,B\n"),
        "participant 'P1' has 'A', 'B' in column 'site': give each person a name of their own, such as 'A-P1'",
    ),
    "unknown people": (
        (HEAD + PLAIN).replace("participant", "who"),
        "18 rows repeat a fabric and load, and column 'who' tells them apart: is it the participant?",
    ),
    "steps of other numbers": (
        HEAD.replace("\n", ",resolution\n") + PLAIN.replace("\n", ",1080\n"),
        "the rating 3.25 in row 2 is no multiple of 1080",
    ),
    "copied rows": (
        "participant,fabric,indentation_mm,rating\n" + BARE + BARE,
        "12 rows are copies of other rows (rows 14 to 25): remove them",
    ),
    "names of one identity": (
        (HEAD + PLAIN).replace("P2", "p1"),
        "'P1' and 'p1' differ only in case, zeros in front, the format of numbers, punctuation or invisible characters",
    ),
    "rows of statistics": (
        wide("P5,3.400,5.900,8.850"),
        "all ratings of participant 'P5' are the mean of those of the others",
    ),
}
ALONE = {
    "lines above the header": (HEAD + PLAIN).replace("P1", "#1"),
    "remarks below": f"{HEAD}{PLAIN}P5\n",
    "several rows of titles": "participant,fabric,indentation_mm,unit,rating\nm,a,1,mm,1\nP1,b,1,mm,2\n",
    "JSON in cells": (HEAD + PLAIN).replace("P1", "{P1}"),
    "repeated headers": HEAD + PLAIN + PLAIN.replace("P", "fabric P"),
    "units in cells": HEAD.replace("\n", ",unit\n") + PLAIN.replace("5\n", "5,cm\n"),
    "practice": HEAD.replace("\n", ",phase\n") + PLAIN.replace("5\n", "5,practice\n"),
    "percentages": (HEAD + PLAIN).replace("participant", "subject %"),
    "several attributes or groups": HEAD.replace("\n", ",group\n")
    + "".join(f"{row},{'softness' if row < 'P3' else 'warmth'}\n" for row in PLAIN.splitlines()),
    "rows of statistics": wide("P5,3.4,5.9,8.8", "Max,3,6,9"),
    "names of one identity": (HEAD + PLAIN).replace("P1", "A'").replace("P2", "A"),
    "copied rows": "participant,fabric,indentation_mm,rating\n"
    + "".join(f"P1,{f},1,{y}\n" for f, y in ("a5", "a5", "b7", "b6")),
    "unknown people": "fabric,indentation_mm,trial,rating,rt\na,1,1,5,0.31\na,1,2,6,0.27\nb,1,1,7,0.9\n",
    "steps of other numbers": HEAD.replace("\n", ",resolution\n") + PLAIN.replace("\n", ",0.25\n"),
    "marked rows": HEAD.replace("\n", ",finished\n") + PLAIN.replace("5\n", "5,1\n"),
    "copied people": "participant,fabric,indentation_mm,rating\nP1,a,1,3\nP1,b,1,4\nP2,a,1,3\nP2,b,1,4\n",
}


def read(file, text):
    return read_experiment(
        file(text),
        file(CLOTH, "fabrics.csv"),
        **({} if " mm" in text or "_mm" in text or "Depth" in text else {"force_n": 1.0}),
    ).ratings


def rows(ratings):
    names = [identity(ratings.participants[p]) for p in ratings.participant]
    told = zip(names, ratings.fabric, ratings.rating, strict=True)
    return sorted((name, ratings.fabrics[f], float(y)) for name, f, y in told)


def test_every_rule_is_tried():
    named = {rule.name for rule in (*ROWS, *COLUMNS, *CONTENTS)}
    assert named == RATED.keys() | MADE.keys() | PRESSED.keys() | REFUSED.keys()


@pytest.mark.parametrize("name", RATED)
def test_ratings_are_understood_and_it_is_said(file, name):
    text, said = RATED[name]
    found = read(file, text)
    assert [note for note in found.notes if said in note], found.notes
    if "P4" in text and "2024" not in text:
        clean = wide() if "mm,b 1" in text else HEAD + PLAIN
        assert rows(found) == rows(read(file, clean))


@pytest.mark.parametrize("name", MADE)
def test_fabrics_are_understood_and_it_is_said(file, name):
    text, said, field = MADE[name]
    found = Fabrics.read(file(text))
    assert [note for note in found.notes if said in note], found.notes
    unit = 1e3 if field == "effective_modulus" else 1e-6
    np.testing.assert_allclose(getattr(found, field) / unit, [3.0, 5.0], rtol=1e-12)


@pytest.mark.parametrize("name", PRESSED)
def test_forces_are_understood_and_it_is_said(file, name):
    text, said, count = PRESSED[name]
    found = Compression.read(file(text))
    assert [note for note in found.notes if said in note], found.notes
    assert len(found) == count
    assert (np.diff(np.unique(found.indentation) if "copied" in name else found.indentation) > 0).all()


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_two_meanings_is_refused(file, name):
    text, said = REFUSED[name]
    assert said in refusal(read, file, text)


@pytest.mark.parametrize("name", ALONE)
def test_tables_like_them_are_left_alone(file, name):
    """Negative controls: no row is left out, and no note of the rule is made."""
    text = ALONE[name]
    found = read(file, text)
    said = {**RATED, **REFUSED}[name][1]
    assert not [note for note in found.notes if said in note]
    cells = sum(line.count(",") for line in text.splitlines()[1:]) if "a 1 mm" in text else text.count("\n") - 1
    assert len(found) + found.n_missing == cells


WRONG = {
    "reversed scales": (
        (HEAD + PLAIN).replace("rating", "hardness"),
        "column 'hardness' seems to be higher for harder, but ratings must be higher for softer; reverse them",
    ),
    "of two numbers": (
        wide("x1,3.400,5.900,8.850", "x2,1.02,1.49,1.14"),
        "all ratings of participant 'x1' are the mean",
    ),
    "an attribute": (
        f"{HEAD[:-1]},attribute\n{PLAIN}".replace("5\n", "5,thick\n") + PLAIN.replace("5\n", "5,warm\n"),
        "column 'attribute' has 'thick', 'warm' for one touch of one participant: keep only the rows that",
    ),
    "a day": ((HEAD + PLAIN).replace(",3.25", ",45415"), "45415 looks like the day 2024-05-03, which a spreadsheet"),
    "a footnote": (
        (HEAD + PLAIN).replace(",3.25", ",3²"),
        "row 2, column 'rating': expected a finite number, got '3²'",
    ),
    "a numbered title": (
        HEAD.replace("\n", ",rating.1\n") + PLAIN.replace("5\n", "5,7\n"),
        "columns 'rating', 'rating.1' may each be 'rating'; put them below each other, or choose one with --column",
    ),
    "people under a sign": ((HEAD + PLAIN).replace("participant", "#"), "column '#' tells them apart"),
    "a turned table": (
        "participant,P1,P1,P2\nfabric,a,b,a\nrating,3,4,5\n",
        "2 columns are called 'p1', expected one; its titles stand below each other: transpose it in a spreadsheet",
    ),
    "a unit of something else": (
        HEAD.replace("indentation_mm", "Load (mm)") + PLAIN,
        "column 'Load (mm)' is not read: its unit mm does not fit force_n; write the unit that its numbers have, or "
        "convert them, as to 'Load (N)'",
    ),
    "an unknown unit": (
        HEAD.replace("indentation_mm", "depth (turns)") + PLAIN,
        "column 'depth (turns)' is not read: 'turns' is no unit known here; convert its numbers, as to 'depth (mm)'",
    ),
}
LEFT = {
    "practice of a loop": HEAD.replace("\n", ",practice.thisN\n") + f"P1,a,1,1,9,0\n{PLAIN}".replace("5\n", "5,\n"),
    "people without a title": (HEAD + PLAIN).replace("participant", ""),
    "a preview": HEAD.replace("\n", ",Status\n") + f"P9,a,1,1,9,Survey Preview\n{PLAIN}".replace("5\n", "5,0\n"),
    "numbers of people": f"{HEAD}{PLAIN}n = 4,,,,24\n",
    "quartiles": wide("Q1,2.875,5.000,8.425"),
    "variances": wide("Varianz,1,1,1", "Range,2,2,2"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_would_be_misread_is_refused(file, name):
    text, said = WRONG[name]
    assert said in refusal(Ratings.read, file(text))  # without a table of fabrics, whose names could tell


@pytest.mark.parametrize("name", LEFT)
def test_rows_that_nobody_rated_are_left_out(file, name):
    clean = wide() if " mm" in LEFT[name] else HEAD + PLAIN
    assert rows(read(file, LEFT[name])) == rows(read(file, clean))


# names of columns and units


@pytest.mark.parametrize(
    ("title", "value"),
    [
        ("modulus effective [MPa]", 0.003),
        ("E_fab (10^-3 MPa)", 3.0),
        ("E_fab [×10⁻³ MPa]", 3.0),
        ("E_fab (kPa x 10^2)", 0.03),
        ("E_fab (10-3 MPa)", 3.0),
    ],
)
def test_words_and_units_in_any_order_and_powers_of_ten_in_units(file, title, value):
    found = Fabrics.read(file(f"fabric,{title}\na,{value}\n"))
    np.testing.assert_allclose(found.effective_modulus, [3e3], rtol=1e-12)


def test_limits_and_rigidities_with_the_unit_among_the_words(file):
    found = Fabrics.read(file("fabric,effective_modulus_kpa_low,effective_modulus_kpa_high\na,1,4\n"))
    assert (found.effective_modulus_low.tolist(), found.effective_modulus_high.tolist()) == ([1e3], [4e3])
    for title in ("bending_rigidity_gfcm2_cm", "B (gf.cm^2/cm)", "Bending rigidity, B (gf·cm²/cm)"):
        assert Fabrics.read(file(f"fabric;{title}\na;0.1\n")).bending_rigidity.tolist() == [9.80665e-6]


@pytest.mark.parametrize(
    "title", ["E_fab x 10^2 (kPa)", "E_fab ×10⁴ [kPa]", "E_fab [10^-4 kPa] (kPa)", "E_fab/1000 (kPa)"]
)
def test_powers_of_ten_in_titles_are_refused_with_or_without_a_rename(file, title):
    path = file(f"fabric,{title}\na,3\n")
    for columns in ({}, {"effective_modulus_kpa": title}):
        assert "are its numbers to be multiplied by" in refusal(Fabrics.read, path, columns=columns)


def test_thickness_beside_a_rigidity_is_said_not_to_be_used(file):
    for title in ("thickness_mm", "Dicke [mm]"):
        notes = Fabrics.read(file(f"fabric,bending_rigidity_n_m,{title}\na,1e-5,0.5\n")).notes
        assert any(f"{title} is not used where a rigidity D is measured: by the printed" in note for note in notes)


def test_a_column_that_follows_the_fabric_or_counts_rows_names_nobody(file):
    codes = "".join(f"x{f},{f},1,5.{k}\n" for k, f in enumerate("abc"))
    assert read(file, f"code,fabric,indentation_mm,rating\n{codes}").participants == ("participant",)
    two = (HEAD + PLAIN).replace("participant", "ID").replace("trial", "Name")
    assert "columns 'ID', 'Name' may each be the participant; choose one" in refusal(read, file, two)
    blind = (HEAD + PLAIN).replace("participant", "Participant Private ID").replace("trial", "Participant Public ID")
    assert len(read(file, blind.replace(",1,2,", ",1,1,")).participants) == 4


def test_a_hint_is_tried_before_it_is_given(file):
    """The command line prints options only with which the table is read; in N m, 0.03 is the rigidity of a board."""
    ratings = file((HEAD + PLAIN).replace("rating", "feel"), "feel.csv")
    file(CLOTH, "fabrics.csv")
    assert call("check", "--data", ratings).stderr.endswith(f"check --data {ratings} --column rating=feel\n")
    whole = file(HEAD + PLAIN)
    for values, mends in (("a,0.03\nb,0.5\nc,2", False), ("a,3e-6\nb,5e-6\nc,9e-6", True)):
        cloth = file(f"fabric,B\n{values}\n", "cloth.csv")
        advice = call("sample", "--data", whole, "--fabrics", cloth, "--out", cloth.parent / "out").stderr
        assert advice.rstrip().endswith("--column bending_rigidity_n_m=B") == mends


@pytest.mark.parametrize(
    ("title", "reversed_"),
    [
        ("hardness", True),
        ("Rating (1 = soft, 7 = hard)", True),
        ("softness (soft - hard)", True),
        ("Softness [hard-soft]", False),
        ("softness 7: very soft, 1: very hard", False),
        ("Weichheit", False),
        # ends may be negated, or alone
        ("softness (1 = very soft, 7 = not at all soft)", True),
        ("softness (1 = not soft, 7 = very soft)", False),
        ("softness (1 = least soft, 7 = most soft)", False),
        ("Bewertung (1 = sehr weich)", True),
        ("Bewertung (7 = sehr weich)", False),
        ("softness (1 = very hard)", False),
        ("柔らかさ (1=柔らかい, 7=硬い)", True),
        ("柔らかさ (1=硬い, 7=柔らかい)", False),
    ],
)
def test_titles_of_reversed_scales(title, reversed_):
    assert is_reversed(title) is reversed_


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("fabric,indentation_mm,Ada,Bo", "no column 'rating'; if its columns are people, call them P1, P2, …"),
        ("participant,a_1,a_2,b_1", "if they are loads, write the unit, as in 'a_1 mm'"),
        ("participant,cloth,indentation_mm,rating", "'2' is not a fabric of"),
        ("fabric,indentation_mm,stiffness", "seems to be higher for harder"),
    ],
)
def test_messages_say_what_mends_and_give_no_hint_that_misreads(file, header, said):
    message = refusal(read, file, f"{header}\n1,2,3,4\n".replace(",4", "" if header.count(",") < 3 else ",4"))
    assert said in message
    assert "try:" not in message


# names of one identity


@pytest.mark.parametrize(
    ("one", "two", "same"),
    [
        ("1", "1.0", True),
        ("01", "1", True),
        ("judge 3", "Judge 3.00", True),
        ("P1", "p-01", True),
        ("T-shirt", "Tshirt", True),
        ("P1", "P\u200b1", True),
        ("A 1/2", "A 12", False),
        ("-4", "4", False),
        ("P٣", "P٤", False),
    ],
)
def test_identities_of_names(one, two, same):
    assert (identity(one) == identity(two)) == same


def test_names_are_joined_within_and_between_tables(file):
    mixed = PLAIN.replace("P1,", "1,", 3).replace("P1,", "1.0,").replace("P", "")
    cloth = file("fabric,effective_modulus_kpa\nA,20\nB,90\nC,300\n", "cloth.csv")
    forces = file(PRESS + "01,1,0.5\n05,1,0.4\n", "forces.csv")
    found = read_experiment(file(HEAD + mixed), cloth, compression_path=forces)
    assert found.ratings.participants == ("1", "2", "3", "4")
    assert found.ratings.fabrics == ("A", "B", "C")
    assert found.compression.participants == ("1", "05")
    for said in ("'1' and '1.0' are read as the same", "'a' as 'A', 'b' as 'B', 'c' as 'C'", "'01' as '1'"):
        assert any(said in note for note in found.notes), found.notes
    twice = file("fabric,effective_modulus_kpa\na,20\nA,90\n", "twice.csv")
    assert "'A' and 'a' differ only in case" in refusal(Fabrics.read, twice)


def test_people_of_an_unknown_title_in_several_spellings_are_asked_for(file):
    names = ("1", "01", "1", "2", "2", "2", "3", "3.0", "3")
    rows = "".join(f"{who},{fabric},1,{k}.5\n" for k, (who, fabric) in enumerate(zip(names, "abcabcabc", strict=True)))
    assert "column 'who' tells them apart" in refusal(read, file, f"who,fabric,indentation_mm,rating\n{rows}")


def test_repeats_survive_a_file(file):
    """Equal ones too, which without numbers of trials would be taken for copies."""
    both = "".join(line.replace(",1,", f",1,{t},", 1) + "\n" for t in (1, 2) for line in BARE.splitlines())
    found = Ratings.read(file(HEAD + both))
    again = Ratings.read(file(ratings_csv(found), "again.csv"))
    assert again.rating.tolist() == found.rating.tolist()
    assert len(again) == 24


def test_repeats_on_a_coarse_scale_are_read_and_copied_blocks_refused(file):
    random = np.random.default_rng(12)
    latent = random.normal(0, 1.2, (6, 1)) + random.normal(0, 1.2, (1, 24))
    first, second = (np.clip(np.round(4 + latent + random.normal(0, 0.6, (6, 24))), 1, 7) for _ in range(2))

    def text(*sessions):
        rows = [(p, k, y[p, k]) for y in sessions for p in range(6) for k in range(24)]
        lines = [f"P{p},f{k // 2},{1 + k % 2},{value:g}" for p, k, value in rows]
        return "\n".join(["participant,fabric,indentation_mm,rating", *lines]) + "\n"

    assert np.mean(first == second) > 0.3
    assert len(Ratings.read(file(text(first, second)))) == 288
    second[2] = first[2]
    assert "rows are copies of other rows" in refusal(Ratings.read, file(text(first, second)))


# files


def frame():
    return pd.read_csv(pd.io.common.StringIO(HEAD + PLAIN))


FILES = {
    "a.json": lambda path: frame().to_json(path, orient="records"),
    "b.jsonl": lambda path: frame().to_json(path, orient="records", lines=True),
    "c.json": lambda path: frame().to_json(path, orient="split", index=False),
    "d.json": lambda path: path.write_text(json.dumps(frame().to_dict("list"))),
    "e.feather": lambda path: frame().to_feather(path),
    "e.parquet": lambda path: frame().to_parquet(path),
    "indexed.parquet": lambda path: frame().set_index("fabric").to_parquet(path),
    "f.dta": lambda path: frame().astype({"fabric": "category"}).to_stata(path, write_index=False),
    "g.csv": lambda path: path.write_bytes(gzip.compress((HEAD + PLAIN).encode())),
    "h.csv.xz": lambda path: frame().to_csv(path, index=False),
    "i.csv.zip": lambda path: frame().to_csv(path, index=False),
    "j.txt": lambda path: path.write_text((HEAD + PLAIN).replace(",", " ")),
    "k.txt": lambda path: path.write_text((HEAD + PLAIN).replace(",", "|")),
    "l.csv": lambda path: (
        frame().to_excel(path.with_suffix(".xlsx"), index=False) or path.with_suffix(".xlsx").rename(path)
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_files_are_recognised_by_their_first_bytes(file, tmp_path, name):
    for module in ("pyarrow", "openpyxl"):
        pytest.importorskip(module)
    FILES[name](tmp_path / name)
    assert rows(Ratings.read(tmp_path / name)) == rows(Ratings.read(file(HEAD + PLAIN)))


def test_spss_files_are_read_with_their_labels(file, tmp_path):
    spss = pytest.importorskip("pyreadstat")
    coded = frame().assign(fabric=frame().fabric.map({"a": 1.0, "b": 2.0, "c": 3.0}))
    spss.write_sav(coded, str(tmp_path / "r.sav"), variable_value_labels={"fabric": {1.0: "a", 2.0: "b", 3.0: "c"}})
    assert rows(Ratings.read(tmp_path / "r.sav")) == rows(Ratings.read(file(HEAD + PLAIN)))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\x80\x05\x95", "this is a pickle, which could run code"),
        (b"<!DOCTYPE html>", "this is a web page"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0", "this is an old workbook: save it as .xlsx"),
        (b"PK\x03\x04 junk", "not a workbook that can be read"),
        (b"PAR1 junk", "not a Parquet file that can be read"),
        (b"\x1f\x8b\x08\0", "a compressed file that cannot be unpacked"),
        (b"version https://git-lfs.github.com/spec/v1", "this is a pointer to a file that is not downloaded"),
        (gzip.compress(b"X\n\0\0\0\3", mtime=0), "this is a file of R"),
        (b'{"a": 1}', "JSON, expected a list of records"),
    ],
)
def test_other_files_are_named(file, content, said):
    path = file(content)
    assert said in refusal(Ratings.read, path)


def test_an_archive_of_several_files_and_a_bomb_are_refused(tmp_path):
    path = tmp_path / "r.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.csv", "x")
        archive.writestr("b.csv", "x")
    assert "an archive of 2 files" in refusal(Ratings.read, path)
    path.write_bytes(gzip.compress(bytes(2**28 + 10)))
    assert "unpacks to more than 256 MB" in refusal(Ratings.read, path)


def test_a_sheet_for_each_person_is_stacked_and_shown_names_are_read(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for k, name in enumerate(("Ada", "Bo", "Mean")):
        sheet = book.active if not k else book.create_sheet()
        sheet.title = name
        for row in (("fabric", "indentation_mm", "rating"), (1, 1, 2.5 + k), (2, 1, 0.04)):
            sheet.append(row)
        sheet["A2"].number_format = sheet["A3"].number_format = '"cloth "00'
        sheet["C3"].number_format = "0.0"
    book.save(tmp_path / "r.xlsx")
    found = Ratings.read(tmp_path / "r.xlsx")
    assert (found.participants, found.fabrics) == (("Ada", "Bo"), ("cloth 01", "cloth 02"))
    assert found.loads == (Indentation(1e-3),)
    assert any("sheets of statistics are left out: Mean" in note for note in found.notes)


def test_no_traceback_for_any_cell_of_any_table(file):
    """Odd cells in every place end in a table or a message."""
    for text in ("{", "{}", '{"a":1}', "3 ± 4", "%", "#", "Mean", "1e999", "[", "\u0660"):
        lines = (HEAD + PLAIN).splitlines()
        for i in range(4):
            for j in range(5):
                cells = [line.split(",") for line in lines]
                cells[i][j] = text
                try:
                    Ratings.read(file("\n".join('","'.join(["", *row, ""])[2:-2] for row in cells) + "\n"))
                except InputError:
                    continue
