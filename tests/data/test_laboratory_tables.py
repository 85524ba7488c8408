"""Tables as laboratories keep them: each that was once misread, with one like it that is read as it stands."""

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.data import Afferents, Compression, Fabrics, Ratings, read_experiment
from support.command_line import call
from support.refusals import refusal

RECORDED = {
    "afferent": ("A1", "A1", "A2", "A2"),
    "force_n": ("0.5", "1", "0.5", "1"),
    "probe_curvature_per_m": ("0", "0", "200", "200"),
    "distance_mm": ("0", "1", "0", "1"),
    "rate_hz": ("21", "30", "40", "55"),
}
PRESS = "participant,indentation_mm,force_n\n"
RATED = "participant,fabric,indentation_mm,trial,rating\n" + "".join(
    f"P{p},{f},1,{t},{p * (3 + k)}.{t}\n" for p in (1, 2) for k, f in enumerate("abc") for t in (1, 2)
)


def recorded(file, *below, **changed):
    """Read firing of which some columns have other titles and cells."""
    columns = {changed.get(f"{name}_title", name): changed.get(name, cells) for name, cells in RECORDED.items()}
    lines = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True)), *below]
    return Afferents.read(file("\n".join(lines) + "\n"))


def wrong(found):
    return [note for note in found.notes if "looks wrong" in note]


@pytest.mark.parametrize(
    ("name", "title", "cells"),
    [
        ("probe_curvature_per_m", "curvature (1/mm)", ("0", "0", "0.2", "0.2")),
        ("probe_curvature_per_m", "Probe curvature [mm⁻¹]", ("0", "0", "0.2", "0.2")),
        ("probe_curvature_per_m", "curvature per m", ("0", "0", "200", "200")),
        ("rate_hz", "rate (kHz)", ("0.021", "0.03", "0.04", "0.055")),
        ("rate_hz", "impulses per s", RECORDED["rate_hz"]),
        ("rate_hz", "rate", RECORDED["rate_hz"]),
    ],
)
def test_curvatures_and_rates_are_read_in_the_unit_of_their_header(file, name, title, cells):
    plain, found = recorded(file), recorded(file, **{f"{name}_title": title, name: cells})
    np.testing.assert_allclose(found.curvature, plain.curvature, rtol=1e-12)
    np.testing.assert_allclose(found.rate, plain.rate, rtol=1e-12)


def test_durations_are_read_in_the_unit_of_their_header_and_not_without_one(file):
    text = "force_n,probe_curvature_per_m,distance_mm,count,{}\n1,0,0,20,500\n"
    assert Afferents.read(file(text.format("window (ms)"))).rate.tolist() == [40.0]
    assert "write one, as in 'window (s)'" in refusal(Afferents.read, file(text.format("window")))
    assert "its unit mm does not fit" in refusal(recorded, file, probe_curvature_per_m_title="curvature (mm)")


def test_a_row_of_means_is_no_afferent(file):
    assert recorded(file, "Mean,1,0,0,36").names == ("A1", "A2")
    assert recorded(file, "A3,1,0,0,36").names == ("A1", "A2", "A3")


def test_a_response_time_is_no_rating(file):
    text = "fabric,indentation_mm,{}\na,1,812\nb,1,640\n"
    for title in ("response (ms)", "response_s"):
        assert "no column 'rating'" in refusal(Ratings.read, file(text.format(title)))
    assert Ratings.read(file(text.format("response (0-1000)"))).rating.tolist() == [812, 640]


# what may be no measurement


@pytest.mark.parametrize(("last", "named"), [("99", True), ("888", True), ("9.9", False), ("99.0", False)])
def test_codes_in_measured_columns_are_named(file, last, named):
    cloth = Fabrics.read(file(f"fabric,effective_modulus_kpa\na,3\nb,7\nc,{last}\n"))
    assert bool([note for note in wrong(cloth) if "row 4, column 'effective_modulus_kpa'" in note]) == named


def test_decimals_that_a_program_gave_to_all_ratings_hide_no_code(file):
    text = "fabric,indentation_mm,rating\na,1,{}\nb,1,{}\nc,1,{}\n"
    assert "999.0 looks like a code for a missing rating" in refusal(
        Ratings.read, file(text.format("5.0", "7.0", "999.0"))
    )
    for numbers in (("5", "7", "999.0"), ("5.0", "7.0", "9.9900e+02"), ("520.0", "740.0", "999.0")):
        assert Ratings.read(file(text.format(*numbers))).rating.tolist() == [float(number) for number in numbers]


def test_measurements_of_a_file_added_twice_are_named(file):
    once = "P1,1,0.3\nP1,1.5,0.6\nP1,2,1.1\n"
    assert wrong(Compression.read(file(PRESS + once + once)))[0].endswith(
        "rows 2 to 7: every one is there again, equal in all columns: are rows copied?"
    )
    assert not wrong(Compression.read(file(PRESS + once + once.replace("0.6", "0.7"))))
    assert not wrong(Compression.read(file(PRESS + once + once.replace("P1", "P2"))))


@pytest.mark.parametrize(
    ("depths", "forces", "said"),
    [
        ((0, 1, 2, 3.5, 4), (0, 0, 0, 0.1, 0.4), "the force is 0 up to 2 mm"),
        ((0, 0.2, 0.4, 1, 2), (0, 0, 0, 0.1, 0.4), None),
        ((4, 3, 2, 1), (0.1, 0.3, 0.8, 2), "forces fall with indentation"),
        ((4, 3, 2, 1), (2, 0.8, 0.3, 0.1), None),
    ],
)
def test_indentations_that_are_positions_of_a_stage_are_named(file, depths, forces, said):
    rows = "".join(f"P1,{d},{f}\n" for d, f in zip(depths, forces, strict=True))
    notes = wrong(Compression.read(file(PRESS + rows)))
    assert [said in note for note in notes] == [True] * (said is not None)


def test_a_column_may_say_that_the_plate_moves_back(file):
    text = "indentation_mm,force_n,phase\n1,0.3,{0}\n1,0.1,{1}\n2,0.9,{0}\n2,0.4,{1}\n"
    assert Compression.read(file(text.format("loading", "unloading"))).force.tolist() == [0.3, 0.9]
    assert len(Compression.read(file(text.format("loading", "again")))) == 4


def test_a_flat_plate_is_one_in_any_spelling_and_others_are_named(file):
    text = "indentor,indentation_mm,force_n\nFlat-plate,1,0.3\nflat_plate,2,0.9\nsphere,1,0.1\n"
    found = Compression.read(file(text))
    assert len(found) == 2
    assert "1 of 3 rows has another indentor than a flat plate ('sphere'); left out" in found.notes[-1]
    assert "('ball', 'flat_ball', 'sphere')" in refusal(
        Compression.read, file(text.replace("Flat-", "").replace("plate", "ball"))
    )


# ratings


@pytest.mark.parametrize(
    ("column", "marks", "kept"),
    [
        ("is_practice", ("TRUE", "FALSE"), 6),
        ("phase", ("practice 1", "main"), 6),
        ("training", ("yes", "no"), 12),  # of a person
    ],
)
def test_practice_is_left_out_where_a_column_says_so(file, column, marks, kept):
    lines = RATED.replace("rating\n", f"rating,{column}\n").replace(".1\n", f".1,{marks[0]}\n")
    found = Ratings.read(file(lines.replace(".2\n", f".2,{marks[1]}\n")))
    assert len(found) == kept


def test_catch_trials_are_named(file):
    found = Ratings.read(file(RATED.replace("rating\n", "rating,catch\n").replace(".1\n", ".1,0\n") + "P1,a,1,3,9,1\n"))
    assert [note for note in wrong(found) if "column 'catch' marks row 14" in note]


def test_people_of_several_studies_need_names_of_their_own(file):
    lines = RATED.replace("rating\n", "rating,{}\n").replace(".1\n", ".1,1\n").replace(".2\n", ".2,2\n")
    one_trial = lines.replace(",1,2,", ",1,1,")
    said = "participant 'P1' has '1', '2' in column 'study'"
    assert said in refusal(Ratings.read, file(one_trial.format("study")))
    assert len(Ratings.read(file(one_trial.format("day")))) == 12


def test_a_further_column_of_a_fabric_is_not_passed_over(file):
    cloth = file("fabric,effective_modulus_kpa\nfelt,20\nlawn,90\n", "fabrics.csv")
    wide = "participant,felt,lawn,{}\nP1,3,4,5\nP2,6,7,8\n"
    for again in ("felt.1", "felt (2)"):
        message = refusal(read_experiment, file(wide.format(again)), cloth, force_n=1.0)
        assert f"columns 'felt' and '{again}' may both be of one fabric" in message
    assert len(read_experiment(file(wide.format("age")), cloth, force_n=1.0).ratings) == 4
    both = file("fabric,effective_modulus_kpa\nfelt,20\nfelt 2,50\nlawn,90\n", "fabrics.csv")
    assert len(read_experiment(file(wide.format("felt 2")), both, force_n=1.0).ratings) == 6


# advice


@pytest.mark.parametrize(
    ("title", "cell", "advised"),
    [
        ("log10 rating", "1.2", ""),
        ("rating (log)", "1.2", ""),
        ("response_time", "812", ""),
        ("feel", "12", "--column rating=feel"),
        ("rating", '"1,280"', ""),
        ("rating", '"12,5"', "--decimal ,"),
    ],
)
def test_no_advice_misreads_logarithms_or_thousands(file, title, cell, advised):
    file("fabric,effective_modulus_kpa\na,20\nb,90\n", "fabrics.csv")
    path = file(f"fabric,indentation_mm,{title}\na,1,{cell}\nb,1,{cell}\n")
    told = call("check", "--data", path).stderr.partition("try: ")[2].strip()
    assert told.endswith(advised) if advised else not told


def test_no_advice_reads_a_unit_that_is_not_known(file):
    file("fabric,effective_modulus_kpa\na,20\nb,90\n", "fabrics.csv")
    for title, advised in (("force (gr)", ""), ("force", "--column force_n=force")):
        path = file(f"fabric,{title},rating\na,1,5\nb,1,7\n")
        told = call("check", "--data", path).stderr.partition("try: ")[2].strip()
        assert told.endswith(advised) if advised else not told


def test_a_fabric_without_one_of_the_directions_is_named(file):
    rows = "a,warp,9\na,weft,4\nb,warp,9\n{}c,,5\n"  # c is a felt, which has none
    for more, said in (("", ["looks wrong: not measured in all directions: b"]), ("b,weft,4\n", [])):
        cloth = Fabrics.read(file(f"fabric,direction,E_fab (kPa)\n{rows.format(more)}"))
        assert [note.removeprefix("ratings.csv: ") for note in wrong(cloth)] == said
    wide = "fabric,E_fab warp (kPa),E_fab weft (kPa)\na,9,4\nb,9,{}\n"
    assert len(wrong(Fabrics.read(file(wide.format(""))))) == 1
    assert not wrong(Fabrics.read(file(wide.format("4"))))


def test_a_thickness_without_a_unit_is_named(file):
    message = refusal(Fabrics.read, file("fabric,tensile_modulus_mpa,thickness\na,2,0.5\n"))
    assert "column 'thickness' is not read: it has no unit known here" in message
    with pytest.raises(InputError, match="row 3, fabric 'b'"):
        Fabrics.read(file("fabric,tensile_modulus_mpa,thickness_mm\na,2,0.5\nb,2,\n"))
