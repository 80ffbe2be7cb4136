"""Paints lines as they come from a scan, some at a time and in a thread of its own.

A line costs the scan nothing but a place in a queue. What has come in a tenth of a second is turned
into pixels together, which is quicker than line by line and soon enough for an eye.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.experiment import Experiment
from sldvexp.console.board import NoticeBoard
from sldvexp.scan import ImageScan
from sldvexp.session import LineDone
from sldvexp.session.watching import SEARCH, complex_pixels
from sldvexp.signal import Flag
from sldvexp.typing import IntArray

log = logging.getLogger(__name__)

#: How long lines are gathered, s.
GATHERED = 0.1
#: Side of the square in which an image is drawn, over its own.
AROUND = 1.06
#: The same where a search is drawn, which goes on beyond what is known of it.
GROWN = 1.6
MILLI = 1e3

Square = tuple[list[int], list[int]]


class Painter:
    """Paints the picture ``image`` on a board.

    Parameters
    ----------
    experiment : Experiment
    board : NoticeBoard
    painted : callable
        Called after some lines were painted, in the painter's thread.

    Attributes
    ----------
    flagged : dict of Flag to int
        Pixels of this view with each flag.
    bad : dict of str to dict of int to float
        Part of the pixels that have any, by the lines' name and number.
    """

    def __init__(
        self, experiment: Experiment, board: NoticeBoard, painted: Callable[[], None]
    ) -> None:
        self._experiment, self._board, self._painted = experiment, board, painted
        self.flagged: dict[Flag, int] = {}
        self.bad: dict[str, dict[int, float]] = {}
        self._view = self._shown = ""
        self._shown_square: Square = ([0, 0], [0, 0])
        self._searched: list[LineDone] = []  # lines of this view that search circles
        self._lines: queue.Queue[LineDone | None] = queue.Queue()
        board.begin("image")
        self._thread = threading.Thread(target=self._work, name="painter", daemon=True)
        self._thread.start()

    def put(self, line: LineDone) -> None:
        """Take a line."""
        self._lines.put(line)

    def settle(self) -> None:
        """Wait until all lines that were taken are painted."""
        self._lines.join()

    def end(self) -> None:
        """Paint what was taken, and nothing more."""
        self._lines.put(None)
        self._thread.join()

    def _work(self) -> None:
        ended = False
        while not ended:
            taken = [self._lines.get()]
            if taken[0] is not None:
                time.sleep(GATHERED)
            while not self._lines.empty():
                taken.append(self._lines.get())
            lines = [line for line in taken if line is not None]
            ended = len(lines) < len(taken)
            try:
                for together in _alike(lines):
                    self._paint(together)
                self._painted()
            except Exception:  # a picture must not end a scan
                log.exception("painting lines of a scan")
            for _ in taken:
                self._lines.task_done()

    def _paint(self, lines: Sequence[LineDone]) -> None:
        """Paint some lines of one view that were scanned alike."""
        first = lines[0]
        if first.view != self._view:
            self._view, self.flagged, self.bad, self._searched = first.view, {}, {}, []
        value, flags = pixels_of(*lines)
        self._begin(first, lines)
        ends = np.cumsum([len(line.dac) for line in lines])[:-1]
        for line, v, f in zip(lines, np.split(value, ends), np.split(flags, ends), strict=True):
            self.bad.setdefault(line.lines, {})[line.number] = float(np.mean(f != 0))
            self._add(line, v, f)
        for flag in Flag:
            self.flagged[flag] = self.flagged.get(flag, 0) + int(np.sum(flags & flag != 0))

    def _begin(self, first: LineDone, lines: Sequence[LineDone]) -> None:
        """Begin a picture anew, unless these lines belong to the one that is shown."""
        if not first.searches:
            shown, square = f"{first.view} {first.lines}", self._square(first)
            if shown != self._shown:
                self._board.begin("image", low=square[0], high=square[1], name=shown)
                self._shown, self._shown_square = shown, square
            return
        shown, dac = f"{first.view} {SEARCH}", np.concatenate([line.dac for line in lines])
        low, high = self._shown_square
        inside = ((dac >= low) & (dac < high)).all()
        if shown == self._shown and inside:
            self._searched += lines
            return
        before = self._searched if shown == self._shown else []
        square = square_around(np.concatenate([dac, *(line.dac for line in before)]), GROWN)
        self._board.begin("image", low=square[0], high=square[1], name=shown)
        self._shown, self._shown_square = shown, square
        for line in before:
            self._add(line, *pixels_of(line))
        self._searched = [*before, *lines]

    def _add(self, line: LineDone, value: NDArray[Any], flags: NDArray[Any]) -> None:
        """Add a line to the picture that is shown."""
        rows = self._rows(line)
        tall, wide = (
            pitch(line.dac) if line.searches else spacing(line.dac, self._shown_square, rows)
        )
        arrays = [line.dac.astype(np.int32).ravel(), value, flags]
        self._board.add("image", arrays, tall=tall, wide=wide)

    def _image_scan(self, line: LineDone) -> ImageScan | None:
        """Find the part of the scan whose pixels are known beforehand, if the line is of it."""
        parts = self._experiment.scan.parts(line.view)
        images = (p for p in parts if isinstance(p, ImageScan) and p.kind == line.kind)
        return next(images, None)

    def _rows(self, line: LineDone) -> int:
        """Count the rows of the grid of pixels that a line is of; 0 if of none."""
        part = self._image_scan(line)
        shape = part.shape(line.view) if part else None
        return shape[0] if shape else 0

    def _square(self, line: LineDone) -> Square:
        """Find a square of DAC steps around all lines of an image, or around this line."""
        part = self._image_scan(line)
        dac = part.known_pixels(line.view) if part else line.dac
        return square_around(dac, AROUND)


def pixels_of(*lines: LineDone) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Compute amplitudes, mm/s, and flags of the pixels of lines that were scanned alike."""
    first = lines[0]
    image = complex_pixels(first.signal, first.acquisition, [line.samples for line in lines])
    value = MILLI * np.abs(image.velocity[:, 0])
    return (
        np.where(np.isfinite(value), value, 0.0).astype(np.float32),
        image.flags.astype(np.uint8),
    )


def square_around(dac: IntArray, wider: float) -> Square:
    """Find a square of DAC steps around pixels, wider than these by a factor."""
    low, high = dac.min(axis=0), dac.max(axis=0)
    side = int(wider * (high - low).max()) + 2
    low = ((low + high - side) // 2).astype(int)
    return low.tolist(), (low + side).tolist()


def pitch(dac: IntArray) -> tuple[int, int]:
    """Find how far pixels of a ring around a predicted circle are apart, along both mirrors.

    Examples
    --------
    >>> pitch(np.array([[0, 0], [0, 7], [0, 14], [5, 0], [5, 14]]))
    (5, 7)
    """
    up, left = (np.diff(np.unique(dac[:, k])) for k in (0, 1))
    return _median(up), _median(left)


def _median(distances: IntArray) -> int:
    return int(np.ceil(np.median(distances))) if len(distances) else 1


def _alike(lines: Sequence[LineDone]) -> Iterator[list[LineDone]]:
    """Yield lines that follow one another and were scanned alike, in their order."""

    def how(line: LineDone) -> tuple[object, ...]:
        return line.view, line.lines, line.acquisition, line.samples.rate

    for _, together in groupby(lines, how):
        yield list(together)


def spacing(dac: IntArray, square: Square, rows: int) -> tuple[int, int]:
    """Find how high and wide a pixel of a line is drawn, DAC steps, so that it meets the next.

    Parameters
    ----------
    rows : int
        Of a grid of pixels whose row the line is; 0 of a line alone.
    """
    steps = np.abs(np.diff(dac, axis=0))
    along = max(int(np.ceil(np.median(steps.max(axis=1)))), 1) if len(steps) else 1
    if not rows:
        return along, along
    return max(int(np.ceil((square[1][0] - square[0][0]) / rows)), 1), along
