"""A reconstructed field as the group `field` of a run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.field.result import PARTS, FieldResult
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.volume.prisms import Prisms


def field_to_dataset(
    result: FieldResult,
    prisms: Prisms,
    method: Reconstruction,
    frequency: ArrayLike | None = None,
    element_error: np.ndarray | None = None,
) -> xr.Dataset:
    """Make the group ``field``.

    Parameters
    ----------
    result : FieldResult
    prisms : Prisms
    method : Reconstruction
    frequency : array_like, shape (frequency,), Hz, optional
        Without it there is no such dimension, and the result must have one frequency.
    element_error : ndarray of complex, shape (node, component, frequency), m/s, optional
        See `sldvexp.field.bounds.element_error.element_error`.

    Returns
    -------
    xarray.Dataset
        Attributes hold the counts of Table 5.7, pooled residuals, and what was used.
    """
    coords: dict[str, Any] = {
        "component": list(result.components),
        "view": [c.view.name for c in result.coverage],
        "row": list(result.rows.labels),
        "equation": list(result.components[: len(result.sse)])
        if len(result.sse) > 1
        else ["all components"],
        "part": list(PARTS),
        "reason": list(result.coverage[0].lost),
    }
    if len(result.sse) == 4:
        coords["equation"] = [*result.components, "intercept"]
    if frequency is not None:
        coords["frequency"] = np.asarray(frequency, float)
    arrays = _variables(result, prisms, element_error, frequency is not None)
    group = dataset.group("field", coords, **arrays)
    group.attrs |= _attributes(result, method)
    return group


def _variables(
    result: FieldResult, prisms: Prisms, element_error: np.ndarray | None, frequencies: bool
) -> dict[str, ArrayLike | None]:
    """Arrays of the group, without a frequency dimension if there is none."""

    def last(array: np.ndarray | None) -> np.ndarray | None:
        return array if array is None or frequencies else array[..., 0]

    pose = result.std_pose
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
        "element_error": last(element_error),
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


def _attributes(result: FieldResult, method: Reconstruction) -> dict[str, Any]:
    """Headline numbers, pooled over equations and frequencies, and what stands behind them."""
    equations = len(result.sse)
    found: dict[str, Any] = {
        "dof": result.unknowns,
        "samples": result.samples,
        **pooled(result.sse, result.samples),
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
        "coverage": "\n".join(c.summary() for c in result.coverage),
        "notes": "\n".join(result.messages),
    }
    if (test := result.intercept_test) is not None and test.statistic.size == 1:
        found["f_statistic"] = float(test.statistic.item())
    return found
