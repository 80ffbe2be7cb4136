"""Systems that are singular because no view sees some direction at some nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.equations.assembly import Equations
from sldvexp.field.equations.system import HOLD, Solve, System
from sldvexp.field.equations.undetermined import Flags
from sldvexp.field.solvers.base import Solver
from sldvexp.field.visibility.coverage import flagged


def prepared(solver: Solver, equations: Equations, found: Flags) -> tuple[Equations, Solve]:
    """The equations as they can be solved, and the solver's factors.

    Directions that are not determined at their nodes are flagged; if they make the whole singular
    they are held at zero, so firmly that the rest can be given.

    Raises
    ------
    UserError
        If samples are missing; it says why.
    """
    try:
        return equations, solver.prepare(equations.system)
    except UserError as error:
        if len(found.node) and equations.system.block > 1:
            firm = replace(equations, system=held(equations.system, found))
            try:
                return firm, solver.prepare(firm.system)
            except UserError:
                pass  # The first sentence says more.
        if not (lost := flagged(equations.coverage)):
            raise
        told = str(error).removeprefix("field: ")
        raise UserError(f"field: {lost}; without those {told}") from None


def held(system: System, found: Flags) -> System:
    """The system with the flagged directions held, as firmly as nodes that have no samples.

    Parameters
    ----------
    system : System
        That couples the components.
    found : Flags
    """
    count, last = system.graph.nodes, system.layers - 1
    size = np.trace(system.lumped[system.active], axis1=-2, axis2=-1).mean() / system.block
    pairs = system.pairs.copy()
    for node, rank, direction in zip(found.node, found.rank, found.direction, strict=True):
        lost = np.zeros((system.block, system.block))
        lost[:3, :3] = direction[rank:].T @ direction[rank:]
        if system.block > 3 and not found.determined[node, 3]:
            lost[3, 3] = 1.0
        layer, place = divmod(int(node), count)
        gap, k = (layer, 0) if layer < last else (last - 1, 2)
        pairs[gap, k, system.graph.diagonal[place]] += HOLD * size * lost
    return replace(system, pairs=pairs, exact=False)
