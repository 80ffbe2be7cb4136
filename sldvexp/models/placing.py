"""Is the model where the structure is: its units and axes, before anything is compared.

Shapes of a model in other units or axes would be compared with pixels beside them. One rule holds
before a measurement and after it: most of what is known of the structure must lie on the model. It
is known by the pixels that move; those at rest may look past the model. Before there are pixels,
the surface of the volume stands for it. That may reach beyond the structure as well: then most of
the model must lie on it, and the model be too large beside it for a wrong unit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.mapping import PredictedPixels
from sldvexp.typing import Array, BoolArray
from sldvexp.units import LengthUnit

#: Part of the smaller extent that nodes of volume and model may lie beside one another.
BESIDE = 0.1
#: Part of the structure that must lie on the model, and the least extent of a model over that of
#: a volume around it: centimetres for inches would be 0.394.
MOST, LEAST = 0.5, 0.45
#: A pixel moves if some modal velocity is so many times its noise, a chance of 2e-8, above this
#: part of what the fastest of the view have, of which pixels at rest may have a little.
MOVES, AT_REST, FASTEST = 6.0, 0.05, 0.95
#: How near the ratio of extents must be to that of two units to name them.
ALIKE = 0.3


def lies_beside(share: float, inside: float = 0.0, size: float = 0.0) -> bool:
    """Tell whether a model lies beside the structure.

    Parameters
    ----------
    share : float
        Of what is known of the structure, on the model.
    inside, size : float
        Share of the model on that, and its extent over that of it, where that may reach beyond the
        structure.

    Examples
    --------
    >>> [lies_beside(0.6), lies_beside(0.3), lies_beside(0.3, 0.9, 0.6), lies_beside(0.1, 1.0, 0.1)]
    [False, True, False, True]
    """
    return share < MOST and not (inside >= MOST and size >= LEAST)


def check_place(model: FiniteElementModel, tree: Mapping[str, xr.Dataset]) -> None:
    """Complain about a model that lies elsewhere than the surface of the volume.

    Raises
    ------
    UserError
        It names the boxes of both, and the unit that would explain it.
    """
    if "volume" not in tree:
        return
    volume = tree["volume"]
    layer = int(np.argmin(np.abs(volume["depth"].values)))
    surface = volume["position"].values[volume["node_layer"].values == layer]
    extent, own = (float(np.linalg.norm(np.ptp(p, axis=0))) for p in (surface, model.position))
    near, filled = BESIDE * min(extent, own), _filled(model)
    away, _ = scipy.spatial.KDTree(filled).query(surface)
    nodes = scipy.spatial.KDTree(surface)
    apart = float(np.median(nodes.query(surface, k=2)[0][:, 1]))  # of a coarse volume
    back, _ = nodes.query(filled)
    share, inside = float(np.mean(away <= near)), float(np.mean(back <= max(near, apart)))
    if not lies_beside(share, inside, own / extent):
        return
    where = (
        f"lies on the surface of the volume, but is {own / extent:.2g} times as large"
        if inside >= MOST
        else "lies beside the surface that is seen, most of it by more than "
        f"{1e3 * np.median(away):.3g} mm"
    )
    raise UserError(
        f"{model.source}: {where}: the model spans {_box(model.position)}, the surface of "
        f"the volume {_box(surface)}; {_remedy(model.position, surface)}"
    )


def check_seen(views: Sequence[PredictedPixels], source: str) -> None:
    """Complain if most moving pixels of a view look past the model, or all pixels do.

    Raises
    ------
    UserError
    """
    for view in views:
        seen, past = moving(view)
        whole = len(seen) + len(past)
        move = int(seen.sum() + past.sum())
        if whole and not len(seen):
            few = f"none of {whole} pixels of view {view.pixels.name} looks at the model"
        elif move and lies_beside(seen.sum() / move):
            few = (
                f"only {seen.sum()} of {move} pixels of view {view.pixels.name} that move look at "
                "the model"
            )
        else:
            continue
        raise UserError(
            f"{source}: {few}; are its unit and axes right (model.unit, model.frame), and is it "
            "the part that was scanned?"
        )


def moving(view: PredictedPixels) -> tuple[BoolArray, BoolArray]:
    """Tell which pixels move, of those that see the model and of those that look past it.

    Returns
    -------
    seen, past : ndarray of bool
    """
    both = (view.pixels, view.beside)
    size = np.abs(np.concatenate([part.velocity for part in both]))
    noise = np.concatenate([part.std for part in both])
    if not len(size):
        return np.zeros(0, bool), np.zeros(0, bool)
    least = MOVES * noise + AT_REST * np.quantile(size, FASTEST, axis=0)
    moves = (size > least).any(axis=1)
    return moves[: len(view.pixels.pixel)], moves[len(view.pixels.pixel) :]


def _filled(model: FiniteElementModel) -> Array:
    """List nodes and the middles of the elements."""
    return np.concatenate([model.position, model.position[model.halves].mean(axis=1)])


def _box(position: Array) -> str:
    """Describe where nodes lie, in m."""
    ends = zip("xyz", position.min(axis=0), position.max(axis=0), strict=True)
    return ", ".join(f"{axis} from {low:.4g} to {high:.4g} m" for axis, low, high in ends)


def _remedy(model: Array, surface: Array) -> str:
    """Guess the setting that is wrong."""
    size, wanted = (np.sort(np.ptp(one, axis=0))[::-1] for one in (model, surface))
    ratio = float(np.linalg.norm(size) / np.linalg.norm(wanted))
    for unit in LengthUnit:
        if unit is not LengthUnit.m and abs(np.log(ratio * unit.value)) < ALIKE:
            return f"{1 / unit.value:.4g} times as large, as if it were in {unit.name}: model.unit"
    if abs(np.log(ratio)) < ALIKE:
        return "of like size, but elsewhere or turned: say where its axes stand with model.frame"
    return (
        "say its unit with model.unit, and where its axes stand with model.frame, or let the "
        "volume be no larger than the structure"
    )
