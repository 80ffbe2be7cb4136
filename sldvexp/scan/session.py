"""`scan=session`: in every view the calibration object and the structure, from one place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar, Self

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.geometry import KnownPose
from sldvexp.laser import TwoMirror
from sldvexp.scan.base import Scan, ScanPart, check_rough_pose
from sldvexp.scan.by_hand import ByHand
from sldvexp.scan.calibration import CalibrationScan, Centres
from sldvexp.scan.outline import OutlineScan, OutlineView
from sldvexp.scan.pixel_list import PixelList
from sldvexp.scan.rectangle import Rectangle, ScanRegion
from sldvexp.targets import Target


@register("scan", "session")
@dataclass
class Session(Scan):
    """Several scans in each view, one after the other, without moving the instrument between.

    Every view needs one part of each kind that is used: its circles, its image. A part without
    views is not used.

    Parameters
    ----------
    calibration : CalibrationScan
        Where the instrument stands.
    structure : Rectangle
        The images.
    pixels : PixelList
        The images of views that `structure` does not have.
    marks : ByHand
        Where the instrument stands, as a person finds it.
    outline : OutlineScan
        Where the instrument stands, by the outline of the part itself.
    poses : dict of str to KnownPose
        Rough poses of views, once for all parts: of these views `calibration` finds the circles,
        unless `marks` has the view, which then begin where they are predicted, or `outline` has a
        mesh, whose outline is scanned instead, and `structure` images the region of its
        `corners_at`.
    """

    rough_poses_key: ClassVar[str] = "scan.poses"

    calibration: CalibrationScan = field(default_factory=CalibrationScan)
    structure: Rectangle = field(default_factory=Rectangle)
    pixels: PixelList = field(default_factory=PixelList)
    marks: ByHand = field(default_factory=ByHand)
    outline: OutlineScan = field(default_factory=OutlineScan)
    poses: dict[str, KnownPose] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks = Checks()
        for name, pose in self.poses.items():
            check_rough_pose(checks, f"poses.{name}", pose)
        checks.done()
        used = {name: part for name, part in self._parts().items() if part.views}
        for kind in {part.kind: None for part in used.values()}:
            names = [name for name, part in used.items() if part.kind == kind]
            found = [view for name in names for view in used[name].views]
            twice = sorted(view for view, count in Counter(found).items() if count > 1)
            told = f"has the view {', '.join(twice)}, of which {names[0]} takes the image already"
            checks.require(not twice, f"{names[-1]}.views", told)
            missing = [view for view in self.view_names() if view not in found]
            told = f"lacks the view {', '.join(missing)}, which other parts of the session have"
            checks.require(not missing, f"{names[0]}.views", told)
        checks.done()

    def in_steps(
        self,
        laser: TwoMirror,
        target: Target | None,
        poses: Mapping[str, KnownPose] = MappingProxyType({}),
    ) -> Self:
        """See `Scan`; all parts."""
        parts: Any = {n: part.in_steps(laser, target, poses) for n, part in self._parts().items()}
        return replace(self, poses={}, **parts)

    def view_names(self) -> list[str]:
        """See `Scan`."""
        every = [view for part in self._parts().values() for view in part.views]
        return list(dict.fromkeys(every))

    def parts(self, view: str) -> list[ScanPart]:
        """See `Scan`."""
        return [part for part in self._parts().values() if view in part.views]

    def inputs(self) -> list[str]:
        """See `Scan`."""
        return [path for part in self._parts().values() for path in part.inputs()]

    def _parts(self) -> dict[str, ScanPart]:
        """Name the parts by the names of their fields, with entries of views of rough poses."""
        found, marked = self.poses.items(), self.marks.views
        unmarked = [(view, pose) for view, pose in found if view not in marked]
        outlined = bool(self.outline.path)
        circles = {} if outlined else {view: Centres(pose=pose) for view, pose in unmarked}
        outlines = {view: OutlineView(pose) for view, pose in unmarked} if outlined else {}
        regions = {
            view: ScanRegion(pose=pose)
            for view, pose in found
            if self.structure.corners_at and view not in self.pixels.views
        }
        marks = {v: replace(m, pose=m.pose or self.poses.get(v)) for v, m in marked.items()}
        return {
            "calibration": replace(self.calibration, views=circles | self.calibration.views),
            "structure": replace(self.structure, views=regions | self.structure.views),
            "pixels": self.pixels,
            "marks": replace(self.marks, views=marks),
            "outline": replace(self.outline, views=outlines | self.outline.views),
        }
