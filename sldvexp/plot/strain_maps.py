"""Maps of the strain of a surface: components, the largest extension, stress, and hot spots.

A flat surface is seen along two axes of the world, as the field's maps are; one that bends is
rolled out, along its own coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from sldvexp.dataset import VARIABLES, RunData, Source
from sldvexp.lazy import xarray as xr
from sldvexp.plot import style
from sldvexp.plot.layer import AXES
from sldvexp.plot.maps import FAINT, PHASES, map_of, phase_map, scale_of
from sldvexp.plot.selection import at_frequency, one_of, require
from sldvexp.plot.strains import hottest_places, strains_of
from sldvexp.typing import Array, IndexArray

STRAIN = VARIABLES["strain"]
PLACE = STRAIN["position"]
#: Units as figures and pages write them, without prefix.
STRAIN_UNIT, STRESS_UNIT = "strain", STRAIN["von_mises"].units
NO_STRAIN = (
    "the run has no strain (group strain); choose reconstruction=shell or spline, as in "
    "experiment=plate_strain"
)
#: Values of the second figure, their bounds, titles and units.
QUANTITIES = (
    ("principal_strain", "principal_confidence", "largest extension", STRAIN_UNIT),
    ("von_mises", "von_mises_confidence", "von Mises stress", STRESS_UNIT),
)
#: Deviation of unit normals from one another up to which a surface is flat.
FLAT = 1e-6
#: Ticks of directions along the longer side, and their length over their distance.
TICKS, TICK_LENGTH = 16, 0.75
#: Standard error, deg, beyond which a direction is not drawn.
VAGUE = 15.0


@dataclass(frozen=True, eq=False)
class StrainMap:
    """Strain at one frequency, and the plane that it is drawn in.

    Attributes
    ----------
    group : Dataset
        Without a frequency.
    mesh : Triangulation
        In the shown unit.
    axes : ndarray, shape (place, 2, 2)
        t1 and t2 in the plane.
    labels : tuple of (str, str)
        Of the plane's axes.
    """

    group: xr.Dataset
    mesh: Triangulation
    axes: Array
    labels: tuple[str, str]

    @classmethod
    def of(cls, group: xr.Dataset) -> StrainMap:
        """Lay out a group ``strain`` of one frequency."""
        frame = group["frame"].values
        normals = frame[:, 2]
        if np.ptp(normals, axis=0).max() <= FLAT:
            position = group["position"].values
            plane = sorted(np.argsort(np.ptp(position, axis=0))[1:])
            place, axes = position[:, plane], frame[:, :2, plane]
            labels = [PLACE.titled(AXES[i]) for i in plane]
        else:
            place = group["coordinate"].values
            axes = np.broadcast_to(np.eye(2), (len(place), 2, 2))
            labels = [PLACE.titled(f"along {name}") for name in ("t1", "t2")]
        x, y = PLACE.factor * place.T
        triangle = group["triangle"].values
        # A closed surface is cut where its first coordinate comes back: there triangles turn over.
        a, b, c = np.moveaxis(place[triangle], 1, 0)
        area = np.linalg.det(np.stack([b - a, c - a], axis=1))
        mesh = Triangulation(x, y, triangle[area * np.median(area) > 0])
        return cls(group, mesh, axes, (labels[0], labels[1]))

    @property
    def ratio(self) -> float:
        """Height of a panel over its width."""
        return float(min(max(np.ptp(self.mesh.y) / np.ptp(self.mesh.x), 0.2), 1.6))

    @property
    def level(self) -> str:
        """What bounds are called."""
        return f"{self.group.attrs['confidence_level']:.0%} bound"

    def label(self, panels: NDArray[Any]) -> None:
        """Name the axes of maps."""
        style.inner_ticks(panels)
        for one in panels.ravel():
            one.set(xlabel=self.labels[0], ylabel=self.labels[1])
            one.set_aspect("equal")
            one.label_outer()

    def directions(self, axes: Axes) -> None:
        """Draw ticks along the largest extension, where it and its direction are known."""
        group, spacing = self.group, max(np.ptp(self.mesh.x), np.ptp(self.mesh.y)) / TICKS
        size = group["principal_strain"].values[:, 0]
        known = group["principal_direction_std"].values <= VAGUE
        known &= size > group["principal_confidence"].values[:, 0]
        place = np.column_stack([self.mesh.x, self.mesh.y])
        even = _spread(place, spacing)
        chosen = even[known[even]]
        angle = np.radians(group["principal_direction"].values[chosen])
        way = np.cos(angle)[:, None] * self.axes[chosen, 0]
        way += np.sin(angle)[:, None] * self.axes[chosen, 1]
        half = TICK_LENGTH * spacing / 2 * way
        ends = list(np.stack([place[chosen] - half, place[chosen] + half], axis=1))
        for colour, width in (("#ffffff", 2.2), ("#000000", 1.0)):
            ticks = LineCollection(ends, colors=colour, linewidths=width)
            axes.add_collection(ticks, autolim=False)

    def spots(self, axes: Axes) -> None:
        """Draw the hot spots with their numbers in tables."""
        for number, node in enumerate(hottest_places(self.group), start=1):
            where = x, y = self.mesh.x[node], self.mesh.y[node]
            # The number stands towards the middle of the map, so that it is inside.
            beside = -9.0 if x > self.mesh.x.mean() else 5.0
            above = -9.0 if y > self.mesh.y.mean() else 5.0
            axes.plot(*where, "+", color="#000000", markersize=7, clip_on=False)
            look = {"facecolor": "#ffffff", "edgecolor": "#000000", "linewidth": 0.6, "pad": 1.2}
            axes.annotate(
                str(number),
                where,
                (beside, above),
                textcoords="offset points",
                fontsize="small",
                bbox=look,
            )


def unavailable_because(run: RunData) -> str:
    """Explain why no strain can be shown; empty if one can."""
    return "" if strains_of(run) else NO_STRAIN


@style.styled
def strain(
    source: Source | RunData, frequency: float | None = None, name: str | None = None
) -> Figure:
    """Draw size, phase and bound of every component of the strain of the face.

    Components have one scale. Where a strain is smaller than its bound its size is pale, and its
    phase means nothing and is hatched.

    Parameters
    ----------
    frequency : float, Hz, optional
        Without it the one of the largest strain.
    name : str, optional
        Of the field that it is of, ``field`` or one of those it is compared with.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> place = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    >>> found = group("strain", {"strain_component": ["ss", "tt", "st"]}, position=place,
    ...               triangle=[[0, 1, 2]], frame=np.tile(np.eye(3), (3, 1, 1)),
    ...               strain=1e-5 * place, confidence=1e-7 * (1 + place))
    >>> strain({"strain": found.assign_attrs(confidence_level=0.95)}).axes[0].get_title()
    'e_ss: amplitude'
    """
    shown, hertz = _chosen(RunData.from_source(source), "strain", frequency, name)
    title = style.joined("Strain of the face", hertz)
    names = [str(c) for c in shown.group["strain_component"].values]
    titles = [f"e_{c}: {what}" for c in names for what in ("amplitude", PHASES, shown.level)]
    shared: dict[str, Any] = {"sharex": True, "sharey": True, "below": style.SCALE_BELOW}
    room: dict[str, Any] = {"beside": 0.16, "right": 0.15, "between": style.LOW}
    title = f"{title} ({FAINT})"
    made, axes = style.sheet(len(names), 3, shown.ratio, title, titles, **room, **shared)
    values = shown.group["strain"].transpose("strain_component", ...).values
    bounds = shown.group["confidence"].transpose("strain_component", ...).values
    size, unit = scale_of([np.abs(values)], STRAIN_UNIT)
    width, _ = scale_of([bounds], STRAIN_UNIT, factor=size[0])
    for row, value, bound in zip(axes, values, bounds, strict=True):
        sizes = map_of(row[0], shown.mesh, np.abs(value), size, bound=bound)
        phases = phase_map(row[1], shown.mesh, value, bound)
        widths = map_of(row[2], shown.mesh, bound, width)
    for column, mapped, label in ((0, sizes, unit), (2, widths, unit)):
        if mapped is not None:
            style.scale_below(axes[:, column], mapped, label)
    style.in_turns(style.scale_below(axes[:, 1], phases, style.PHASE))
    shown.label(axes)
    return made


@style.styled
def hot_spots(
    source: Source | RunData, frequency: float | None = None, name: str | None = None
) -> Figure:
    """Draw the largest extension with its direction, and von Mises stress with its hot spots.

    Parameters
    ----------
    frequency : float, Hz, optional
        Without it the one of the largest strain.
    name : str, optional
        Of the field that it is of, ``field`` or one of those it is compared with.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> place = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    >>> found = group("strain", {"strain_component": ["ss", "tt", "st"]}, position=place,
    ...               triangle=[[0, 1, 2]], frame=np.tile(np.eye(3), (3, 1, 1)),
    ...               principal_strain=1e-5 * place[:, :2],
    ...               principal_confidence=1e-7 * (1 + place[:, :2]),
    ...               principal_direction=[30.0] * 3, principal_direction_std=[1.0] * 3)
    >>> hot_spots({"strain": found.assign_attrs(confidence_level=0.95)}).axes[0].get_title()
    'largest extension'
    """
    shown, hertz = _chosen(RunData.from_source(source), "hot_spots", frequency, name)
    rows = 1 + ("von_mises" in shown.group)
    title = style.joined("Largest extension and stress of a cycle, face", hertz)
    kinds = QUANTITIES[:rows]
    titles = [t for _, _, what, _ in kinds for t in (what, f"{what}: {shown.level}")]
    shared: dict[str, Any] = {"sharex": True, "sharey": True}
    made, axes = style.sheet(rows, 2, shown.ratio, title, titles, style.SCALE_BESIDE, **shared)
    for row, (name, bound, _, unit) in zip(axes, kinds, strict=True):
        values, width = (_first(shown.group[n]) for n in (name, bound))
        factor = None
        for panel, own, own_bound in zip(row, (values, width), (width, None), strict=True):
            scale, label = scale_of([own], unit, factor=factor)
            factor = scale[0]
            if mapped := map_of(panel, shown.mesh, own, scale, bound=own_bound):
                style.scale_beside(panel, mapped, label)
    shown.directions(axes[0, 0])
    shown.spots(axes[-1, 0])
    shown.label(axes)
    return made


def _chosen(
    run: RunData, figure: str, frequency: float | None, name: str | None
) -> tuple[StrainMap, str]:
    """Take the strain at a frequency, and say which."""
    require(figure, unavailable_because(run))
    known = strains_of(run)
    chosen = one_of(name, known, figure, "strain")
    group, hertz = at_frequency(known[chosen], figure, frequency, "strain")
    return StrainMap.of(group), hertz


def _first(values: xr.DataArray) -> Array:
    """Take values of places, of principal strains the first."""
    return np.asarray(values.isel(principal=0) if "principal" in values.dims else values)


def _spread(place: Array, spacing: float) -> IndexArray:
    """Choose places row by row, each at least so far from those before; of a grid, every nth."""
    chosen: list[int] = []
    for i in np.lexsort([place[:, 0].round(6), place[:, 1].round(6)]).tolist():
        away = np.linalg.norm(place[chosen] - place[i], axis=1) if chosen else np.inf
        if np.all(away > (1 - 1e-6) * spacing):
            chosen.append(i)
    return np.array(chosen, np.int64)
