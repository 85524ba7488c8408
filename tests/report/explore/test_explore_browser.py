"""The page in a real browser: a moved slider moves the curve, and its words and command follow."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from softness_bayes.report.charts import chart_data
from softness_bayes.report.explore.picture import picture
from support.browser import browser, find_browser
from support.report_runs import EVIL

pytestmark = pytest.mark.browser

DRAWN = "typeof Bokeh !== 'undefined' && Bokeh.documents.length > 0 && Bokeh.documents[0].is_idle"
MODEL = "Bokeh.documents[0].get_model_by_name({!r})"
COLUMN = "Array.from(" + MODEL + ".data[{!r}])"
TWO_FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
HANDLE = "Bokeh.index.find_one_by_id({0}.id).el.shadowRoot.querySelector('.noUi-handle')"


@pytest.fixture(scope="module")
def window(tmp_path_factory, of_ratings, served):
    """The page of a run on ratings, drawn."""
    program = find_browser()
    if program is None:
        pytest.skip("no browser: install chromium (apt-get install chromium) to run these tests")
    with served(of_ratings) as address, browser(program, tmp_path_factory.mktemp("browser")) as opened:
        opened.resize(1300)
        opened.visit(address)
        opened.wait(DRAWN)
        opened.address = address
        yield opened
        opened.visit("about:blank")


def column(window, name, key):
    return np.array(window.script(COLUMN.format(name, key)), float)


def command(window):
    """Return the text of the command as a mouse selects it."""
    return window.script(
        f"(() => {{ const shown = Bokeh.index.find_one_by_id({MODEL.format('said')}.id).el.shadowRoot; "
        "const range = document.createRange(); range.selectNodeContents(shown.querySelector('pre')); "
        "return range.toString(); })()"
    )


def wait_for(window, text):
    window.wait(f"{MODEL.format('said')}.text.includes({json.dumps(text)})")


def test_it_shows_the_run_in_silence(window, of_ratings, result):
    found, load = picture(of_ratings, of_ratings.start), of_ratings.start.load
    np.testing.assert_allclose(column(window, "curve", "rate"), found.rate[load])
    np.testing.assert_allclose(column(window, "curve", "rating"), found.rating[load])
    expected = chart_data(result)["e_fab"][load]
    for name in ("rate", "rating"):
        for key in ("low90", "high50"):
            np.testing.assert_allclose(column(window, f"{name}/band", key), getattr(expected, name)[key])
    np.testing.assert_allclose(column(window, "data", "mean"), expected.fabrics["mean"])
    assert window.complaints() == []
    # everything comes from this server, and no name became an element
    own = (window.address, window.address.replace("http", "ws"), "data:", "blob:")
    assert [one for one in window.requested() if not one.startswith(own)] == []
    assert EVIL in window.script(f"{MODEL.format('fabric')}.options.map(one => one[1])")
    assert window.script("document.querySelectorAll('script').length") < 10


def test_a_moved_slider_moves_the_curve(window, of_ratings):
    before = column(window, "curve", "rate")
    handle = HANDLE.format(MODEL.format("b"))
    window.script(f"{handle}.focus()")
    for kind in ("keyDown", "keyUp"):
        window("Input.dispatchKeyEvent", type=kind, key="PageDown", code="PageDown", windowsVirtualKeyCode=34)
    window.wait(f"{MODEL.format('curve')}.data.rate[80] !== {float(before[80])!r}")
    span = next(one for one in of_ratings.spans if one.name == "b")
    state = of_ratings.start
    b = span.value(window.script(f"{MODEL.format('b')}.value"))
    assert b < state.values["b"]
    found = picture(of_ratings, replace(state, values={**state.values, "b": b}))
    wait_for(window, f"--set b={b:g}")
    np.testing.assert_allclose(column(window, "curve", "rate"), found.rate[state.load])
    assert found.sentences[0] in window.script(f"{MODEL.format('said')}.text")
    assert command(window) == found.command
    # the number beside the slider is the one that is computed with
    title = f"Bokeh.index.find_one_by_id({MODEL.format('b')}.id).el.shadowRoot.querySelector('.bk-slider-value')"
    assert window.script(f"{title}.textContent") == f"{b:g}"


def test_a_fast_drag_does_not_queue(window, of_ratings):
    """Forty events at once: the last is drawn, and most of the others are not."""
    span = next(one for one in of_ratings.spans if one.name == "b")
    places = np.linspace(span.place(span.low), span.place(span.high), 42)[1:-1].tolist()
    window.script(
        f"{{ window.drawn = 0; {MODEL.format('curve')}.properties.data.change.connect(() => window.drawn++); "
        f"for (const place of {places}) {MODEL.format('b')}.value = place }}"
    )
    wait_for(window, f"--set b={span.value(places[-1]):g} ")
    state = replace(of_ratings.start, values={**of_ratings.start.values, "b": span.value(places[-1])})
    window.script(TWO_FRAMES)
    shown = command(window)
    assert f"--set b={state.values['b']:g} " in shown
    assert 1 <= window.script("window.drawn") <= 20
    assert window.complaints() == []
