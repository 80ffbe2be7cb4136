"""`pose=given`: poses known from numbers, from a text of Figure 4.29's kind, or from a run.

Nothing is estimated here. Standard deviations of Euler angles become a covariance of the rotation
vector, ``C_w = J^-1 C_euler J^-T`` with the Jacobian J of the angles by the vector; a text's bounds
are taken as those of a normal variable at the asked level.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import NormalDist

import numpy as np

from sldvexp import dataset
from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.files import read_text, require_file
from sldvexp.geometry import KnownPose, euler_jacobian
from sldvexp.io.tables import number
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseMethod, PoseResult, pose_to_dataset
from sldvexp.pose.uncertainty import half_width
from sldvexp.targets import Target


@register("pose", "given")
@dataclass
class Given(PoseMethod):
    """Known poses: nothing is estimated, the numbers and their bounds are taken over.

    Parameters
    ----------
    path : str
        A run's ``run.nc``, or a text as the program writes it (``pose.txt``, Figure 4.29).
    views : dict of str to KnownPose
        Poses as numbers, instead of a path.
    confidence : float
        Level of the intervals.
    """

    path: str = ""
    views: dict[str, KnownPose] = field(default_factory=dict)
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(
            bool(self.path) != bool(self.views),
            "path",
            "give either a path or views, not both or none",
        )
        checks.probability("confidence", self.confidence)
        for name, view in self.views.items():
            view.check(checks, f"views.{name}")
            for key in ("euler_std", "origin_std"):
                for value in getattr(view, key):
                    checks.non_negative(f"views.{name}.{key}", value)
            both = bool(view.euler_std) == bool(view.origin_std)
            message = "give euler_std and origin_std together"
            checks.require(both, f"views.{name}.euler_std", message)
            few = "must be 0 (errors known) or at least 2"
            checks.require(view.samples == 0 or view.samples > 1, f"views.{name}.samples", few)
        checks.done()

    def inputs(self) -> list[str]:
        """List the file, if poses come from one."""
        return [self.path] if self.path else []

    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Take the poses over; nothing of the run matters."""
        return self.read()

    def read(self) -> PoseResult:
        """Read the poses, wherever they stand."""
        if self.path:
            return PoseResult(read_poses(locate(self.path), self.confidence))
        return PoseResult(known_poses(self.views, self.confidence))


def known_poses(views: dict[str, KnownPose], confidence: float) -> xr.Dataset:
    """Make the group ``pose`` of Euler angles and origins with standard deviations.

    Examples
    --------
    >>> from sldvexp.geometry import KnownPose
    >>> stood = KnownPose([-1.153, 2.547, 1.913], [0.862, 0.508, 1.553])
    >>> known_poses({"front": stood}, 0.95)["euler"].values.round(3)
    array([[-1.153,  2.547,  1.913]])
    """
    poses = list(views.values())
    rotation = np.array([p.rotation for p in poses])
    covariance = np.full((len(poses), 6, 6), np.nan)
    for matrix, r, p in zip(covariance, rotation, poses, strict=True):
        if not p.euler_std:
            continue
        n = p.samples or 1
        by_euler = np.linalg.inv(euler_jacobian(r))
        std = p.angle_unit.value * np.array(p.euler_std)
        matrix[:] = 0.0
        matrix[:3, :3] = by_euler @ np.diag(np.square(std) / n) @ by_euler.T
        matrix[3:, 3:] = np.diag(np.square(p.origin_std) * p.unit.value**2 / n)
    return pose_to_dataset(
        list(views),
        rotation,
        np.array([p.place for p in poses]),
        covariance,
        [p.samples - 1 if p.samples else np.inf for p in poses],
        confidence,
    )


_LINE = re.compile(r"^\s*(phi[123]|x0_[xyz])\s*=\s*(\S+)(?:\s*\+-\s*(\S+))?")
_NEEDED = ("view", "rotation", "origin", "covariance")
_NAMES = ("phi1", "phi2", "phi3", "x0_x", "x0_y", "x0_z")


def read_poses(path: Path, confidence: float) -> xr.Dataset:
    """Read the group ``pose`` of a file.

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
        with dataset.readable(path), dataset.load(path) as tree:
            if "pose" not in tree.children:
                raise UserError(f"{path}: the run has no group pose")
            group = tree["pose"].to_dataset().load()
        dataset.require_declared(path, "pose", group)
        group.attrs.pop("notes", None)
        bounds = [n for n in group if str(n).endswith("_confidence")]
        behind = ["dof", *(str(n).replace("_confidence", "_std") for n in bounds)] if bounds else []
        if missing := [n for n in (*_NEEDED, *behind) if n not in group]:
            raise UserError(f"{path}: the group pose lacks {', '.join(missing)}")
        return _at_level(group, confidence)
    lines = read_text(path).splitlines()
    return known_poses(_parse(lines, path, confidence), confidence)


def _at_level(pose: xr.Dataset, confidence: float) -> xr.Dataset:
    """Give the intervals another level, from standard errors and their freedom."""
    for name in ("euler", "origin", "intrinsic"):
        if f"{name}_confidence" in pose:
            width = half_width(pose[f"{name}_std"].values, pose["dof"].values, confidence)
            pose[f"{name}_confidence"] = pose[f"{name}_confidence"].copy(data=width)
    pose.attrs["confidence_level"] = confidence
    return pose


def _parse(lines: list[str], path: Path, confidence: float) -> dict[str, KnownPose]:
    """Read the poses of a text, by view."""
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
