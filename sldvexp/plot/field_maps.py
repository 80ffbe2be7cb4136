"""Maps of a velocity field on one layer: size, phase and bound of every component."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sldvexp.dataset import RunData, Source
from sldvexp.plot import style
from sldvexp.plot.layer import field_unavailable_because, layer_of
from sldvexp.plot.maps import FAINT, PHASES, map_of, phase_map, scale_of
from sldvexp.plot.selection import require


@style.styled
def field(
    source: Source | RunData,
    frequency: float | None = None,
    depth: float | None = None,
    name: str | None = None,
) -> Figure:
    """Draw size, phase and bound of every component of the velocity on one layer.

    Components have one scale. Where a velocity is smaller than its bound its size is pale, and its
    phase means nothing and is hatched.

    Parameters
    ----------
    frequency : float, Hz, optional
        Without it the one of the largest velocity.
    depth : float, m, optional
        Of the layer; without it the given surface.
    name : str, optional
        ``field``, or one of those it is compared with.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.dataset import group
    >>> corner = np.array([[0, 0], [0.1, 0], [0, 0.1], [0.1, 0.1]])
    >>> place = np.array([[x, y, z] for z in (0.0, 0.01) for x, y in corner])
    >>> prisms = [[0, 1, 2, 4, 5, 6], [1, 3, 2, 5, 7, 6]]
    >>> depth = group("volume", {}, depth=[0.0, 0.01])
    >>> solved = group("field", {}, velocity=place + 0j, position=place, element=prisms,
    ...                confidence=0.1 * place, observable=np.ones((8, 3), int))
    >>> field({"volume": depth, "field": solved}).axes[0].get_title()
    'x: amplitude'
    """
    run = RunData.from_source(source)
    require("field", field_unavailable_because(run))
    layer = layer_of(run, "field", frequency, depth, name)
    names = layer.components
    title = style.joined(f"Velocity {layer.where}", layer.frequency)
    level = layer.bound_name
    titles = [f"{c}: {what}" for c in names for what in ("amplitude", PHASES, level)]
    title = f"{title} ({FAINT})"
    shared = {"sharex": True, "sharey": True, "below": style.SCALE_BELOW, "right": 0.15}
    room = {"beside": 0.16, "between": style.LOW}
    made, axes = style.sheet(len(names), 3, layer.ratio, title, titles, **room, **shared)
    velocity = [layer.values("velocity", c) for c in names]
    bound = [layer.bound(c) for c in names]
    seen = [layer.values("observable", c) != 0 for c in names]
    size, unit = scale_of([np.abs(v[s]) for v, s in zip(velocity, seen, strict=True)], style.SPEED)
    widths = [b[s] for b, s in zip(bound, seen, strict=True)]
    width, _ = scale_of(widths, style.SPEED, factor=size[0])
    mesh = layer.mesh()
    scales: dict[tuple[int, str], Any] = {}
    for row, v, b, s in zip(axes, velocity, bound, seen, strict=True):
        scales[0, unit] = map_of(row[0], mesh, np.abs(v), size, s, b) or scales.get((0, unit))
        scales[1, style.PHASE] = phase_map(row[1], mesh, v, b)
        scales[2, unit] = map_of(row[2], mesh, b, width, s) or scales.get((2, unit))
    for (column, label), mapped in scales.items():
        if mapped is not None:
            scale = style.scale_below(axes[:, column], mapped, label)
            if column == 1:
                style.in_turns(scale)
    style.inner_ticks(axes)
    for one in axes.ravel():
        layer.label(one)
        one.label_outer()
    return made
