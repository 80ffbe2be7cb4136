"""Scan lines across one circle: raw, filtered, gradient and edges, coarse and fine."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sldvexp.dataset import VARIABLES, RunData, Source
from sldvexp.errors import UserError
from sldvexp.image import ScanLineEdges, ScanLines, even_edges, gradient_edges
from sldvexp.instrument import RawSamples, Status
from sldvexp.instrument.recording import JOURNAL, read_line
from sldvexp.lazy import scipy
from sldvexp.plot import style
from sldvexp.plot.circle_edges import circle_numbers
from sldvexp.plot.paper import broken
from sldvexp.plot.selection import one_of, plugin, require, settings
from sldvexp.scan.calibration import EdgeMethod
from sldvexp.session.circles import PLACE

#: Kinds of scan lines, and how many edges each of their lines crosses.
KINDS = {"coarse": 2, "fine": 1}

NO_LINES = (
    "the run has no scan lines across circles (files <circle>_fine_*.npz in its folder journal); "
    "they come from a scan of a calibration object, as in experiment=dissertation/automated_pose"
)


@dataclass(frozen=True, eq=False)
class Taken:
    """Scan lines of one kind and what became of them.

    Parameters
    ----------
    filtered : ndarray, shape (line, pixel), m/s
    gradient : ndarray, shape (line, pixel), m/s per step
    window : int
        Of the median filter, pixels.
    """

    raw: ScanLines
    filtered: np.ndarray
    gradient: np.ndarray
    edges: ScanLineEdges
    window: int


def unavailable_because(run: RunData) -> str:
    """Explain why no scan lines can be shown; empty if they can."""
    return "" if "config" in run.attributes and _views(run) else NO_LINES


@style.styled
def scan_lines(
    source: Source | RunData,
    view: str | None = None,
    circle: int | None = None,
    folder: str | Path | None = None,
) -> Figure:
    """Draw scan lines across one circle (Figures 4.13 to 4.17 and 4.19 to 4.22).

    A column for the coarse and one for the fine lines; rows are the velocity as measured,
    median-filtered, its gradient along the line, and the edges that were found.

    Parameters
    ----------
    view : str, optional
        Without it the first.
    circle : int, optional
        The circle's number; that of its rough centre where the pose is not known, which tells it.
        Without it the first.
    folder : str or Path, optional
        Of the run, if `source` is not the file in it: the samples are in its ``journal``.

    Examples
    --------
    >>> scan_lines({})  # samples in the folder of a run are needed
    Traceback (most recent call last):
    sldvexp.errors.UserError: plot: scan_lines: the run has no scan lines across circles ...
    """
    run = RunData.from_source(source, folder)
    require("scan_lines", unavailable_because(run))
    view = one_of(view, _views(run), "scan_lines", "view")
    scanned = set(_circles(run, view))
    numbers = {str(n): str(k) for k, n in circle_numbers(run, view).items() if str(k) in scanned}
    circles = sorted(numbers, key=int)
    number = one_of(None if circle is None else str(circle), circles, "scan_lines", "circle")
    taken = {kind: _take(run, view, numbers[number], kind) for kind in KINDS}
    title = f"Scan lines across circle {number} of {len(circles)}, view {view}"
    made = style.figure(7.4, title)
    axes = made.subplots(4, 2, sharex="col")
    factor, unit = style.prefixed(
        np.concatenate([one.raw.magnitude.ravel() for one in taken.values()]), style.SPEED
    )
    for column, (kind, one) in zip(axes.T, taken.items(), strict=True):
        _column(column, kind, one, factor)
    for axis, what in zip(
        axes[:, 0], ("velocity", "velocity", "gradient", "velocity"), strict=True
    ):
        per = " per step" * (what == "gradient")
        axis.set_ylabel(f"{what}, {unit}{per}")
    for axis in axes[-1]:
        along = VARIABLES["edge"]["dac"].titled("place along the line")
        axis.set_xlabel(broken(along, 0.4 * style.inches()))
    return made


def _column(axes: Any, kind: str, taken: Taken, factor: float) -> None:
    """Draw four panels of one kind of lines."""

    def name(axis: Any, text: str) -> None:
        axis.set_title(broken(f"{count}: {text}", 0.34 * style.inches()))

    along = taken.raw.along
    count = f"{len(along)} {kind} lines"
    raw = np.where(taken.raw.flag, np.nan, taken.raw.magnitude)
    _lines(axes[0], along, factor * raw, error=factor * taken.raw.std)
    name(axes[0], "in phase with the motion, as measured")
    _lines(axes[1], along, factor * taken.filtered)
    name(axes[1], f"median of {taken.window} pixels")
    _lines(axes[2], along, factor * taken.gradient)
    name(axes[2], "gradient of the median")
    _lines(axes[3], along, factor * taken.filtered, faint=True)
    place, height = edge_heights(taken)
    axes[3].errorbar(
        place,
        factor * height,
        xerr=taken.edges.std,
        fmt="o",
        color=style.COLOURS[3],
    )
    name(axes[3], f"{len(place)} edges ± standard error")


def edge_heights(taken: Taken) -> tuple[np.ndarray, np.ndarray]:
    """Find place of each edge along its line, steps, and the filtered velocity there, m/s."""
    edges, lines = taken.edges, taken.raw
    away = edges.position - lines.origin[edges.line]
    place = (away * lines.direction[edges.line]).sum(axis=-1)
    pairs = zip(place, edges.line, strict=True)
    height = [np.interp(p, lines.along[k], taken.filtered[k]) for p, k in pairs]
    return place, np.array(height)


def _lines(
    axes: Axes,
    along: np.ndarray,
    values: np.ndarray,
    error: np.ndarray | None = None,
    faint: bool = False,
) -> None:
    """Draw a few lines each in its own look, many in one; their standard errors if known."""
    few = len(along) <= len(style.LINES)
    for k, look in enumerate(style.looks(len(along))):
        own = {"color": look["color"], "linestyle": look["linestyle"]} if few else {}
        own |= {} if few else {"color": style.COLOURS[0], "alpha": 0.35}
        own |= {"color": style.COLOURS[-1]} if faint else {}
        axes.plot(along[k], values[k], linewidth=0.8, **own)
        if error is not None and few:
            colour = own["color"]
            low, high = values[k] - error[k], values[k] + error[k]
            axes.fill_between(along[k], low, high, color=colour, alpha=0.25, linewidth=0)
        elif error is not None:
            axes.errorbar(
                along[k], values[k], error[k], fmt="none", linewidth=0.4, capsize=0, **own
            )


def _take(run: RunData, view: str, circle: str, kind: str) -> Taken:
    """Demodulate the kept samples of some lines, and look for edges as the session did."""
    image, dac = _image(run, view, f"{circle}_{kind}")
    shape = dac.shape[:2]
    lines = ScanLines.of_velocity(
        image.velocity[:, 0].reshape(shape),
        image.std[:, 0].reshape(shape),
        dac.astype(float),
        (image.flags != 0).reshape(shape),
        f"circle {circle}",
    )
    scan = _scan_settings(run)
    window = int(scan[kind]["window"])
    if kind == "fine":
        edges = even_edges(lines, PLACE[EdgeMethod[scan["edge"]]], window)
    else:
        edges = gradient_edges(lines, KINDS[kind], window)
    filtered = scipy.ndimage.median_filter(lines.filled(), size=(1, window), mode="mirror")
    gradient = np.gradient(filtered, axis=1) / lines.pitch[:, None]
    return Taken(lines, filtered, gradient, edges, window)


def _image(run: RunData, view: str, name: str) -> tuple[Any, np.ndarray]:
    """Demodulate the kept lines of a name: complex pixels and DAC steps (line, pixel, mirror)."""
    kept = [read_line(path) for path in sorted(_journal(run, view).glob(f"{name}_*.npz"))]
    whole = [line for line in kept if line is not None]
    if not whole:
        raise UserError(f"plot: scan_lines: the view {view} has no whole scan line {name}")
    samples = [line[2] for line in whole if isinstance(line[2], RawSamples)]
    asked = whole[0][1]
    status = np.concatenate([s.status for s in samples])
    image = plugin(run, "signal", "scan_lines").demodulate(
        np.concatenate([s.counts for s in samples]),
        np.arange(int(asked[1])) / samples[0].rate,
        tuple(asked[3:]),
        volts_per_count=samples[0].volts_per_count,
        quality=status & Status.dropped_out == 0,
    )
    return image, np.array([line[0] for line in whole])


def _scan_settings(run: RunData) -> dict[str, Any]:
    """Read how the calibration object was scanned; a session has that below its own settings."""
    scan: dict[str, Any] = settings(run, "scan_lines")["scan"] or {}
    scan = scan.get("calibration") or scan
    if not all(key in scan for key in (*KINDS, "edge")):
        raise UserError("plot: scan_lines: the run's scan has no coarse and fine lines")
    return scan


def _journal(run: RunData, view: str) -> Path:
    return (run.folder or Path()) / JOURNAL / view


def _views(run: RunData) -> list[str]:
    """Find views with kept lines of both kinds."""
    return [view for view in run.below("edge") if run.folder and _circles(run, view)]


def _circles(run: RunData, view: str) -> list[str]:
    """Find circles of a view with kept lines of both kinds, by their number."""
    names = {p.name.rpartition("_")[0] for p in _journal(run, view).glob("*_*.npz")}
    numbers = {m[1] for name in names if (m := re.fullmatch(r"(\d+)_fine", name))}
    return sorted((n for n in numbers if f"{n}_coarse" in names), key=int)
