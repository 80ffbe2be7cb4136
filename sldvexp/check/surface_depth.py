"""`check=surface_depth`: where in the volume the real surface is, without any geometry."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp import dataset
from sldvexp.check.agreement import agreement, best_depth
from sldvexp.check.base import Check, Examined
from sldvexp.check.tangential import least_motion
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import xarray as xr


@register("check", "surface_depth")
@dataclass
class SurfaceDepth(Check):
    """Depth of the middle of a vibrating shell in the volume, from velocities alone.

    Away from it every view looks at another place of the structure. To first order that adds a
    tangential velocity, the distance times the slope of the normal velocity, and a thin shell that
    bends has the same by itself (Love): none in the middle of its thickness. So the tangential
    velocity is least there. To second order the views disagree, which needs no shell but says less;
    where they agree best is found besides if there are four views or more.

    Parameters
    ----------
    parts : int
        Into how many parts the surface is cut; how the depth changes when each is left out is its
        standard error, whatever the cause.
    """

    parts: int = 16

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(self.parts >= 4, "parts", f"must be at least 4, not {self.parts}")
        checks.done()

    def examine(self, run: Examined) -> xr.Dataset:
        """``depth`` along the normals, ``agreement_depth``, and ``misfit`` at sampled depths.

        Raises
        ------
        UserError
            If there is no field.
        """
        if not {"field", "volume"} <= set(run.tree):
            raise UserError("check=surface_depth needs a field: choose volume and reconstruction")
        depth, std, inside = least_motion(run.tree["field"], run.tree["volume"], self.parts)
        notes = [] if inside else ["the surface lies outside of the volume; move volume.offset"]
        found = agreement(run, self.parts) if len(run.tree["field"]["view"]) > 3 else None
        agreed, agreed_std = best_depth(found) if found else (None, None)
        group = dataset.group(
            "examined/surface_depth",
            {"sample_depth": found.depth if found else []},
            depth=depth,
            depth_std=std,
            agreement_depth=agreed,
            agreement_depth_std=agreed_std,
            misfit=found.misfit.sum(axis=0) / found.freedom.sum(axis=0) if found else None,
        )
        group.attrs["notes"] = "\n".join(notes)
        return group
