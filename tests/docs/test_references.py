"""References to the docs lead somewhere: every section that sources, tests and pages cite is a heading of its page."""

from __future__ import annotations

import re

from support.pages import headings
from support.paths import ROOT

SOURCES = sorted(
    path
    for folder in ("softness_bayes", "tests", "notebooks")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".md", ".ipynb", ".html") and "__pycache__" not in path.parts
)
NUMBERED = ("model.md", "files.md")
_CITED = re.compile(r"\b(\w+\.md)`?\s+(\d+(?:(?:\s*[-–]\s*|,\s+|\s+and\s+)\d+)*)")


def cited(text):
    """Return page and section of every numbered reference in a text, ranges spelt out."""
    # a reference may break over lines, of comments too
    flat = re.sub(r"\n[ #]*", " ", text)
    found = set()
    for page, sections_of_it in _CITED.findall(flat):
        for part in re.split(r",|and", sections_of_it):
            ends = [int(end) for end in re.findall(r"\d+", part)]
            found |= {(page, str(k)) for k in range(ends[0], ends[-1] + 1)}
    return found


def test_every_reference_is_a_heading():
    every = {(path, *one) for path in SOURCES for one in cited(path.read_text(encoding="utf-8"))}
    wrong = [
        f"{path.relative_to(ROOT)}: {page} {section}"
        for path, page, section in every
        if page in NUMBERED and section not in headings(page)
    ]
    assert not wrong
    # the walk finds what there is to find
    assert {section for path, page, section in every if page == "model.md" and path.suffix == ".py"} >= {
        str(k) for k in range(1, 12)
    }


def test_references_are_found():
    """Negative control: ranges, lists and broken lines are read, other numbers are not."""
    found = cited(
        "see (model.md 2-4, 9) and model.md 6 and 8; files.md\n    # 5: 1/2; in 3 files, README.md says 7 times"
    )
    assert found == {*(("model.md", str(k)) for k in (2, 3, 4, 9, 6, 8)), ("files.md", "5")}
