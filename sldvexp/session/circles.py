"""One view of a calibration object: scan lines to edges of its circles (Section 4.5.2).

What the coarse lines show at each rough centre, and what is wrong where they show no circle.
"""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.geometry import Ellipse
from sldvexp.geometry.conic import principal_axes
from sldvexp.image import (
    ScanLineEdges,
    ScanLines,
    even_edges,
    fit_circle,
    gradient_edges,
    pixel_edges,
    profile_edges,
)
from sldvexp.image.pinhole import require_ellipse
from sldvexp.image.scan_lines import LEAST_PIXELS
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.scan.calibration import CalibrationScan, CircleLines, EdgeMethod
from sldvexp.scan.lines import along_ellipse
from sldvexp.session.camera import Camera, ViewContext, line_name
from sldvexp.session.marked import coarse_lines, given_circles, on_board
from sldvexp.session.search import (
    COARSE,
    STAND_ELSEWHERE,
    RoughCircle,
    corrected_by_circles,
    search_circles,
)
from sldvexp.signal import ComplexImage, instrument_fault
from sldvexp.signal.instrument_faults import MOST, moving
from sldvexp.targets import Circles
from sldvexp.targets.shadows import SPAN
from sldvexp.typing import Array, IntArray

#: Of fine lines in the journal, behind the number of the circle, as `COARSE` is.
FINE = "fine"
#: Of the pixels of coarse lines every so many are looked at, until a circle is seen: where a wide
#: spot blurs an edge over more pixels than are looked at around one, both its sides lie on it.
THINNED = 1, 2, 4
#: Share of the coarse lines' edges with which a circle is seen well.
ENOUGH = 5 / 6
#: Half of a fine line over the width of a blurred edge, at least.
BEYOND = 2.5
#: By how much lines may differ that another estimator places, over the length of one.
SAME = 0.2
PLACE = {
    EdgeMethod.pixel: pixel_edges,
    EdgeMethod.gradient: gradient_edges,
    EdgeMethod.profile: profile_edges,
}


def scan_calibration(scan: CalibrationScan, at: ViewContext) -> dict[str, xr.Dataset]:
    """Scan the circles of a view; the group ``edge/<view>``."""
    rough = scan.views[at.view].pose
    at.camera.sample(scan.sampling)
    try:
        circles = search_circles(scan, at) if rough else given_circles(scan, at)
    except UserError as error:
        raise UserError(f"scan: in the view {at.view}, {error}") from None
    if isinstance(at.target, Circles) and len(circles) != len(at.target.circles):
        raise UserError(
            f"scan: the view {at.view} has {len(circles)} rough centres, but the calibration "
            f"object has {len(at.target.circles)} circles; give each of them one"
        )
    try:
        edges = scan_circles(at.camera, scan, circles, at.laser)
    except UserError as error:
        raise UserError(f"scan: in the view {at.view}, {error}") from None
    if rough:
        found = np.array([fit_circle(circle)[0].ellipse.centre for circle in edges])
        at.poses[at.view] = corrected_by_circles(found, rough, at)
    return {f"edge/{at.view}": edges_to_dataset(edges)}


def circle_lines(scan: CalibrationScan, view: str) -> dict[str, int]:
    """List names and pixels of the lines of a view's circles, in their order."""
    circles = range(1, len(scan.centres(view)) + 1)
    return {
        line_name(f"{circle}_{name}", k): stage.pixels
        for name, stage in ((COARSE, scan.coarse), (FINE, scan.fine))
        for circle in circles
        for k in range(stage.lines)
    }


def scan_circles(
    camera: Camera, scan: CalibrationScan, circles: Sequence[RoughCircle], laser: TwoMirror
) -> list[ScanLineEdges]:
    """Scan every circle of a view, coarsely and then finely, and find its edge points.

    Parameters
    ----------
    circles : sequence of RoughCircle
        In any order.
    laser : TwoMirror
        Its board limits the lines.

    Returns
    -------
    list of ScanLineEdges
        One for each rough centre, in DAC steps.

    Raises
    ------
    UserError
        If a circle is not where it should be; it says what was seen.
    """
    looks = [_look(camera, scan, k, circle, laser) for k, circle in enumerate(circles, 1)]
    centres = np.array([circle.centre for circle in circles])
    require_circles(looks, camera.journal.folder, _other_board(centres, laser))
    pairs = enumerate(zip(looks, circles, strict=True), 1)
    return [_edges(camera, scan, k, look, circle.name, laser) for k, (look, circle) in pairs]


def _other_board(centres: IntArray, laser: TwoMirror) -> str:
    """Name a board with coarser steps, if any, in whose range all these centres lie."""
    own = laser.board.value[1]
    for board in type(laser.board):
        if board.value[1] < own and np.abs(centres).max() <= board.value[1]:
            share = 100 * np.abs(centres).max() / own
            return (
                f"all centres lie within {share:.0f} % of the range of laser.board="
                f"{laser.board.name}; are they steps of {board.name}?"
            )
    return ""


def _look(
    camera: Camera, scan: CalibrationScan, number: int, circle: RoughCircle, laser: TwoMirror
) -> CoarseScan:
    """Scan coarse lines across one circle; the ellipse that they show."""
    key, stage = f"{number}_{COARSE}", scan.coarse
    dac, stride, finer = coarse_lines(scan, circle, laser)
    dac = _placed(camera, key, dac)
    image = camera.image(key, list(dac))
    look = CoarseScan(circle.whereabouts, f"{key}_*", image, stage, stride, finer, circle.shade)
    look = replace(look, half_chord=circle.half_chord, marked=circle.marked)
    most, inside = 0, np.mean(moving(image)) > NEARLY_ALL
    for every in THINNED:
        if every > 1 and (inside or stage.pixels < LEAST_PIXELS * every):
            break
        try:
            lines = _lines(image, dac, circle.whereabouts, every)
            seen = gradient_edges(lines, 2, stage.window // every | 1)
            ellipse = fit_circle(seen, "algebraic")[0].ellipse
        except UserError as error:
            look = replace(look, problem=look.problem or str(error))
            continue
        if len(seen.std) > most:
            most = len(seen.std)
            wide = BEYOND * float(np.median(seen.width)) / (scan.fine.pixels // 2)
            blurred = 0 if scan.fine.stride else int(np.ceil(wide))
            look = replace(look, ellipse=ellipse, finer=max(finer, blurred))
        if most >= ENOUGH * 2 * stage.lines:
            break
    return look


def _edges(
    camera: Camera,
    scan: CalibrationScan,
    number: int,
    look: CoarseScan,
    name: str,
    laser: TwoMirror,
) -> ScanLineEdges:
    """Scan fine lines around the ellipse of the coarse ones; the edges of the circle."""
    assert look.ellipse is not None
    key = f"{number}_{FINE}"
    length, direction = principal_axes(look.ellipse.parameters)
    axes = (direction * length).T
    stage = scan.fine
    fine = along_ellipse(look.ellipse.centre, axes, stage.lines, stage.pixels, look.finer)
    dac = _placed(camera, key, on_board(fine, laser))
    image = camera.image(key, list(dac))
    found = even_edges(_lines(image, dac, name), PLACE[scan.edge], scan.fine.window)
    try:
        require_ellipse(found)
    except UserError as error:
        require_instrument(image, look.name, camera.journal.folder / f"{key}_*", MANY)
        if look.shade:
            raise UserError(f"{look.shade}; {STAND_ELSEWHERE} ({error})") from None
        raise
    return found


def _placed(camera: Camera, key: str, dac: IntArray) -> IntArray:
    """Put lines across a circle where a recording has them, if that is as good as the same."""
    within = SAME * float(np.ptp(dac[0], axis=0).max())
    return np.stack(camera.placed(key, list(dac), within))


def _lines(image: ComplexImage, dac: IntArray, name: str, every: int = 1) -> ScanLines:
    """Scan lines of the velocity at the first frequency, of every so many pixels."""
    shape = dac.shape[:2]
    return ScanLines.of_velocity(
        image.velocity[:, 0].reshape(shape)[:, ::every],
        image.std[:, 0].reshape(shape)[:, ::every],
        dac[:, ::every].astype(float),
        (image.flags != 0).reshape(shape)[:, ::every],
        name,
    )


def edges_to_dataset(edges: list[ScanLineEdges]) -> xr.Dataset:
    """Make the group ``edge/<view>`` of the edge points of one view.

    Parameters
    ----------
    edges : list of ScanLineEdges
        One for each rough centre.

    Returns
    -------
    xarray.Dataset
        Attribute ``summary`` says for each circle what was seen and what was rejected, ``lost``
        how many candidates were rejected in all for each reason, as JSON.
    """
    sizes = [len(e.std) for e in edges]
    group = dataset.group(
        "edge",
        {"edge": np.arange(sum(sizes))},
        dac=np.concatenate([e.position for e in edges]),
        dac_std=np.concatenate([e.std for e in edges]),
        direction=np.concatenate([e.direction for e in edges]),
        width=np.concatenate([e.width for e in edges]),
        reach=np.concatenate([_pairs(e.reach, e, np.nan) for e in edges]),
        growth_std=np.concatenate([_pairs(e.growth_std, e, 0.0) for e in edges]),
        phase=np.concatenate([e.phase for e in edges]),
        circle=np.repeat(np.arange(1, len(edges) + 1), sizes),
    )
    lost = sum((Counter(e.counts()) for e in edges), Counter())
    group.attrs["lost"] = json.dumps({reason.value: count for reason, count in lost.items()})
    group.attrs["summary"] = "\n".join(f"{e.name}: {e.summary()}" for e in edges)
    return group


def _pairs(values: Array | None, edges: ScanLineEdges, usual: float) -> Array:
    return np.full((len(edges.std), 2), usual) if values is None else values


def edges_of(group: xr.Dataset) -> list[ScanLineEdges]:
    """Read the edge points of each circle, without lines and rejections, from ``edge/<view>``."""
    names = [line.partition(": ")[0] for line in str(group.attrs["summary"]).splitlines()]
    every = {str(name): v.values for name, v in group.items() if "edge" in v.dims}
    number = every["circle"]
    circles = []
    for one in np.unique(number):
        at = np.flatnonzero(number == one)
        own = {name: values[at] for name, values in every.items()}
        circles.append(
            ScanLineEdges(
                position=own["dac"],
                std=own["dac_std"],
                direction=own["direction"],
                width=own["width"],
                line=np.arange(len(at)),
                reach=own.get("reach"),
                growth_std=own.get("growth_std"),
                rising=np.zeros(len(at), bool),
                phase=own["phase"],
                rejected=(),
                lines=len(at),
                name=names[one - 1],
            )
        )
    return circles


#: Share of the pixels that must move where something moves.
SOME = 0.02
#: Share of flagged pixels that explains why a circle that moves is not found.
MANY = 0.2
#: Share of pixels that move on lines which lie inside a circle.
NEARLY_ALL = 0.9
#: Velocities are told in mm/s.
MILLI = 1e3


@dataclass(frozen=True, eq=False)
class CoarseScan:
    """Coarse lines through one rough centre.

    Parameters
    ----------
    name : str
        As in "the circle around DAC steps (10, 20)".
    files : str
        Pattern of its scan lines' files.
    image : ComplexImage
    stage : CircleLines
        As it is set.
    stride : ndarray of int, shape (line,), steps
        Of each line.
    finer : int, steps
        Stride of the fine lines that follow.
    shade : str
        Which other circles hide this one.
    ellipse : Ellipse or None
    problem : str
        Why there is none.
    half_chord : ndarray, shape (line,), steps, optional
    marked : bool
        As in `RoughCircle`.
    """

    name: str
    files: str
    image: ComplexImage
    stage: CircleLines
    stride: IntArray
    finer: int = 1
    shade: str = ""
    ellipse: Ellipse | None = None
    problem: str = ""
    half_chord: Array | None = None
    marked: bool = False

    @property
    def silent(self) -> bool:
        """True if nothing moves there."""
        return self.ellipse is None and float(np.mean(moving(self.image))) < SOME


def require_circles(looks: Sequence[CoarseScan], folder: Path, suspicion: str = "") -> None:
    """Refuse to go on if a rough centre shows no circle, or two show the same.

    Parameters
    ----------
    looks : sequence of CoarseScan
        Of all rough centres of a view.
    folder : Path
        Where the view's scan lines are kept.
    suspicion : str
        Of the rough centres, told if nothing moves at any.

    Raises
    ------
    UserError
        That names the circle, the cause and what was seen.
    """
    for look in looks:
        if look.ellipse is None:
            require_instrument(look.image, look.name, folder)
    if silent := [look for look in looks if look.silent]:
        raise UserError(_nothing_moves(silent, len(looks), folder, suspicion))
    for look in looks:
        if look.ellipse is None:
            require_instrument(look.image, look.name, folder, MANY)
            raise UserError(_no_ellipse(look))
    found = [(look, look.ellipse) for look in looks if look.ellipse is not None]
    for (look, one), (other_look, other) in itertools.combinations(found, 2):
        if np.linalg.norm(one.centre - other.centre) < one.semi_axes[0]:
            if shade := look.shade or other_look.shade:
                raise UserError(f"{shade}; {STAND_ELSEWHERE}")
            raise UserError(
                f"{look.name} and {other_look.name} are one and the same, in fact around "
                f"({one.centre[0]:.0f}, {one.centre[1]:.0f}); give every circle one rough centre"
            )


def _no_ellipse(look: CoarseScan) -> str:
    """Say what may be wrong with lines that show a motion, but no circle."""
    longer = _longer_lines(look)
    if look.shade:
        return f"{look.shade}; {STAND_ELSEWHERE} ({look.problem})"
    if np.mean(moving(look.image)) > NEARLY_ALL:
        return f"{look.name}: everything on its lines moves, they do not reach its edge; {longer}"
    if look.half_chord is not None and not look.marked:
        return f"{look.problem}; {_other_lines(look.stage, look.stride, look.half_chord)}"
    within = int(moving(look.image).reshape(look.stage.lines, -1).sum(axis=1).min())
    if within < look.stage.window and look.stride.min() > 1:
        longer = (
            f"give the lines a smaller coarse.stride than {look.stride.min()}, as only {within} "
            f"pixels of one of them move, and coarse.window={look.stage.window} blurs fewer than "
            "its own"
        )
    return f"{look.problem}; put the rough centre nearer to the circle's middle, or {longer}"


def _longer_lines(look: CoarseScan) -> str:
    """Say which lines would reach farther: as far as the circle's size asks for, or twice."""
    size = (
        "with a rough pose, or with the circles' numbers beside three rough centres or more, and "
        "no coarse.stride the circle's size tells it"
    )
    where = "below scan, or in a session below scan.calibration"
    larger = 2 * int(look.stride.max())
    if look.half_chord is not None:
        needed = SPAN * look.half_chord.max() / (look.stage.pixels // 2)
        larger = int(np.ceil(needed)) if needed > look.stride.max() else larger
    return (
        f"give the lines more pixels or a larger stride than {look.stride.max()}, "
        f"coarse.stride={larger}, {where}; {size}"
    )


def _other_lines(stage: CircleLines, stride: IntArray, half_chord: Array) -> str:
    """Say which coarse lines would show a circle that a rough pose predicts as so wide."""
    if stage.stride is None:
        return (
            f"its lines have a pixel every {', '.join(map(str, stride))} DAC steps, as the rough "
            f"pose tells the circle's size: give it more of them, coarse.lines={3 * stage.lines}, "
            "below scan, or in a session below scan.calibration, or stand more in front of its "
            "plane"
        )
    within = int(2 * half_chord.min() / stage.stride)
    reach = stage.stride * (stage.pixels // 2)
    if within < stage.window:
        fault = (
            f"only {within} pixels of one of its lines lie within the circle, as the rough pose "
            f"predicts it, fewer than coarse.window={stage.window}"
        )
    else:
        fault = f"its lines reach {reach} DAC steps to each side, the circle {half_chord.max():.0f}"
    return (
        f"{fault}: set no coarse.stride, below scan, or in a session below scan.calibration, where "
        f"{stage.stride} is set; the rough pose then tells one for each line"
    )


def require_instrument(image: ComplexImage, name: str, files: Path, share: float = MOST) -> None:
    """Refuse pixels that say that something is wrong with the instrument.

    Parameters
    ----------
    name : str
        What they are of.
    files : Path
        Files, or the folder, that keep what was measured with that fault.
    share : float
        Of the pixels, from which a flag counts.

    Raises
    ------
    UserError
    """
    if fault := instrument_fault(image, share):
        raise UserError(f"{name}: {fault}; then delete {files} and resume the run")


def _nothing_moves(silent: Sequence[CoarseScan], count: int, folder: Path, suspicion: str) -> str:
    """Say what may be wrong with circles that do not move."""
    most = max(_largest(look.image) for look in silent)
    noise = max(float(np.median(look.image.std)) for look in silent)
    seen = f"{MILLI * most:.2g} mm/s at most, with a noise of {MILLI * noise:.2g}"
    if len(silent) == count:
        return (
            f"nothing moves at any of the {count} rough centres ({seen}): the calibration object "
            "is out of view, its speakers are not driven, or no light comes back; see that the "
            "speakers sound, and that the beam stands in each circle at its rough centre"
            f"{suspicion and '; '}{suspicion}"
        )
    names = " and ".join(look.name for look in silent)
    files = " and ".join(str(folder / look.files) for look in silent)
    what = "its speaker is" if len(silent) == 1 else "their speakers are"
    return (
        f"{names}: nothing moves there ({seen}), while {count - len(silent)} of {count} circles "
        f"move; {what} dead, or the rough centre lies beside the circle; once the speaker sounds, "
        f"delete {files} and resume the run"
    )


def _largest(image: ComplexImage) -> float:
    """Find the largest amplitude of a pixel that is not flagged, m/s; zero if all are."""
    return float(np.abs(image.velocity[image.flags == 0]).max(initial=0.0))
