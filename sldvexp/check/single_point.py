"""Velocities at one point as checks of Section 5.2 compare them: estimates and their operators.

Every method is linear, ``V = H v``, so that two estimates from the same views have a known joint
covariance; taken for independent they would be compared with too wide a bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.dataset import RunData
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.least_squares import PointFit, point_fit
from sldvexp.reconstruction.rows import parse
from sldvexp.typing import Array

#: Relative singular value below which a direction counts as not determined.
TOLERANCE = 1e-4


def point_methods(run: RunData, check: str) -> dict[str, xr.Dataset]:
    """Take the reconstructions of points, ``point`` first.

    Raises
    ------
    UserError
        If there is none.
    """
    if "point" not in run.groups:
        raise UserError(
            f"check={check} needs the velocity of a point: choose instrument=file and a "
            "reconstruction, for example with experiment=point"
        )
    others = {n: g for n, g in run.groups.items() if n.startswith("compare/") and "hadamard" in g}
    return {"point": run.groups["point"], **others}


@dataclass(frozen=True, eq=False)
class SinglePoint:
    """Views of the one point of a run, and its reconstructions.

    Attributes
    ----------
    directions : ndarray, shape (view, 1, axis)
    velocity : ndarray, shape (view, frequency), m/s
    std : ndarray, shape (1, view), optional, m/s
        If the noise was given.
    """

    methods: dict[str, xr.Dataset]
    names: list[str]
    directions: Array
    velocity: np.ndarray
    std: Array | None

    @classmethod
    def from_run(cls, run: RunData, check: str) -> SinglePoint:
        """Take them out of a run.

        Raises
        ------
        UserError
            If there is no point, there are several, or the noise depends on the frequency.
        """
        methods = point_methods(run, check)
        if "line_of_sight" not in run.groups or "point" in methods["point"].dims:
            raise UserError(f"check={check} is for the views of a single point, and there are more")
        seen = run.groups["line_of_sight"]
        velocity = seen["velocity"].values.reshape(seen.sizes["view"], -1)
        std = None
        if methods["point"].attrs["noise_from"] == "given":
            each = seen["velocity_std"].values.reshape(len(velocity), -1)
            if np.ptp(each, axis=1).any():
                raise UserError(f"check={check} needs the same noise at all frequencies")
            std = each[None, :, 0]
        directions = seen["direction_cosines"].values[:, None]
        return cls(methods, list(map(str, seen["view"].values)), directions, velocity, std)

    @property
    def components(self) -> int:
        """Real numbers of a sample."""
        return 2 if np.iscomplexobj(self.velocity) else 1

    def method(self, name: str, key: str) -> xr.Dataset:
        """Take a reconstruction by its group's name.

        Parameters
        ----------
        key : str
            Of the setting that names it, for the message.
        """
        if name not in self.methods:
            raise UserError(f"{key}: there is no {name}; {nearest(name, self.methods)}")
        return self.methods[name]

    def fit(self, method: xr.Dataset) -> PointFit:
        """Set up the estimator that a reconstruction used."""
        return point_fit(
            self.directions,
            parse(method.attrs["rows"], self.names).matrix,
            std=self.std,
            intercept=method.attrs["model"] == "full",
            generalised=method.attrs["weights"] == "noise",
            tolerance=TOLERANCE,
        )

    def fit_of_all(self) -> PointFit:
        """Set up the least squares of all views without intercept, of the smallest variance."""
        return point_fit(
            self.directions,
            np.eye(len(self.names)),
            std=self.std,
            intercept=False,
            generalised=True,
            tolerance=TOLERANCE,
        )
