"""Lever arm of the slopes: what bending alone says of how high the measured face lies.

With Love's theory and nothing but bending every pixel is ``v = D_n w - zeta D_t . grad w``, where
the lever arm zeta is half the thickness. It is a column more, ``-D_t . grad w`` with the w of the
shell field, beside the splines of w with their prior and the errors of the poses with theirs.
Motions of the middle along itself are columns too, low-order functions of both directions. With w
eliminated, all of a line's data are a small system ``(F, g)`` of information and score,

    F = X'X - X'A H^-1 A'X,    g = X'y - X'A H^-1 A'y,    H = A'A + exp(lam) P,

from which any set of columns is estimated or tested, whatever the others are: estimates are
``F^-1 g`` with the covariance ``F^-1``, and ``g' F^-1 g`` is the chi-square of the score test that
none of them is needed. lam is that of the largest restricted likelihood.

Views from behind have told of w, and are left out: their lever arm is that of the back.

Lines are turned in phase so that w is as real as can be. Motion of the middle a quarter of a period
off changes nothing of the lever arm then; motion in phase with the bending does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.bounds.pose_uncertainty import POSE
from sldvexp.lazy import scipy
from sldvexp.shell.linear_form import LinearForm
from sldvexp.shell.love import ThinShell
from sldvexp.shell.outline import Outline
from sldvexp.shell.surface_fit import WEIGHTS, SurfaceFit
from sldvexp.typing import Array, ComplexArray, IntArray

#: Waves of the low-order motions of the middle along each side: 0 to this less one.
WAVES = 4
#: Motions of the middle in each direction: all products of such waves.
MEMBRANE = WAVES**2
#: Relative eigenvalue of an information that counts as zero.
SINGULAR = 1e-10


@dataclass(frozen=True, eq=False)
class SmallSystem:
    """Information and score of a few unknowns, all others eliminated.

    Attributes
    ----------
    information : ndarray, shape (unknown, unknown)
    score : ndarray, shape (unknown,)
    """

    information: Array
    score: Array

    def without(self, gone: IntArray, precision: Array | float = 0.0) -> SmallSystem:
        """Eliminate unknowns whose prior has mean 0 and such a precision.

        Examples
        --------
        >>> import numpy as np
        >>> both = SmallSystem(np.array([[2.0, 1.0], [1.0, 1.0]]), np.array([3.0, 1.0]))
        >>> alone = both.without(np.array([1]), np.eye(1))
        >>> alone.information.tolist(), alone.score.tolist()
        ([[1.5]], [2.5])
        """
        if len(gone) == 0:
            return self
        kept = np.setdiff1d(np.arange(len(self.score)), gone)
        own = self.information[np.ix_(gone, gone)] + precision
        crossed = self.information[np.ix_(kept, gone)]
        solved = np.linalg.lstsq(own, np.column_stack([crossed.T, self.score[gone]]))[0]
        information = self.information[np.ix_(kept, kept)] - crossed @ solved[:, :-1]
        return SmallSystem(information, self.score[kept] - crossed @ solved[:, -1])

    def estimate(self) -> tuple[Array, Array]:
        """Solve for all unknowns; their covariance."""
        covariance = np.asarray(np.linalg.inv(self.information), float)
        return covariance @ self.score, covariance

    def score_test(self) -> tuple[float, int]:
        """Compute chi-square of no unknown at all, and its degrees of freedom."""
        values, vectors = np.linalg.eigh(self.information)
        known = values > SINGULAR * values.max()
        squares = (vectors.T @ self.score)[known] ** 2 / values[known]
        return float(squares.sum()), int(known.sum())


@dataclass(frozen=True, eq=False)
class BendingLine:
    """One part of a line under bending alone: lever arms, motions of the middle, poses.

    Attributes
    ----------
    system : SmallSystem
        Of changes of the lever arm, m, then of motions of the middle, then of the poses' errors in
        their own standard deviations.
    arms : int
        How many lever arms there are, one a patch.
    """

    system: SmallSystem
    arms: int

    @property
    def _poses(self) -> IntArray:
        return np.arange(self.arms + 2 * MEMBRANE, len(self.system.score))

    def _membrane(self, each: int = MEMBRANE) -> IntArray:
        """Find the places of the first motions of the middle in either direction."""
        first = np.arange(each)
        return self.arms + np.r_[first, MEMBRANE + first]

    def arm_system(self, membrane: int = 0) -> SmallSystem:
        """Keep lever arms and poses, with some motions of the middle in either direction free."""
        used = self._membrane(membrane)
        unused = np.setdiff1d(self._membrane(), used)
        kept = np.setdiff1d(np.arange(len(self.system.score)), unused)
        own = self.system
        part = SmallSystem(own.information[np.ix_(kept, kept)], own.score[kept])
        return part.without(np.flatnonzero(np.isin(kept, used)))

    def membrane_test(self, arm_std: float | None) -> tuple[float, int]:
        """Test all motions of the middle together; chi-square and degrees of freedom.

        Parameters
        ----------
        arm_std : float, m, optional
            How well the lever arm is known; without it nothing is known of it.
        """
        posed = self.system.without(self._poses, np.eye(len(self._poses)))
        arms = np.arange(self.arms)
        if arm_std is None:
            return posed.without(arms).score_test()
        if arm_std == 0:
            kept = self._membrane()
            own = posed.information[np.ix_(kept, kept)]
            return SmallSystem(own, posed.score[kept]).score_test()
        return posed.without(arms, np.eye(self.arms) / arm_std**2).score_test()


def bending_lines(
    fit: SurfaceFit, lines: IntArray, patches: tuple[int, int] = (1, 1)
) -> list[tuple[BendingLine, BendingLine]]:
    """Make the small systems of some lines, of the part in phase with w and of the other.

    Parameters
    ----------
    fit : SurfaceFit
        Of a shell.
    lines : ndarray of int
        Which of the fit's frequencies.
    patches : tuple of int
        Into how many patches along s and along t the lever arm may differ.

    Raises
    ------
    UserError
        If no view sees the face.
    """
    if not any(len(p.pixel) and p.side > 0 for p in fit.pixels):
        raise UserError(
            "the lever arm of the face's slopes needs views of the face; all stand behind the sheet"
        )
    theta, turn = turned(fit, lines)
    poses = fit.errors.factor[:-2]
    poses = poses[:, np.any(poses != 0, axis=0)]
    sums = [(_LineProducts(), _LineProducts()) for _ in lines]
    normal = np.zeros((fit.shell.coefficients - fit.shell.of_w.start,) * 2)
    begin = 0
    for k, pixels in enumerate(fit.pixels):
        here = slice(begin, begin := begin + len(pixels.pixel))
        if not len(pixels.pixel) or pixels.side < 0:
            continue
        own = _add_view(fit, poses, lines, patches, theta, turn, k, here, sums)
        normal += own
    of_w = fit.shell.of_w
    penalty = fit.shell.penalties(None)[0][of_w, of_w]
    grids = [WEIGHTS[0] - 2 * np.log(size) for size in _sizes(fit, lines, theta)]
    work = _Elimination.of(normal, penalty, float(np.exp(np.min(grids))))
    arms = patches[0] * patches[1]
    return [
        (BendingLine(work.eliminated(a, grid), arms), BendingLine(work.eliminated(b, grid), arms))
        for (a, b), grid in zip(sums, grids, strict=True)
    ]


def joint_arms(lines: Sequence[SmallSystem], arms: int, common: bool = False) -> SmallSystem:
    """Put lever arms of several lines into one system, with the errors of the poses eliminated.

    Parameters
    ----------
    lines : sequence of SmallSystem
        Each of so many lever arms, and the same poses after them.
    arms : int
    common : bool
        Whether all lines have the same lever arms, or each its own.
    """
    poses = len(lines[0].score) - arms
    own = arms if common else arms * len(lines)
    information, score = np.zeros((own + poses, own + poses)), np.zeros(own + poses)
    for i, line in enumerate(lines):
        first = 0 if common else arms * i
        place = np.r_[first : first + arms, own : own + poses]
        information[np.ix_(place, place)] += line.information
        score[place] += line.score
    return SmallSystem(information, score).without(np.arange(own, own + poses), np.eye(poses))


def turned(fit: SurfaceFit, lines: IntArray) -> tuple[ComplexArray, ComplexArray]:
    """Turn lines in phase so that w is as real as can be.

    Returns
    -------
    theta : ndarray of complex, shape (coefficient, line)
        Of the field, turned.
    turn : ndarray of complex, shape (line,)
        Factors that did so.
    """
    theta = fit.columns.combined(fit.posterior.mean())[:, lines]
    w = fit.shell.w(fit.outline.corners) @ theta[fit.shell.of_w]
    turn = np.exp(-0.5j * np.angle(np.sum(w**2, axis=0)))
    return theta * turn, turn


def strongest(fit: SurfaceFit, count: int) -> IntArray:
    """Find the lines of most motion along the normal, peaks of it first; ascending."""
    theta = fit.columns.combined(fit.posterior.mean())
    w = fit.shell.w(fit.outline.corners) @ theta[fit.shell.of_w]
    size = np.sqrt(np.mean(np.abs(w) ** 2, axis=0))
    beside = np.pad(size, 1, constant_values=-1.0)
    at_peak = (size >= beside[:-2]) & (size >= beside[2:])
    return np.sort(np.lexsort((-size, ~at_peak))[:count])


def wave_number(fit: SurfaceFit, lines: IntArray) -> Array:
    """Compute the r.m.s. wave number of w in every line, rad/m: of its slopes, as shear weighs it.

    ``k^2 = - sum grad w . grad lap w / sum |grad w|^2`` over the surface's nodes.
    """
    theta = turned(fit, lines)[0].real[fit.shell.of_w]
    places, w = fit.outline.corners, fit.shell.w
    slope = [w(places, 1, 0) @ theta, w(places, 0, 1) @ theta]
    bent = [
        (w(places, 3, 0) + w(places, 1, 2)) @ theta,
        (w(places, 2, 1) + w(places, 0, 3)) @ theta,
    ]
    along = -sum(np.sum(a * b, axis=0) for a, b in zip(slope, bent, strict=True))
    squares = sum(np.sum(a**2, axis=0) for a in slope)
    return np.asarray(np.sqrt(np.maximum(along / squares, 0.0)))


def low_order(fit: SurfaceFit, coordinates: Array) -> Array:
    """Evaluate waves over the outline's rectangle, shape (place, MEMBRANE), the longest first.

    Around a closed surface they are whole waves, cosines and sines in turn.
    """
    low, high = fit.outline.low, fit.outline.high
    x, y = np.moveaxis(np.pi * (coordinates - low) / (high - low), -1, 0)
    along_s = [np.cos(i * x) for i in range(WAVES)]
    if fit.outline.closed:
        along_s = [(np.cos if i % 2 else np.sin)((i + i % 2) * x) for i in range(1, WAVES)]
        along_s = [np.ones_like(x), *along_s]
    order = sorted(np.ndindex(WAVES, WAVES), key=lambda ij: (sum(ij), ij))
    return np.stack([along_s[i] * np.cos(j * y) for i, j in order], axis=-1)


def patch_of(outline: Outline, coordinates: Array, patches: tuple[int, int]) -> IntArray:
    """Find the patch of every place, of equal parts of the outline's rectangle, row by row."""
    low, high = outline.low, outline.high
    share = (coordinates - low) / (high - low) * patches
    i, j = np.clip(share.astype(int), 0, np.array(patches) - 1).T
    return np.asarray(i * patches[1] + j)


class _LineProducts:
    """Products of the rows of one part of a line, over all views."""

    def __init__(self) -> None:
        self.crossed: Array | float = 0.0
        self.products: Array | float = 0.0

    def add(self, design: Array, columns: Array, data: Array) -> None:
        """Add a view's whitened rows: of w, and of the other columns with the data last."""
        all_columns = np.column_stack([columns, data])
        self.crossed = self.crossed + design.T @ all_columns
        self.products = self.products + all_columns.T @ all_columns


@dataclass(frozen=True, eq=False)
class _Elimination:
    """Elimination of w for any weight of its prior: one eigenproblem turns A'A and P diagonal.

    With ``G (A'A + c P) G' = 1`` and ``G P G' = D`` it is ``H^-1 = G' (1 + (exp(lam) - c) D)^-1 G``
    and ``log|H| = sum log(1 + (exp(lam) - c) D)`` but for a constant.
    """

    whitener: Array
    roughness: Array
    least: float
    rank: int

    @classmethod
    def of(cls, normal: Array, penalty: Array, least: float) -> _Elimination:
        root = scipy.linalg.cholesky(normal + least * penalty, lower=True)
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)), lower=True)
        values, vectors = np.linalg.eigh(inverse @ penalty @ inverse.T)
        own = np.linalg.eigvalsh(penalty)
        rank = int((own > SINGULAR * own.max()).sum())
        return cls(vectors.T @ inverse, np.maximum(values, 0.0), least, rank)

    def eliminated(self, sums: _LineProducts, grid: Array) -> SmallSystem:
        """Eliminate w with the weight of a grid that has the largest restricted likelihood."""
        crossed, products = self.whitener @ sums.crossed, np.asarray(sums.products)
        scale = 1 / (1 + (np.exp(grid) - self.least)[:, None] * self.roughness)
        twice = -scale @ crossed[:, -1] ** 2 - np.log(scale).sum(axis=1) - self.rank * grid
        left = products - crossed.T @ (scale[twice.argmin()][:, None] * crossed)
        return SmallSystem(left[:-1, :-1], left[:-1, -1])


def _sizes(fit: SurfaceFit, lines: IntArray, theta: ComplexArray) -> Array:
    """Compute the r.m.s. of w in every line, in the unit of its whitened columns."""
    w = fit.shell.w(fit.outline.corners) @ theta[fit.shell.of_w]
    return np.asarray(np.sqrt(np.mean(np.abs(w) ** 2, axis=0)) / fit.measured.scale[lines])


def _add_view(
    fit: SurfaceFit,
    poses: Array,
    lines: IntArray,
    patches: tuple[int, int],
    theta: ComplexArray,
    turn: ComplexArray,
    view: int,
    here: slice,
    sums: list[tuple[_LineProducts, _LineProducts]],
) -> Array:
    """Add one view's pixels to the sums of every line's parts; the part of A'A that is theirs."""
    pixels, shell, measured = fit.pixels[view], fit.shell, fit.measured
    weight = 1 / measured.pixel_std[here][:, None]
    of_w = shell.of_w
    design = pixels.design(shell, fit.face)[:, of_w] * weight
    tangential = pixels.cosine[:, :2]
    bending = theta.copy()
    bending[: of_w.start] = 0
    turns = _values(shell, bending, pixels.coordinates, shell.motion_by_height(pixels.coordinates))
    arm = np.einsum("pa,pal->pl", pixels.cosine, turns) * weight
    patch = patch_of(fit.outline, pixels.coordinates, patches)
    in_patch = patch[:, None] == np.arange(patches[0] * patches[1])
    waves = low_order(fit, pixels.coordinates)
    membrane = np.hstack([d[:, None] * waves for d in tangential.T]) * weight
    moved, posed = _by_errors(fit, poses, view, theta)
    data = measured.velocity(view, pixels)[:, lines] * turn * weight + moved * weight
    for i, scale in enumerate(measured.scale[lines]):
        for part, of_part in enumerate((np.real, np.imag)):
            columns = np.hstack(
                [
                    of_part(arm[:, i, None]) * in_patch / scale,
                    membrane,
                    of_part(posed[..., i]) * weight / scale,
                ]
            )
            sums[i][part].add(design, columns, of_part(data[:, i]) / scale)
    return np.asarray(design.T @ design)


def _by_errors(
    fit: SurfaceFit, poses: Array, view: int, theta: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Compute what a view's predictions change by the errors found, and by those of the poses."""
    pixels = fit.pixels[view]
    if not poses.size and not fit.at.any():
        count, lines = len(pixels.pixel), theta.shape[1]
        return np.zeros((count, lines), complex), np.zeros((count, 0, lines), complex)
    errors = len(fit.at)
    calibration = np.arange(errors)[fit.errors.own]
    own = np.r_[POSE * view : POSE * (view + 1), calibration]
    changes = prediction_changes(fit, view, theta)
    return (
        np.einsum("pel,e->pl", changes, fit.at[np.r_[own, errors - 2, errors - 1]]),
        np.einsum("pel,eq->pql", changes[:, :-2], poses[own]),
    )


def prediction_changes(fit: SurfaceFit, view: int, theta: ComplexArray) -> ComplexArray:
    """Differentiate a view's predictions by its pose, the calibration, height and thickness.

    Parameters
    ----------
    theta : ndarray of complex, shape (coefficient, line)

    Returns
    -------
    ndarray of complex, shape (pixel, 6 + calibration + 2, line)
    """
    pixels, shell, face = fit.pixels[view], fit.shell, fit.face
    others = [error.of_beams(view, pixels.pixel) for error in fit.errors.calibration]
    place, cosine = pixels.changes(fit.laser, fit.outline, face, fit.at[-2], others)
    where, toward = pixels.coordinates, pixels.cosine
    moves = _values(shell, theta, where, pixels.motion(shell, face))
    change = np.einsum("pae,pal->pel", cosine, moves)
    for axis in range(2):
        slope = _values(shell, theta, where, pixels.motion(shell, face, 1 - axis, axis))
        change += place[:, axis, :, None] * np.einsum("pa,pal->pl", toward, slope)[:, None]
    thicker = _values(shell, theta, where, shell.motion_by_height(where))
    by_height = change[:, -1] + np.einsum("pa,pal->pl", toward, thicker)
    by_thickness = pixels.side * by_height / 2
    return np.concatenate([change, by_thickness[:, None]], axis=1)


def _values(
    shell: ThinShell, theta: ComplexArray, places: Array, forms: list[LinearForm]
) -> ComplexArray:
    """Compute forms of fields with complex coefficients, shape (place, form, line)."""
    values = shell.values(np.hstack([theta.real, theta.imag]), places, forms)
    return np.asarray(values[..., : theta.shape[1]] + 1j * values[..., theta.shape[1] :])
