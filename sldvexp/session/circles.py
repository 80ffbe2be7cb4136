"""One view of a calibration object: scan lines to edges of its circles (Section 4.5.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.geometry.conic import principal_axes
from sldvexp.image.conics import fit_circle
from sldvexp.image.edges import gradient_edges, profile_edges
from sldvexp.image.lines import Edges, ScanLines
from sldvexp.scan.calibration import Calibration, EdgeMethod
from sldvexp.scan.lines import across, along_ellipse

if TYPE_CHECKING:
    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.session.camera import Camera


def scan_circles(
    camera: Camera, scan: Calibration, centres: NDArray[np.int64], laser: TwoMirror
) -> list[Edges]:
    """Scan every circle of a view, coarsely and then finely, and find its edge points.

    Parameters
    ----------
    camera : Camera
    scan : Calibration
    centres : ndarray of int, shape (circle, 2), steps
        Rough centres, in any order.
    laser : TwoMirror
        Its board limits the lines.

    Returns
    -------
    list of Edges
        One for each rough centre, in DAC steps.

    Raises
    ------
    UserError
        If a circle is not where it should be; it says what was seen.
    """
    return [_circle(camera, scan, k, centre, laser) for k, centre in enumerate(centres, 1)]


def _circle(
    camera: Camera, scan: Calibration, number: int, centre: NDArray[np.int64], laser: TwoMirror
) -> Edges:
    """Edges of one circle on its fine lines."""
    name = f"the circle around DAC steps ({centre[0]}, {centre[1]})"
    coarse = _on_board(across(centre, scan.coarse.lines, scan.coarse.pixels), laser)
    seen = gradient_edges(_lines(camera, f"{number}_coarse", coarse, name), 2, scan.coarse.window)
    ellipse = fit_circle(seen, "algebraic")[0].ellipse
    length, direction = principal_axes(ellipse.parameters)
    axes = (direction * length).T
    fine = along_ellipse(ellipse.centre, axes, scan.fine.lines, scan.fine.pixels)
    lines = _lines(camera, f"{number}_fine", _on_board(fine, laser), name)
    place = profile_edges if scan.edge is EdgeMethod.profile else gradient_edges
    return place(lines, 1, scan.fine.window)


def _on_board(dac: NDArray[np.int64], laser: TwoMirror) -> NDArray[np.int64]:
    """Lines that leave the board's range are moved back into it as a whole."""
    low, high = laser.board.value
    under = np.minimum(dac.min(axis=1, keepdims=True) - low, 0)
    over = np.maximum(dac.max(axis=1, keepdims=True) - high, 0)
    return dac - under - over


def _lines(camera: Camera, key: str, dac: NDArray[np.int64], name: str) -> ScanLines:
    """Scan lines of the velocity at the first frequency."""
    image = camera.image(key, dac)
    shape = dac.shape[:2]
    return ScanLines.of_velocity(
        image.velocity[:, 0].reshape(shape),
        image.std[:, 0].reshape(shape),
        dac.astype(float),
        (image.flags != 0).reshape(shape),
        name,
    )


def edge_group(edges: list[Edges]) -> xr.Dataset:
    """The edge points of one view as the group ``edge/<view>``.

    Parameters
    ----------
    edges : list of Edges
        One for each rough centre.

    Returns
    -------
    xarray.Dataset
        Attribute ``summary`` says for each circle what was seen and what was rejected.
    """
    sizes = [len(e.std) for e in edges]
    group = dataset.group(
        "edge",
        {"edge": np.arange(sum(sizes))},
        dac=np.concatenate([e.position for e in edges]),
        dac_std=np.concatenate([e.std for e in edges]),
        direction=np.concatenate([e.direction for e in edges]),
        width=np.concatenate([e.width for e in edges]),
        circle=np.repeat(np.arange(1, len(edges) + 1), sizes),
    )
    group.attrs["summary"] = "\n".join(f"{e.name}: {e.summary()}" for e in edges)
    return group


def edges_of(group: xr.Dataset) -> list[Edges]:
    """Edge points of each circle from a group ``edge/<view>``, without lines and rejections."""
    circles = []
    for number in np.unique(group["circle"].values):
        own = group.isel(edge=np.flatnonzero(group["circle"].values == number))
        count = own.sizes["edge"]
        circles.append(
            Edges(
                position=own["dac"].values,
                std=own["dac_std"].values,
                direction=own["direction"].values,
                width=own["width"].values,
                line=np.arange(count),
                rising=np.zeros(count, bool),
                rejected=(),
                lines=count,
                name=f"circle image {number}",
            )
        )
    return circles
