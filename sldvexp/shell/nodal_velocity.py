"""Velocities at the nodes of a volume around a shell: Love's kinematics at every node's height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.shell.functionals import Forms
from sldvexp.shell.linear_form import LinearForm, summed
from sldvexp.shell.surface_fit import SurfaceFit
from sldvexp.typing import Array, ComplexArray, IndexArray
from sldvexp.volume import Prisms

#: Difference of coordinates, over their extent, that is none.
SAME = 1e-9
#: Places whose velocities are made at once.
PLACES = 4096


@dataclass(frozen=True, eq=False)
class NodalVelocity:
    """Velocities of one fit at all nodes.

    Attributes
    ----------
    fit : SurfaceFit
    prisms : Prisms
    local : bool
        Whether components are those along the nodes' own axes.
    hangs_from_face : bool
        Whether nodes are laid around the face, so that the thickness decides their height.
    """

    fit: SurfaceFit
    prisms: Prisms
    local: bool
    hangs_from_face: bool

    def by_source(self) -> tuple[ComplexArray, dict[str, Array]]:
        """Compute the velocity and its variances at all nodes, as `SurfaceFit.by_source` does.

        The velocity is linear in the height and its variances are quadratic: where the layers have
        the same coordinates, three of them give all.

        Returns
        -------
        values : ndarray of complex, shape (node, component, frequency)
        variance : dict of str to ndarray, shape (part, node, component, frequency)
        """
        layers, count = self.prisms.layers, self.prisms.surface_nodes
        place, height = self.fit.outline.chart.place(self.prisms.position)
        by_layer, z = place.reshape(layers, count, 2), height.reshape(layers, count)
        alike = np.abs(by_layer - by_layer[0]).max() < SAME * np.ptp(place)
        some = [0, layers // 2, layers - 1] if layers > 3 else list(range(layers))
        if alike:
            nodes, heights = np.arange(count), z[some]
        else:
            nodes, heights = np.arange(self.prisms.nodes), height[None]
        blocks = np.array_split(nodes, -(-len(nodes) // PLACES))
        each = [self._of_places(place[own], heights[:, own], own) for own in blocks]

        def at_all(found: Sequence[NDArray[Any]]) -> NDArray[Any]:
            whole = np.moveaxis(np.concatenate(found, axis=-2), -3, -2)
            if alike and len(some) < layers:
                whole = np.einsum("lsn,...sncf->...lncf", _interpolating(z, heights), whole)
            return whole.reshape(*whole.shape[:-4], -1, *whole.shape[-2:])

        values, variances = zip(*each, strict=True)
        return at_all(values), {name: at_all([v[name] for v in variances]) for name in variances[0]}

    def _of_places(
        self, place: Array, heights: Array, nodes: IndexArray
    ) -> tuple[ComplexArray, dict[str, Array]]:
        """Compute the velocity and its variances at places, each at several heights.

        Parameters
        ----------
        heights : ndarray, shape (height, place), m
        nodes : ndarray of int, shape (place,)
            Whose local axes they have.

        Returns
        -------
        values : ndarray of complex, shape (height, component, place, frequency)
        variance : dict of str to ndarray, shape (part, height, component, place, frequency)
        """
        shell = self.fit.shell
        forms = [form for z in heights for form in self._velocity_forms(place, z, nodes)]
        thicker = None
        if self.hangs_from_face:
            by_height = self._velocity_forms(place, None, nodes)
            thicker = Forms(shell, place, [form * 0.5 for form in by_height] * len(heights))
        values, variance = self.fit.by_source(Forms(shell, place, forms), thicker)
        shape = (len(heights), 3, len(place), values.shape[-1])
        return values.reshape(shape), {k: v.reshape(2, *shape) for k, v in variance.items()}

    def _velocity_forms(
        self, place: Array, height: Array | None, nodes: IndexArray
    ) -> list[LinearForm]:
        """Make the forms of every component at nodes.

        Without a height they are the derivatives by the height.
        """
        shell = self.fit.shell
        own = shell.motion_by_height(place) if height is None else shell.motion(place, height)
        frames = self.fit.outline.chart.frames(place)
        if self.local:
            axes = self.prisms.frame[nodes % self.prisms.surface_nodes]
            turn = np.einsum("nai,nbi->nab", axes, frames)
        else:
            turn = np.swapaxes(frames, 1, 2)
        return [summed([own[i] * turn[:, a, i] for i in range(3)]) for a in range(3)]


def _interpolating(z: Array, known: Array) -> Array:
    """Make the weights of three heights that give quadratic functions at others.

    Parameters
    ----------
    z : ndarray, shape (layer, node)
    known : ndarray, shape (3, node)

    Returns
    -------
    ndarray, shape (layer, 3, node)
    """
    weights = np.ones((len(z), 3, z.shape[1]))
    for i in range(3):
        for j in {0, 1, 2} - {i}:
            weights[:, i] *= (z - known[j]) / (known[i] - known[j])
    return weights
