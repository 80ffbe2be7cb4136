"""Result of a field's reconstruction, and the group of a run's dataset that is made of it.

Bounds are per real and imaginary part. Noise of the velocities is the same in both; an error of a
pose moves all velocities together and shows in the part where the velocity is, so that bounds of
the two parts differ, and the larger one holds for both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.field.bounds.advice import mean_squares
from sldvexp.field.bounds.budget import by_source, model_variances, not_included
from sldvexp.field.bounds.element_error import SurfaceMean, element_error
from sldvexp.field.visibility.coverage import Coverage
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction import ReconstructionSettings, RowSet
from sldvexp.statistics import FTest, student_factor
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Components of velocities, and parts of complex numbers.
WORLD, LOCAL = ("x", "y", "z"), ("t1", "t2", "n")
PARTS = ("real", "imaginary")


@dataclass(frozen=True, eq=False)
class FieldResult:
    """Nodal velocities with bounds; what is not determined is NaN and has a flag.

    Attributes
    ----------
    components : tuple of str
        x, y, z, or t1, t2, n of each node's own frame.
    velocity : ndarray of complex, shape (node, component, frequency), m/s
    variance : dict of str to ndarray, shape (part or 1, node, component, frequency), m2/s2
        By the names of `sldvexp.field.bounds.budget.SOURCES`; empty without bounds. That from the
        velocities' noise is the same in both parts. An error of a pose moves all velocities
        together, and shows in the part where the velocity is.
    interpolation_error : ndarray of complex, shape (node, component, frequency), m/s, optional
        Estimated error of the interpolation between pixels, where that can be told.
    intercept, intercept_std : ndarray, shape (node, frequency), optional, m/s
        Of the full model; the latter of the larger part.
    observable : ndarray of bool, shape (node, component)
    flagged_node : ndarray of int, shape (flagged,)
        Nodes where not all components are determined.
    flagged_rank : ndarray of int, shape (flagged,)
        How many directions are.
    flagged_direction : ndarray, shape (flagged, 3, 3)
        Orthonormal, in the components' axes; the first `rank` are determined.
    unknowns : int
        Of one equation: of all components together, or of one for the contravariant method.
    samples : int
        Scalar rows as Table 5.7 counts them: rows of samples, twice the samples (real and
        imaginary) for the contravariant method.
    sse : ndarray, shape (equation, frequency), m2/s2
        Sum of squares that is minimised; an equation for each component, or one.
    residual_std : ndarray, shape (equation, frequency), m/s
        ``sqrt(sse / samples)``, as Table 5.7 prints it.
    s : ndarray, shape (equation, frequency), m/s
        Of a real component, with the degrees of freedom that are left.
    residual_std_by_view : ndarray, shape (view, frequency), m/s
    residual_std_by_row : ndarray, shape (row, frequency), m/s
    chi2_ratio : ndarray, shape (equation, frequency), optional
        `sse` over its expectation from the pixels' noise.
    cond, rcond : float
        Of the normal equations' matrix: largest over smallest eigenvalue, and the reciprocal
        condition number in the 1-norm.
    intercept_test : FTest, optional
        Of all intercepts together, in the covariance that pixels and poses give them; see
        `sldvexp.field.bounds.intercept_test`.
    efficiency : ndarray, shape (node, component), optional
        Least variance that all views allow in these elements, over this method's; of the noise.
    bounds_error : float
        Largest relative error of a standard error, from noise and poses, found at the few nodes
        where it was computed exactly.
    coverage : tuple of Coverage
        What each view sees.
    messages : tuple of str
        What a user must know about flagged nodes and bounds, in sentences.
    visibility : VolumeVisibility
        The volume, its samples and the views.
    method : ReconstructionSettings
        Rows, model, weights and confidence that were asked for.
    frequency : ndarray, shape (frequency,), Hz, optional
    """

    GROUP: ClassVar[str] = "field"

    components: tuple[str, ...]
    velocity: ComplexArray
    variance: dict[str, Array]
    intercept: ComplexArray | None
    intercept_std: Array | None
    observable: BoolArray
    flagged_node: NDArray[np.int_]
    flagged_rank: NDArray[np.int_]
    flagged_direction: Array
    rows: RowSet
    unknowns: int
    samples: int
    sse: Array
    residual_std: Array
    s: Array
    residual_std_by_view: Array
    residual_std_by_row: Array
    chi2_ratio: Array | None
    cond: float
    rcond: float
    intercept_test: FTest | None
    efficiency: Array | None
    bounds_error: float
    coverage: tuple[Coverage, ...]
    messages: tuple[str, ...]
    visibility: VolumeVisibility
    method: ReconstructionSettings
    frequency: Array | None = None
    interpolation_error: ComplexArray | None = None

    def __repr__(self) -> str:
        """Say how many, how well the samples fit, and how good it is."""
        nodes, _, frequencies = self.velocity.shape
        lines = [
            f"FieldResult: velocity ({', '.join(self.components)}) at {nodes} nodes and "
            f"{frequencies} frequenc{'y' if frequencies == 1 else 'ies'}, rows {self.rows}",
            f"  {self.samples} samples of {len(self.coverage)} views, residual "
            f"{self._pooled['residual_std']:.3g} m/s (r.m.s.)",
        ]
        if self.efficiency is not None and np.isfinite(self.efficiency).any():
            low = np.nanmin(self.efficiency)
            lines.append(f"  efficiency {low:.3g} or more of what these views allow")
        if self.confidence is not None and np.isfinite(self.confidence).any():
            level = self.method.confidence
            lines.append(f"  largest bound {np.nanmax(self.confidence):.3g} m/s ({level:.0%})")
        return "\n".join(lines)

    @property
    def std_noise(self) -> Array | None:
        """Standard error from the velocities' noise, shape (node, component, frequency), m/s."""
        return np.sqrt(self.variance["noise"][0]) if self.variance else None

    @property
    def std_pose(self) -> Array | None:
        """Standard error from the poses, shape (part, node, component, frequency), m/s."""
        return np.sqrt(self.variance["pose"]) if "pose" in self.variance else None

    @cached_property
    def std_by_part(self) -> Array | None:
        """Standard error of all sources, shape (part, node, component, frequency), m/s."""
        if not self.variance:
            return None
        std = np.sqrt(sum(self.variance.values()))
        return np.asarray(np.broadcast_to(std, (len(PARTS), *std.shape[1:])))

    @property
    def confidence_by_part(self) -> Array | None:
        """Half-width of the interval of each part, shape (part, node, component, frequency)."""
        if self.std_by_part is None:
            return None
        return float(student_factor(self.method.confidence, np.inf)) * self.std_by_part

    @property
    def std(self) -> Array | None:
        """Standard error of the larger of both parts, shape (node, component, frequency)."""
        return None if self.std_by_part is None else self.std_by_part.max(axis=0)

    @property
    def confidence(self) -> Array | None:
        """Half-width that holds for both parts, shape (node, component, frequency)."""
        return None if self.confidence_by_part is None else self.confidence_by_part.max(axis=0)

    @cached_property
    def element_error(self) -> ComplexArray:
        """Estimated error of linear elements, shape (node, component, frequency), m/s.

        See `sldvexp.field.bounds.element_error.element_error`.
        """
        return element_error(self._mean, self.velocity)

    @cached_property
    def _mean(self) -> SurfaceMean:
        return SurfaceMean.from_prisms(self.visibility.prisms, self.visibility.rule)

    @property
    def mean_squares(self) -> Array:
        """Parts of the budget that advice is given by, shape (5, component), m2/s2."""
        return mean_squares(self._mean, self.variance, self.element_error, self.interpolation_error)

    def with_model_errors(self) -> FieldResult:
        """Add what the elements and the interpolation leave out of the field to its bounds."""
        if not self.variance:
            return self
        noise, elements = self.variance["noise"][0], self.element_error
        added = model_variances(self._mean, noise, elements, self.interpolation_error)
        return replace(self, variance={**self.variance, **added})

    @property
    def _pooled(self) -> dict[str, float]:
        return pooled(self.sse, self.samples)

    def to_dataset(self) -> xr.Dataset:
        """Make the group ``field`` of a run.

        Without `frequency` there is no such dimension. Attributes hold the counts of Table 5.7,
        pooled residuals, and what was used.

        Raises
        ------
        UserError
            If there are several frequencies and it is not known which.
        """
        if self.frequency is None and self.velocity.shape[-1] != 1:
            raise UserError(
                f"the field has {self.velocity.shape[-1]} frequencies, but it is not said which; "
                "give frequency, in Hz"
            )
        coords: dict[str, Any] = {
            "component": list(self.components),
            "view": [c.view.name for c in self.coverage],
            "row": list(self.rows.labels),
            "equation": list(self.components[: len(self.sse)])
            if len(self.sse) > 1
            else ["all components"],
            "part": list(PARTS),
            "reason": list(self.coverage[0].lost),
        }
        if self.variance:
            coords["source"] = by_source(self.variance)[0]
        if len(self.sse) == 4:
            coords["equation"] = [*self.components, "intercept"]
        if self.frequency is not None:
            coords["frequency"] = np.asarray(self.frequency, float)
        group = dataset.group("field", coords, **_variables(self))
        group.attrs |= _attributes(self)
        return group


def _variables(result: FieldResult) -> dict[str, ArrayLike | None]:
    """Collect arrays of the group, without a frequency dimension if there is none."""

    def last(array: np.ndarray | None) -> np.ndarray | None:
        return array if array is None or result.frequency is not None else array[..., 0]

    pose, prisms = result.std_pose, result.visibility.prisms
    test = result.intercept_test
    flagged = len(result.flagged_node) > 0
    return {
        "velocity": last(result.velocity),
        "velocity_std": last(result.std),
        "confidence": last(result.confidence),
        "velocity_std_noise": last(result.std_noise),
        "velocity_std_pose": None if pose is None else last(pose.max(axis=0)),
        "velocity_std_by_part": last(result.std_by_part),
        "confidence_by_part": last(result.confidence_by_part),
        "variance": last(by_source(result.variance)[1]) if result.variance else None,
        "element_error": last(result.element_error),
        "interpolation_error": last(result.interpolation_error),
        "intercept": last(result.intercept),
        "intercept_std": last(result.intercept_std),
        "position": prisms.position,
        "element": prisms.element.astype(np.int32),
        "observable": result.observable,
        "flagged_node": result.flagged_node if flagged else None,
        "flagged_rank": result.flagged_rank if flagged else None,
        "flagged_direction": result.flagged_direction if flagged else None,
        "efficiency": result.efficiency,
        "sse": last(result.sse),
        "residual_std": last(result.residual_std),
        "s": last(result.s),
        "chi2_ratio": last(result.chi2_ratio),
        "residual_std_by_view": last(result.residual_std_by_view),
        "residual_std_by_row": last(result.residual_std_by_row),
        "f_statistic": None if test is None else last(test.statistic),
        "f_p_value": None if test is None else last(test.p_value),
        "samples_seen": [c.seen for c in result.coverage],
        "samples_lost": [list(c.lost.values()) for c in result.coverage],
    }


def pooled(sse: np.ndarray, samples: int) -> dict[str, float]:
    """Sum of squares and residuals of all equations and frequencies together."""
    return {"sse": float(sse.sum()), "residual_std": float(np.sqrt(sse.mean() / samples))}


def _attributes(result: FieldResult) -> dict[str, Any]:
    """Collect headline numbers, pooled over equations and frequencies, and their settings."""
    equations, method = len(result.sse), result.method
    found: dict[str, Any] = {
        "dof": result.unknowns,
        "samples": result.samples,
        **result._pooled,
        "cond": result.cond,
        "rcond": result.rcond,
        "bounds_error": result.bounds_error,
        "equations": equations,
        "components_determined": int(result.observable.sum()),
        "rows": str(result.rows),
        "model": method.model.name,
        "weights": method.weights.name,
        "coordinate_system": "world" if result.components[0] == "x" else "local",
        "confidence_level": method.confidence,
        "interpolation": result.visibility.interpolation.name,
        "not_included": "; ".join(not_included(result.variance)),
        "coverage": "\n".join(c.summary() for c in result.coverage),
        "notes": "\n".join(result.messages),
    }
    if (test := result.intercept_test) is not None and test.statistic.size == 1:
        found["f_statistic"] = float(test.statistic.item())
    return found
