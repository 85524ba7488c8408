"""Odd but legitimate tables: two rows of titles, merged cells, dates as names, Excel's own first line."""

import datetime

import pytest

from softness_bayes.data import Ratings, read_experiment
from softness_bayes.touch.contact import Force, Indentation

ROWS = "A,cotton,100,10\nA,silk,100,25\nB,cotton,50,12\nB,silk,50,30\n"


# loads below the fabrics


@pytest.mark.parametrize(
    "head",
    [
        ",cotton,cotton,silk,silk\nparticipant,1 N,2 mm,1 N,2 mm\n",
        "participant,cotton,,silk,\n,1 N,2 mm,1 N,2 mm\n",
        "participant,cotton,,silk,\nparticipant,1N,2mm,1N,2mm\n",
        "participant,1 N,2 mm,1 N,2 mm\n,cotton,cotton,silk,silk\n",
    ],
)
def test_loads_below_fabrics_are_read(file, head):
    found = Ratings.read(file(f"{head}A,10,12,25,27\nB,,13,30,33\n"))
    assert found.fabrics == ("cotton", "silk")
    assert found.loads == (Indentation(2e-3), Force(1.0))
    told = {(p, f, k): y for p, f, k, y in zip(found.participant, found.fabric, found.load, found.rating, strict=True)}
    depths = {(0, 0, 0): 12, (0, 1, 0): 27, (1, 0, 0): 13, (1, 1, 0): 33}
    assert told == {**depths, (0, 0, 1): 10, (0, 1, 1): 25, (1, 1, 1): 30}
    assert found.n_missing == 1


# workbooks


def test_merged_cells_and_days_of_a_workbook(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["participant", "fabric", "force_n", "rating", "effective_modulus_kpa"])
    for day in (datetime.date(2024, 2, 1), datetime.datetime(2024, 3, 1)):
        for fabric, rating, modulus in (("cotton", 10, 50), ("silk", 20, 10)):
            sheet.append([day, fabric, 1, rating, modulus])
    sheet.merge_cells("A2:A3")
    sheet.merge_cells("A4:A5")
    sheet.merge_cells("G1:H1")  # side by side: nothing is meant by it
    book.save(tmp_path / "ratings.xlsx")
    found = read_experiment(tmp_path / "ratings.xlsx").ratings
    assert found.participants == ("2024-02-01", "2024-03-01")
    assert found.participant.tolist() == [0, 0, 1, 1]
    assert "ratings.xlsx: merged cells A2:A3, A4:A5: their value is used in each row" in found.notes


# others


@pytest.mark.parametrize("told", ["sep=;", '"sep=;"'])
def test_the_separator_that_excel_writes_is_read(file, told):
    text = ROWS.replace(",", ";")
    found = Ratings.read(file(f"{told}\nparticipant;fabric;force_n;rating\n{text}"))
    assert found.rating.tolist() == [10, 25, 12, 30]
    assert found.rows.tolist() == [3, 4, 5, 6]
