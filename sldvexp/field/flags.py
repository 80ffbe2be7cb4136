"""Nodes where the views do not determine everything, and what they still do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.equations import Equations
from sldvexp.reconstruction.observability import (
    determined_components,
    determined_intercept,
    undetermined,
)

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Part of a node's samples that must determine something for the node to count as determined.
SMALLEST_PART = 0.02


@dataclass(frozen=True, eq=False)
class Flags:
    """What is determined at each node.

    Attributes
    ----------
    observable : ndarray of bool, shape (node, component)
    determined : ndarray of bool, shape (node, parameter)
        The same, with the intercept if there is one.
    node : ndarray of int, shape (flagged,)
    rank : ndarray of int, shape (flagged,)
        Determined directions of the velocity.
    direction : ndarray, shape (flagged, 3, 3)
        Orthonormal; the first `rank` are determined.
    """

    observable: Bools
    determined: Bools
    node: NDArray[np.int_]
    rank: NDArray[np.int_]
    direction: Array


def flags(equations: Equations) -> Flags:
    """Judge every node by its samples.

    As many parameters are determined as at a part of the node's samples, by the views of each alone.
    The directions that are not are those of the least information of all its samples. Nodes next to
    it and views that turn from sample to sample may say more; that is in the bounds, and no reason
    to trust it.
    """
    parameters = equations.ranked.shape[-1]
    ranked = equations.ranked.reshape(-1, parameters)
    rank = np.sum(ranked >= SMALLEST_PART, axis=1)
    node = np.flatnonzero(rank < parameters)
    null = np.zeros((len(node), parameters, parameters))
    lumped = equations.system.lumped.reshape(len(ranked), *equations.system.lumped.shape[2:])
    coupled = lumped.shape[-1] > 1
    vectors = np.linalg.eigh(lumped[node])[1] if coupled else np.eye(parameters)
    lost = np.arange(parameters) < parameters - rank[node, None]
    null[...] = np.swapaxes(np.broadcast_to(vectors, null.shape), 1, 2) * lost[..., None]
    determined = np.ones(ranked.shape, bool)
    determined[node, :3] = determined_components(null)
    if parameters == 4:
        determined[node, 3] = determined_intercept(null)
    value, direction = np.linalg.eigh(undetermined(null))
    return Flags(
        determined[:, :3],
        determined,
        node,
        np.sum(value < 0.5, axis=1),
        np.ascontiguousarray(np.swapaxes(direction, 1, 2)),
    )


def described(found: Flags, position: Array, components: tuple[str, ...]) -> list[str]:
    """Sentences about flagged nodes."""
    sentences = []
    blind = found.rank == 0
    for some, told in (
        (blind, "no sample around which is seen well enough to determine anything there"),
        (~blind, "where the views determine some directions of the velocity only"),
    ):
        nodes = found.node[some]
        if not len(nodes):
            continue
        place = ", ".join(f"{x:.4g}" for x in position[nodes[0]])
        sentence = f"{_counted(len(nodes), len(position))} {told}: the first is node {nodes[0]} at ({place}) m"
        if not blind[some].any():
            first = np.flatnonzero(some)[0]
            lost = found.direction[first][found.rank[first] :]
            named = " and ".join("(" + ", ".join(f"{x + 0.0:.2f}" for x in d) + ")" for d in lost)
            sentence += f", without the velocity along {named} in {', '.join(components)}"
        sentences.append(sentence)
    return sentences


def _counted(count: int, total: int) -> str:
    return f"{count} of {total} nodes {'has' if count == 1 else 'have'} "
