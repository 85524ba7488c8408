"""Provenance, typed: what is written as attributes is read back, and only this module knows how it is written."""

import dataclasses
import re
from dataclasses import fields, replace

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.checking.provenance import (
    PRIOR,
    READING,
    VERSION,
    Asked,
    DirectionTaken,
    Ending,
    Finding,
    Findings,
    NumericalErrors,
    PlateData,
    Provenance,
    RatingData,
    RatingSettings,
    Silence,
    attributes_of,
    family_of,
)
from softness_bayes.likelihood.scales import FALLS, STANDARDISED
from softness_bayes.parameters.priors import parse_prior
from softness_bayes.results.lookup import MissingError, Named
from softness_bayes.touch.readings import MENDED, NAMED_READINGS

SECTIONS = {
    "asked": Asked(2, "softness-bayes sample", {"fix": {"m": 2.0}, "max_seconds": float("inf")}, 3, "in-vivo"),
    "ending": Ending("Converged.", True, 900, 0, 100, 1.5, 40_000, 2),
    "direction": DirectionTaken(FALLS, False, "from the data", 0.25, 0.7, 0.01),
    "rating_model": RatingSettings(0.5, STANDARDISED, 1e-3, "12 nodes", "student", "heavy tails", "whole numbers"),
    "rating_data": RatingData("abc", "def", 4),
    "errors": NumericalErrors(1e-4, 1e-5, "Exact enough.", 0.01, 0.03, 0.99, 0.4, True, True, 0.02),
    "silence": Silence(0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    "plate": PlateData("123", 2, 4.0, 2.2, 2.0, 2.4, 0.5),
}
NONE = replace(SECTIONS["rating_model"], accuracy=None)
LONG = replace(SECTIONS["asked"], seed=2**90)


@pytest.mark.parametrize(("name", "section"), [*SECTIONS.items(), ("rating_model", NONE), ("asked", LONG)])
def test_a_section_comes_back_as_it_was_written(name, section):
    written = attributes_of(section)
    assert written.keys() == {each.name for each in fields(section)}
    assert all(isinstance(value, (str, int, float)) and not isinstance(value, bool) for value in written.values())
    assert all(value == value for value in written.values())  # a missing number equals itself on some Pythons alone
    assert getattr(Provenance(written), name) == section


def test_findings_come_back_as_they_were_written():
    whole = Finding("fabrics", 0.1, 0.2, 0.3, False, ("--prior a", "b"), 3, "felt", 0.4, 0.5, "log rating", 0.7)
    found = Provenance(attributes_of(Findings((whole, Finding("noise", np.nan, modelled=True))))).findings
    assert found["fabrics"] == whole
    assert (found["noise"].modelled, found["noise"].advice, np.isnan(found["noise"].p_value)) == (True, (), True)


def test_families_are_read_without_what_only_begins_like_them():
    priors = {"b": parse_prior("lognormal(100,0.5)"), "mu": parse_prior("normal(3,3)")}
    others = attributes_of(SECTIONS["asked"], SECTIONS["silence"])  # prior_set, prior_silent_everywhere
    chosen = NAMED_READINGS["hertz"]
    found = Provenance(
        {**family_of(PRIOR, priors), **others, **family_of(READING, chosen.names), **family_of(VERSION, {"numpy": "2"})}
    )
    assert found.priors == priors
    assert found.readings == chosen != MENDED
    assert found.versions == {"numpy": "2"}


def test_what_runs_without_ratings_lack_has_a_default_and_all_else_is_missed():
    former = Provenance(Named({"direction": "falls-with-firing"}, "attribute", "old.nc"))
    known = dataclasses.replace(
        former.direction, direction_rises=0.5, direction_rises_se=0.1
    )  # NaN differs from itself
    assert known == DirectionTaken(FALLS, True, "", 1.0, 0.5, 0.1)
    assert np.isnan([former.direction.direction_rises, former.direction.direction_rises_se]).all()
    assert former.rating_model.rating_errors == "normal"
    assert former.silence.posterior_silent_everywhere == 0.0
    assert former.verdict == ""
    with pytest.raises(MissingError, match=r"old\.nc: no attribute 'verdict'"):
        _ = former.ending


@pytest.mark.parametrize(
    ("name", "attribute", "value"),
    [("ending", "steps", "many"), ("direction", "direction", "sideways"), ("rating_model", "rating_scale", "stars")],
)
def test_an_attribute_that_makes_no_sense_is_named(name, attribute, value):
    written = {**attributes_of(*SECTIONS.values()), attribute: value}
    with pytest.raises(InputError, match=re.escape(value)):
        getattr(Provenance(written), name)
