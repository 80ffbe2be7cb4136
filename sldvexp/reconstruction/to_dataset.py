"""A point reconstruction as the group `point` of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.reconstruction.result import PointVelocity


def points_to_dataset(method: Reconstruction, line_of_sight: xr.Dataset) -> xr.Dataset:
    """Reconstruct from the group ``line_of_sight`` and make the group ``point``.

    Parameters
    ----------
    method : Reconstruction
    line_of_sight : xarray.Dataset
        ``direction_cosines``, ``velocity`` and perhaps ``velocity_std``; point and frequency
        dimensions are optional and stay as they are.

    Returns
    -------
    xarray.Dataset
        Attributes hold the worst `rcond`, `hadamard` and `dof`, the total `sse`, how many
        components every point has, the lowest p-value of a test of the model, and what was used.
    """
    velocity = line_of_sight["velocity"]
    std = line_of_sight.get("velocity_std")
    result = method.reconstruct(
        line_of_sight["direction_cosines"].transpose("view", ..., "axis").values,
        velocity.values,
        None if std is None else std.values,
        [str(v) for v in line_of_sight["view"].values],
    )
    coords: dict[str, Any] = {
        d: velocity[d].values for d in ("point", "frequency") if d in velocity.dims
    }
    group = dataset.group(
        "point", coords | {"row": list(result.rows.labels)}, **_variables(result, coords)
    )
    group.attrs |= _attributes(method, result)
    return group


def _variables(result: PointVelocity, coords: dict[str, Any]) -> dict[str, ArrayLike | None]:
    """Arrays of the group, without the dimensions that the data does not have."""

    def by_point(array: np.ndarray) -> np.ndarray:
        """(point, ...) as it is, or of the one point."""
        return array if "point" in coords else array[0]

    def fields(array: np.ndarray | None) -> np.ndarray | None:
        """(point, ..., frequency) without what is not there."""
        if array is None:
            return None
        array = by_point(array)
        return array if "frequency" in coords else array[..., 0]

    frequencies = result.velocity.shape[-1]
    efficiency = np.broadcast_to(result.efficiency, result.velocity.shape)
    test = result.intercept_test
    made: dict[str, ArrayLike | None] = {
        "velocity": fields(result.velocity),
        "velocity_std": fields(result.std),
        "confidence": fields(result.confidence),
        "intercept": fields(result.intercept),
        "intercept_std": fields(result.intercept_std),
        "f_statistic": None if test is None else fields(test.statistic),
        "f_p_value": None if test is None else fields(test.p_value),
        "sse": fields(result.sse),
        "s": fields(result.s),
        "dof": fields(np.repeat(result.dof[:, None], frequencies, axis=1)),
        "rcond": by_point(result.rcond),
        "hadamard": by_point(result.hadamard),
        "efficiency": fields(efficiency),
        "observable": by_point(result.observable),
    }
    if result.basis is not None:
        made["basis"] = by_point(result.basis)
    if result.chi_square_p_value is not None:
        made["chi2_p_value"] = fields(result.chi_square_p_value)
    if (along := result.along) is not None:
        last: Any = slice(None) if "frequency" in coords else 0
        made |= {
            "deficient_point": along.point,
            "observed_rank": along.rank,
            "observed_direction": along.direction,
            "observed_velocity": along.velocity[..., last],
            "observed_velocity_std": along.std[..., last],
            "observed_confidence": along.confidence[..., last],
        }
    if "point" not in coords:
        residual = np.moveaxis(result.residuals(), 1, 0)
        made |= {"residual": fields(residual), "matrix": result.matrix[0]}
    return made


def _attributes(method: Reconstruction, result: PointVelocity) -> dict[str, Any]:
    """Headline numbers and what stands behind them."""
    found: dict[str, Any] = {
        "rcond": float(np.min(result.rcond)),
        "hadamard": float(np.min(result.hadamard)),
        "dof": float(np.min(result.dof)),
        "sse": float(np.nansum(result.sse)),
        "s": _worst(np.max, result.s),
        "components": int(result.observable.sum(axis=-1).min()),
        "rows": str(result.rows),
        "model": method.model.name,
        "weights": method.weights.name,
        "noise_from": result.noise_from,
        "confidence_level": method.confidence,
        "notes": "\n".join(result.messages),
    }
    test = result.intercept_test
    tests = [result.chi_square_p_value, None if test is None else test.p_value]
    if p_values := [p for p in tests if p is not None]:
        found["lowest_p_value"] = _worst(np.min, *p_values)
    if test is not None and test.statistic.size == 1:
        found["f_statistic"] = float(test.statistic.item())
    return found


def _worst(choose: Callable[[np.ndarray], Any], *arrays: np.ndarray) -> float:
    """Extreme of the numbers that there are; NaN if there are none."""
    values = np.concatenate([np.ravel(a) for a in arrays])
    known = values[np.isfinite(values)]
    return float(choose(known)) if known.size else np.nan
