"""Local server of the page: it listens on the loopback address and accepts only connections from its own page."""

from __future__ import annotations

import errno
import logging
from collections.abc import Callable
from socket import create_server, socket
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.web import ErrorHandler

from softness_bayes.base.errors import InputError
from softness_bayes.report.explore.page import Page
from softness_bayes.report.explore.subject import Subject

ADDRESS = "127.0.0.1"
"""The loopback address: nobody else on a network reaches it."""


def listening(port: int) -> socket:
    """Return a socket that listens on a port of the loopback address; port 0 selects any free port.

    Raises
    ------
    InputError
        If the port is taken.
    """
    try:
        return create_server((ADDRESS, port))
    except OSError as error:
        known = {errno.EADDRINUSE: "it is in use", errno.EACCES: "it needs other permissions"}
        reason = known.get(error.errno or 0, error.strerror)
        raise InputError(f"--port {port}: {reason}; expected a free port, or 0 for any that is free") from None


def serve(subject: Subject, opened: socket, report: Callable[[str], None]) -> None:
    """Serve the page of a subject until the process is interrupted.

    Parameters
    ----------
    subject
        The model to explore.
    opened
        Socket from `listening`.
    report
        Callback that receives the page's address once the server runs.
    """
    server = page_server(subject, opened)
    report(address_of(server))
    server.io_loop.start()


def page_server(subject: Subject, opened: socket) -> BaseServer:
    """Return a server of the page in this thread's event loop; the caller starts it."""
    for name in ("bokeh", "tornado"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [logging.NullHandler()], False

    def begin(document: Document) -> None:
        Page(subject, document)

    application = Application(FunctionHandler(begin))
    opened.setblocking(False)
    port = opened.getsockname()[1]
    tornado = _Tornado({"/": application}, extra_websocket_origins=[f"{ADDRESS}:{port}"])
    tornado.port = port
    http = HTTPServer(tornado)
    http.add_socket(opened)
    server = BaseServer(IOLoop.current(), tornado, http)
    server.start()
    return server


class _Tornado(BokehTornado):
    """Bokeh's application for the page's own address alone.

    A page of another site may let its own name point to the loopback address (DNS rebinding). The browser then takes
    this server for that site, and names that site as host. So every request, those that open a websocket included, must
    name the address and port as its host, and as its origin if it has one.
    """

    port: int
    """The port that is served."""

    def find_handler(self, request: HTTPServerRequest, **kwargs: Any) -> Any:
        hosts = {f"{ADDRESS}:{self.port}"} | ({ADDRESS} if self.port == 80 else set())
        origin = request.headers.get("Origin")
        if request.headers.get("Host") in hosts and (origin is None or origin.removeprefix("http://") in hosts):
            return super().find_handler(request, **kwargs)
        return self.get_handler_delegate(request, ErrorHandler, {"status_code": 403})


def address_of(server: BaseServer) -> str:
    """Return the address of a server's page."""
    return f"http://{ADDRESS}:{server.port}/"
