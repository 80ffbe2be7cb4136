"""A reconstruction method over a field: what each sample contributes to the normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.equations.pointwise import Pointwise, RowModel
from sldvexp.field.visibility.looks import Look, Looks
from sldvexp.field.visibility.view import View
from sldvexp.field.visibility.visibility import Seen
from sldvexp.reconstruction.base import Model, Reconstruction, Weights
from sldvexp.reconstruction.rows import RowSet
from sldvexp.typing import Array, IndexArray

#: Triangles that are looked at to choose the best rows.
TRIANGLES_FOR_ROWS = 200


@dataclass(frozen=True, eq=False)
class Samples:
    """Contributions of samples, ``sum_s B_s^T B_s (x) N_s theta = sum_s B_s^T (x) T_s v_s``.

    Attributes
    ----------
    pointwise : Pointwise
    information : ndarray, shape (sample, block, block)
        N_s. The contravariant method's is 1 or 0: all components have the same equations.
    estimator : ndarray, shape (sample, parameter, view)
        T_s.
    inverse : ndarray, shape (sample, parameter, parameter), optional
        Contravariant only: of the sample's own normal equations.
    std : ndarray, shape (sample, view), m/s
        Mean standard error of the pixels around a sample. That of the interpolated velocity is
        smaller between pixels than on them, but its errors are then shared with more samples.
    """

    pointwise: Pointwise
    information: Array
    estimator: Array
    inverse: Array | None
    std: Array


@dataclass(frozen=True, eq=False)
class FieldModel:
    """A method with its rows, for these views.

    Parameters
    ----------
    method : Reconstruction
    rows : RowSet
    local : bool
        Components along the surface's tangents and normal instead of the world's axes.
    pixel_std : tuple of ndarray, shape (pixel,), m/s
        Of each view: root mean square over the frequencies.
    """

    method: Reconstruction
    rows: RowSet
    local: bool
    pixel_std: tuple[Array, ...]

    @classmethod
    def of(cls, method: Reconstruction, looks: Looks, local: bool) -> FieldModel:
        """Choose the rows; one set serves the whole field."""
        some = _spread(len(looks.prisms.triangles))
        look = looks.at(some)
        by_all = look.valid.all(axis=1)
        points = look.directions[by_all if by_all.any() else slice(None)]
        rows = method.row_set(np.swapaxes(points, 0, 1), looks.names)
        model = cls(method, rows, local, tuple(_pixel_std(v) for v in looks.views))
        model._check_rows()
        model._check_std(looks.views)
        return model

    @property
    def contravariant(self) -> bool:
        """Whether samples are solved one by one before the field is."""
        return self.method.sample_by_sample

    @property
    def intercept(self) -> bool:
        """Whether nodes have an intercept."""
        return self.method.model is Model.full

    @property
    def generalised(self) -> bool:
        """Whether rows are weighted by their noise."""
        return self.method.weights is Weights.noise

    @property
    def parameters(self) -> int:
        """Unknowns of a node."""
        return 4 if self.intercept else 3

    @property
    def block(self) -> int:
        """Unknowns of a node that the normal equations couple."""
        return 1 if self.contravariant else self.parameters

    @property
    def variance(self) -> float:
        """Variance that weights are relative to: the mean over the views' pixels, or 1, m2/s2."""
        if not self.generalised:
            return 1.0
        return float(np.mean(np.concatenate(self.pixel_std) ** 2))

    @property
    def row_model(self) -> RowModel:
        """The rows' least squares at a sample; weights say nothing where each is solved exactly."""
        exact = self.contravariant and len(self.rows) == self.parameters
        return RowModel(
            self.rows.matrix,
            self.intercept,
            self.generalised and not exact,
            self.method.rank_tolerance,
            complete=self.contravariant,
        )

    def directions(self, look: Look) -> Array:
        """Direction cosines in the components' axes, shape (sample, view, 3)."""
        world = look.directions
        return world @ np.swapaxes(look.frame, 1, 2) if self.local else world

    def at(self, look: Look) -> Samples:
        """Contributions of the samples of a look."""
        std = np.stack(
            [_mean_std(*each) for each in zip(look.seen, self.pixel_std, strict=True)], 1
        )
        relative = std / np.sqrt(self.variance) if self.generalised else std
        pointwise = self.row_model.at(self.directions(look), look.valid, relative)
        if not self.contravariant:
            return Samples(pointwise, pointwise.information, pointwise.estimator, None, std)
        kept = pointwise.kept
        inverse = np.zeros((len(kept), self.parameters, self.parameters))
        inverse[kept] = np.linalg.inv(pointwise.information[kept])
        estimator = inverse @ pointwise.estimator
        return Samples(pointwise, kept.astype(float)[:, None, None], estimator, inverse, std)

    def _check_rows(self) -> None:
        independent = int(np.linalg.matrix_rank(self.rows.matrix))
        if independent < self.parameters:
            what = "three components and an intercept" if self.intercept else "three components"
            raise UserError(
                f"field: the rows {self.rows} are {independent} independent ones, which cannot "
                f"determine {what} anywhere; {self.parameters} are needed, so take more views"
            )

    def _check_std(self, views: Sequence[View]) -> None:
        if not self.generalised:
            return
        for view, std in zip(views, self.pixel_std, strict=True):
            zero = np.flatnonzero((std <= 0) & view.usable)
            if len(zero):
                raise UserError(
                    f"view {view.name}: the standard error of pixel {zero[0]} is 0, so that "
                    "weights=noise would trust it beyond all others; use weights=equal"
                )


def _pixel_std(view: View) -> Array:
    """Root mean square over frequencies; 0 where a pixel is flagged."""
    square = np.square(view.std).reshape(len(view.std), -1).mean(axis=1)
    return np.where(view.usable, np.sqrt(np.where(view.usable, square, 0.0)), 0.0)


def _mean_std(seen: Seen, pixel_std: Array) -> Array:
    """Root of the mean variance of the pixels around each sample; 0 where there are none."""
    size = abs(seen.weights)
    total = size.sum(axis=1)
    mean = np.divide(size @ pixel_std**2, total, out=np.zeros(len(total)), where=total > 0)
    return np.sqrt(mean)


def _spread(count: int) -> IndexArray:
    """Some triangles, evenly spread."""
    number = min(count, TRIANGLES_FOR_ROWS)
    return np.unique(np.linspace(0, count - 1, number).round().astype(np.intp))
