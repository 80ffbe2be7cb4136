"""The conic of one circle from the edges on its scan lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry.conic import curvature, signed_distance
from sldvexp.geometry.conic_fit import ConicFit, fit_ellipse
from sldvexp.image.scan_lines import Edges


def fit_circle(edges: Edges, method: str = "likelihood") -> tuple[ConicFit, Edges]:
    """Conic through the edges of one circle, freed from the spot's size.

    A spot of width w sees half the motion not on a curved edge but ``curvature w^2 / 2`` inside of
    it. The first fit tells the curvature, the edges are moved out by that much, and fitted again.

    Parameters
    ----------
    edges : Edges
        Of all scan lines across the circle.
    method : str
        Of `sldvexp.geometry.conic_fit.fit_ellipse`.

    Returns
    -------
    fit : ConicFit
    edges : Edges
        The same edges, moved out, in the order of ``fit.residual``.

    Raises
    ------
    UserError
        If the edges make no ellipse; it names the circle and says what was seen on its lines.
    """
    try:
        first = _fit(edges, method)
        _, normal = signed_distance(edges.position, first.ellipse.parameters)
        across = edges.width * np.abs((normal * edges.direction).sum(axis=-1))
        shift = curvature(normal, first.ellipse.parameters) * across**2 / 2.0
        moved = replace(edges, position=edges.position + shift[:, None] * normal)
        return _fit(moved, method), moved
    except UserError as error:
        raise UserError(f"{error} (seen: {edges.summary()})") from None


def _fit(edges: Edges, method: str) -> ConicFit:
    return fit_ellipse(edges.position, edges.std, edges.direction, method=method, name=edges.name)
