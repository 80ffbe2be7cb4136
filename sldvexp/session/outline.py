"""One view of a part: scan lines across its outline to edges.

Lines run outwards. On the part the velocity has an amplitude, behind it there is none; its sign
differs from place to place with the mode's shape, so that every line is taken in phase with its own
motion. Behind a part that hangs free no light comes back: if most pixels there have dropped out and
few on the part, the edge is where the light ends.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.image import ScanLineEdges, ScanLines, gradient_edges
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.scan.lines import laid
from sldvexp.scan.outline import OutlineLines, OutlineScan
from sldvexp.session.camera import ViewContext, line_name
from sldvexp.session.circles import (
    COARSE,
    FINE,
    MANY,
    MILLI,
    PLACE,
    SAME,
    edges_to_dataset,
    require_instrument,
)
from sldvexp.signal import ComplexImage
from sldvexp.signal.instrument_faults import without_light
from sldvexp.typing import Array, BoolArray, IntArray

#: Of the lines in the journal.
NAME = "outline"
#: Edges that a pose needs: six unknowns, and some to see a wrong one by.
LEAST = 10
#: Attributes of ``edge/<view>``: the part's mesh and its unit, and the rough pose.
PART, PART_UNIT = "part", "part_unit"
ROUGH_ROTATION, ROUGH_ORIGIN = "rough_rotation", "rough_origin"
#: Shares of pixels without light behind a part and on it, from which the light tells the edge.
DARK, LIT = 0.7, 0.3


def scan_outline(scan: OutlineScan, at: ViewContext) -> dict[str, xr.Dataset]:
    """Scan the outline of a part in a view; the group ``edge/<view>``.

    Raises
    ------
    UserError
        If the lines do not show it; it says what was seen.
    """
    pose = scan.views[at.view].pose
    assert pose is not None
    at.camera.sample(scan.sampling)
    name = f"the outline in the view {at.view}"
    part = scan.outline()
    try:
        scan.require_size(part, [pose.place])
        point, outward = part.outline(pose.rotation, pose.place, at.laser, scan.lines)
    except UserError as error:
        raise UserError(f"scan: in the view {at.view}, {error}") from None
    point, outward = _dac(point, outward, at.laser)
    first, seen = _edges(scan, at, scan.coarse, COARSE, point, outward, name)
    _require_outline(first, seen, at, name)
    found, seen = _edges(scan, at, scan.fine, FINE, first.position, first.direction, name)
    _require_outline(found, seen, at, name)
    group = edges_to_dataset([found])
    group.attrs |= {
        PART: scan.path,
        PART_UNIT: scan.unit.name,
        ROUGH_ROTATION: pose.rotation.ravel(),
        ROUGH_ORIGIN: pose.place,
    }
    return {f"edge/{at.view}": group}


def outline_lines(scan: OutlineScan, view: str) -> dict[str, int]:
    """List names and pixels of the lines of a view's outline, in their order."""
    return {
        line_name(f"{NAME}_{name}", k): stage.pixels
        for name, stage in ((COARSE, scan.coarse), (FINE, scan.fine))
        for k in range(scan.lines)
    }


def _dac(point: Array, outward: Array, laser: TwoMirror) -> tuple[Array, Array]:
    """Give places and unit vectors of angles over steps as DAC steps, where mirrors reach them."""
    angle = point * laser.step
    reached = laser.reaches(angle)
    if not reached.any():
        raise UserError("scan: the mirrors do not reach the part's outline at the rough pose")
    dac = laser.dac_from_angle(angle[reached])
    # Mirrors wired the other way turn the direction.
    sense = np.sign(laser.angle_from_dac([[1.0, 1.0]]) - laser.angle_from_dac([[0.0, 0.0]]))
    return dac, outward[reached] * sense


def _edges(
    scan: OutlineScan,
    at: ViewContext,
    stage: OutlineLines,
    key: str,
    point: Array,
    outward: Array,
    name: str,
) -> tuple[ScanLineEdges, ComplexImage]:
    """Scan lines across places of the outline and find one edge on each."""
    coarse, fine = scan.strides(at.laser)
    dac = laid(point, outward, stage.pixels, coarse if key == COARSE else fine)
    low, high = at.laser.board.value
    dac = dac[np.all((dac >= low) & (dac <= high), axis=(1, 2))]
    within = SAME * float(np.ptp(dac[0], axis=0).max()) if len(dac) else 0.0
    dac = np.array(at.camera.placed(f"{NAME}_{key}", list(dac), within, lost=len(dac)))
    image = at.camera.image(f"{NAME}_{key}", list(dac))
    lines = outline_scan_lines(image, dac, name)
    place = gradient_edges if key == COARSE else PLACE[scan.edge]
    return outward_edges(place(lines, 1, stage.window)), image


def outline_scan_lines(image: ComplexImage, dac: IntArray, name: str) -> ScanLines:
    """Make scan lines of the velocity at the first frequency, or of the light.

    Parameters
    ----------
    dac : ndarray of int, shape (line, pixel, 2), steps
    """
    shape = dac.shape[:2]
    flag = (image.flags != 0).reshape(shape)
    dark = without_light(image).reshape(shape)
    if _is_light(dark):
        return ScanLines(
            np.where(dark, 0.0, 1.0),
            np.full(shape, 0.05),
            dac.astype(float),
            np.zeros(shape, bool),
            name,
        )
    velocity, std = image.velocity[:, 0].reshape(shape), image.std[:, 0].reshape(shape)
    good = np.where(flag, 0.0, velocity)
    common = ScanLines.of_velocity(velocity, std, dac.astype(float), flag, name)
    # Own phase of each line: a square has no sign.
    axis = np.exp(0.5j * np.angle(np.sum(good**2, axis=1)))[:, None]
    in_phase = (velocity * axis.conj()).real
    turned = np.sum(np.where(flag, 0.0, in_phase), axis=1) < 0
    return replace(common, magnitude=np.where(turned[:, None], -in_phase, in_phase))


def _is_light(dark: BoolArray) -> bool:
    """Tell whether pixels without light lie behind the part: in the outer thirds of the lines."""
    third = dark.shape[1] // 3
    return bool(dark[:, -third:].mean() > DARK and dark[:, :third].mean() < LIT)


def outward_edges(edges: ScanLineEdges) -> ScanLineEdges:
    """Take the edges where the part ends, not those where a line comes upon something else."""
    kept = ~edges.rising
    arrays = ("position", "std", "direction", "width", "line", "rising", "phase")
    return replace(edges, **{name: getattr(edges, name)[kept] for name in arrays})


def _require_outline(edges: ScanLineEdges, image: ComplexImage, at: ViewContext, name: str) -> None:
    """Refuse to go on with too few edges."""
    if len(edges.std) >= LEAST:
        return
    folder = at.camera.journal.folder
    require_instrument(image, name, folder / f"{NAME}_*")
    require_instrument(image, name, folder / f"{NAME}_*", MANY)
    good = image.flags == 0
    most = MILLI * float(np.abs(image.velocity[good, 0]).max(initial=0.0))
    noise = MILLI * float(np.median(image.std[:, 0]))
    raise UserError(
        f"scan: {name} is not shown: {edges.summary()}, where velocities reach {most:.2g} mm/s "
        f"with a noise of {noise:.2g}; choose a frequency at which the part moves along its edges "
        "(held edges rest), a background that rests, or a better rough pose and longer coarse lines"
    )
