"""A console in a process of its own, and a page of it in a real browser."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from sldvexp.virtual_lab.console import experiment
from sldvexp.virtual_lab.lab import VirtualLab
from tests.console.conftest import BENCH
from tests.report.devtools import Browser

PATIENCE = 120.0
ROOT = Path(__file__).parents[2]
#: Who runs tests in the background has them ignore Ctrl-C, and their processes too.
HEEDS = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)


class Served:
    """A console that serves ``experiment=bench`` of a folder of its own."""

    def __init__(self, folder: Path, *settings: str, bench: str = BENCH) -> None:
        self.folder = folder
        (folder / "my" / "experiment").mkdir(parents=True, exist_ok=True)
        (folder / "my" / "experiment" / "bench.yaml").write_text(bench)
        self.output = folder / "console.txt"
        line = [sys.executable, "-u", "-m", "sldvexp.cli.main", "console", "experiment=bench"]
        with self.output.open("w") as output:
            self.process = subprocess.Popen(
                [*line, *settings, "--config-dir", "my"],
                cwd=folder,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
                preexec_fn=HEEDS,
            )
        end = time.monotonic() + PATIENCE
        while not self.output.read_text().startswith("http"):
            assert self.process.poll() is None, self.output.read_text()
            assert time.monotonic() < end
            time.sleep(0.05)
        self.address = self.output.read_text().split()[0]

    @property
    def runs(self) -> list[Path]:
        """Folders of the runs that it has begun, the oldest first."""
        return sorted(path.parent for path in self.folder.glob("outputs/*/*/.hydra"))

    def end(self, number: int = signal.SIGINT) -> int:
        """End it and give its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(timeout=PATIENCE)


class Page(Browser):
    """The console's page, used by clicks and keys alone."""

    def __init__(self, address: str, size: tuple[int, int], dark: bool = False) -> None:
        super().__init__()
        self.address = address
        self.renew(size, dark)

    def renew(self, size: tuple[int, int], dark: bool = False) -> None:
        """Come anew, in a window of a size, and forget whatever was done here."""
        self.size(*size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.command("Emulation.setEmulatedMedia", features=[scheme])
        self.open_address("about:blank")  # an address that is only loaded anew scrolls back
        self.open_address(self.address)
        self.until(lambda: "Connecting" not in self.text("who"))

    def until(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, self.js("return document.body.innerText")
            time.sleep(0.03)

    def text(self, name: str) -> str:
        return self.js("return document.getElementById(arguments[0]).textContent", name)

    def can(self, name: str) -> bool:
        return self.js(
            "const e = document.getElementById(arguments[0]);"
            "return !e.disabled && e.getClientRects().length > 0",
            name,
        )

    def place(self, name: str, across: float = 0.5, down: float = 0.5) -> tuple[float, float]:
        """Bring a part into view and say where it is."""
        left, top, width, height = self.js(
            "const e = document.getElementById(arguments[0]);"
            "e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect();"
            "return [b.left, b.top, b.width, b.height]",
            name,
        )
        return left + across * width, top + down * height

    def click(self, name: str) -> None:
        """Click on a part, which must not move away under the mouse."""
        self.until(lambda: self.can(name))
        self.js(
            "window.met = ''; addEventListener('click',"
            "(event) => { window.met = event.target.id; }, {capture: true, once: true})"
        )
        at = self.place(name)
        self.mouse(at, at)
        assert self.js("return window.met") == name

    @property
    def beam(self) -> tuple[int, int]:
        return int(self.text("at-up")), int(self.text("at-left"))

    def click_at(self, dac) -> None:
        """Click on the field of view, and come as near as its pixels are to DAC steps."""
        code = "return document.getElementById('map').cells.placeOf(arguments[0])"
        at = self.place("map", *self.js(code, [float(d) for d in dac]))
        before = self.text("at-up"), self.text("at-left")
        self.mouse(at, at)
        self.until(lambda: (self.text("at-up"), self.text("at-left")) != before)

    def come_to(self, dac) -> None:
        """Bring the beam to DAC steps by a click and by arrow keys."""
        wanted = [int(d) for d in np.rint(dac)]
        self.click_at(wanted)
        for key, size in (("2", 10), ("1", 1)):
            self.key(key)
            for mirror, (more, less) in enumerate(
                (("ArrowUp", "ArrowDown"), ("ArrowLeft", "ArrowRight"))
            ):
                while abs(off := wanted[mirror] - self.beam[mirror]) >= size:
                    before = self.beam
                    self.key(more if off > 0 else less)
                    self.until(lambda before=before: self.beam != before)

    @property
    def view(self) -> str:
        """Name of the view that is chosen."""
        return self.js("return document.querySelector('#view [aria-selected=true]').dataset.name")

    @property
    def marks(self) -> int:
        """Number of marks that are set in this view."""
        return self.js(
            "return [...document.querySelectorAll('#marks tbody tr')].filter((row) =>"
            "row.cells[1].textContent !== '–' && !row.cells[1].classList.contains('predicted'))"
            ".length"
        )

    def mark(self) -> None:
        count = self.marks
        self.key("m")
        self.until(lambda: self.marks == count + 1)

    def choose_next_view(self) -> None:
        """Choose the next view as a person at the keyboard does."""
        before = self.view
        self.js("document.querySelector('#view [aria-selected=true]').focus()")
        self.key("ArrowDown")
        self.key("Enter")
        self.until(lambda: self.view != before)
        self.until(lambda: self.marks == 0)

    def aim(self, lab: VirtualLab, view: str) -> None:
        """Aim at three circles as they are seen, and go to the rest where it is predicted."""
        lab.use_view(view)
        for place in lab.true_dac(lab.calibration_object.center)[:3]:
            self.come_to(place + np.array([2, -3]))  # nobody meets the middle
            self.mark()
        for _ in range(5):
            self.until(lambda: self.can("go"))
            before = self.beam
            self.key("g")
            self.until(lambda before=before: self.beam != before)
            self.mark()


def bench_lab() -> VirtualLab:
    """The virtual lab that `BENCH` has, of which a test knows the truth."""
    e = experiment(["experiment=plate"])
    return VirtualLab(e.scene, e.laser, e.target, e.seed)
