"""Numbers and names that can be read in two ways: decided by the table, said, or refused with what decides."""

import csv
import time
import unicodedata

import pytest
from click.testing import CliRunner

from softness_bayes.base.errors import InputError
from softness_bayes.cli import main
from softness_bayes.data import Fabrics, Ratings, read_experiment
from support.refusals import refusal

HEADER = ["participant", "fabric", "indentation_mm", "rating"]


def table(tmp_path, ratings, separator=";", name="ratings.csv", load="1"):
    rows = [HEADER, *(["P1", f"f{k}", load, rating] for k, rating in enumerate(ratings))]
    path = tmp_path / name
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, delimiter=separator).writerows(rows)
    return path


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("number", ["1,234", "+1,234", "1.234"])
def test_a_number_of_two_meanings_is_refused_with_what_decides(tmp_path, separator, number):
    path = table(tmp_path, ["950", number, "800"], separator)
    message = refusal(Ratings.read, path)
    assert message.startswith(f"{path}: row 3, column 'rating': '{number}' may be ")
    assert message.endswith("give the decimal mark with --decimal . or --decimal ,")
    mark, other = (",", ".") if "," in number else (".", ",")
    assert Ratings.read(path, decimal=mark).rating.tolist() == [950, 1.234, 800]
    assert Ratings.read(path, decimal=other).rating.tolist() == [950, 1234, 800]


@pytest.mark.parametrize(
    ("ratings", "found", "note"),
    [
        (["950", "0,82"], [950, 0.82], ""),
        (["1,234", "0,82"], [1.234, 0.82], "row 2, column 'rating': 1,234 is read as 1.234, because 0,82 in row 3"),
        (["1.234", "2.500"], [1.234, 2.5], ""),  # a program's three decimals, in all cells
        (["1.234", "950.0"], [1.234, 950], ""),
        # points group thousands where a number shows it
        (["1.234,5", "12"], [1234.5, 12], ""),
        (["1.234.567", "0,5"], [1234567, 0.5], ""),
        (["1.234", "2.345,5"], [1234, 2345.5], "1.234 is read as 1234, because 2.345,5 in row 3"),
        (["1\u00a0234,567", "3"], [1234.567, 3], ""),
    ],
)
def test_other_numbers_decide_and_what_was_assumed_is_said(tmp_path, ratings, found, note):
    read = Ratings.read(table(tmp_path, ratings))
    assert read.rating.tolist() == found
    said = [one for one in read.notes if "is read as" in one]
    assert len(said) == bool(note)
    assert note in " ".join(said)


def test_between_commas_a_quoted_comma_is_refused_with_the_remedy(tmp_path):
    path = table(tmp_path, ["950", "1,234"], ",")
    remedy = r"got '1,234'; if commas are decimal marks, add --decimal , and if they group thousands, --decimal \.$"
    with pytest.raises(InputError, match=remedy):
        Ratings.read(path)
    assert Ratings.read(path, decimal=".").rating.tolist() == [950, 1234]
    assert Ratings.read(path, decimal=",").rating.tolist() == [950, 1.234]


@pytest.mark.parametrize(
    ("ratings", "options", "problem"),
    [
        *(([cell], {}, f"row 2, column 'rating': expected a finite number, got '{cell}'") for cell in ("1e999", "1_0")),
        (["5,5", "vs. 2"], {}, "expected a finite number, got 'vs. 2'"),
        (["12,34"], {"decimal": "."}, "got '12,34'"),
        (["12,34"], {"decimal": "x"}, "expected one of ',', '.'"),
        (["1,234.5", "0,5"], {}, "row 2, column 'rating': expected"),  # one has a decimal point, the other a comma
        (["1,23,456", "5"], {}, "row 2, column 'rating': expected a finite number, got '1,23,456'"),
        (["1 234", "5"], {}, "row 2, column 'rating': expected a finite number, got '1 234'"),  # perhaps two numbers
        *(
            (["5", cell], {}, "did a spreadsheet program turn a number into a date")
            for cell in ("2024-02-01", "01.02.2024", "1-Feb", "2/1/24")
        ),
    ],
)
def test_what_is_no_number_is_quoted_as_it_stands(tmp_path, ratings, options, problem):
    assert problem in refusal(Ratings.read, table(tmp_path, ratings), **options)


# what reaches the terminal


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_no_table_passes_an_escape_sequence_to_the_terminal(tmp_path, encoding):
    for place, cell in (("P\x1b[31m1", "one"), ("P1", "\x1b]0;title\x07"), ("P1", "5\x9b31m")):
        path = tmp_path / "ratings.csv"
        rows = f"participant,fabric,indentation_mm,rating,\x85junk\n{place},a,1,{cell},1\n"
        path.write_bytes(rows.encode(encoding))
        done = CliRunner().invoke(main, ["check", "--data", str(path)])
        assert done.exit_code == 2
        assert not any(unicodedata.category(c) == "Cc" and c != "\n" for c in done.output)


# no reader is worse than linear


def seconds(call):
    begun = time.perf_counter()
    message = refusal(call)
    return time.perf_counter() - begun, message


def test_one_wide_row_costs_no_more_than_its_length(tmp_path):
    path = table(tmp_path, ["5"] * 1080, ",")
    rows = path.read_text()
    path.write_text(f"{rows}P1,a,1,5{',' * 16_379}x\n")
    taken, message = seconds(lambda: Ratings.read(path))
    assert message.endswith(
        "row 1082: 'x' is beyond the 4 columns of the header; remove it, or give its column a title"
    )
    assert taken < 2
    path.write_text(f"{rows}P1,a,1,5{',' * 16_379}\n")
    assert len(Ratings.read(path)) == 1081  # nothing stands in the cells beyond


@pytest.mark.parametrize(
    "cell", ["x" * 100_000, "9" * 100_000, "9," * 50_000, '"' * 99_999, "1e" + "9" * 100_000, "\u0301" * 100_000]
)
def test_a_long_cell_is_refused_in_a_line_and_soon(tmp_path, cell):
    path = tmp_path / "ratings.csv"
    path.write_text(f"participant;fabric;indentation_mm;rating\nP1;a;1;{cell}\n", encoding="utf-8")
    taken, message = seconds(lambda: Ratings.read(path))
    assert taken < 2
    assert len(message) < len(str(path)) + 350
    assert "\n" not in message


# thousands that cannot be decimals


@pytest.mark.parametrize("separator", [";", "\t", ","])
@pytest.mark.parametrize(
    ("ratings", "found"),
    [
        (["1,234.5", "12"], [1234.5, 12]),
        (["1,234,567", "0.5"], [1234567, 0.5]),
        (["1\u00a0234", "1\u202f234.5"], [1234, 1234.5]),
        (["1'234", "1\u2019234.25"], [1234, 1234.25]),
        (["1,234", "2,345.5"], [1234, 2345.5]),
    ],
)
def test_thousands_that_cannot_be_decimals_are_read(tmp_path, ratings, found, separator):
    read = Ratings.read(table(tmp_path, ratings, separator))
    assert read.rating.tolist() == found
    assert len(read.notes) == (ratings[0] == "1,234")
    if read.notes:
        assert "1,234 is read as 1234, because 2,345.5 in row 3" in read.notes[0]


# encodings


JAPANESE = "被験者,布,押し込み量 [mm],柔らかさ\n山田,綿,1,5\n"
LATIN = "participant,fabric,indentation_mm,rating\nP1,{},1,5\n"


def test_shift_jis_is_read_and_said(tmp_path):
    path = tmp_path / "ratings.csv"
    for text, name in (
        (JAPANESE, "綿"),
        (LATIN.format("木綿"), "木綿"),
        (LATIN.format("ポリエステル"), "ポリエステル"),
    ):
        path.write_bytes(text.encode("cp932"))
        read = Ratings.read(path)
        assert read.fabrics == (name,)
        assert "ratings.csv: not UTF-8: read as Shift-JIS" in read.notes


@pytest.mark.parametrize(
    "name",
    ["Größe", "soie à jour", "l\u2019épais", "Young\u2019s", "\u201ca\u201d", "ÄÖÜ", "façonné", "\u0153uvré", "€5"],
)
def test_western_text_is_not_taken_for_shift_jis(tmp_path, name):
    path = tmp_path / "ratings.csv"
    path.write_bytes(LATIN.format(name).encode("cp1252"))
    (note,) = Ratings.read(path).notes
    assert "read as Latin-1" in note


def test_paths_that_cannot_be_read_are_refused(tmp_path):
    for path in (tmp_path, tmp_path / "no.csv", tmp_path / ("a" * 300), tmp_path / ("a" * 300 + ".xlsx"), "a\x00b"):
        for call in (Ratings.read, read_experiment, Fabrics.read):
            with pytest.raises(InputError):
                call(path)
