"""Figure of a plan: the stands with their beams, and the bound asked for over the surface.

Stands are shown twice at one scale, from above and from the front, so that distances can be read
off: the reader stands where the instrument does. Sizes of the panels follow from what they show,
``w_room + w_map`` is the sheet's width and both columns are equally high, so that they fill it.
"""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.tri import Triangulation
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from sldvexp.config.planning import PlanCriterion
from sldvexp.planner.planned import StandPlan
from sldvexp.planner.search import ONE_SIDED
from sldvexp.plot import style
from sldvexp.typing import Array

#: Beams that are drawn from each stand.
BEAMS = 6
#: Part of a bound's range below which all nodes are shown alike, and colours of a map.
SAME, LEVELS = 0.02, 48
#: Part of the room's extent that is free around the stands, and least parts of it that are shown
#: along x, y and z.
AROUND, LEAST = 0.09, (0.8, 0.25, 0.25)
#: Inches below a panel that has no numbers there, with the title of the next; between two columns;
#: for the surface's scale; and least width of a column.
BELOW, APART, SCALE, NARROWEST = 0.42, 0.2, 0.8, 1.9
#: Largest height of a column over the sheet's width.
TALLEST = 0.72
#: Views of the room: which axes of the world go across and up, and whether the latter points down.
SIDES = {"from above": (0, 2, True), "from the front": (0, 1, False)}


@style.styled
def draw(plan: StandPlan) -> Figure:
    """Draw stands and beams in the room, and beside it the bound of every node.

    Parameters
    ----------
    plan : StandPlan
    """
    which = "largest" if plan.goal.criterion is PlanCriterion.worst else "r.m.s."
    title = f"{len(plan.stands)} stands: {which} bound {1e3 * plan.asked:.3g} mm/s"
    low, high = _room(plan)
    surface = _flat(plan)
    made, rooms, close = _sheet(title, high - low, _ratio(surface), space=surface is None)
    for axes, (name, side) in zip(rooms, SIDES.items(), strict=True):
        axes.set_title(name)
        _stands(axes, plan, *side[:2])
        _limit(axes, low, high, *side)
    rooms[0].tick_params(labelbottom=False)
    rooms[0].set_xlabel("")
    values = 1e3 * plan.by_node
    colours = _coloured(values)
    if surface is None:
        _in_space(close, plan, colours.to_rgba(values))
    else:
        _unrolled(close, plan, surface, colours, values)
    close.set_title("bound over the surface")
    style.scale_beside(close, colours, f"bound ({plan.confidence:.0%}), mm/s")
    style.legend(made, *rooms)
    return made


def _room(plan: StandPlan) -> tuple[Array, Array]:
    """Find the corners of what the room's panels show: all stands and the object, m."""
    origins = np.array([stand.origin for stand in plan.stands])
    points = np.concatenate([origins, plan.place.to_be_seen])
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low
    short = np.maximum(np.array(LEAST) * extent.max() - extent, 0.0) / 2
    beside = AROUND * extent.max() + short
    return low - beside, high + beside


def _flat(plan: StandPlan) -> Array | None:
    """Lay the surface flat, as one faces it, mm; none if it has no side of its own."""
    prisms = plan.place.surface
    if np.linalg.norm(prisms.frame[:, 2].mean(axis=0)) < ONE_SIDED:
        return None
    middle = int(np.linalg.norm(prisms.surface - plan.place.middle, axis=1).argmin())
    along = prisms.surface @ prisms.frame[middle, :2].T
    return np.asarray(1e3 * (along - (along.max(axis=0) + along.min(axis=0)) / 2))


def _ratio(surface: Array | None) -> float:
    """Give the height of the surface's panel over its width."""
    if surface is None:
        return 1.0
    wide, high = np.ptp(surface, axis=0)
    return float(high / wide)


def _sheet(title: str, extent: Array, ratio: float, space: bool) -> tuple[Figure, list[Any], Any]:
    """Make the panels: the room's above each other, and the surface's beside or below them.

    Parameters
    ----------
    extent : ndarray, shape (3,), m
        Of the room along x, y and z.
    ratio : float
        Height of the surface's panel over its width.
    space : bool
        Whether that shows the surface in space.
    """
    width, per_metre = style.inches(), extent[[2, 1]] / extent[0]
    wide, close = _widths(width, float(per_metre.sum()), ratio)
    highs, high = per_metre * wide, min(ratio * close, TALLEST * width)
    column = highs.sum() + BELOW
    if style.narrow():
        left, down = style.LEFT, column + BELOW + style.BOTTOM
        foot = down + high
    else:
        left, foot = 2 * style.LEFT + wide + APART, max(column, high)
        high = foot if space else high
        down = (foot - high) / 2
    made = style.figure(style.TOP + foot + style.BOTTOM)
    height = made.get_figheight()
    made.set_layout_engine("none")
    made.suptitle(title, y=1 - style.EDGE / height, va="top")
    top = height - style.TOP

    def panel(left: float, down: float, wide: float, high: float, **more: Any) -> Any:
        box = (left / width, (top - down - high) / height, wide / width, high / height)
        return made.add_axes(box, **more)

    first, second = highs
    rooms = [
        panel(style.LEFT, 0.0, wide, first),
        panel(style.LEFT, first + BELOW, wide, second),
    ]
    more = {"projection": "3d"} if space else {}
    return made, rooms, panel(left, down, close, high, **more)


def _widths(width: float, rooms: float, surface: float) -> tuple[float, float]:
    """Give the widths of the room's panels and of the surface's, inch.

    Parameters
    ----------
    width : float, inch
        Of the sheet.
    rooms, surface : float
        Heights over widths: of the room's two panels together, and of the surface's.
    """
    if style.narrow():
        return width - style.LEFT - APART, width - style.LEFT - SCALE
    free = width - 2 * style.LEFT - APART - SCALE
    # Equally high: BELOW + rooms wide = surface (free - wide).
    wide = float(np.clip((surface * free - BELOW) / (rooms + surface), NARROWEST, free - NARROWEST))
    wide = min(wide, TALLEST * width / rooms)
    return wide, free - wide


def _stands(axes: Any, plan: StandPlan, across: int, up: int) -> None:
    """Draw every stand with some beams, the calibration object, and what is in the way."""
    outline = plan.place.outline
    ends = outline[np.linspace(0, len(outline) - 1, BEAMS).astype(int)]
    for box in plan.place.room.forbidden.values():
        (a, c), (b, d) = ((corner[across], corner[up]) for corner in (box.low, box.high))
        look: Any = {"facecolor": "none", "edgecolor": style.COLOURS[-1], "hatch": "///"}
        axes.add_patch(Rectangle((a, c), b - a, d - c, label="forbidden", **look))
    for k, stand in enumerate(plan.stands):
        new = k >= len(plan.stands) - plan.new
        colour = style.COLOURS[3 if new else 0]
        for end in ends:
            way = np.stack([stand.origin, end])[:, [across, up]]
            axes.plot(*way.T, color=colour, linewidth=0.3, alpha=0.5)
        at = stand.origin[[across, up]]
        label = "stand" if new else "stand that is given"
        axes.plot(*at, "D" if new else "s", color=colour, markersize=4, label=label)
        axes.annotate(stand.name, at, (4, 3), textcoords="offset points")
    corners = plan.place.surface.surface[plan.place.surface.triangles][..., [across, up]]
    axes.plot(*_around(corners.reshape(-1, 2)).T, color=style.COLOURS[5], label="surface")
    marks = plan.place.marks.position
    if len(marks):
        look = {"color": style.COLOURS[1], "markersize": 2, "label": "calibration object"}
        axes.plot(*marks[:, [across, up]].T, ".", **look)


def _around(points: Array) -> Array:
    """Give the corners of the box around points, closed."""
    (a, c), (b, d) = points.min(axis=0), points.max(axis=0)
    return np.array([[a, c], [b, c], [b, d], [a, d], [a, c]])


def _limit(axes: Any, low: Array, high: Array, across: int, up: int, down: bool) -> None:
    """Show the whole room at one scale; what is nearer to the reader stands lower from above."""
    axes.set_xlim(low[across], high[across])
    axes.set_ylim(*((high[up], low[up]) if down else (low[up], high[up])))
    axes.set_xlabel(f"{'xyz'[across]}, m")
    axes.set_ylabel(f"{'xyz'[up]}, m")


def _unrolled(axes: Any, plan: StandPlan, along: Array, colours: Any, values: Array) -> None:
    """Draw the bound over the surface as one faces it."""
    known = np.isfinite(values)[plan.place.surface.triangles].all(axis=1)
    t1, t2 = along.T
    mesh = Triangulation(t1, t2, plan.place.surface.triangles, mask=~known)
    levels = np.linspace(colours.norm.vmin, colours.norm.vmax, LEVELS)
    axes.tricontourf(
        mesh, np.nan_to_num(values), levels, cmap=colours.cmap, norm=colours.norm, extend="both"
    )
    axes.set_xlabel("along t1, mm")
    axes.set_ylabel("along t2, mm")
    style.hatched(axes)
    style.ends_of(axes, t1, t2)


def _coloured(values: Array) -> Any:
    """Make the scale of the bounds."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if high - low < SAME * high:
        low, high = (1 - SAME) * low, (1 + SAME) * high
    norm = matplotlib.colors.Normalize(low, high)
    return matplotlib.cm.ScalarMappable(norm, matplotlib.colormaps[style.SIZE_MAP])


def _in_space(axes: Any, plan: StandPlan, colours: Array) -> None:
    """Draw the surface in space, the world's y up, each triangle in its corners' mean colour."""
    prisms = plan.place.surface
    colour = colours[prisms.triangles].mean(axis=1)
    look: Any = {"facecolors": colour, "edgecolors": colour, "linewidths": 0.2}
    axes.add_collection3d(Poly3DCollection(prisms.surface[prisms.triangles], **look))
    low, high = prisms.surface.min(axis=0), prisms.surface.max(axis=0)
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
