"""Paints lines as they come from a scan, some at a time and in a thread of its own.

A line costs the scan nothing but a place in a queue. What has come in a part of a second is turned
into pixels together, which is quicker than line by line and soon enough for an eye. Of several
frequencies a picture shows the one at which most moves so far, ``max_f sum |v_f|^2`` over its good
pixels; it is painted anew when another one has become plainly larger.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.experiment import Experiment
from sldvexp.console.board import NoticeBoard
from sldvexp.scan import ImageScan, Scan
from sldvexp.scan.calibration import CalibrationScan
from sldvexp.session import LineDone
from sldvexp.session.watching import SEARCH, pixels_of
from sldvexp.signal import Flag
from sldvexp.typing import IntArray

log = logging.getLogger(__name__)

#: How long lines are gathered, s: a picture may be half a second late, and each takes its own time.
GATHERED = 0.25
#: Side of the square in which an image is drawn, over its own.
AROUND = 1.06
#: The same where a rough pose tells about the image, and where a search goes on beyond this.
ROUGHLY, GROWN = 1.2, 1.6
#: Kind of the part that scans circles.
CIRCLES = CalibrationScan.kind
MILLI = 1e3

Square = tuple[list[int], list[int]]


#: R.m.s. amplitude at another frequency over that at the one that is shown, from which it is shown.
PLAINLY = 1.2
#: Amplitudes of several frequencies that are kept of a picture at most; one of more pixels goes on
#: with the frequency that it has.
MOST_KEPT = 2**24


@dataclass(frozen=True, eq=False)
class PaintedPixels:
    """Pixels that were scanned alike.

    Attributes
    ----------
    value : ndarray of float32, shape (pixel, frequency), mm/s
        Amplitudes.
    flag : ndarray of uint8, shape (pixel,)
    frequency : ndarray, shape (frequency,), Hz
    """

    value: NDArray[np.float32]
    flag: NDArray[np.uint8]
    frequency: NDArray[Any]

    @property
    def bad(self) -> int:
        """Number of pixels with a flag."""
        return int(np.count_nonzero(self.flag))

    def power(self) -> NDArray[Any]:
        """Add up the squared amplitudes of good pixels, shape (frequency,)."""
        good = self.value[self.flag == 0].astype(float)
        return np.asarray(np.sum(good**2, axis=0))


@dataclass(frozen=True, eq=False)
class _PaintedLine:
    """Pixels of a line at their DAC steps, and how high and wide each is drawn."""

    dac: NDArray[np.int32]
    pixels: PaintedPixels
    tall: int
    wide: int

    def arrays(self, shown: int) -> list[NDArray[Any]]:
        """Give what a page paints of the frequency of that number."""
        return [self.dac.ravel(), self.pixels.value[:, shown], self.pixels.flag]


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
        self._squares: dict[str, Square] = {}  # of pictures of this view
        self._kept: dict[str, list[_PaintedLine]] = {}  # of these, to be shown again
        self._power: dict[str, NDArray[Any]] = {}  # of these, by frequency
        self._chosen: dict[str, int] = {}  # of these, the frequency that is shown
        self._ends: dict[str, IntArray] = {}  # of these, smallest and largest steps
        self._size_kept: dict[str, int] = {}  # of these, amplitudes that are kept
        self._apart: dict[tuple[str, str], int] = {}  # of views and kinds, steps between rows
        self._in_steps: Scan | None = None
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
        """Paint some lines that were scanned alike."""
        found = painted_pixels(*lines)
        ends = np.cumsum([len(line.dac) for line in lines])[:-1]
        pairs = zip(np.split(found.value, ends), np.split(found.flag, ends), strict=True)
        pixels = (PaintedPixels(v, f, found.frequency) for v, f in pairs)
        both = zip(lines, pixels, strict=True)
        for (view, name), some in groupby(both, lambda pair: (pair[0].view, pair[0].lines)):
            if view != self._view:
                self._view, self.flagged, self.bad = view, {}, {}
                self._squares, self._kept, self._power, self._chosen = {}, {}, {}, {}
                self._ends, self._size_kept = {}, {}
            of_one = list(some)
            bad = self.bad.setdefault(name, {})
            bad |= {line.number: own.bad / len(own.flag) for line, own in of_one}
            self._show(of_one[0][0], [self._painted_line(*pair) for pair in of_one])
            flag = np.concatenate([own.flag for _, own in of_one])
            for each in Flag:
                count = int(np.count_nonzero(flag & each))
                self.flagged[each] = self.flagged.get(each, 0) + count

    def _painted_line(self, line: LineDone, pixels: PaintedPixels) -> _PaintedLine:
        size = pitch(line.dac) if line.searches else self._size(line)
        return _PaintedLine(line.dac.astype(np.int32), pixels, *size)

    def _show(self, line: LineDone, parts: list[_PaintedLine]) -> None:
        """Add parts to the picture that is shown; begin another one if they are none of it.

        Lines of a circle are one picture, also if others were scanned between them, and so are
        those that search circles: it grows with them.
        """
        shown = f"{line.view} {SEARCH if line.searches else line.lines.partition('_')[0]}"
        before = self._kept.setdefault(shown, [])
        square = self._squares.get(shown) or self._square(line)
        if line.kind == CIRCLES:
            known = [self._ends[shown]] if shown in self._ends else []
            dac = np.concatenate([*known, *(part.dac for part in parts)])
            ends = self._ends[shown] = np.stack([dac.min(axis=0), dac.max(axis=0)])
            if (ends < square[0]).any() or (ends >= square[1]).any():
                square = square_around(ends, GROWN if line.searches else AROUND)
        other = self._choose(shown, parts)
        chosen, added = self._chosen[shown], parts
        if other or shown != self._shown or square != self._squares.get(shown):
            self._board.begin("image", low=square[0], high=square[1], name=shown)
            self._shown, self._squares[shown] = shown, square
            added = [*before, *parts]
        for (tall, wide), some in groupby(added, lambda part: (part.tall, part.wide)):
            alike = list(some)
            hertz = alike[0].pixels.frequency
            how = {"frequency": float(hertz[chosen]), "among": len(hertz)}
            together = zip(*(part.arrays(chosen) for part in alike), strict=True)
            arrays = [np.concatenate(each) for each in together]
            self._board.add("image", arrays, tall=tall, wide=wide, **how)
        if line.kind == CIRCLES or self._may_choose(shown):
            before += parts
            more = sum(part.pixels.value.size for part in parts)
            self._size_kept[shown] = self._size_kept.get(shown, 0) + more

    def _choose(self, shown: str, parts: Sequence[_PaintedLine]) -> bool:
        """Choose the frequency at which most moves so far; true if it is another one now."""
        if len(parts[0].pixels.frequency) == 1:
            self._chosen[shown] = 0
            return False
        power = self._power.get(shown, 0.0) + np.sum([p.pixels.power() for p in parts], axis=0)
        self._power[shown] = power
        strongest, now = int(np.argmax(power)), self._chosen.get(shown)
        if now is None:
            self._chosen[shown] = strongest
        elif power[strongest] > PLAINLY**2 * power[now] and self._may_choose(shown):
            self._chosen[shown] = strongest
            return True
        return False

    def _may_choose(self, shown: str) -> bool:
        """Tell whether a picture of several frequencies is small enough to be painted anew."""
        return shown in self._power and self._size_kept.get(shown, 0) <= MOST_KEPT

    def _image_scan(self, line: LineDone) -> ImageScan | None:
        """Find the part of the scan whose pixels are known beforehand, if the line is of it."""
        if self._in_steps is None:
            e = self._experiment
            self._in_steps = e.scan.in_steps(e.laser, e.target)
        parts = self._in_steps.parts(line.view)
        images = (p for p in parts if isinstance(p, ImageScan) and p.kind == line.kind)
        return next(images, None)

    def _size(self, line: LineDone) -> tuple[int, int]:
        """Find how high and wide a pixel of a line is drawn, DAC steps, so that it meets the next.

        Rows of a grid are the same distance apart.
        """
        along, key = spacing(line.dac), (line.view, line.kind)
        if key not in self._apart:
            self._apart[key] = self._rows_apart(line)
        return self._apart[key] or along, along

    def _rows_apart(self, line: LineDone) -> int:
        """Find how far rows of the grid are apart that a line is of, steps; 0 without a grid."""
        part = self._image_scan(line)
        if part is None or not part.shape(line.view):
            return 0
        rows = part.lines(line.view)
        apart = abs(rows[-1][0, 0] - rows[0][0, 0]) / max(len(rows) - 1, 1)
        return max(int(np.ceil(apart)), 1)

    def _square(self, line: LineDone) -> Square:
        """Find a square of DAC steps around all lines of an image, or around this line."""
        part = self._image_scan(line)
        dac = part.known_pixels(line.view) if part else line.dac
        rough = line.view in self._experiment.scan.rough_poses()  # the circles have corrected it
        return square_around(dac, ROUGHLY if rough else AROUND)


def painted_pixels(*lines: LineDone) -> PaintedPixels:
    """Compute amplitudes and flags of the pixels of lines that were scanned alike."""
    first = lines[0]
    image = pixels_of(first.signal, first.acquisition, [line.samples for line in lines])
    value = MILLI * np.abs(image.velocity)
    return PaintedPixels(
        np.where(np.isfinite(value), value, 0.0).astype(np.float32),
        image.flags.astype(np.uint8),
        np.asarray(image.frequencies),
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


def _median(distances: NDArray[Any]) -> int:
    return int(np.ceil(np.median(distances))) if len(distances) else 1


def _alike(lines: Sequence[LineDone]) -> Iterator[list[LineDone]]:
    """Yield lines that follow one another and were scanned alike, in their order."""

    def how(line: LineDone) -> tuple[object, ...]:
        return line.kind, line.acquisition, getattr(line.samples, "rate", None)

    for _, together in groupby(lines, how):
        yield list(together)


def spacing(dac: IntArray) -> int:
    """Find how far pixels of a line are apart, DAC steps.

    Examples
    --------
    >>> spacing(np.array([[0, 0], [3, 5], [6, 10]]))
    5
    """
    steps = np.sort(np.abs(np.diff(dac, axis=0)).max(axis=1))
    return max(int(steps[len(steps) // 2]), 1) if len(steps) else 1
