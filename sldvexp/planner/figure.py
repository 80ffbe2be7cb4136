"""Figure of a plan: the stands with their beams, and the bound asked for over the surface."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from sldvexp.config.planning import PlanCriterion
from sldvexp.planner.planned import StandPlan
from sldvexp.planner.search import ONE_SIDED
from sldvexp.plot import style
from sldvexp.typing import Array

#: Part of the sheet for the room, and height of the sheet over its width.
ROOM, HEIGHT = 0.5, 0.46
#: Beams that are drawn from each stand.
BEAMS = 6
#: Part of a bound's range below which all nodes are shown alike.
SAME = 0.02


@style.styled
def draw(plan: StandPlan) -> Figure:
    """Draw stands and beams in the room, and beside it the bound of every node.

    Parameters
    ----------
    plan : StandPlan
    """
    which = "largest" if plan.goal.criterion is PlanCriterion.worst else "r.m.s."
    title = f"{len(plan.stands)} stands: {which} bound {1e3 * plan.asked:.3g} mm/s"
    width = style.inches()
    made = style.figure(HEIGHT * width, title)
    made.set_layout_engine("none")
    room: Any = made.add_axes((0.02, 0.08, ROOM, 0.82), projection="3d")
    _stands(room, plan)
    values = 1e3 * plan.by_node
    colours = _coloured(values)
    _in_space(room, plan, colours.to_rgba(values))
    _scale_room(room, plan)
    _close(made, plan, colours, values)
    style.legend(made, room)
    place = (0.9, 0.26, style.SCALE / width, 0.6)
    style.upright_scale(made, place, colours, f"bound ({plan.confidence:.0%}), mm/s")
    return made


def _close(made: Figure, plan: StandPlan, colours: Any, values: Array) -> None:
    """Draw the surface alone: as one faces it, or in space if it has no side of its own."""
    prisms = plan.place.surface
    normal = prisms.frame[:, 2].mean(axis=0)
    box = (ROOM + 0.09, 0.2, 0.79 - ROOM, 0.66)
    if np.linalg.norm(normal) < ONE_SIDED:
        axes: Any = made.add_axes(box, projection="3d")
        _in_space(axes, plan, colours.to_rgba(values))
        corners = prisms.surface
        _limit(axes, corners.min(axis=0), corners.max(axis=0))
        return
    middle = int(np.linalg.norm(prisms.surface - plan.place.middle, axis=1).argmin())
    along = prisms.surface @ prisms.frame[middle, :2].T
    along = 1e3 * (along - (along.max(axis=0) + along.min(axis=0)) / 2)
    flat: Any = made.add_axes(box)
    known = np.isfinite(values)[prisms.triangles].all(axis=1)
    look: Any = {"shading": "gouraud", "cmap": colours.cmap, "norm": colours.norm}
    flat.tripcolor(*along.T, prisms.triangles[known], np.nan_to_num(values), **look)
    flat.set_aspect("equal")
    flat.set_xlabel("along t1, mm")
    flat.set_ylabel("along t2, mm")
    flat.grid(False)


def _coloured(values: Array) -> Any:
    """Make the scale of the bounds."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if high - low < SAME * high:
        low, high = (1 - SAME) * low, (1 + SAME) * high
    norm = matplotlib.colors.Normalize(low, high)
    return matplotlib.cm.ScalarMappable(norm, matplotlib.colormaps["viridis"])


def _in_space(axes: Any, plan: StandPlan, colours: Array) -> None:
    """Draw the triangles, each in the mean colour of its corners."""
    prisms = plan.place.surface
    colour = colours[prisms.triangles].mean(axis=1)
    look: Any = {"facecolors": colour, "edgecolors": colour, "linewidths": 0.2}
    axes.add_collection3d(Poly3DCollection(prisms.surface[prisms.triangles], **look))


def _stands(axes: Any, plan: StandPlan) -> None:
    """Draw every stand with some beams, and the calibration object."""
    outline = plan.place.outline
    ends = outline[np.linspace(0, len(outline) - 1, BEAMS).astype(int)]
    for k, stand in enumerate(plan.stands):
        new = k >= len(plan.stands) - plan.new
        colour = style.COLOURS[3 if new else 0]
        for end in ends:
            way = np.stack([stand.origin, end])
            axes.plot(*way.T, color=colour, linewidth=0.3, alpha=0.5)
        label = "stand" if new else "stand that is given"
        axes.plot(*stand.origin, "D" if new else "s", color=colour, markersize=4, label=label)
        axes.text(*stand.origin, f" {stand.name}", ha="left", va="bottom")
    marks = plan.place.marks.position
    if len(marks):
        look = {"color": style.COLOURS[1], "markersize": 2, "label": "calibration object"}
        axes.plot(*marks.T, ".", **look)


def _scale_room(axes: Any, plan: StandPlan) -> None:
    """Show all stands and the object."""
    origins = np.array([stand.origin for stand in plan.stands])
    points = np.concatenate([origins, plan.place.to_be_seen])
    _limit(axes, points.min(axis=0), points.max(axis=0))


def _limit(axes: Any, low: Array, high: Array) -> None:
    """Give all axes one scale, the world's y up."""
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(a, b + 1e-6)
    length = np.maximum(high - low, 0.05 * (high - low).max())
    axes.set_box_aspect(length, zoom=0.85)
    axes.tick_params(pad=-2)
    for axis, name, own in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", length, strict=True):
        axis.set_major_locator(style.ticks(1 if own < 0.6 * length.max() else 3))
        axis.set_label_text(f"{name}, m")
        axis.labelpad = -4
    axes.view_init(elev=20, azim=-60, vertical_axis="y")
