"""Cells of CSV files: what a spreadsheet would run is written behind an apostrophe, and reads back as it was."""

from __future__ import annotations

import csv
import io

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softness_bayes.base.files.spreadsheet import csv_of, escaped, table_of, unescaped
from softness_bayes.data import Fabrics, Ratings, fabrics_csv, ratings_csv, read_experiment
from softness_bayes.touch.contact import Indentation

FORMULAE = (
    '=HYPERLINK("http://x")',
    "+1+cmd|' /C calc'!A0",
    "-2+3",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "=",
    "'=1",
    "\uff1d1",
)
HARMLESS = ("P1", "-1", "+5", "-1.5e-3", "+.5", "", "'", "'tis", "a=b", " =1", "O'Neil", "Müller")


@pytest.mark.parametrize("text", FORMULAE)
def test_what_would_run_is_escaped(text):
    assert escaped(text) == f"'{text}"
    assert unescaped(escaped(text)) == text


@pytest.mark.parametrize("text", HARMLESS)
def test_what_would_not_stays_as_it_is(text):
    assert escaped(text) == unescaped(text) == text


@given(st.text(alphabet="=+-@'\t\r\n\uff0ba1. ", max_size=6))
def test_every_text_reads_back(text):
    assert unescaped(escaped(text)) == text
    # and no cell begins as a formula does, unless it is a number
    if escaped(text)[:1] in tuple("=+-@\t\r"):
        float(escaped(text))


def test_tables_keep_numbers_and_names():
    table = pd.DataFrame({"name": ["=1+1", "-3", "plain"], "value": [-1.5, np.nan, 2.0], "count": [-1, 0, 1]})
    text = csv_of(table.set_index("name"))
    assert text.splitlines() == ["name,value,count", "'=1+1,-1.5,-1", "-3,,0", "plain,2.0,1"]
    again = table_of(io.StringIO(text), "name")
    pd.testing.assert_frame_equal(again, table.set_index("name"), check_exact=True)


def test_ids_that_look_like_formulae_come_back_from_a_spreadsheet_safe_table(tmp_path):
    people = ("=cmd|' /C calc'!A0", "@her", "-1", "'=quoted")
    cloth = Fabrics(("+felt", "=lawn"), effective_modulus=np.array([8e4, 2e4]))
    ratings = Ratings.crossed(people, cloth.names, (Indentation(2e-3),), np.arange(1.0, 9.0).reshape(4, 2, 1))
    (tmp_path / "ratings.csv").write_text(ratings_csv(ratings, cloth), encoding="utf-8")
    (tmp_path / "fabrics.csv").write_text(fabrics_csv(cloth), encoding="utf-8")
    with open(tmp_path / "ratings.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["participant"] for row in rows} == {"'=cmd|' /C calc'!A0", "'@her", "-1", "''=quoted"}
    assert {row["fabric"] for row in rows} == {"'+felt", "'=lawn"}
    assert all(float(row["rating"]) > 0 for row in rows)
    for fabrics in (None, tmp_path / "fabrics.csv"):
        found = read_experiment(tmp_path / "ratings.csv", fabrics)
        assert {*found.ratings.participants} == {*people}
        assert {*found.fabrics.names} == {*cloth.names}
        names = [found.ratings.participants[k] for k in found.ratings.participant]
        before = [ratings.participants[k] for k in ratings.participant]
        assert dict(zip(found.ratings.rating, names, strict=True)) == dict(zip(ratings.rating, before, strict=True))
