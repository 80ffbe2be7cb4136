"""Maps of a velocity field on one layer: size, phase and bound of every component."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from sldvexp.dataset import RunData, Source
from sldvexp.plot import style
from sldvexp.plot.layer import field_unavailable_because, layer_of
from sldvexp.plot.maps import PHASES, map_of, phase_map
from sldvexp.plot.selection import require


@style.styled
def field(
    source: Source | RunData,
    frequency: float | None = None,
    depth: float | None = None,
    name: str | None = None,
) -> Figure:
    """Draw size, phase and bound of every component of the velocity on one layer.

    Where a velocity is smaller than its bound its phase means nothing and is hatched.

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
    'x: size'
    """
    run = RunData.from_source(source)
    require("field", field_unavailable_because(run))
    layer = layer_of(run, "field", frequency, depth, name)
    rows = len(layer.components)
    wide, high = (np.ptp(layer.position[:, i]) for i in layer.plane)
    ratio = min(max(high / wide, 0.35), 1.4)
    title = style.joined(f"Velocity {layer.where}", layer.frequency)
    shared = {"sharex": True, "sharey": True}
    made, axes = style.sheet(rows, 3, 10.5, ratio, title, style.SCALE_BESIDE, **shared)
    for row, component in zip(axes, layer.components, strict=True):
        velocity, mesh = layer.values("velocity", component), layer.mesh()
        bound, seen = layer.bound(component), layer.values("observable", component) != 0
        map_of(row[0], mesh, np.abs(velocity), style.SPEED, 0.0, seen)
        phases = phase_map(row[1], mesh, velocity, bound)
        map_of(row[2], mesh, bound, style.SPEED, known=seen)
        row[0].set_title(f"{component}: size")
        row[1].set_title(f"{component}: {PHASES}")
        row[2].set_title(f"{component}: {layer.bound_name}")
    style.in_turns(style.scale_beside(axes[:, 1], phases, style.PHASE))
    for one in axes.ravel():
        layer.label(one)
        one.label_outer()
    return made
