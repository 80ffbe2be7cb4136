"""`check=field_pattern`: how fields compare in what does not depend on how much the plate moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr

#: Component that leaves the surface, in world axes along a plate and in local ones.
OUT_OF_PLANE = ("z", "n")


@register("check", "field_pattern")
@dataclass
class FieldPattern(Check):
    """Ratios between components, between views and between methods (Tables 5.7 and 5.8).

    In world axes z is taken for the direction out of the plane; choose ``volume.coordinates=local``
    for a surface that stands otherwise.
    """

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ratios of the chosen field, called ``field``, and of those it is compared with.

        Returns
        -------
        xarray.Dataset
            ``std_ratio`` and ``residual_ratio`` of each component to the one out of the plane,
            ``view_ratio`` of each view's residuals to the median view's, and ``cond_ratio`` of the
            condition number of ``field`` to that of each.

        Raises
        ------
        UserError
            If there is no field.
        """
        if "field" not in run.groups:
            raise UserError("check=field_pattern needs a field: choose a volume, a reconstruction")
        fields = {"field": run.groups["field"]} | run.below("compare", "residual_std_by_view")
        components = list(map(str, run.groups["field"]["component"].values))
        views = list(map(str, run.groups["field"]["view"].values))
        each = fields.values()
        cond = np.array([g.attrs.get("cond", np.nan) for g in each])
        return dataset.group(
            "examined/field_pattern",
            {"field": list(fields), "component": components, "view": views},
            std_ratio=[_over_normal(_of_measurement(g), "component") for g in each],
            residual_ratio=[_residual_ratio(g["residual_std"], components) for g in each],
            view_ratio=[_over_median(g["residual_std_by_view"]) for g in each],
            cond_ratio=cond[0] / cond,
        )


def _of_measurement(field: xr.Dataset) -> xr.DataArray:
    """Leave out of standard errors what elements and interpolation add, as the figures do."""
    if "variance" not in field:
        return field["velocity_std"]
    of_model = field["source"].isin(["interpolation", "elements"])
    return field["variance"].where(~of_model, 0.0).sum("source") ** 0.5


def _over_normal(std: xr.DataArray, dim: str) -> xr.DataArray:
    """Compare r.m.s. along a dimension of components with that out of the plane."""
    squares = (std**2).mean([d for d in std.dims if d != dim])
    normal = squares[dim].isin(OUT_OF_PLANE)
    return (squares / squares.where(normal, drop=True).item()) ** 0.5


def _residual_ratio(std: xr.DataArray, components: list[str]) -> xr.DataArray:
    """Compare residuals so; NaN where components are not solved for one by one."""
    if std["equation"].values.tolist() != components:
        return std.isel(equation=[0] * len(components)).mean("frequency") * float("nan")
    return _over_normal(std, "equation")


def _over_median(std: xr.DataArray) -> xr.DataArray:
    """Compare the r.m.s. of each view with the median of all."""
    by_view = (std**2).mean("frequency") ** 0.5
    return by_view / by_view.median()
