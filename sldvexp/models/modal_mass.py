"""Modal masses from a known force: where it acts, along which way, and how large it is.

A mode of shape psi, 1 where the model moves most, is driven at d by the force F along n. At
resonance its peak velocity there is ``alpha = F psi(d).n / (2 zeta omega m)``, so that

    m = F psi(d).n / (2 zeta omega alpha)

needs no sensor at d: the model tells psi there. Errors of alpha and of the damping are taken as
independent; they are opposed, as a peak too wide is too low, so that the bound is rather too large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sldvexp.errors import Checks, UserError
from sldvexp.lazy import xarray as xr
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.seen_surface import SeenSurface
from sldvexp.models.shape_agreement import ShapeTest
from sldvexp.models.slopes import tangents
from sldvexp.typing import Array, ComplexArray

#: Part of the model's extent that the force's place may lie beside its surface.
BESIDE = 0.05


@dataclass
class DrivePoint:
    """Force that drives the structure.

    Parameters
    ----------
    point : list of 3 float, m
        Where it acts, in the world.
    point_std : float, m
        Standard uncertainty along the surface.
    direction : list of 3 float
        Along which it acts when the reference is positive, of any length.
    force : float, N
        Of one unit of the reference, as N per V.
    force_std : float, N
        Its standard uncertainty.
    """

    point: list[float] = field(default_factory=list)
    point_std: float = 0.0
    direction: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    force: float = 1.0
    force_std: float = 0.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no force can be."""
        for key in ("point", "direction"):
            values = getattr(self, key)
            checks.require(len(values) == 3, f"{name}.{key}", f"must be 3 numbers, not {values}")
            checks.finite(f"{name}.{key}", *values)
        length = float(np.linalg.norm(self.direction))
        checks.require(length > 0, f"{name}.direction", "must not be zero")
        checks.positive(f"{name}.force", self.force)
        checks.non_negative(f"{name}.force_std", self.force_std)
        checks.non_negative(f"{name}.point_std", self.point_std)


@dataclass(frozen=True, eq=False)
class ModalMasses:
    """Modal masses of the paired modes, for shapes that are 1 where the model moves most.

    Attributes
    ----------
    mass, std : ndarray, shape (test,), kg
    receptance : ndarray of complex, shape (test,)
        Motion at the force along it over that force, of real part alone if all is as said: its
        phase at resonance, after the factor of a positive mass is taken out, of size 1.
    phase_std : ndarray, shape (test,), rad
    """

    mass: Array
    std: Array
    receptance: ComplexArray
    phase_std: Array


def modal_masses(
    model: FiniteElementModel, tests: Sequence[ShapeTest], modes: xr.Dataset, drive: DrivePoint
) -> ModalMasses:
    """Compute modal masses of measured modes by the shapes of the model.

    Parameters
    ----------
    modes : xarray.Dataset
        The group ``modes``, with the amplitude of the reference.

    Raises
    ------
    UserError
        If the force acts beside the model.
    """
    at, slope = motion_at(model, drive)
    measured, own = (np.array([getattr(t, key) for t in tests]) for key in ("mode", "model_mode"))
    largest = np.linalg.norm(model.translation, axis=1).max(axis=0)[own]
    scale = np.array([t.scale for t in tests]) * largest
    scale_std = np.array([t.scale_std for t in tests]) * largest
    damping, omega = (modes[k].values[measured] for k in ("damping_ratio", "natural_frequency"))
    force = drive.force * float(modes["reference"])
    shape = at[own] / largest
    size = np.abs(scale)
    mass = force * np.abs(shape) / (4 * np.pi * damping * omega * size)
    relative = [
        scale_std / size,
        modes["scale_std"].values[measured] if "scale_std" in modes else np.zeros(len(tests)),
        modes["damping_ratio_std"].values[measured] / damping,
        np.full(len(tests), drive.force_std / drive.force),
        drive.point_std * slope[own] / np.abs(at[own]),
    ]
    turned = scale * np.sign(shape) / size
    phase = modes["phase_std"].values[measured] if "phase_std" in modes else np.zeros(len(tests))
    return ModalMasses(
        mass,
        mass * np.sqrt(np.sum(np.square(relative), axis=0)),
        turned,
        np.hypot(phase, scale_std / size),
    )


def motion_at(model: FiniteElementModel, drive: DrivePoint) -> tuple[Array, Array]:
    """Find the motion along the force where it acts, and its largest slope, (mode,) each.

    Raises
    ------
    UserError
        If it acts beside the model.
    """
    way = np.array(drive.direction, float)
    way /= np.linalg.norm(way)
    point = np.array(drive.point, float)
    reach = BESIDE * float(np.linalg.norm(np.ptp(model.position, axis=0)))
    step = 0.1 * reach
    beside = np.concatenate([[np.zeros(3)], step * tangents(way), -step * tangents(way)])
    begin, ways = point + beside - 2 * reach * way, np.tile(way, (len(beside), 1))
    surface = SeenSurface(model, 0.0)
    pairs = np.meshgrid(np.arange(len(begin)), np.arange(len(model.halves)), indexing="ij")
    met = surface.meet(begin, ways, (pairs[0].ravel(), pairs[1].ravel()))
    away = np.linalg.norm(met.place[0] - point) if met.meets[0] else np.inf
    if away > reach:
        nearest = np.linalg.norm(model.position - point, axis=1).min()
        raise UserError(
            f"drive.point: the force acts beside the model: no surface lies along drive.direction "
            f"within {1e3 * reach:.3g} mm, and the nearest node is {1e3 * nearest:.3g} mm away; it "
            "is in m and in the world's axes"
        )
    motion = -surface.along(met, ways)  # along is towards the start
    ends = np.where(np.isfinite(motion[1:]), motion[1:], motion[0])
    return motion[0], np.asarray(np.abs(ends - motion[0]).max(axis=0) / step)
