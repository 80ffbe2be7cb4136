"""Image coordinates in which the two-mirror scanner is a pinhole camera, but for its mirror offset.

``(tan(up_down), tan(left_right) / cos(up_down))`` is ``(y / z, x / z)`` where the mirrors have no
offset (Eqs 4.2 and 4.3): there the image of a circle is an ellipse and that of a line a line,
which neither DAC steps nor angles achieve. An offset e leaves the factor ``1 / (1 + e / range)`` on
the second coordinate, nearly the same for a whole calibration object. The unit is a DAC step at 0.

The conic of one circle from the edges on its scan lines.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from sldvexp.errors import UserError
from sldvexp.geometry import BitangentPoints, ConicFit, fit_ellipse
from sldvexp.geometry.conic import distance_jacobian, shape_matrix, signed_distance
from sldvexp.image.scan_lines import ScanLineEdges
from sldvexp.image.spot import seen_edges, spot_of_widths
from sldvexp.laser import MIRRORS, TwoMirror
from sldvexp.typing import Array

#: Rounds in which ellipse and spot settle, and how closely, relative to an edge's error.
ROUNDS, SETTLED = 12, 0.02
#: Widest spot, over the smaller semi-axis, whose edges are where they are computed to be; wider
#: ones see the opposite edge, and lines end before their motion is even.
WIDEST = 0.37
#: How far the smaller semi-axis errs with wider ones, in widths. From `CLOSING` semi-axes on the
#: ellipse closes in on the spot, by `CLOSED` semi-axes for each by which that is wider. Root mean
#: squares of spots of .4 to .7 of the true semi-axis, 45 to 70 degrees; wider ones show no edges.
ERRING, CLOSING, CLOSED = 0.25, 0.45, 2.4


def pinhole_from_dac(laser: TwoMirror, dac: ArrayLike) -> Array:
    """Convert DAC steps to pinhole coordinates.

    Parameters
    ----------
    dac : array_like, shape (..., 2), steps

    Returns
    -------
    ndarray, shape (..., 2), steps

    Raises
    ------
    UserError
        If a step is beyond the board's range.

    Examples
    --------
    >>> from sldvexp.image import pinhole_from_dac
    >>> from sldvexp.laser import TwoMirror
    >>> laser = TwoMirror()
    >>> pinhole_from_dac(laser, [[0, 0], [400, -300]]).round(4)
    array([[   0.    ,    0.    ],
           [ 400.2423, -300.3748]])
    """
    up_down, left_right = np.moveaxis(laser.angle_from_dac(dac), -1, 0)
    plane = np.stack([np.tan(up_down), np.tan(left_right) / np.cos(up_down)], axis=-1)
    return plane / laser.step


def dac_from_pinhole(laser: TwoMirror, pinhole: ArrayLike) -> Array:
    """Convert pinhole coordinates to DAC steps, shape (..., 2): `pinhole_from_dac` inverted.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.image import dac_from_pinhole, pinhole_from_dac
    >>> from sldvexp.laser import TwoMirror
    >>> laser = TwoMirror()
    >>> dac_from_pinhole(laser, pinhole_from_dac(laser, [[400, -300]])).round(6)
    array([[ 400., -300.]])
    """
    y, x = np.moveaxis(np.asarray(pinhole, float) * laser.step, -1, 0)
    up_down = np.arctan(y)
    angle = np.stack([up_down, np.arctan(x * np.cos(up_down))], axis=-1)
    return laser.dac_from_angle(angle)


def pinhole_jacobian(laser: TwoMirror, dac: ArrayLike) -> Array:
    """Differentiate `pinhole_from_dac`, shape (..., 2, 2)."""
    steps = np.asarray(dac, float)
    up_down, left_right = np.moveaxis(laser.angle_from_dac(steps), -1, 0)
    by_angle = np.zeros((*steps.shape, 2))
    by_angle[..., 0, 0] = 1.0 / np.cos(up_down) ** 2
    by_angle[..., 1, 0] = np.tan(left_right) * np.sin(up_down) / np.cos(up_down) ** 2
    by_angle[..., 1, 1] = 1.0 / (np.cos(left_right) ** 2 * np.cos(up_down))
    largest = laser.board.value[1]
    by_step = [
        polynomial.polyval(u, polynomial.polyder(getattr(laser, name).coefficients)) / largest
        for name, u in zip(MIRRORS, np.moveaxis(steps / largest, -1, 0), strict=True)
    ]
    return by_angle * np.stack(by_step, axis=-1)[..., None, :] / laser.step[:, None]


def pinhole_edges(laser: TwoMirror, edges: ScanLineEdges) -> ScanLineEdges:
    """Convert edges to pinhole coordinates, with their directions, standard errors and widths.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.image import ScanLineEdges, pinhole_edges
    >>> from sldvexp.laser import TwoMirror
    >>> step = ScanLineEdges(
    ...     position=np.array([[400.0, -300.0]]), std=np.array([0.5]),
    ...     direction=np.array([[0.0, 1.0]]), width=np.array([2.0]),
    ...     line=np.array([0]), rising=np.array([True]), phase=np.array([0.0]),
    ...     rejected=(), lines=1, name="the circle")
    >>> pinhole_edges(TwoMirror(), step).position.round(4)
    array([[ 400.2423, -300.3748]])
    """
    along = np.einsum("nij,nj->ni", pinhole_jacobian(laser, edges.position), edges.direction)
    stretch = np.linalg.norm(along, axis=-1)
    return replace(
        edges,
        position=pinhole_from_dac(laser, edges.position),
        std=edges.std * stretch,
        direction=along / stretch[:, None],
        width=edges.width * stretch,
        reach=None if edges.reach is None else edges.reach * stretch[:, None],
        growth_std=None if edges.growth_std is None else edges.growth_std * stretch[:, None],
        gain=None if edges.gain is None else edges.gain * stretch[:, None],
    )


def dac_edges(laser: TwoMirror, edges: ScanLineEdges) -> ScanLineEdges:
    """Convert edges to DAC steps, the inverse of `pinhole_edges`."""
    position = dac_from_pinhole(laser, edges.position)
    inverse = np.linalg.inv(pinhole_jacobian(laser, position))
    along = np.einsum("nij,nj->ni", inverse, edges.direction)
    stretch = np.linalg.norm(along, axis=-1)
    return replace(
        edges,
        position=position,
        std=edges.std * stretch,
        direction=along / stretch[:, None],
        width=edges.width * stretch,
        reach=None if edges.reach is None else edges.reach * stretch[:, None],
        growth_std=None if edges.growth_std is None else edges.growth_std * stretch[:, None],
        gain=None if edges.gain is None else edges.gain * stretch[:, None],
    )


def dac_bitangents(laser: TwoMirror, found: BitangentPoints) -> BitangentPoints:
    """Find the bitangent points of ellipses in pinhole coordinates, in DAC steps."""
    points = dac_from_pinhole(laser, found.points)
    inverse = np.linalg.inv(pinhole_jacobian(laser, points))
    covariance = np.einsum(
        "pleij,plejqmfk,qmfhk->pleiqmfh", inverse, found.covariance, inverse, optimize=True
    )
    return BitangentPoints(points, covariance)


def fit_circle(edges: ScanLineEdges, method: str = "likelihood") -> tuple[ConicFit, ScanLineEdges]:
    """Fit a conic through the edges of one circle, freed from the spot's size.

    A spot sees a curved edge inside of where it is (`sldvexp.image.spot`). How far depends on the
    ellipse and the spot, which fit and widths tell: in turns the edges are moved out by as much,
    and fitted again, until both stay. A spot that is wider than a third of the smaller semi-axis
    looks over the circle and beyond, so that this does not settle; it stops where it settles best,
    and what is then still open counts as an error of the edges. From `WIDEST` on the ellipse is
    wrong wherever it settles: edges err together then, and are given errors of their own that make
    those of the ellipse as large.

    Parameters
    ----------
    edges : ScanLineEdges
        Of all scan lines across the circle.
    method : str
        Of `sldvexp.geometry.conic_fit.fit_ellipse`.

    Returns
    -------
    fit : ConicFit
    edges : ScanLineEdges
        The same edges, moved out, in the order of ``fit.residual``.

    Raises
    ------
    UserError
        If the edges make no ellipse; it names the circle and says what was seen on its lines.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.image import ScanLineEdges, fit_circle
    >>> turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    >>> out = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    >>> edges = ScanLineEdges(
    ...     position=0.02 * out + 0.1, std=np.full(24, 1e-4), direction=out,
    ...     width=np.full(24, 1e-3), line=np.arange(24), rising=np.full(24, False),
    ...     phase=np.zeros(24), rejected=(), lines=24, name="the circle")
    >>> fit_circle(edges)[0].ellipse.semi_axes.round(4)
    array([0.02, 0.02])
    """
    try:
        fit, moved = _freed(edges, method)
        fit = _with_growth(fit, moved)
        if blur(fit, moved) > WIDEST:
            wide = blur(fit, moved)
            part = max(ERRING * wide, CLOSED * (wide - CLOSING))
            error = part * fit.ellipse.semi_axes.min()
            wider = max(error / fit.ellipse.semi_axes_std[-1], 1.0)
            moved = replace(moved, std=wider * moved.std)
            spread = replace(fit.ellipse, covariance=wider**2 * fit.ellipse.covariance)
            fit = replace(fit, ellipse=spread, residual_std=wider * fit.residual_std)
        return fit, moved
    except UserError as error:
        raise UserError(f"{error} (seen: {edges.summary()})") from None


def require_ellipse(edges: ScanLineEdges) -> None:
    """Complain about edges that make no ellipse; a third of what `fit_circle` takes.

    The spot, which moves all edges by fractions of its width, is left aside.

    Raises
    ------
    UserError
        As `fit_circle` does.
    """
    try:
        _fit(edges, "likelihood")
    except UserError as error:
        raise UserError(f"{error} (seen: {edges.summary()})") from None


def _with_growth(fit: ConicFit, edges: ScanLineEdges) -> ConicFit:
    """Add the error of the motion's growth, which all edges share, to that of the ellipse."""
    if edges.growth_std is None:
        return fit
    numbers = fit.ellipse.parameters
    _, normal = signed_distance(edges.position, numbers)
    rows = distance_jacobian(normal, numbers) / fit.residual_std[:, None]
    outwards = np.sum(normal * edges.direction, axis=-1) / fit.residual_std
    moved = edges.growth_std * outwards[:, None]
    change = np.linalg.pinv(rows[fit.used]) @ moved[fit.used]
    covariance = fit.ellipse.covariance + change @ change.T
    return replace(fit, ellipse=replace(fit.ellipse, covariance=covariance))


def lines_at_ellipse(edges: ScanLineEdges, width: Array, fit: ConicFit) -> tuple[Array, Array]:
    """Find how far ahead of their edges scan lines cross the ellipse, and the spot that they show.

    Parameters
    ----------
    edges : ScanLineEdges
        Freed from the spot, as `fit_circle` returns them.
    width : ndarray, shape (n,), steps
        Of the edges as they are seen, along the lines.

    Returns
    -------
    ahead : ndarray, shape (n,), steps
    spot : ndarray, shape (2, 2), steps^2
        Covariance of its light.
    """
    _, widening = _seen(edges, width, fit)
    return _to_ellipse(edges, fit.ellipse.parameters), _spot(edges, width / widening, fit)


def blur(fit: ConicFit, edges: ScanLineEdges) -> float:
    """Compare the width of edges with the smaller semi-axis of their ellipse."""
    _, normal = signed_distance(edges.position, fit.ellipse.parameters)
    across = edges.width * np.abs((normal * edges.direction).sum(axis=-1))
    return float(np.median(across) / fit.ellipse.semi_axes.min())


def _freed(edges: ScanLineEdges, method: str) -> tuple[ConicFit, ScanLineEdges]:
    """Fit, and move the edges, in turns until both stay."""
    fit, moved = _fit(edges, method), edges
    if not np.median(edges.width) > 0:
        return fit, edges
    offset, widening = np.zeros_like(edges.width), np.ones_like(edges.width)
    last = np.inf
    for _ in range(ROUNDS):
        before = offset
        offset, widening = _seen(moved, edges.width / widening, fit)
        change = np.abs(offset - before)
        most = float(np.max(change / edges.std))
        if most > last:
            open_ = replace(moved, std=np.hypot(edges.std, change))
            return _fit(open_, method, fit), open_
        moved = _moved(edges, -offset)
        fit, last = _fit(moved, method, fit), most
        # The next change is about this one times by how much the profile is not a straight
        # edge's: for a sharp spot one round is enough.
        if most * np.abs(widening - 1.0).max() <= SETTLED:
            break
    return fit, moved


def _moved(edges: ScanLineEdges, by: Array) -> ScanLineEdges:
    """Move edges along their scan lines, but not the pixels that place them."""
    position = edges.position + by[:, None] * edges.direction
    reach = None if edges.reach is None else edges.reach + by[:, None] * [1.0, -1.0]
    return replace(edges, position=position, reach=reach)


def _seen(edges: ScanLineEdges, width: Array, fit: ConicFit) -> tuple[Array, Array]:
    """Find where the spot sees the edges of the ellipse on the scan lines.

    Parameters
    ----------
    width : ndarray, shape (n,)
        That straight edges would have, along the scan lines.

    Returns
    -------
    offset, widening : ndarray, shape (n,)
        From the ellipse along the line; width as it is seen over that of a straight edge.
    """
    numbers = fit.ellipse.parameters
    spot = _spot(edges, width, fit)
    crossing = _moved(edges, _to_ellipse(edges, numbers))
    return seen_edges(numbers, spot, crossing.position, edges.direction, crossing.reach)


def _spot(edges: ScanLineEdges, width: Array, fit: ConicFit) -> Array:
    _, normal = signed_distance(edges.position, fit.ellipse.parameters)
    cosine = np.abs((normal * edges.direction).sum(axis=-1))
    return spot_of_widths(width * cosine, edges.std * cosine, normal)


def _to_ellipse(edges: ScanLineEdges, numbers: Array) -> Array:
    """Find how far ahead the scan lines cross the ellipse, or come nearest to it, shape (n,)."""
    to_disc = np.linalg.inv(np.linalg.cholesky(shape_matrix(numbers))).T
    at, ahead = (edges.position - numbers[:2]) @ to_disc, edges.direction @ to_disc
    square = (ahead**2).sum(axis=-1)
    nearest = -(at * ahead).sum(axis=-1) / square
    half = np.sqrt(np.maximum(nearest**2 - ((at**2).sum(axis=-1) - 1.0) / square, 0.0))
    return np.where(nearest > 0, nearest - half, nearest + half)


def _fit(edges: ScanLineEdges, method: str, before: ConicFit | None = None) -> ConicFit:
    """Fit an ellipse, by least distances from where another one was before.

    Eq 4.19 has no steps to save, and its weights are those of where it begins.
    """
    start = before if method == "likelihood" else None
    place = edges.position, edges.std, edges.direction
    return fit_ellipse(*place, method=method, name=edges.name, start=start)
