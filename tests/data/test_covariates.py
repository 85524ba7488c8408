"""Participants' covariates: known by being constant, kept as written, named where they are not."""

import json

from softness_bayes.data import Ratings, ratings_csv, read_experiment
from support.command_line import call

TABLE = """participant,age,fabric,ID code,indentation_mm,rating,group,mood,empty,=sum
01,23,felt,007,1,5,a,good,,x
01,,lawn,007,1,7,a,bad,,x
2,NA,felt,1e3,1,6,b,good,,'=1+1
2,NA,lawn,1e3,1,,b,good,,'=1+1
P3,61.50,felt,,1,2,,good,,-
P3,61.50,lawn,,1,3,,bad,,-
"""


def test_what_is_constant_within_participants_is_kept_as_written(file):
    ratings = Ratings.read(file(TABLE))
    assert ratings.participants == ("01", "2", "P3")
    assert ratings.covariates == {
        "age": ("23", "NA", "61.50"),
        "ID code": ("007", "1e3", ""),
        "group": ("a", "b", ""),
        "=sum": ("x", "=1+1", "-"),
    }
    assert "ratings.csv: unused columns: mood, empty" in ratings.notes
    said = "ratings.csv: copied to the results as covariates of participants (no model uses them): "
    said += "age, ID code, group, =sum"
    assert said in ratings.notes
    again = Ratings.read(file(ratings_csv(ratings), "again.csv"))
    assert again.covariates == ratings.covariates
    assert "\n01,felt,1,5,23,007,a,x\n" in (file(ratings_csv(ratings), "again.csv")).read_text()


def test_one_row_each_tells_nothing_of_what_is_constant(file):
    text = "participant,fabric,force_n,rating,age\n1,a,1,5,23\n2,a,1,6,24\n"
    assert Ratings.read(file(text)).covariates == {}
    assert "ratings.csv: unused columns: age" in Ratings.read(file(text)).notes
    nobody = "fabric,force_n,rating,age\na,1,5,23\nb,1,6,23\n"
    assert Ratings.read(file(nobody)).covariates == {}


def test_names_that_tables_have_are_changed_and_said(file):
    text = "participant,fabric,force_n,softness,rating,Effect,effect (covariate)\n"
    text += "1,a,1,5,7,x,u\n1,b,1,6,7,x,u\n2,a,1,4,8,y,v\n2,b,1,3,8,y,v\n"
    ratings = Ratings.read(file(text), columns={"rating": "softness"})
    assert ratings.rating.tolist() == [5, 6, 4, 3]
    assert ratings.covariates == {
        "rating (covariate)": ("7", "8"),
        "Effect (covariate) (covariate)": ("x", "y"),
        "effect (covariate)": ("u", "v"),
    }
    assert Ratings.read(file(ratings_csv(ratings))).covariates == ratings.covariates


def test_wide_tables_have_covariates_in_their_rows(file):
    cloth = file("fabric,effective_modulus_kpa\nfelt,30\nlawn,60\n", "cloth.csv")
    wide = file("participant,sex,felt,lawn\n01,f,5,6\n02,m,7,\n")
    ratings = read_experiment(wide, cloth, force_n=1.0).ratings
    assert ratings.covariates == {"sex": ("f", "m")}
    told = call("check", "--data", wide, "--fabrics", cloth, "--force-n", 1, "--json")
    assert [one["covariates"] for one in json.loads(told.stdout)["participants"]] == [{"sex": "f"}, {"sex": "m"}]
