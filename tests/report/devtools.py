"""A browser that tests drive by its DevTools protocol, over a pipe: no driver, no port."""

from __future__ import annotations

import atexit
import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATH = next((path for name in NAMES if (path := shutil.which(name))), None)
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-gpu-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-rasterization",  # which is slower without such a processor
    "--disable-gpu-compositing",
    "--force-prefers-reduced-motion",  # the shape begins to move when it is told to
    "--hide-scrollbars",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--no-first-run",
    "--remote-debugging-pipe",
)
PATIENCE = 60
#: Keys with their numbers, and the text of those that write.
KEYS = {
    "ArrowLeft": 37,
    "ArrowUp": 38,
    "ArrowRight": 39,
    "ArrowDown": 40,
    "Home": 36,
    "End": 35,
    "Tab": 9,
    "Enter": 13,
    " ": 32,
    "Backspace": 8,
}
WRITTEN = {" ": " ", "Enter": "\r"}


class Chromium:
    """A headless Chromium in a process of its own, which all pages of these tests share."""

    def __init__(self) -> None:
        self._folder = tempfile.mkdtemp()
        ours, theirs = os.pipe(), os.pipe()  # commands to it, answers of it

        def as_three_and_four() -> None:  # where Chromium expects the pipe
            read, write = (fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (ours[0], theirs[1]))
            os.dup2(read, 3)
            os.dup2(write, 4)

        self.process = subprocess.Popen(
            [str(PATH), *OPTIONS, f"--user-data-dir={self._folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            close_fds=False,
            preexec_fn=as_three_and_four,
        )
        os.close(ours[0])
        os.close(theirs[1])
        self._to, self._from, self._rest, self._count = ours[1], theirs[0], b"", 0
        #: What pages said without being asked, by their sessions.
        self.events: dict[str, list[dict[str, Any]]] = {}
        atexit.register(self.close)

    def command(self, session: str | None, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command, to a page or to the browser itself, and wait for its answer."""
        self._count += 1
        told = {"id": self._count, "method": method, "params": parameters}
        if session:
            told["sessionId"] = session
        text = json.dumps(told).encode() + b"\0"
        while text:
            text = text[os.write(self._to, text) :]
        while (answer := self.hear()).get("id") != self._count:
            pass
        assert "error" not in answer, (method, answer["error"])
        return answer["result"]

    def hear(self) -> dict[str, Any]:
        """Wait for what is said next, and keep it with its page if nobody asked for it."""
        while b"\0" not in self._rest:
            assert select.select([self._from], [], [], PATIENCE)[0], "the browser says nothing"
            more = os.read(self._from, 1 << 20)
            assert more, "the browser has ended"
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        said = json.loads(text)
        if "id" not in said and (events := self.events.get(said.get("sessionId", ""))) is not None:
            events.append(said)
        return said

    def close(self) -> None:
        """End the browser and what it kept."""
        atexit.unregister(self.close)
        try:
            self.command(None, "Browser.close")
        except (AssertionError, OSError):
            self.process.terminate()
        self.process.wait(timeout=PATIENCE)
        for end in (self._to, self._from):
            os.close(end)
        shutil.rmtree(self._folder, ignore_errors=True)


#: The browser of this process, once a page was asked for.
_running: list[Chromium] = []


def running() -> Chromium:
    """Give the browser of this process, which begins with its first page."""
    if _running and _running[0].process.poll() is not None:
        _running.pop().close()
    if not _running:
        _running.append(Chromium())
    return _running[0]


class Browser:
    """A page as a browser of its own has it, whose console and requests are kept.

    It shares the process with others, and neither their files, cookies nor focus.
    """

    def __init__(self) -> None:
        self._chromium = running()
        self._session: str | None = None
        self._context = self.command("Target.createBrowserContext")["browserContextId"]
        page = self.command(
            "Target.createTarget", url="about:blank", browserContextId=self._context, newWindow=True
        )
        attached = self.command("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        self._chromium.events[self._session] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.command(f"{domain}.enable")
        self.command("Emulation.setFocusEmulationEnabled", enabled=True)

    @property
    def events(self) -> list[dict[str, Any]]:
        """What the page said without being asked since it was opened."""
        return self._chromium.events[str(self._session)]

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command and wait for its answer."""
        return self._chromium.command(self._session, method, **parameters)

    def size(self, width: int, height: int) -> None:
        """Set the size of the page."""
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def open(self, path: Path) -> None:
        """Open a page of this machine, and forget what others said."""
        self.open_address(path.as_uri())

    def open_address(self, address: str) -> None:
        """Open a page by its address, and forget what others said."""
        self.events.clear()
        self.command("Page.navigate", url=address)
        while not any(e["method"] == "Page.loadEventFired" for e in self.events):
            self._chromium.hear()

    def js(self, code: str, *arguments: Any) -> Any:
        """Run the body of a function with arguments and give what it returns."""
        call = f"(function(){{{code}}})(...{json.dumps(arguments)})"
        told = self.command(
            "Runtime.evaluate", expression=call, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def wait(self, condition: Any) -> None:
        """Wait until a condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "the page takes too long"
            time.sleep(0.05)

    def key(self, name: str) -> None:
        """Press a key and let it go."""
        number = KEYS.get(name, ord(name[0].upper()))
        told = {"key": name, "code": "Space" if name == " " else name}
        told |= {"windowsVirtualKeyCode": number, "nativeVirtualKeyCode": number}
        text = WRITTEN.get(name, name if len(name) == 1 else "")
        down = {"type": "keyDown", "text": text} if text else {"type": "rawKeyDown"}
        self.command("Input.dispatchKeyEvent", **told, **down)
        self.command("Input.dispatchKeyEvent", type="keyUp", **told)

    def mouse(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the button at one place and let it go at another."""
        told = {"button": "left", "clickCount": 1}
        for kind, (x, y), buttons in (
            ("mouseMoved", start, 0),
            ("mousePressed", start, 1),
            ("mouseMoved", end, 1),
            ("mouseReleased", end, 0),
        ):
            self.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, buttons=buttons, **told)

    def wheel(self, place: tuple[float, float], down: float, control: bool = False) -> None:
        """Turn the wheel at a place."""
        x, y = place
        told = {"deltaX": 0, "deltaY": down, "modifiers": 2 if control else 0}
        self.command("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, **told)

    def picture(self) -> bytes:
        """Take a picture of what is seen."""
        return base64.b64decode(self.command("Page.captureScreenshot")["data"])

    def said(self) -> list[str]:
        """List errors and warnings, of the page's own scripts or about them."""
        found = []
        for event in self.events:
            own = event.get("params", {})
            if event["method"] == "Runtime.exceptionThrown":
                found.append(json.dumps(own["exceptionDetails"]))
            elif event["method"] == "Log.entryAdded":
                entry = own["entry"]
                driver = "GL Driver Message" in entry["text"]  # of reading pixels for the picture
                if entry["level"] in ("error", "warning") and not driver:
                    found.append(entry["text"])
            elif event["method"] == "Runtime.consoleAPICalled" and own["type"] != "debug":
                found.append(json.dumps(own["args"]))
        return found

    def fetched(self) -> list[str]:
        """List the addresses of all that was asked for."""
        asked = "Network.requestWillBeSent"
        return [e["params"]["request"]["url"] for e in self.events if e["method"] == asked]

    def close(self) -> None:
        """End the page and what it kept, if the browser was not killed."""
        with suppress(AssertionError, OSError):
            told = {"browserContextId": self._context}
            self._chromium.command(None, "Target.disposeBrowserContext", **told)
        del self._chromium.events[str(self._session)]

    def kill(self) -> None:
        """End the browser in the middle of what it does, with all its pages."""
        self._chromium.process.kill()
        self._chromium.process.wait(timeout=PATIENCE)
