"""Strains of a surface at face, middle and back, and what follows from them, place by place.

All are linear in the splines' coefficients, so that the fit gives their variances. Those of sums of
two give the covariances of the components at a place,

    2 cov(a, b) = var(a + b) - var(a) - var(b),

which principal strains and stresses need. Of a thin shell, the strain of the middle is that of its
membrane and (face - back) / 2 that of its bending at the face.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.shell.functionals import Forms
from sldvexp.shell.linear_form import LinearForm, summed
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
#: Strains of a thin shell's inside, and its force resultants.
THROUGH = ("middle_strain", "back_strain", "bending_strain")
RESULTANTS = ("membrane_force", "bending_moment")


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
        found = self._evaluated(place)
        strain, covariance = _with_covariance(*found["strain"])
        variance = np.moveaxis(covariance.diagonal(axis1=2, axis2=3), -1, 2)
        yield "strain", strain
        yield "strain_std", np.sqrt(variance.max(axis=0))
        yield "strain_std_by_part", np.sqrt(variance)
        extremes, (std, of_direction) = principal(strain), principal_std(strain, covariance)
        yield "principal_strain", extremes.strain
        yield "principal_strain_std", std
        yield "principal_direction", extremes.direction
        yield "principal_direction_std", of_direction
        yield "principal_phase", extremes.phase
        if self.material is not None:
            stress = plane_stress(strain, self.material.E, self.material.nu)
            yield "stress", stress
            yield "stress_std", stress_std(strain, covariance, self.material)
            yield "von_mises", von_mises(stress)
            yield "von_mises_std", von_mises_std(strain, covariance, self.material)
        for name in THROUGH:
            if name in found:
                value, variance = found[name]
                yield name, value
                yield f"{name}_std", np.sqrt(variance.max(axis=0))
        for name in RESULTANTS:
            if name in found:
                yield from self._resultant(name, *found[name])

    def _forms(self, place: Array, half: float) -> dict[str, list[LinearForm]]:
        """Make the forms of all results that are linear, with half the thickness.

        The strain's are followed by sums of two.
        """
        face = self.fit.shell.strains(place, half)
        found = {"strain": face + [face[a] + face[b] for a, b in PAIRS]}
        if not self.of_middle:
            return found
        middle, back = (self.fit.shell.strains(place, height) for height in (0.0, -half))
        bending = [(up + down * -1.0) * 0.5 for up, down in zip(face, back, strict=True)]
        found |= {"middle_strain": middle, "back_strain": back, "bending_strain": bending}
        if self.material is not None:
            stiff = elasticity(self.material.E, self.material.nu)
            parts = (2 * half, middle), ((2 * half) ** 2 / 6, bending)
            for name, (size, strain) in zip(RESULTANTS, parts, strict=True):
                found[name] = [
                    summed(
                        [form * (size * factor) for form, factor in zip(strain, row, strict=True)]
                    )
                    for row in stiff
                ]
        return found

    def _resultant(
        self, name: str, value: ComplexArray, variance: Array
    ) -> Iterator[tuple[str, NDArray[Any]]]:
        """Add to a force resultant C e what the material is not known by, of the strains e."""
        assert self.material is not None
        at = elasticity(self.material.E, self.material.nu)
        strain = np.einsum("ab,pbf->paf", np.linalg.inv(at), value)
        own = np.sqrt(variance.max(axis=0))
        yield name, value
        yield (
            f"{name}_std",
            with_material(own, self.material, lambda e, nu: plane_stress(strain, e, nu)),
        )

    def _evaluated(self, place: Array) -> dict[str, tuple[ComplexArray, Array]]:
        """Compute strains and their variances by part: those of the velocity over i omega.

        Returns
        -------
        dict of str to tuple
            ndarray of complex, shape (place, component, frequency), and its variances, shape (part,
            place, component, frequency).
        """
        half, shell = self.fit.face, self.fit.shell
        by_name = self._forms(place, half)
        forms = [form for each in by_name.values() for form in each]
        thicker = None
        if half:  # without a middle the face is the splines' own surface, whatever the thickness is
            higher = [form for each in self._forms(place, half + STEP).values() for form in each]
            pairs = zip(higher, forms, strict=True)
            by_thickness = [(up + here * -1.0) * (0.5 / STEP) for up, here in pairs]
            thicker = Forms(shell, place, by_thickness)
        values, own, others = self.fit.evaluate(Forms(shell, place, forms), thicker)
        # A velocity that stands still tells of no displacement.
        per_omega = 1 / np.where(self.frequency > 0, 2 * np.pi * self.frequency, np.nan)
        shape = (len(forms), len(place), len(per_omega))
        strain = (-1j * values * per_omega).reshape(shape).swapaxes(0, 1)
        # (a + ib) / (i omega) = b / omega - i a / omega: the parts change places.
        variance = ((own + others)[::-1] * per_omega**2).reshape(2, *shape).swapaxes(1, 2)
        ends = np.cumsum([len(each) for each in by_name.values()])[:-1]
        split = zip(np.split(strain, ends, axis=1), np.split(variance, ends, axis=2), strict=True)
        return dict(zip(by_name, split, strict=True))


def _with_covariance(values: ComplexArray, variance: Array) -> tuple[ComplexArray, Array]:
    """Make strains, and covariances of their components, (part, place, 3, 3, frequency).

    Parameters
    ----------
    values : ndarray of complex, shape (place, 6, frequency)
        Strains and then sums of two.
    variance : ndarray, shape (part, place, 6, frequency)
    """
    count = len(STRAINS)
    parts, places, _, frequencies = variance.shape
    covariance = np.empty((parts, places, count, count, frequencies))
    for a in range(count):
        covariance[:, :, a, a] = variance[:, :, a]
    for i, (a, b) in enumerate(PAIRS):
        both = variance[:, :, count + i] - variance[:, :, a] - variance[:, :, b]
        covariance[:, :, a, b] = covariance[:, :, b, a] = both / 2
    return values[:, :count], covariance
