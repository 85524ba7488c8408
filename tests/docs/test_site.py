"""The pages of the site that are made from declarations; the gate builds the site, and stops at its first warning."""

from __future__ import annotations

import pytest

import softness_bayes
from reference_pages import write_pages
from softness_bayes.cli import VERBS, main
from softness_bayes.parameters.declared import EVERY_PARAMETER


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The text of each page by its name."""
    directory = tmp_path_factory.mktemp("site") / "reference"
    write_pages(directory)
    return {path.stem: path.read_text(encoding="utf-8") for path in directory.iterdir()}


def test_every_command_has_its_options(pages):
    sections = dict(part.split("\n", 1) for part in pages["commands"].split("\n### ")[1:])
    assert list(sections) == list(VERBS)
    for verb, text in sections.items():
        for option in main.get_command(None, verb).params:
            for flag in option.opts if getattr(option, "help", None) and not option.hidden else ():
                assert f"`{flag}" in text or f", {flag}" in text


def test_every_parameter_and_public_name_is_there(pages):
    assert all(f"| `{name}` |" in pages["parameters"] for name in EVERY_PARAMETER)
    assert all(f":: softness_bayes.{name}\n" in pages["names"] for name in softness_bayes._HOMES)


def test_an_unchanged_page_is_left_alone(tmp_path):
    write_pages(tmp_path)
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    write_pages(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == times
