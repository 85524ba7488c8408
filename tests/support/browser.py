"""A headless browser for tests: Debian's chromium, spoken to in its own protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import websocket

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 60.0
"""Time [s] after which a browser that does not answer has failed."""


def find_browser() -> str | None:
    """Return the browser's program, or None."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Page:
    """One page of a running browser."""

    def __init__(self, socket: websocket.WebSocket) -> None:
        self._socket, self._number = socket, count(1)
        self.events: list[dict[str, Any]] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self(f"{domain}.enable")

    def __call__(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result; events on the way are kept."""
        number = next(self._number)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                return message["result"]
            self.events.append(message)

    def open(self, path: Path) -> None:
        """Load a file from disk, and wait until the page and its charts stand."""
        self.events.clear()
        self("Page.navigate", url=path.resolve().as_uri())
        self.wait("document.readyState === 'complete' && location.protocol === 'file:'")

    def visit(self, address: str) -> None:
        """Load a page of a server on this machine, and wait until it stands."""
        self.events.clear()
        self("Page.navigate", url=address)
        self.wait(f"document.readyState === 'complete' && location.href === {json.dumps(address)}")

    def script(self, expression: str) -> Any:
        """Return the value of an expression; a promise is awaited."""
        found = self("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str) -> None:
        """Wait until an expression holds."""
        end = time.monotonic() + PATIENCE
        while not self.script(expression):
            assert time.monotonic() < end, f"never: {expression}"
            time.sleep(0.02)

    def complaints(self) -> list[str]:
        """Return what the page wrote to the console as an error or a warning, and what it threw."""
        self.script("0")
        found = []
        for event in self.events:
            match event["method"], event["params"]:
                case "Runtime.exceptionThrown", {"exceptionDetails": details}:
                    found.append(details.get("exception", {}).get("description", details["text"]))
                case "Runtime.consoleAPICalled", {"type": "error" | "warning" | "assert"} as call:
                    found.append(json.dumps(call["args"]))
                case "Log.entryAdded", {"entry": {"level": "error" | "warning"} as entry}:
                    found.append(entry["text"])
        return found

    def requested(self) -> list[str]:
        """Return every address that the page asked for."""
        self.script("0")
        return [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]

    def resize(self, width: int, height: int = 900) -> None:
        """Give the page the size of a window [CSS pixels]."""
        mobile = width < 600
        self("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)
        self.script("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def printed(self) -> bytes:
        """Return the page as PDF."""
        return base64.b64decode(self("Page.printToPDF")["data"])


@contextmanager
def browser(program: str, home: Path) -> Iterator[Page]:
    """Run a browser with a directory of its own, and end it."""
    flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]
    flags += [
        "--disable-background-networking",
        "--disable-component-update",
        "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
    ]
    flags += ["--remote-allow-origins=*", "--remote-debugging-port=0", f"--user-data-dir={home}", "about:blank"]
    process = subprocess.Popen([program, *flags], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        address = _address(process)
        with_pages = websocket.create_connection(address, timeout=PATIENCE)
        control = Page.__new__(Page)
        control._socket, control._number, control.events = with_pages, count(1), []
        target = control("Target.createTarget", url="about:blank")["targetId"]
        port = address.split("/devtools/")[0]
        socket = websocket.create_connection(f"{port}/devtools/page/{target}", timeout=PATIENCE)
        try:
            yield Page(socket)
        finally:
            socket.close()
            with_pages.close()
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stderr.close()


def _address(process: subprocess.Popen[str]) -> str:
    """Return where a starting browser says that it listens."""
    said = []
    for line in process.stderr:
        said.append(line)
        if "DevTools listening on " in line:
            return line.split("DevTools listening on ")[1].strip()
    raise AssertionError(f"the browser did not start: {''.join(said)}")
