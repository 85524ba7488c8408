"""The server of the page: who reaches it, who may speak to it, and how the command begins and refuses."""

from __future__ import annotations

import socket
import urllib.parse
from html import escape

import pytest
from bokeh.document import Document
from bokeh.events import ButtonClick

from softness_bayes.base.errors import InputError
from softness_bayes.cli import report
from softness_bayes.report.explore import server
from softness_bayes.report.explore.page import ANY, Page
from softness_bayes.report.explore.picture import picture
from softness_bayes.report.explore.server import listening
from support.command_line import call, refused


@pytest.fixture(scope="module")
def address(of_medians, served):
    with served(of_medians) as address:
        yield urllib.parse.urlsplit(address)


def status(address, target="/", host=None, origin=None, upgrade=False):
    """Send a request as it stands, and return the status of the answer."""
    lines = [f"GET {target} HTTP/1.1", "Connection: close"]
    lines += [] if host is None else [f"Host: {host}"]
    lines += [] if origin is None else [f"Origin: {origin}"]
    if upgrade:
        lines[1] = "Connection: Upgrade"
        lines += ["Upgrade: websocket", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="]
    with socket.create_connection((address.hostname, address.port), timeout=60) as channel:
        channel.sendall("\r\n".join([*lines, "", ""]).encode())
        return int(channel.recv(64).split()[1])


def foreign_hosts(address):
    """Return names under which a page of another site could reach the server."""
    port = address.port
    return ("evil.example", f"evil.example:{port}", f"localhost:{port}", f"127.0.0.1:{port + 1}", "127.0.0.1", None)


def test_only_its_own_address_is_answered(address):
    """Against a page of another site whose name points to the loopback address (DNS rebinding)."""
    own = address.netloc
    assert status(address, host=own) == 200
    assert status(address, host=own, origin=f"http://{own}") == 200
    assert status(address, "/ws", own, f"http://{own}", upgrade=True) == 101
    for host in foreign_hosts(address):
        for target in ("/", "/autoload.js", "/ws", "/static/js/bokeh.min.js", f"http://{own}/"):
            assert status(address, target, host) in (400, 403), (host, target)
        assert status(address, "/ws", host, f"http://{host}", upgrade=True) in (400, 403), host
    for origin in (*(f"http://{host}" for host in foreign_hosts(address)), "null", f"https://{own}"):
        assert status(address, "/", own, origin) == 403, origin
        assert status(address, "/ws", own, origin, upgrade=True) == 403, origin


def test_the_check_of_addresses_is_what_refuses(address, monkeypatch):
    """Control: without it, another site's name gets the page, and its token."""
    monkeypatch.delattr(server._Tornado, "find_handler")
    assert status(address, host=f"evil.example:{address.port}") == 200
    assert status(address, host=address.netloc, origin="http://evil.example") == 200


def test_a_port_that_is_taken_is_refused():
    with listening(0) as taken:
        assert taken.getsockname()[0] == "127.0.0.1"
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--port {port}: it is in use; expected a free port"), listening(port):
            pass
    with listening(port):  # it was closed
        pass


# the page without a browser


@pytest.fixture
def page(of_medians):
    return Page(of_medians, Document())


def test_a_slider_redraws_and_reset_goes_back(page, of_medians):
    before = page.said.text, page.charts.sources["curve"].data["rate"]
    page.sliders["b"].value = of_medians.spans[0].place(50.0)
    assert page.state.values["b"] == 50.0
    found = picture(of_medians, page.state)
    assert page.charts.sources["curve"].data["rate"] == pytest.approx(found.rate[page.state.load])
    assert escape(found.command) in page.said.text
    assert "--set b=50 " in page.said.text
    page.reset._trigger_event(ButtonClick(page.reset))
    assert page.state == of_medians.start
    assert page.said.text == before[0]
    assert page.charts.sources["curve"].data["rate"] == pytest.approx(before[1])


def test_fabric_and_modulus_follow_each_other(page):
    page.fabric.value = "2"
    assert page.spans["E_fab"].value(page.sliders["E_fab"].value) == pytest.approx(900.0, rel=1e-4)
    assert "canvas, 900 kPa" in page.said.text
    page.sliders["E_fab"].value = page.spans["E_fab"].place(300.0)
    assert (page.fabric.value, page.state.fabric, page.state.modulus_kpa) == ("", None, 300.0)
    assert page.fabric.options[-1][1] == ANY
    page.load.value = "0"
    assert page.state.load == 0
    assert "Indentation 1 mm" in page.said.text


def test_what_the_model_refuses_is_said_and_the_charts_stay(page, monkeypatch):
    before = page.charts.sources["curve"].data

    def refuse(*_):
        raise InputError("b <1>")

    monkeypatch.setattr("softness_bayes.report.explore.page.picture", refuse)
    page.load.value = "0"
    assert page.said.text == "<p>This cannot be drawn: b &lt;1&gt;</p>"
    assert page.charts.sources["curve"].data is before


# the command


@pytest.fixture
def unserved(monkeypatch):
    """The command up to the moment when it would serve."""
    seen = []
    monkeypatch.setattr(server, "serve", lambda subject, opened, told: (seen.append(subject), told("http://there/")))
    return seen


def test_the_command_prints_the_address(unserved, monkeypatch):
    opened = []
    monkeypatch.setattr(report.webbrowser, "open", opened.append)
    done = call("explore")
    assert (done.returncode, done.stdout, done.stderr) == (0, "http://there/\n", "Ctrl-C ends it\n")
    assert opened == []
    (subject,) = unserved
    assert [str(load) for load in subject.loads] == ["1 mm", "2 mm", "3 mm"]
    assert "example denim" in subject.fabrics.names
    assert call("explore", "--show", "--force-n", "1", "--fix", "m=2").returncode == 0
    assert opened == ["http://there/"]
    assert [str(load) for load in unserved[1].loads] == ["1 N"]
    assert "m" not in [span.name for span in unserved[1].spans]


def test_bad_input_is_refused(unserved, tmp_path, report_run):
    refused(call("explore", tmp_path), "posterior.nc: no such file; expected the posterior.nc of a run")
    refused(call("explore", tmp_path / "none"), "no such file")
    (tmp_path / "unfinished" / "checkpoint").mkdir(parents=True)
    unfinished = call("explore", "unfinished", cwd=tmp_path)
    refused(unfinished, "error: unfinished/posterior.nc: no such file", "try: softness-bayes resume unfinished")
    report_run("skin").save(tmp_path / "skin")
    refused(call("explore", tmp_path / "skin"), "without ratings")
    refused(call("explore", tmp_path / "skin", "--fix", "m=2"), "DIR has its own")
    refused(call("explore", "--column", "fabric=x"), "give --fabrics")
    refused(call("explore", "--port", "70000"), "70000")
    refused(call("explore", "--fix", "c_Na=3"), "c_Na")
    with socket.create_server(("127.0.0.1", 0)) as other:
        refused(call("explore", "--port", other.getsockname()[1]), "it is in use; expected a free port, or 0")
    assert unserved == []
