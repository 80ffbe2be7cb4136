"""Poses in files: a run's dataset, or a text of Figure 4.29's kind."""

from __future__ import annotations

import math
import re
from pathlib import Path
from statistics import NormalDist

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.files import read_text, require_file
from sldvexp.geometry.rotation import KnownPose
from sldvexp.io.tables import number
from sldvexp.lazy import xarray as xr
from sldvexp.pose.given import known_poses
from sldvexp.pose.uncertainty import half_width

_LINE = re.compile(r"^\s*(phi[123]|x0_[xyz])\s*=\s*(\S+)(?:\s*\+-\s*(\S+))?")
_NEEDED = ("view", "rotation", "origin", "covariance")
_NAMES = ("phi1", "phi2", "phi3", "x0_x", "x0_y", "x0_z")


def read_poses(path: Path, confidence: float) -> xr.Dataset:
    """The group ``pose`` of a file.

    Parameters
    ----------
    path : Path
        ``.nc``: a run's file. Anything else: text with lines such as ``phi1 = -1.153 +- 0.004``,
        angles in rad and lengths in m; several views each begin with ``View: name``.
    confidence : float
        Level of the bounds: those of a text are taken as normal, those of a run are made anew.

    Raises
    ------
    UserError
        If the file is missing or has no whole pose.
    """
    require_file(path)
    if path.suffix.lower() == ".nc":
        with dataset.load(path) as tree:
            if "pose" not in tree.children:
                raise UserError(f"{path}: the run has no group pose")
            group = tree["pose"].to_dataset().load()
        group.attrs.pop("notes", None)
        bounds = [n for n in group if str(n).endswith("_confidence")]
        behind = ["dof", *(str(n).replace("_confidence", "_std") for n in bounds)] if bounds else []
        if missing := [n for n in (*_NEEDED, *behind) if n not in group]:
            raise UserError(f"{path}: the group pose lacks {', '.join(missing)}")
        return _at_level(group, confidence)
    lines = read_text(path).splitlines()
    return known_poses(_parse(lines, path, confidence), confidence)


def _at_level(pose: xr.Dataset, confidence: float) -> xr.Dataset:
    """The pose with its intervals at another level, from standard errors and their freedom."""
    for name in ("euler", "origin", "intrinsic"):
        if f"{name}_confidence" in pose:
            width = half_width(pose[f"{name}_std"].values, pose["dof"].values, confidence)
            pose[f"{name}_confidence"] = pose[f"{name}_confidence"].copy(data=width)
    pose.attrs["confidence_level"] = confidence
    return pose


def _parse(lines: list[str], path: Path, confidence: float) -> dict[str, KnownPose]:
    """Poses of a text, by view."""
    quantile = NormalDist().inv_cdf(0.5 + confidence / 2)
    found: dict[str, dict[str, tuple[float, float]]] = {}
    view = path.stem
    for count, line in enumerate(lines, 1):
        if line.startswith("View:"):
            view = line.removeprefix("View:").strip()
        if match := _LINE.match(line):
            where, name = f"{path}, line {count}", match[1]
            value = number(match[2], name, where)
            bound = number(match[3], f"the bound of {name}", where) if match[3] else math.nan
            if bound < 0:
                raise UserError(f"{where}: the bound of {name} must not be negative, not {bound}")
            if name in found.setdefault(view, {}):
                raise UserError(f"{where}: {name} of view {view} stands there twice")
            # A bound that was rounded to zero says nothing of the error.
            found[view][name] = value, bound / quantile or math.nan
    if not found:
        raise UserError(
            f"{path}: there is no pose: lines such as 'phi1 = -1.153 +- 0.004' are needed"
        )
    poses = {}
    for view, values in found.items():
        if missing := [n for n in _NAMES if n not in values]:
            raise UserError(f"{path}: view {view} lacks {', '.join(missing)}")
        numbers, std = zip(*(values[n] for n in _NAMES), strict=True)
        unbounded = [n for n in _NAMES if math.isnan(values[n][1])]
        if 0 < len(unbounded) < len(_NAMES):
            raise UserError(
                f"{path}: view {view} has bounds, but none above zero of {', '.join(unbounded)}"
            )
        bounds = [] if unbounded else list(std)
        poses[view] = KnownPose(list(numbers[:3]), list(numbers[3:]), bounds[:3], bounds[3:])
    return poses
