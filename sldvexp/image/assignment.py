"""Assignments of the image's ellipses to the object's circles, and how well each of them fits."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.geometry import Ellipse, bitangent, circles
from sldvexp.targets import Circles
from sldvexp.typing import Array, IndexArray

#: Circles whose assignments are all tried; they predict where the others of their plane are.
BASE = 3
#: Choices of the base that are followed up.
KEEP = 200
#: Assignments of one plane that are tried with other planes: within this factor of its best, or of
#: the step that the projective approximation may leave.
WITHIN, APPROXIMATION = 10.0, 1.0


@dataclass(frozen=True)
class Assignment:
    """Indices of the ellipses by the circles' numbers, on one plane or on all.

    Parameters
    ----------
    ellipse : dict of int to int
    mirrored : bool
    residual : float, steps
        Root mean square of what the best projective map leaves at the bitangent points.
    upright : bool
        False for a camera that would see near planes far and far planes near.
    obliqueness : float
        Largest cosine between the axes of a camera's image and its line of sight: 0 for one that
        looks straight ahead, as a scanner nearly does, whatever the gains of its mirrors. Points on
        a single plane do not tell it.
    """

    ellipse: dict[int, int]
    mirrored: bool
    residual: float
    upright: bool = True
    obliqueness: float = 0.0


class _Image:
    """Image's ellipses as far as assignments need them: centres and all bitangent points."""

    def __init__(self, ellipses: Sequence[Ellipse]):
        parameters = np.array([e.parameters for e in ellipses])
        self.centre = parameters[:, :2]
        self.table = bitangent.bitangent_points(parameters[:, None], parameters[None])

    def points(self, pairs: IndexArray, mirrored: bool) -> Array:
        """Return points of pairs in the order of the object's, shape (..., 8 pairs, 2).

        NaN for none.
        """
        points = self.table[pairs[..., 0], pairs[..., 1]]
        points = points[..., bitangent.MIRRORED, :, :] if mirrored else points
        return points.reshape(*pairs.shape[:-2], -1, 2)


def assignments(
    target: Circles, ellipses: Sequence[Ellipse], turns: Sequence[bool]
) -> list[Assignment]:
    """Find all assignments that a projective map allows, best first.

    Circles on several planes are assigned plane by plane and then together, by one camera matrix
    for all. A circle alone on its plane has no bitangents and is left out.

    Parameters
    ----------
    turns : sequence of bool
        Whether to try the image as it is (False) and mirrored (True).
    """
    image = _Image(ellipses)
    planes = [members for members in circles_by_plane(target) if len(members) > 1]
    by_plane = [_on_plane(target, members, image, turns) for members in planes]
    if len(by_plane) == 1:
        return by_plane[0]
    likely = [
        [a for a in plane if a.residual <= WITHIN * max(plane[0].residual, APPROXIMATION)]
        for plane in by_plane
    ]
    found = []
    for parts in itertools.product(*likely):
        whole = {number: k for part in parts for number, k in part.ellipse.items()}
        turn = parts[0].mirrored
        alike = all(part.mirrored == turn for part in parts)
        if alike and len(set(whole.values())) == len(whole):
            found.append(_by_camera(target, whole, turn, image))
    return _sorted(found)


def circles_by_plane(target: Circles) -> list[list[int]]:
    """Group numbers of the circles of each plane."""
    planes: dict[str, list[int]] = {}
    for number in sorted(target.circles):
        planes.setdefault(target.circles[number].plane, []).append(number)
    return list(planes.values())


def _on_plane(
    target: Circles, members: list[int], image: _Image, turns: Sequence[bool]
) -> list[Assignment]:
    """Find assignments of one plane's circles to ellipses, best first.

    All ordered choices of ellipses are tried for three circles that stand far from one line; the
    homography of each tells which ellipses are nearest to where the other circles must be.
    """
    base = _base(target, members)
    order = base + [n for n in members if n not in base]
    basic, pairs = (list(itertools.combinations(range(k), 2)) for k in (len(base), len(order)))
    centres = np.array([_numbers(target, n)[:2] for n in order])
    permutations = np.array(list(itertools.permutations(range(len(image.centre)), len(base))))
    found = []
    for turn in turns:
        homography, residual = _fit(target, order, basic, image, permutations, turn)
        likely = np.argsort(residual)[:KEEP]
        place, _ = apply(homography[likely], centres)
        choice = _with_nearest(permutations[likely], place, image.centre)
        _, residual = _fit(target, order, pairs, image, choice, turn)
        found += [
            Assignment(dict(zip(order, row.tolist(), strict=True)), turn, float(rms))
            for row, rms in zip(choice, residual, strict=True)
        ]
    return _sorted(found)


def _sorted(found: list[Assignment]) -> list[Assignment]:
    possible = [a for a in found if np.isfinite(a.residual)]
    return sorted(possible, key=lambda a: a.residual)


def _base(target: Circles, members: list[int]) -> list[int]:
    """Choose three circles of a plane (or both of two) whose centres make the largest triangle."""

    def area(chosen: Iterable[int]) -> float:
        (x1, y1, _), (x2, y2, _), (x3, y3, _) = (_numbers(target, n) for n in chosen)
        return abs((x2 - x1) * (y3 - y1) - (x3 - x1) * (y2 - y1))

    if len(members) < BASE:
        return members
    return list(max(itertools.combinations(members, BASE), key=area))


def _numbers(target: Circles, number: int) -> list[float]:
    """Give a circle's centre x, y and its radius, in the target's unit and its plane's axes."""
    circle = target.circles[number]
    return [circle.x, circle.y, circle.diameter / 2]


def _plane_points(target: Circles, pairs: Sequence[tuple[int, int]]) -> Array:
    """Compute bitangent points of pairs of circles in their plane's axes, shape (8 pairs, 2)."""
    a, b = np.swapaxes([[_numbers(target, n) for n in pair] for pair in pairs], 0, 1)
    return circles.bitangent_points(a, b).reshape(-1, 2)


def _fit(
    target: Circles,
    order: list[int],
    pairs: list[tuple[int, int]],
    image: _Image,
    choice: IndexArray,
    mirrored: bool,
) -> tuple[Array, Array]:
    """Fit a homography to every choice of ellipses, (choice, 3, 3); residuals too, (choice,)."""
    points = _plane_points(target, [(order[i], order[j]) for i, j in pairs])
    return fit_projection(points, image.points(choice[:, np.array(pairs)], mirrored))


def _with_nearest(choice: IndexArray, place: Array, centre: Array) -> IndexArray:
    """Complete each choice by the ellipses, not yet taken, nearest to where circles must be."""
    free = np.ones((len(choice), len(centre)), bool)
    rows = np.arange(len(choice))
    free[rows[:, None], choice] = False
    for k in range(choice.shape[1], place.shape[1]):
        distance = np.linalg.norm(centre - np.nan_to_num(place[:, k, None]), axis=-1)
        nearest = np.argmin(np.where(free, distance, np.inf), axis=1)
        free[rows, nearest] = False
        choice = np.column_stack([choice, nearest])
    return choice


def _by_camera(
    target: Circles, ellipse: dict[int, int], mirrored: bool, image: _Image
) -> Assignment:
    """Assign circles on all planes, judged by one camera matrix.

    Objects with the same circles on two planes fit one camera as well that exchanges the planes and
    turns space inside out. The axes (up, left, away from the instrument) are left-handed, so that
    the camera's determinant is negative for planes that face the instrument.
    """
    points, images = [], []
    for members in circles_by_plane(target):
        pairs = list(itertools.combinations([n for n in members if n in ellipse], 2))
        if pairs:
            plane = target.planes[target.circles[members[0]].plane]
            points.append(plane.origin + _plane_points(target, pairs) @ plane.axes()[:2])
            index = np.array([[ellipse[n] for n in pair] for pair in pairs])
            images.append(image.points(index, mirrored))
    in_space = np.concatenate(points)
    camera, residual = fit_projection(in_space, np.concatenate(images))
    _, depth = apply(camera, in_space)
    turn = np.linalg.det(camera[:, :3]) * np.sign(depth[0])
    upright = bool((turn > 0) == mirrored)
    return Assignment(ellipse, mirrored, float(residual), upright, _obliqueness(camera))


def _obliqueness(camera: Array) -> float:
    """Compute the largest cosine between rows of ``M``, of a camera ``[M t] = diag(f, g, 1) R``."""
    rows = camera[:, :3] / np.linalg.norm(camera[:, :3], axis=1, keepdims=True)
    return float(np.abs(rows @ rows.T - np.eye(3)).max())


def fit_projection(points: Array, image: Array) -> tuple[Array, Array]:
    """Fit the projective map from object to image points (direct linear transformation).

    Of points in a plane it is a homography, of points in space a camera matrix. Both sides are
    moved to their mean and scaled to their spread first.

    Parameters
    ----------
    points : ndarray, shape (..., K, d), any unit
        In a plane (d = 2) or in space (d = 3).
    image : ndarray, shape (..., K, 2), steps

    Returns
    -------
    projection : ndarray, shape (..., 3, d + 1)
    residual : ndarray, shape (...), steps
        Root mean square distance of the points from their images; infinite where the map sends one
        of the points behind the image, or an image point is not a number.
    """
    d = points.shape[-1]
    known = np.nan_to_num(image)
    object_frame, image_frame = _frame(points), _frame(known)
    x = homogeneous(points) @ np.swapaxes(object_frame, -1, -2)
    u, v, _ = np.moveaxis(homogeneous(known) @ np.swapaxes(image_frame, -1, -2), -1, 0)
    x, u, v = np.broadcast_arrays(x, u[..., None], v[..., None])
    none = np.zeros_like(x)
    rows = [np.concatenate(r, axis=-1) for r in ((x, none, -u * x), (none, x, -v * x))]
    design = np.concatenate(rows, axis=-2)
    _, vectors = np.linalg.eigh(np.swapaxes(design, -1, -2) @ design)
    normalised = vectors[..., 0].reshape(*vectors.shape[:-2], 3, d + 1)
    projection = np.linalg.inv(image_frame) @ normalised @ object_frame
    return projection, _residual(projection, points, image)


def apply(projection: Array, points: Array) -> tuple[Array, Array]:
    """Compute images of points, (..., K, 2), and depths to a common factor, (..., K)."""
    mapped = homogeneous(points) @ np.swapaxes(projection, -1, -2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return mapped[..., :2] / mapped[..., 2:], mapped[..., 2]


def homogeneous(points: Array) -> Array:
    """Append a one to points, shape (..., K, d + 1)."""
    return np.concatenate([points, np.ones_like(points[..., :1])], axis=-1)


def _frame(points: Array) -> Array:
    """Find the similarity to mean zero and mean square one, shape (..., d + 1, d + 1)."""
    mean = points.mean(axis=-2)
    scale = 1.0 / np.sqrt(((points - mean[..., None, :]) ** 2).sum(-1).mean(-1))
    d = points.shape[-1]
    frame = np.zeros((*points.shape[:-2], d + 1, d + 1))
    frame[..., range(d), range(d)] = scale[..., None]
    frame[..., :d, d] = -scale[..., None] * mean
    frame[..., d, d] = 1.0
    return frame


def _residual(projection: Array, points: Array, image: Array) -> Array:
    mapped, depth = apply(projection, points)
    square = ((mapped - image) ** 2).sum(axis=-1).mean(axis=-1)
    before = np.all(depth > 0, axis=-1) | np.all(depth < 0, axis=-1)
    return np.where(before & np.isfinite(square), np.sqrt(square), np.inf)
