"""The site of guide and reference: every link leads somewhere, both ways, and a broken one ends the building."""

from __future__ import annotations

import pdoc
import pytest

from softness_bayes.tools import guide
from softness_bayes.tools.api_pages import TEMPLATES, modules
from softness_bayes.tools.guide import unresolved

REFERENCE = {f"{name.replace('.', '/')}.html" for name in (*modules(), "softness_bayes.touch.readings")}


@pytest.fixture
def draw():
    """The template of a page, as the builder fills it in."""
    pdoc.render.configure(docformat="numpy", template_directory=TEMPLATES)
    return pdoc.render.env.get_template("guide.html.jinja2").render


def stand_in(directory):
    """Write empty pages of the reference, one of which has a place in it; making the real ones takes the gate."""
    for page in REFERENCE:
        path = directory / page
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('<p id="MENDED"></p>' if page.endswith("readings.html") else "", encoding="utf-8")


def test_every_link_of_the_guide_leads_somewhere(tmp_path, draw):
    stand_in(tmp_path)
    guide.build(tmp_path, REFERENCE, draw)
    made = [tmp_path / place for place in guide.pages().values()]
    assert unresolved(made) == []
    front = made[0].read_text(encoding="utf-8")
    assert made[0] == tmp_path / "index.html"
    for place in guide.pages().values():
        assert f'href="{place}"' in front
    assert f'href="{guide.REFERENCE}"' in front
    assert (tmp_path / "notebooks" / "figures" / "rating.png").exists()


def test_a_cited_section_is_linked(tmp_path, draw):
    stand_in(tmp_path)
    guide.build(tmp_path, REFERENCE, draw)
    page = tmp_path / "softness_bayes" / "touch" / "readings.html"
    missing = f"model.md {99}"  # not spelt out: references in the sources must lead somewhere
    page.write_text(f"moduli (model.md 3), nothing ({missing})", encoding="utf-8")
    guide.lead_to_guide(tmp_path, REFERENCE)
    text = page.read_text(encoding="utf-8")
    assert '<a href="../../model.html#3-contact">model.md 3</a>' in text
    assert f"nothing ({missing})" in text
    assert unresolved([page]) == []


def test_names_in_the_code_lead_to_the_reference(tmp_path):
    stand_in(tmp_path)
    text = "<code>touch.readings.MENDED</code> <code>touch.readings.NOTHING</code> <code>ratings.csv</code>"
    linked = guide._with_reference(text, "", REFERENCE, tmp_path)
    assert linked.count("<a ") == 1
    assert '<a href="softness_bayes/touch/readings.html#MENDED"><code>touch.readings.MENDED</code></a>' in linked


@pytest.mark.parametrize(
    ("broken", "error", "named"),
    [
        ("[it](nowhere.md)", ValueError, "nowhere.html"),
        ("[it](nowhere.csv)", FileNotFoundError, "nowhere.csv"),
        ("[it](data.md#nowhere)", ValueError, "data.html#nowhere"),
    ],
)
def test_a_broken_link_is_named(tmp_path, draw, broken, error, named):
    clone = tmp_path / "clone"
    (clone / guide.DOCS).mkdir(parents=True)
    (clone / guide.FRONT).write_text("# Title\n\n| [data](softness_bayes/docs/data.md) |\n", encoding="utf-8")
    (clone / guide.DOCS / "data.md").write_text(f"# Data\n\n{broken}\n", encoding="utf-8")
    with pytest.raises(error, match=named):
        guide.build(tmp_path / "site", {guide.REFERENCE}, draw, clone)
