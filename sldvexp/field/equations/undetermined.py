"""Nodes where the views do not determine everything, and what they still do.

A node is judged by its own samples, as many directions being determined as at some of them.
Directions that no view sees may make the whole system singular; they are flagged, and then held at
zero by a term on the diagonal, so that all else can be solved. Where few samples are left, all of
them together may still leave more open than each node's own do: of a small system this is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.field.equations.assembly import SMALLEST_PART, Equations
from sldvexp.field.equations.system import HOLD, NormalEquations, Solve, hold
from sldvexp.field.solvers.base import Solver
from sldvexp.field.visibility.coverage import flagged
from sldvexp.reconstruction.observability import (
    LEAN,
    determined_components,
    determined_intercept,
    undetermined,
)
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, eq=False)
class Observability:
    """Directions and components that are determined at each node.

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

    observable: BoolArray
    determined: BoolArray
    node: NDArray[np.int_]
    rank: NDArray[np.int_]
    direction: Array

    def without(self, lost: BoolArray) -> Observability:
        """Flag further nodes, at which nothing is determined.

        Parameters
        ----------
        lost : ndarray of bool, shape (node,)
        """
        before = np.isin(self.node, np.flatnonzero(lost), invert=True)
        added = np.flatnonzero(lost)
        node = np.concatenate([self.node[before], added])
        order = np.argsort(node)
        every = np.broadcast_to(np.eye(3), (len(added), 3, 3))
        return Observability(
            self.observable & ~lost[:, None],
            self.determined & ~lost[:, None],
            node[order],
            np.concatenate([self.rank[before], np.zeros(len(added), int)])[order],
            np.concatenate([self.direction[before], every])[order],
        )


def find_undetermined(equations: Equations, hole: BoolArray | None = None) -> Observability:
    """Judge every node by its samples; in a hole nothing is determined.

    As many parameters are determined as at a part of the node's samples, by each one's views alone.
    The directions that are not are those of the least information of all its samples. Nodes next to
    it and views that turn from sample to sample may say more; that is in the bounds, and no reason
    to trust it.

    Parameters
    ----------
    hole : ndarray of bool, shape (node,), optional
        See `sldvexp.field.visibility.holes.nodes_in_holes`.
    """
    parameters = equations.ranked.shape[-1]
    ranked = equations.ranked.reshape(-1, parameters)
    rank = np.sum(ranked >= SMALLEST_PART, axis=1)
    if hole is not None:
        rank[hole] = 0
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
    return Observability(
        determined[:, :3],
        determined,
        node,
        np.sum(value < 0.5, axis=1),
        np.ascontiguousarray(np.swapaxes(direction, 1, 2)),
    )


def describe_undetermined(
    found: Observability, position: Array, components: tuple[str, ...]
) -> list[str]:
    """Describe flagged nodes in sentences."""
    blind = found.rank == 0
    sentences = []
    if blind.any():
        some = found.node[blind]
        where = _at(some, position)
        sentences.append(
            f"{_counted(some, position)} not seen well enough to determine anything{where}"
        )
    if (~blind).any():
        some, first = found.node[~blind], np.flatnonzero(~blind)[0]
        lost = found.direction[first][found.rank[first] :]
        named = " and ".join("(" + ", ".join(f"{x + 0.0:.2f}" for x in d) + ")" for d in lost)
        sentences.append(
            f"{_counted(some, position)} seen in some directions only{_at(some, position)}, where "
            f"the velocity along {named} in {', '.join(components)} is not determined"
        )
    return sentences


def _counted(nodes: NDArray[np.int_], position: Array) -> str:
    return f"{len(nodes)} of {len(position)} nodes {'is' if len(nodes) == 1 else 'are'}"


def _at(nodes: NDArray[np.int_], position: Array) -> str:
    place = ", ".join(f"{x:.4g}" for x in position[nodes[0]])
    which = "" if len(nodes) == 1 else "the first is "
    return f": {which}node {nodes[0]} (from 0) at ({place}) m"


def factorise(
    solver: Solver, equations: Equations, found: Observability
) -> tuple[Equations, Solve]:
    """Factorise the equations, made solvable if they are not, and return both.

    Directions that are not determined at their nodes are in `found`; if they make the whole
    singular they are held at zero, so firmly that the rest can be given.

    Raises
    ------
    UserError
        If it stays singular: where samples are missing it says why, else in the solver's words.
    """
    try:
        return equations, solver.prepare(equations.system)
    except UserError as error:
        if len(found.node) and equations.system.block > 1:
            firm = replace(equations, system=constrain_undetermined(equations.system, found))
            try:
                return firm, solver.prepare(firm.system)
            except UserError:
                pass  # The first sentence says more.
        if not (lost := flagged(equations.coverage)):
            raise
        told = str(error).removeprefix("field: ")
        raise UserError(f"field: {lost}; without those {told}") from None


def constrain_undetermined(system: NormalEquations, found: Observability) -> NormalEquations:
    """Hold the flagged directions as firmly as nodes that have no samples.

    A system that does not couple the components is held at nodes that have lost all of them.
    """
    count = system.graph.nodes
    size = np.trace(system.lumped[system.active], axis1=-2, axis2=-1).mean() / system.block
    pairs = system.pairs.copy()
    for node, rank, direction in zip(found.node, found.rank, found.direction, strict=True):
        lost = np.zeros((system.block, system.block))
        if system.block == 1:
            lost[0, 0] = rank == 0
        else:
            lost[:3, :3] = direction[rank:].T @ direction[rank:]
        if system.block > 3 and not found.determined[node, 3]:
            lost[3, 3] = 1.0
        layer, place = divmod(int(node), count)
        hold(pairs, system.layers, (layer, system.graph.diagonal[place]), HOLD * size * lost)
    return replace(system, pairs=pairs, exact=False)


def constrain_singular(
    equations: Equations, found: Observability
) -> tuple[Equations, Observability]:
    """Make a small system regular, and flag nodes that all samples together leave open.

    Those are the nodes that the null space of the matrix leans towards, when the flagged directions
    are held: a velocity of theirs can be exchanged for one of others, and no sample notices. Of
    large systems the null space is not known.
    """
    system = equations.system
    if not system.is_small or not system.is_singular:
        return equations, found
    system = constrain_undetermined(equations.system, found)
    while system.is_singular:
        value, vector = np.linalg.eigh(system.dense)
        open_ = value <= len(value) * np.finfo(float).eps * value[-1]
        open_[0] = True  # round-off alone kept it from a factor
        share = np.square(vector[:, open_]).sum(axis=1).reshape(system.nodes, -1).sum(axis=1)
        # One node at least, so that this ends: held directions have no part in what is left open.
        found = found.without(np.sqrt(share) >= min(LEAN, np.sqrt(share.max())))
        system = constrain_undetermined(equations.system, found)
    return replace(equations, system=system), found
