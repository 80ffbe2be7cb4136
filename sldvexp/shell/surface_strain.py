"""Strains of a surface at face, middle and back, and what follows from them, place by place.

All are linear in the splines' coefficients, so that the fit gives their variances. Those of sums of
two give the covariances of the components at a place,

    2 cov(a, b) = var(a + b) - var(a) - var(b),

which principal strains and stresses need. Of a thin shell, the strain of the middle is that of its
membrane and (face - back) / 2 that of its bending at the face.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.shell.love import STRAINS
from sldvexp.shell.material import Isotropic
from sldvexp.shell.principal import principal, principal_std
from sldvexp.shell.stress import (
    elasticity,
    plane_stress,
    stress_std,
    von_mises,
    von_mises_std,
    with_material,
)
from sldvexp.shell.surface_fit import SurfaceFit
from sldvexp.typing import Array, ComplexArray

#: Step of half the thickness by which strains are differentiated by it, m.
STEP = 1e-6
#: Places that are worked on at once.
BLOCK = 1000
#: Pairs of components whose sums tell their covariance.
PAIRS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, eq=False)
class SurfaceStrain:
    """Strains at places of a fitted surface.

    Attributes
    ----------
    fit : SurfaceFit
    frequency : ndarray, shape (frequency,), Hz
    material : Isotropic, optional
    of_middle : bool
        Whether the splines are those of a thin shell's middle, which tells any height.
    """

    fit: SurfaceFit
    frequency: Array
    material: Isotropic | None
    of_middle: bool

    def arrays(self, place: Array) -> dict[str, NDArray[Any]]:
        """Compute everything, by the names of the group ``strain``.

        Parameters
        ----------
        place : ndarray, shape (place, 2), m
        """
        blocks = np.array_split(place, max(1, -(-len(place) // BLOCK)))
        found = [dict(self._block(block)) for block in blocks]
        by_part = {"strain_std_by_part"}
        return {
            name: np.concatenate([one[name] for one in found], axis=1 if name in by_part else 0)
            for name in found[0]
        }

    def _block(self, place: Array) -> Iterator[tuple[str, NDArray[Any]]]:
        """Compute everything at some places."""
        strain, covariance = self._with_covariance(lambda half: self._rows(place, half))
        variance = np.moveaxis(covariance.diagonal(axis1=2, axis2=3), -1, 2)
        yield "strain", strain
        yield "strain_std", np.sqrt(variance.max(axis=0))
        yield "strain_std_by_part", np.sqrt(variance)
        found, (std, of_direction) = principal(strain), principal_std(strain, covariance)
        yield "principal_strain", found.strain
        yield "principal_strain_std", std
        yield "principal_direction", found.direction
        yield "principal_direction_std", of_direction
        yield "principal_phase", found.phase
        if self.material is not None:
            stress = plane_stress(strain, self.material.E, self.material.nu)
            yield "stress", stress
            yield "stress_std", stress_std(strain, covariance, self.material)
            yield "von_mises", von_mises(stress)
            yield "von_mises_std", von_mises_std(strain, covariance, self.material)
        if self.of_middle:
            yield from self._through_the_thickness(place)

    def _through_the_thickness(self, place: Array) -> Iterator[tuple[str, NDArray[Any]]]:
        """Compute strains of middle, back and bending, and force resultants."""

        def bending(half: float) -> Array:
            return (self._rows(place, half) - self._rows(place, -half)) / 2

        strains: dict[str, Callable[[float], Array]] = {
            "middle_strain": lambda half: self._rows(place, 0.0),
            "back_strain": lambda half: self._rows(place, -half),
            "bending_strain": bending,
        }
        for name, make in strains.items():
            value, variance = self._evaluated(make)
            yield name, value
            yield f"{name}_std", np.sqrt(variance.max(axis=0))
        if self.material is None:
            return
        resultants: dict[str, Callable[[float], Array]] = {
            "membrane_force": lambda half: 2 * half * self._rows(place, 0.0),
            "bending_moment": lambda half: (2 * half) ** 2 / 6 * bending(half),
        }
        for name, make in resultants.items():
            yield from self._resultant(name, make)

    def _resultant(
        self, name: str, make: Callable[[float], Array]
    ) -> Iterator[tuple[str, NDArray[Any]]]:
        """Compute a force resultant C e of strains e that are multiplied by powers of h."""
        assert self.material is not None
        at = elasticity(self.material.E, self.material.nu)
        value, variance = self._evaluated(lambda half: np.tensordot(at, make(half), 1))
        strain = np.einsum("ab,pbf->paf", np.linalg.inv(at), value)
        own = np.sqrt(variance.max(axis=0))
        yield name, value
        yield (
            f"{name}_std",
            with_material(own, self.material, lambda e, nu: plane_stress(strain, e, nu)),
        )

    def _rows(self, place: Array, height: float) -> Array:
        """Make the rows of the strains at a height, shape (3, place, coefficient), 1/m."""
        return np.stack(self.fit.shell.strain(place, height))

    def _evaluated(self, make: Callable[[float], Array]) -> tuple[ComplexArray, Array]:
        """Compute strains and their variances by part: those of the velocity over i omega.

        Parameters
        ----------
        make : callable
            Makes rows, shape (component, place, coefficient), of half the sheet's thickness.

        Returns
        -------
        strain : ndarray of complex, shape (place, component, frequency)
        variance : ndarray, shape (part, place, component, frequency)
        """
        half = self.fit.face
        rows = make(half)
        flat = rows.reshape(-1, rows.shape[-1])
        # Without a middle the face is the splines' own surface, whatever the thickness is.
        thicker = (make(half + STEP) - rows).reshape(flat.shape) / STEP / 2 if half else None
        values, own, others = self.fit.evaluate(flat, thicker)
        omega = 2 * np.pi * self.frequency
        shape = (*rows.shape[:2], len(omega))
        strain = (values / (1j * omega)).reshape(shape)
        # (a + ib) / (i omega) = b / omega - i a / omega: the parts change places.
        variance = ((own + others)[::-1] / omega**2).reshape(2, *shape)
        return np.moveaxis(strain, 0, 1), np.moveaxis(variance, 1, 2)

    def _with_covariance(self, make: Callable[[float], Array]) -> tuple[ComplexArray, Array]:
        """Compute strains, and covariances of their components, (part, place, 3, 3, frequency)."""

        def and_sums(half: float) -> Array:
            rows = make(half)
            return np.concatenate([rows, [rows[a] + rows[b] for a, b in PAIRS]])

        values, variance = self._evaluated(and_sums)
        count = len(STRAINS)
        parts, places, _, frequencies = variance.shape
        covariance = np.empty((parts, places, count, count, frequencies))
        for a in range(count):
            covariance[:, :, a, a] = variance[:, :, a]
        for i, (a, b) in enumerate(PAIRS):
            both = variance[:, :, count + i] - variance[:, :, a] - variance[:, :, b]
            covariance[:, :, a, b] = covariance[:, :, b, a] = both / 2
        return values[:, :count], covariance
