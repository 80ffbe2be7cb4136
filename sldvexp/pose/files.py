"""Poses in files: a run's dataset, or a text of Figure 4.29's kind."""

from __future__ import annotations

import math
import re
from pathlib import Path

import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.pose.given import KnownPose, known_poses

_LINE = re.compile(r"^\s*(phi[123]|x0_[xyz])\s*=\s*(\S+)(?:\s*\+-\s*(\S+))?")
_NAMES = ("phi1", "phi2", "phi3", "x0_x", "x0_y", "x0_z")


def read_poses(path: Path, confidence: float) -> xr.Dataset:
    """The group ``pose`` of a file.

    Parameters
    ----------
    path : Path
        ``.nc``: a run's file. Anything else: text with lines such as ``phi1 = -1.153 +- 0.004``,
        angles in rad and lengths in m; several views each begin with ``View: name``.
    confidence : float
        Level of the bounds in a text, taken as normal.

    Raises
    ------
    UserError
        If the file is missing or has no whole pose.
    """
    if path.suffix == ".nc":
        with dataset.load(path) as tree:
            if "pose" not in tree.children:
                raise UserError(f"{path}: the run has no group pose")
            group = tree["pose"].to_dataset().load()
        group.attrs.pop("notes", None)
        return group
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read as text ({error})") from None
    return known_poses(_parse(lines, path, confidence), confidence)


def _parse(lines: list[str], path: Path, confidence: float) -> dict[str, KnownPose]:
    """Poses of a text, by view."""
    from statistics import NormalDist

    quantile = NormalDist().inv_cdf(0.5 + confidence / 2)
    found: dict[str, dict[str, tuple[float, float]]] = {}
    view = path.stem
    for number, line in enumerate(lines, 1):
        if line.startswith("View:"):
            view = line.removeprefix("View:").strip()
        if match := _LINE.match(line):
            try:
                value, bound = float(match[2]), float(match[3] or "nan")
            except ValueError:
                raise UserError(f"{path}: line {number}: {line.strip()!r} has no number") from None
            found.setdefault(view, {})[match[1]] = value, bound / quantile
    if not found:
        raise UserError(
            f"{path}: there is no pose: lines such as 'phi1 = -1.153 +- 0.004' are needed"
        )
    poses = {}
    for view, values in found.items():
        if missing := [n for n in _NAMES if n not in values]:
            raise UserError(f"{path}: view {view} lacks {', '.join(missing)}")
        numbers, std = zip(*(values[n] for n in _NAMES), strict=True)
        bounds = [] if any(map(math.isnan, std)) else list(std)
        poses[view] = KnownPose(list(numbers[:3]), list(numbers[3:]), bounds[:3], bounds[3:])
    return poses
