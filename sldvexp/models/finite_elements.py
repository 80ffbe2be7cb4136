"""Finite element model of a structure, as far as its surface moves: nodes, elements, shapes.

Shapes are real and have any scale: what is measured is compared with each after one free complex
factor. A shell's elements stand at its middle, the surface that the beam sees half its thickness
beside it. There the motion is ``s = u + z tau``, with the height z of that surface above the
elements along their normal n and the change of the normal ``tau = theta x n``; a model without
rotations theta keeps its normals normal (Kirchhoff): ``tau = -(grad u) . n`` along the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sldvexp.errors import UserError
from sldvexp.models.slopes import NodalSlopes
from sldvexp.typing import Array, IntArray
from sldvexp.volume import TriangulatedSurface, vertex_normals

#: Two shapes whose MAC is above this at frequencies nearer than `SAME_FREQUENCY` are one.
SAME_SHAPE, SAME_FREQUENCY = 0.999, 1e-6


@dataclass(frozen=True, eq=False)
class FiniteElementModel:
    """Surface of a finite element model, and its mode shapes.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
        In the world.
    triangles, quadrilaterals : ndarray of int, shape (element, 3) and (element, 4)
        Nodes from 0, around each element.
    frequency : ndarray, shape (mode,), Hz
        Ascending.
    translation : ndarray, shape (node, 3, mode)
        Along the world's axes.
    rotation : ndarray, shape (node, 3, mode), 1/m, optional
        About the world's axes, in rad per unit of the translation in m.
    thickness : float, m
        Of a shell; the surface seen is half of it beside the elements. 0 if these are the surface.
    source : str
        The file that it comes from, for messages.

    Raises
    ------
    UserError
        If the arrays do not fit one another, or a mode has no frequency or is given twice.
    """

    position: Array
    triangles: IntArray
    quadrilaterals: IntArray
    frequency: Array
    translation: Array
    rotation: Array | None = None
    thickness: float = 0.0
    source: str = "model"

    def __post_init__(self) -> None:
        self._check_sizes()
        self._check_modes()

    def wrong(self, message: str) -> UserError:
        """Make the error of a model that cannot be used."""
        return UserError(f"{self.source}: {message}")

    @property
    def modes(self) -> int:
        """Number of its modes."""
        return len(self.frequency)

    @cached_property
    def halves(self) -> IntArray:
        """All elements as triangles: the triangles, then both halves of each quadrilateral."""
        a, b, c, d = self.quadrilaterals.T
        cut = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
        return np.concatenate([self.triangles, cut])

    @cached_property
    def normal(self) -> Array:
        """Unit normals at the nodes, shape (node, 3)."""
        return vertex_normals(TriangulatedSurface(self.position, self.halves, source=self.source))

    @cached_property
    def change_of_normal(self) -> Array:
        """Change tau of the normal at the nodes, shape (node, 3, mode), 1/m."""
        if self.rotation is not None:
            return np.cross(np.moveaxis(self.rotation, 1, 2), self.normal[:, None]).swapaxes(1, 2)
        return -np.einsum("ndcm,nc->ndm", self._recovered, self.normal)

    @cached_property
    def gradients(self) -> tuple[Array, Array]:
        """Gradients of the translation and of tau, each (node, 3, component, mode), 1/m, 1/m^2.

        That of the translation across the surface is what the rotations say: ``n . du = -tau``.
        """
        across = np.einsum("ndcm,nc->ndm", self._recovered, self.normal)
        off = -self.change_of_normal - across
        of_middle = self._recovered + np.einsum("ndm,nc->ndcm", off, self.normal)
        return of_middle, self._slopes.gradients(self.change_of_normal)

    @cached_property
    def _slopes(self) -> NodalSlopes:
        return NodalSlopes.on(self.position, self.normal)

    @cached_property
    def _recovered(self) -> Array:
        """Gradient of the translation from the nodes alone, shape (node, 3, component, mode)."""
        return self._slopes.gradients(self.translation)

    def motion(self, height: float) -> Array:
        """Compute the motion at a height above the elements, shape (node, 3, mode)."""
        return self.translation + height * self.change_of_normal

    def moved(self, rotation: Array, shift: Array) -> FiniteElementModel:
        """Turn it and shift it: ``position -> rotation position + shift``."""
        turned = None if self.rotation is None else rotation @ self.rotation
        return replace(
            self,
            position=self.position @ rotation.T + shift,
            translation=rotation @ self.translation,
            rotation=turned,
        )

    def with_modes(self, some: Array) -> FiniteElementModel:
        """Keep some of its modes."""
        turned = None if self.rotation is None else self.rotation[..., some]
        return replace(
            self,
            frequency=self.frequency[some],
            translation=self.translation[..., some],
            rotation=turned,
        )

    def _check_sizes(self) -> None:
        nodes, modes = len(self.position), len(self.frequency)
        if not len(self.triangles) and not len(self.quadrilaterals):
            raise self.wrong("has no surface elements; write triangles or quadrilaterals into it")
        if not modes:
            raise self.wrong("has no mode shapes; give those of the finite element program")
        shapes = [self.translation] + ([] if self.rotation is None else [self.rotation])
        if any(one.shape != (nodes, 3, modes) for one in shapes):
            raise self.wrong(
                f"{nodes} nodes and {modes} frequencies need shapes ({nodes}, 3, {modes}), not "
                f"{self.translation.shape}"
            )
        if not all(np.isfinite(one).all() for one in (*shapes, self.position)):
            raise self.wrong("has a node or a shape with a value that is not a number")

    def _check_modes(self) -> None:
        """Refuse frequencies that are none, and shapes that are none or are there twice."""
        f = self.frequency
        if not (np.isfinite(f) & (f > 0)).all():
            bad = int(np.flatnonzero(~(np.isfinite(f) & (f > 0)))[0])
            raise self.wrong(f"mode {bad + 1} has no frequency above zero, but {f[bad]:g} Hz")
        flat = self.translation.reshape(-1, self.modes)
        size = np.linalg.norm(flat, axis=0)
        if (size == 0).any():
            raise self.wrong(f"mode {int(np.argmin(size)) + 1} moves no node")
        alike = np.abs(flat.T @ flat) ** 2 / np.outer(size, size) ** 2 > SAME_SHAPE
        near = np.abs(np.log(f[:, None] / f)) < SAME_FREQUENCY
        twice = np.argwhere(np.triu(alike & near, 1))
        if len(twice):
            one, two = twice[0] + 1
            raise self.wrong(
                f"modes {one} and {two} have one frequency, {f[one - 1]:.6g} Hz, and one shape: "
                "the mode is given twice; leave one out, as by model.containing"
            )
