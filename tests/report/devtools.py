"""A browser that tests drive by its DevTools protocol, over a pipe: no driver, no port."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
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
    "--force-prefers-reduced-motion",  # the shape begins to move when it is told to
    "--hide-scrollbars",
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


class Browser:
    """A headless Chromium with one page, whose console and requests are kept."""

    def __init__(self) -> None:
        self._folder = tempfile.mkdtemp()
        ours, theirs = os.pipe(), os.pipe()  # commands to it, answers of it

        def as_three_and_four() -> None:  # where Chromium expects the pipe
            read, write = (fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (ours[0], theirs[1]))
            os.dup2(read, 3)
            os.dup2(write, 4)

        self._process = subprocess.Popen(
            [str(PATH), *OPTIONS, f"--user-data-dir={self._folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            close_fds=False,
            preexec_fn=as_three_and_four,
        )
        os.close(ours[0])
        os.close(theirs[1])
        self._to, self._from, self._rest, self._count = ours[1], theirs[0], b"", 0
        self._session: str | None = None
        self.events: list[dict[str, Any]] = []
        targets = self.command("Target.getTargets")["targetInfos"]
        page = next(t for t in targets if t["type"] == "page")["targetId"]
        attached = self.command("Target.attachToTarget", targetId=page, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.command(f"{domain}.enable")

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command and wait for its answer."""
        self._count += 1
        told = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            told["sessionId"] = self._session
        text = json.dumps(told).encode() + b"\0"
        while text:
            text = text[os.write(self._to, text) :]
        own = self._count
        while True:
            answer = self._next()
            if answer.get("id") == own:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self.events.append(answer)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            assert select.select([self._from], [], [], PATIENCE)[0], "the browser says nothing"
            more = os.read(self._from, 1 << 20)
            assert more, "the browser has ended"
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        return json.loads(text)

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
        self.events = []
        self.command("Page.navigate", url=address)
        while not any(e["method"] == "Page.loadEventFired" for e in self.events):
            self.events.append(self._next())

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
        """End the browser and what it kept."""
        try:
            self._session = None
            self.command("Browser.close")
        except (AssertionError, OSError):
            self._process.terminate()
        self._process.wait(timeout=PATIENCE)
        for end in (self._to, self._from):
            os.close(end)
        shutil.rmtree(self._folder, ignore_errors=True)
