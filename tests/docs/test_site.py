"""The site: its pages that are made from declarations, and how it works from disk in a browser."""

from __future__ import annotations

import subprocess
import sys

import pytest

import softness_bayes
from reference_pages import write_pages
from softness_bayes.cli import VERBS, main
from softness_bayes.parameters.declared import EVERY_PARAMETER
from support.browser import browser, find_browser
from support.pages import DOCS, PAGES
from support.paths import ROOT


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


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The site, built without a warning."""
    out = tmp_path_factory.mktemp("built")
    options = ["--quiet", "--fail-on-warning", "-c", ROOT / ".docs", "-d", out / "read"]
    subprocess.run([sys.executable, "-m", "sphinx", *map(str, options), DOCS, out / "site"], cwd=ROOT, check=True)
    return out / "site"


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(find_browser() is None, reason="no chromium")
def test_the_site_works_from_disk(built, tmp_path):
    """Pages fit a phone, figures have a text, the search finds, and nothing is asked of another host."""
    searched = {
        "left-handed": "Raters differ",
        "staircase": "staircase",
        "Kawabata": "Your data",
        "Versuchsperson": "Tables and",
    }
    with browser(find_browser(), tmp_path) as page:

        def opened(path, query="", ready="true"):
            page("Page.navigate", url="about:blank")
            page.wait("location.protocol === 'about:'")
            page.events.clear()
            page("Page.navigate", url=path.as_uri() + query)
            page.wait(f"location.protocol === 'file:' && document.readyState === 'complete' && {ready}")
            assert all(url.startswith(("file:", "data:")) for url in page.requested())

        page.resize(400)
        for name in PAGES.keys() - {"README.md"}:
            opened(built / name.replace(".md", ".html"))
            assert page.complaints() == []
            assert page.script("document.documentElement.scrollWidth <= innerWidth"), name
            assert page.script("[...document.images].every(image => image.alt)"), name
        for word, title in searched.items():
            opened(built / "search.html", f"?q={word}", "!!document.querySelector('#search-results li')")
            page.wait(f"document.querySelector('#search-results').innerText.includes({title!r})")
