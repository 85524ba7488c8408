"""The report in a real browser: it loads in silence, its switches switch, and it fits a desk, a phone and paper."""

from __future__ import annotations

import numpy as np
import pytest

from softness_bayes.report.charts import chart_data
from softness_bayes.report.page import write_report
from support.browser import browser, find_browser

pytestmark = pytest.mark.browser

DRAWN = "Bokeh.documents.length > 0 && Bokeh.documents.every(drawn => drawn.is_idle)"
MODEL = "Bokeh.documents.map(drawn => drawn.get_model_by_name({!r})).find(found => found !== null)"
COLUMN = "Array.from(" + MODEL + ".data[{!r}])"


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    program = find_browser()
    if program is None:
        pytest.skip("no browser: install chromium (apt-get install chromium) to run these tests")
    with browser(program, tmp_path_factory.mktemp("browser")) as window:
        yield window


@pytest.fixture(scope="module")
def result(report_run):
    return report_run("ratings")


@pytest.fixture(scope="module")
def opened(chromium, result, tmp_path_factory):
    """The report of ratings in a window as wide as a desk's, all charts drawn."""
    path = write_report(result, tmp_path_factory.mktemp("report") / "report.html")
    assert path.stat().st_size < 5e6
    chromium.resize(1200)
    chromium.open(path)
    chromium.wait(DRAWN)
    return chromium


def choose(window, name, value):
    """Press a switch as a mouse does."""
    window.script(f"document.querySelector('input[name={name}][value=\"{value}\"]').parentElement.click()")


def columns(window, name, *keys):
    return [np.array(window.script(COLUMN.format(name, key)), float) for key in keys]


def test_it_loads_in_silence_and_asks_for_nothing(opened, result):
    assert opened.complaints() == []
    asked = opened.requested()
    assert asked[0].startswith("file:")
    assert all(address.startswith("data:") for address in asked[1:])
    # both charts stand, and every figure that is not kept for paper is drawn
    assert opened.script("document.querySelectorAll('.chart .bk-Figure').length") == 2
    assert opened.script("[...document.images].every(image => image.complete && image.naturalWidth > 300)")
    # no name became an element, nor ran
    assert opened.script("document.querySelectorAll('[onerror]').length") == 0


def test_a_complaint_would_be_heard(opened):
    """A control: an error, a warning and a broken promise are all seen."""
    before = len(opened.complaints())
    opened.script("console.error('one'); setTimeout(() => { throw new Error('two') }); console.warn('three')")
    opened.wait("new Promise(done => setTimeout(() => done(true), 50))")
    told = opened.complaints()[before:]
    assert len(told) == 3
    assert any("two" in text for text in told)
    opened.events.clear()


def test_switches_show_the_other_load_and_the_other_axis(opened, result):
    every = chart_data(result)
    for axis, load in (("e_fab", 1), ("ratio", 1), ("ratio", 0), ("e_fab", 0)):
        choose(opened, "axis", axis)
        choose(opened, "load", load)
        expected = every[axis][load]
        for what in ("rate", "rating"):
            keys = ("x", "median", "low50", "high50", "low90", "high90")
            for key, found in zip(keys, columns(opened, f"{what}/band", *keys), strict=True):
                np.testing.assert_allclose(found, getattr(expected, what)[key])
            ends = opened.script(f"[{MODEL.format(what)}.x_range.start, {MODEL.format(what)}.x_range.end]")
            assert ends == pytest.approx(expected.ends)
            assert opened.script(f"{MODEL.format(what)}.title.text") == expected.title
            label = opened.script(f"{MODEL.format(what)}.below[0].axis_label")
            assert ("E_skin" in label) == (axis == "ratio")
            np.testing.assert_allclose(*columns(opened, f"{what}/turn", "middle"), expected.turn["middle"])
        (mean,) = columns(opened, "rating/fabrics", "mean")
        np.testing.assert_allclose(mean, expected.fabrics["mean"])
        assert opened.script("document.getElementById('turn').textContent") == expected.sentence
        opened.wait(DRAWN)
    assert every["e_fab"][0].sentence != every["ratio"][1].sentence
    assert opened.complaints() == []


def test_a_pointed_at_curve_tells_its_values(opened):
    opened.script("document.querySelectorAll('.chart')[0].scrollIntoView({block: 'center'})")
    box = opened.script(
        "(({left, top, width, height}) => [left, top, width, height])"
        "(document.querySelectorAll('.chart')[0].getBoundingClientRect())"
    )
    opened("Input.dispatchMouseEvent", type="mouseMoved", x=box[0] + 0.6 * box[2], y=box[1] + 0.45 * box[3])
    tip = (
        "(function text(node) { return [...node.childNodes].map(text).join(' ') + "
        "(node.shadowRoot ? text(node.shadowRoot) : '') + (node.nodeType === 3 ? node.data : ''); })(document.body)"
    )
    opened.wait(f"/median: *\\s*[0-9.]+/.test({tip}.replace(/\\s+/g, ' '))")
    assert opened.complaints() == []


@pytest.mark.parametrize("width", [1200, 400, 320])
def test_it_fits_the_width_of_a_desk_and_of_a_phone(opened, width):
    opened.resize(width)
    opened.wait(DRAWN)
    assert opened.script("document.documentElement.scrollWidth") <= width
    assert opened.script("[...document.querySelectorAll('.chart')].every(c => c.scrollWidth <= innerWidth)")
    # wide tables scroll by themselves
    if width < 600:
        wide = opened.script(
            "(({scrollWidth, clientWidth}) => [scrollWidth, clientWidth])"
            "(document.getElementById('summary').parentElement)"
        )
        assert wide[0] > wide[1]
    opened.resize(1200)


def test_paper_has_every_load_and_no_switch(opened):
    opened("Emulation.setEmulatedMedia", media="print")
    seen = "e => getComputedStyle(e).display !== 'none'"
    assert not opened.script(f"[...document.querySelectorAll('.controls, .interactive')].some({seen})")
    assert opened.script(f"[...document.querySelectorAll('.replaced')].every({seen})")
    opened.resize(750)
    assert opened.script("document.documentElement.scrollWidth") <= 750
    opened.resize(1200)
    opened("Emulation.setEmulatedMedia", media="")
    assert opened.printed()[:5] == b"%PDF-"
    # what was folded away is printed too
    assert opened.script("[...document.querySelectorAll('details')].every(part => part.open)")
