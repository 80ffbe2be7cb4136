"""Serves the page and speaks with browsers, on this machine alone.

Who may come: whoever knows the token, which is a part of every address; the ``Host`` must name this
machine, so that no stranger's name can be turned on it, and a browser's ``Origin`` must be the page
itself. Who may steer: one browser, the controller, until it leaves. All others watch.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import queue
import re
import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from sldvexp.console.board import NoticeBoard
from sldvexp.errors import UserError

PAGE = Path(__file__).with_name("page")
#: Files of the page that a browser may have.
FILES = tuple(sorted(file.name for file in PAGE.iterdir() if file.is_file()))
#: Names of this machine that a browser may use; through a port forward the port is another.
HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")
#: Bytes of a wish at most.
LONGEST = 2**14
#: How soon a controller that has silently gone is missed, s: asked so often, waited for so long.
ASKED, WAITED = 1.0, 5.0
#: Pause between two loads of news to a browser, s.
PAUSE = 0.02
#: Answers to who may not come.
NOT_HERE = "This is not an address of the console: use the one that it printed."

OWN = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
#: A run's own page has its scripts inside; it is kept apart from the console and the network.
APART = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; worker-src blob:; font-src data:"
)

#: How the bench hears that the controller has gone.
LOST = {"do": "lost"}

Wish = dict[str, Any]


class Server:
    """Server of the console; as a context manager it serves in a thread of its own.

    Parameters
    ----------
    board : NoticeBoard
        What browsers see.
    wishes : queue of dict
        Gets what the controller wants, and `LOST` when it has gone.
    page_of_run : callable
        Gives the page of the run that was finished last, None if there is none.
    plan : callable
        Draws the figure of the plan that was made last, as PNG, for a narrow screen or not; empty
        if there is none.
    port : int
        0 takes a free one.
    token : str, optional
        Part of the address; a new one by default.
    """

    def __init__(
        self,
        board: NoticeBoard,
        wishes: queue.Queue[Wish],
        page_of_run: Callable[[], Path | None],
        plan: Callable[[bool], bytes] = lambda narrow: b"",
        port: int = 0,
        token: str | None = None,
    ) -> None:
        self.board, self.wishes = board, wishes
        self.page_of_run, self.plan = page_of_run, plan
        self.token = token or secrets.token_urlsafe(24)
        self.controller: WebSocket | None = None
        try:
            self._socket = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            told = f"cannot listen on 127.0.0.1, port {port}: {error.strerror}"
            raise UserError(f"{told}; without --port a free one is taken") from None
        self.port: int = self._socket.getsockname()[1]
        settings = uvicorn.Config(
            guarded(self._application()),
            lifespan="off",
            log_config=None,
            log_level="critical",  # a run has a log of its own
            access_log=False,
            server_header=False,
            proxy_headers=False,
            ws="auto",
            ws_max_size=LONGEST,
            ws_per_message_deflate=False,  # it takes a scan's processor more than it saves a line
            ws_ping_interval=ASKED,
            ws_ping_timeout=WAITED,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(settings)
        self._thread = threading.Thread(target=self._serve, name="console", daemon=True)
        self._watching: set[WebSocket] = set()

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/{self.token}/"

    def __enter__(self) -> Server:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()

    def _serve(self) -> None:
        asyncio.run(self._server.serve(sockets=[self._socket]))

    def _application(self) -> Starlette:
        return Starlette(
            routes=[
                Route("/{token}/", self._file),
                Route("/{token}/run.html", self._page_of_run),
                Route("/{token}/plan.png", self._plan),
                Route("/{token}/narrow_plan.png", self._plan),
                Route("/{token}/{name}", self._file),
                WebSocketRoute("/{token}/talk", self._talk),
            ]
        )

    def _known(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())

    async def _file(self, request: Request) -> Response:
        """Give a file of the page."""
        name = request.path_params.get("name", "index.html")
        if not self._known(request.path_params["token"]) or name not in FILES:
            return PlainTextResponse(NOT_HERE, 404)
        return FileResponse(PAGE / name)

    async def _page_of_run(self, request: Request) -> Response:
        """Give the page of the run that was finished last."""
        known = self._known(request.path_params["token"])  # first: a stranger has nothing looked up
        page = self.page_of_run() if known else None
        if page is None or not page.is_file():
            return PlainTextResponse(NOT_HERE, 404)
        return FileResponse(page, headers={"content-security-policy": APART})

    async def _plan(self, request: Request) -> Response:
        """Give the figure of the plan that was made last."""
        known = self._known(request.path_params["token"])
        narrow = request.url.path.endswith("narrow_plan.png")
        # It is drawn by now at the earliest, which must not keep the others waiting.
        figure = await asyncio.to_thread(self.plan, narrow) if known else b""
        if not figure:
            return PlainTextResponse(NOT_HERE, 404)
        return Response(figure, media_type="image/png")

    async def _talk(self, browser: WebSocket) -> None:
        """Speak with one browser until it goes."""
        if not self._known(browser.path_params["token"]) or not _own_page(browser):
            await browser.close(1008)  # before it is accepted: the answer is 403
            return
        await browser.accept()
        loop, woken = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            if woken.is_set():  # it has not begun to read since
                return
            with suppress(RuntimeError):  # a loop that has ended wakes nobody
                loop.call_soon_threadsafe(woken.set)

        reader = self.board.reader(wake)
        self._watching.add(browser)
        self._tell_who_steers()
        woken.set()
        telling = asyncio.create_task(self._tell(browser, reader, woken))
        try:
            while True:
                await self._hear(browser, await browser.receive_text())
        except (WebSocketDisconnect, KeyError, RuntimeError):  # it has gone, or sent no text
            pass
        finally:
            telling.cancel()
            self.board.leave(reader)
            self._watching.discard(browser)
            self._let_go(browser)

    async def _tell(self, browser: WebSocket, reader: Any, woken: asyncio.Event) -> None:
        """Send what is new, as fast as the browser takes it."""
        more, told = False, ""
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                if not more:
                    await woken.wait()
                woken.clear()
                news, more = self.board.news(reader)
                for each in news:
                    if isinstance(each, str):
                        await browser.send_text(each)
                    else:
                        await browser.send_bytes(each)
                if told != (told := self._role(browser)):
                    await browser.send_text(json.dumps({"role": told}))
                await asyncio.sleep(0 if more else PAUSE)

    async def _hear(self, browser: WebSocket, text: str) -> None:
        """Take what a browser wants: the controller's wishes go to the bench."""
        try:
            wish = json.loads(text)
        except (ValueError, RecursionError):
            wish = None
        if not isinstance(wish, dict) or not isinstance(wish.get("do"), str):
            await _refuse(browser, "That is no wish that the console knows.")
        elif wish["do"] == "take":
            if self.controller not in (None, browser):
                await _refuse(browser, "Somebody else is steering; you are watching.")
            else:
                self.controller = browser
                self.wishes.put({"do": "taken"})
            self._tell_who_steers()
        elif wish["do"] == "leave" and self.controller is browser:
            self._let_go(browser)
        elif self.controller is not browser:
            await _refuse(browser, "You are watching: only who steers can do that.")
        elif wish["do"] in ("lost", "taken"):
            await _refuse(browser, "That is no wish that the console knows.")
        else:
            self.wishes.put(wish)

    def _let_go(self, browser: WebSocket) -> None:
        """Note that a browser does not steer any more."""
        if self.controller is browser:
            self.controller = None
            self.wishes.put(dict(LOST))
            self._tell_who_steers()

    def _tell_who_steers(self) -> None:
        told = {"steered": self.controller is not None, "browsers": len(self._watching)}
        self.board.tell("who", told)

    def _role(self, browser: WebSocket) -> str:
        return "controller" if browser is self.controller else "watcher"


def guarded(app: ASGIApp) -> ASGIApp:
    """Let in only who calls this machine by its own name, and say to browsers how to be careful."""

    async def guard(scope: Scope, receive: Receive, send: Send) -> None:
        host = _header(scope, b"host")
        if not HOST.fullmatch(host):
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.close", "code": 1008})
                return
            await PlainTextResponse(NOT_HERE, 421)(scope, receive, send)
            return

        async def careful(message: Message) -> None:
            if message["type"] == "http.response.start":
                named = {name for name, _ in message["headers"]}
                added = {
                    b"content-security-policy": OWN.format(host=host).encode(),
                    b"cross-origin-opener-policy": b"same-origin",
                    b"cross-origin-resource-policy": b"same-origin",
                    b"referrer-policy": b"no-referrer",
                    b"x-content-type-options": b"nosniff",
                    b"x-frame-options": b"DENY",
                    b"cache-control": b"no-store",
                }
                more = [(name, value) for name, value in added.items() if name not in named]
                message["headers"] = [*message["headers"], *more]
            await send(message)

        await app(scope, receive, careful)

    return guard


def _own_page(browser: WebSocket) -> bool:
    """Tell whether a page of this very server opened the connection."""
    host = browser.headers.get("host", "")
    return browser.headers.get("origin") == f"http://{host}"


def _header(scope: Scope, name: bytes) -> str:
    """Find a header that must be there once."""
    found = [value.decode("latin-1") for key, value in scope["headers"] if key == name]
    return found[0] if len(found) == 1 else ""


async def _refuse(browser: WebSocket, why: str) -> None:
    await browser.send_text(json.dumps({"refused": why}))
