"""Effect of the mirrors' calibration on a field: solved with it and with what it may be instead.

Errors that were adjusted together with the poses have these poses go along (`PoseErrors`). What is
stated of the laser beforehand, standard deviations of gain, zero, polynomial and mirror offset, is
the same in all views and leaves the poses as they are: where poses were found with the same mirrors
they make up for a part of it, and the variance is an upper one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from sldvexp.field.bounds.pose_uncertainty import PoseErrors
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.laser import TwoMirror
from sldvexp.typing import Array


def calibration_changes(
    visibility: VolumeVisibility,
    errors: PoseErrors | None,
    solved: Callable[[VolumeVisibility], Array],
) -> list[Array]:
    """Compute changes of the solution with each independent error of one standard deviation.

    Parameters
    ----------
    errors : PoseErrors, optional
        With the intrinsics that were adjusted with the poses.
    solved : callable
        From what views see of the volume to the solution.
    """
    changes = []
    if errors is not None and len(errors.pose):
        for more, less in errors.moved(visibility.views):
            by_views = [solved(visibility.seen_by(views)) for views in (more, less)]
            changes.append((by_views[0] - by_views[1]) / 2)
    adjusted = any(view.intrinsics is not None for view in visibility.views)
    for high, low, part in stated_lasers(visibility.laser, adjusted):
        by_laser = [solved(visibility.seen_with(laser)) for laser in (high, low)]
        changes.append((by_laser[0] - by_laser[1]) * part)
    return changes


def stated_lasers(laser: TwoMirror, adjusted: bool) -> Iterator[tuple[TwoMirror, TwoMirror, float]]:
    """Give lasers on both sides of a stated one, and what part of their distance one deviation is.

    Parameters
    ----------
    adjusted : bool
        Whether gains, zeros and offset were adjusted with the poses, and are not stated again.
    """
    if laser.mirror_offset_std and not adjusted:
        low = max(0.0, laser.mirror_offset - laser.mirror_offset_std)
        high = laser.mirror_offset + laser.mirror_offset_std
        part = laser.mirror_offset_std / (high - low)
        yield replace(laser, mirror_offset=high), replace(laser, mirror_offset=low), part
    for more, less in laser.up_down.deviations(not adjusted):
        yield replace(laser, up_down=more), replace(laser, up_down=less), 0.5
    for more, less in laser.left_right.deviations(not adjusted):
        yield replace(laser, left_right=more), replace(laser, left_right=less), 0.5
