"""Problems of tables: all of them in one message, each once, and none that follows from another."""

from softness_bayes.data import Compression, Fabrics, Ratings, read_experiment
from support.refusals import refusal

HEADER = "participant,fabric,indentation_mm,rating\n"
CLOTH = "fabric,tensile_modulus_mpa,thickness_mm\nvoile,3.2,0.22\ndenim,33,0.68\n"


def test_all_problems_of_ratings_are_named_in_the_order_of_rows(file):
    path = file(f"{HEADER}P1,voile,1,five\nP1,,x,6\n,denim,,7\nP1,denim,9,?\nP1,voile,1,8\n")
    depth = "expected a number from 1e-06 to 8 (a fingertip's radius is 8 mm), got"
    assert refusal(Ratings.read, path).splitlines() == [
        f"{path}: 7 problems:",
        "  row 2, column 'rating': expected a finite number, got 'five'",
        "  row 3, column 'fabric': expected a name, got ''",
        f"  row 3, column 'indentation_mm': {depth} 'x'",
        "  row 4, column 'participant': expected a name, got ''",
        "  row 4, column 'indentation_mm': expected a load, got ''",
        "  row 5, column 'rating': expected a finite number, got '?'",
        f"  row 5, column 'indentation_mm': {depth} '9'",
    ]


def test_the_first_twenty_are_shown_and_all_are_counted(file):
    path = file(HEADER + "P1,voile,1,1\n" + "".join(f"P1,x{k},1,1\n" for k in range(1000)))
    lines = refusal(read_experiment, path, file(CLOTH, "cloth.csv")).splitlines()
    assert (lines[0], lines[-1]) == (f"{path}: 1000 problems:", "  … and 980 more lines")
    assert [line.split(",")[0] for line in lines[1:-1]] == [f"  row {row}" for row in range(3, 23)]


def test_a_problem_that_many_rows_share_stands_in_one_line(file):
    depths = "".join(f"P1,voile,{depth},5\n" for depth in range(9, 30))
    path = file(HEADER + "P1,voile,1,x\n" + depths + "P1,voile,2,x\nP1,voile,3,5\nP1,voile,,x\nP1,voile,4,x\n")
    expected = "expected a number from 1e-06 to 8 (a fingertip's radius is 8 mm)"
    assert refusal(Ratings.read, path).splitlines() == [
        f"{path}: 26 problems:",
        "  rows 2, 24, 26, … and 1 more, column 'rating': expected a finite number, got 'x'",
        f"  rows 3, 4, 5, … and 18 more, column 'indentation_mm': {expected}, got '9', '10', '11', … and 18 more",
        "  row 26, column 'indentation_mm': expected a load, got ''",
    ]


def test_all_missing_columns_are_named_at_once(file):
    path = file("participant,thing\nP1,2\n")
    general, absent = refusal(Ratings.read, path).splitlines()[1:]
    assert general.startswith("  no load column (indentation_mm or force_n); give the load of all ratings by one of")
    assert "; its columns are 'participant', 'thing'" in general
    assert absent == "  no columns 'fabric' and 'rating'"
    assert "no column 'force_n'; its columns are 'indentation_mm'" in refusal(
        Compression.read, file("indentation_mm\n1\n")
    )


def test_an_unknown_fabric_is_named_once_with_its_number_of_rows(file):
    path, cloth = file(HEADER + "P1,viole,1,5\n" * 5 + "P1,x,1,7\nP1,denim,1,6\n"), file(CLOTH, "cloth.csv")
    assert refusal(read_experiment, path, cloth).splitlines() == [
        f"{path}: 2 problems:",
        f"  row 2, column 'fabric': 'viole' is not a fabric of {cloth} (did you mean 'voile'?), as in 4 other rows",
        f"  row 7, column 'fabric': 'x' is not a fabric of {cloth}",
    ]


def test_all_problems_of_fabrics_are_named_and_none_that_follows(file):
    head = "fabric,tensile_modulus_mpa,thickness_mm,thickness_cv,poisson_ratio\n"
    path = file(f"{head}a,1,x,0.1,\nb,-1,1,,0.7\nb,2,2,,\nc,1,,,\nd,1,1,9,\ne,1,1,0.1,0.2\n", "fabrics.csv")
    assert refusal(Fabrics.read, path).splitlines() == [
        f"{path}: 6 problems:",
        "  row 5, fabric 'c': expected effective_modulus_kpa, or bending_rigidity_n_m, or both tensile_modulus_mpa and "
        "thickness_mm, or both effective_modulus_low_kpa and effective_modulus_high_kpa",
        "  row 2, column 'thickness_mm': expected a finite number above 0, got 'x'",
        "  row 3, column 'tensile_modulus_mpa': expected a finite number above 0, got '-1'",
        "  row 3, column 'poisson_ratio': expected a finite number above -1 and at most 0.5, got '0.7'",
        "  row 4, column 'fabric': expected one row for each fabric, got 'b'; give the mean of repeated measurements",
        "  row 6, column 'thickness_cv': expected a number from 0 to 3, got '9'",
    ]


def test_problems_of_fabrics_in_ratings_are_named_with_the_others(file):
    own = file("fabric,force_n,rating,effective_modulus_kpa\na,1,x,3\nb,1,2,4\na,1,2,4\n")
    assert refusal(read_experiment, own) == (
        f"{own}: row 4, column 'effective_modulus_kpa': 'a' has '4' here and '3' in row 2"
    )


def test_the_remedy_for_commas_is_said_once(file):
    message = refusal(Ratings.read, file(f'{HEADER}P1,a,1,"1,5"\nP1,b,1,"2,5"\n'))
    assert message.count("--decimal ,") == 1
    assert message.count("expected a finite number") == 2
    assert refusal(Ratings.read, file(f'{HEADER}P1,a,"1,5","1,5"\n')).count("--decimal ,") == 1
