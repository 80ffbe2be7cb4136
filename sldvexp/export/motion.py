"""Surface that moves, as exports to look at have it: GLB, GIF and MP4.

A point of the surface is drawn at p + s Re(V exp(i phi)), with the complex velocity V (m/s) at one
frequency, its phase phi, and the scale s, drawn metres for 1 m/s; the report's page draws the same.
A sine's velocity leads its displacement by a quarter of a period and is of the same shape, so that
the drawn motion is that of the displacement too. What is not determined stays at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from sldvexp.dataset import FREQUENCY, VARIABLES
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import Checks, UserError
from sldvexp.export.base import VelocityExport
from sldvexp.export.strains import strain_of
from sldvexp.export.velocities import (
    PrismMesh,
    bounds_of,
    frequencies_of,
    mesh_of,
    velocities_of,
    velocity_in_world,
)
from sldvexp.lazy import xarray as xr
from sldvexp.plot.moving_look import MOVING_SHARE, SECONDS_A_TURN
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray

#: Frequencies are the same if they are to the six digits that pages show.
SIX_DIGITS = 5e-6


class MotionColour(Enum):
    """What the colours of a moving surface say.

    Attributes
    ----------
    amplitude
        Amplitude of the velocity, all components together.
    strain
        Largest extension of a cycle in the face, for runs with strain.
    """

    amplitude = "amplitude"
    strain = "strain"


@dataclass
class MovingExport(VelocityExport):
    """Base of the exports that show the surface in motion.

    Parameters
    ----------
    frequency : float, optional
        Of the motion in Hz; without it, the strongest of the surface.
    colour : MotionColour, optional
        What colours say; without it strain, if the run has it, else amplitude.
    seconds : float
        Duration of a drawn period.
    """

    frequency: float | None = None
    colour: MotionColour | None = None
    seconds: float = SECONDS_A_TURN

    called: ClassVar[str] = "motion"

    def __post_init__(self) -> None:
        checks = Checks()
        if self.frequency is not None:
            checks.positive("frequency", self.frequency)
        checks.positive("seconds", self.seconds)
        self.check(checks)
        checks.done()

    def check(self, checks: Checks) -> None:
        """Note what is wrong with further settings."""


@dataclass(frozen=True, eq=False)
class Motion:
    """One layer of a field, or points, as it moves at one frequency.

    Attributes
    ----------
    position : ndarray, shape (node, 3), m
        At rest, in the world.
    cells : sequence of ndarray of int, shape (cell, corner)
        Triangles, lines or points that are drawn, by nodes from 0.
    velocity : ndarray of complex, shape (node, 3), m/s
        Along the world's axes; NaN where it is not determined.
    hertz : float, optional
        None if the run does not know it.
    value : ndarray, shape (node,)
        That the colours tell; NaN where there is none.
    title, unit : str
        What that is.
    faint : ndarray of bool, shape (node,)
        Where it is below its bound.
    """

    position: Array
    cells: Sequence[IntArray]
    velocity: ComplexArray
    hertz: float | None
    value: Array
    title: str
    unit: str
    faint: BoolArray

    @property
    def scale(self) -> float:
        """Drawn metres for 1 m/s; 0 if nothing moves."""
        return drawn_scale(self.position, np.nan_to_num(self.velocity))

    @property
    def enlarged(self) -> float | None:
        """Drawn deflections over displacements, which are V / (2 pi f); None if f is unknown."""
        return None if self.hertz is None else 2 * np.pi * self.hertz * self.scale

    @property
    def drawn(self) -> ComplexArray:
        """Deflections as they are drawn, shape (node, 3), m."""
        return self.scale * np.nan_to_num(self.velocity)


def amplitude(velocity: NDArray) -> Array:
    """Compute the root of the sum of the squared components' amplitudes, shape (node,)."""
    return np.sqrt((np.abs(velocity) ** 2).sum(axis=1))


def drawn_scale(position: Array, velocity: ComplexArray) -> float:
    """Choose how many metres are drawn for 1 m/s; 0 if nothing moves."""
    most = float(amplitude(velocity).max())
    diagonal = float(np.linalg.norm(np.ptp(position, axis=0)))
    return MOVING_SHARE * diagonal / most if most > 0 else 0.0


def motion_of(
    run: RunData, format_name: str, hertz: float | None, colour: MotionColour | None
) -> Motion:
    """Take the moving surface of a run.

    Parameters
    ----------
    format_name : str
        For messages.
    hertz : float, optional
        Without it the strongest frequency of the surface.
    colour : MotionColour, optional
        Without it the strain, if the run has it for the surface, or else the amplitude.

    Raises
    ------
    UserError
        If the run has no such frequency or no strain, or the places are not known.
    """
    found, mesh = velocities_of(run), mesh_of(run, format_name)
    layer = mesh.surface_layer
    world = velocity_in_world(found, mesh)[layer]
    frequencies = frequencies_of(found)
    if not np.isfinite(mesh.position[layer]).all():
        lost = int(np.isnan(mesh.position[layer]).any(axis=1).argmax())
        name = found["place"].values[layer[lost]]
        raise UserError(f"export={format_name}: the place of {name} is not known")
    index = frequency_index(world, frequencies, hertz, format_name)
    position, velocity = mesh.position[layer], world[..., index]
    own = None if frequencies is None else float(frequencies[index])
    strain = None if colour is MotionColour.amplitude else _strain_here(run, position, own)
    if colour is MotionColour.strain and strain is None:
        raise UserError(
            f"export={format_name}: the run has no strain of this surface; choose "
            "reconstruction=shell or spline, as in experiment=plate_strain, or colour=amplitude"
        )
    if strain is not None:
        value, bound = (strain[f"principal_{n}"].values for n in ("strain", "confidence"))
        title, unit = "largest extension", "strain"
    else:
        value, title, unit = amplitude(velocity), "amplitude", VARIABLES["field"]["velocity"].units
        known = bounds_of(found).get("confidence", np.zeros(found["velocity"].shape))
        bound = amplitude(known[layer][..., index])
    return Motion(position, _cells(mesh), velocity, own, value, title, unit, value < bound)


def frequency_index(
    velocity: ComplexArray, frequencies: Array | None, hertz: float | None, format_name: str
) -> int:
    """Find a frequency, or the one at which a component of the velocity is largest.

    Parameters
    ----------
    velocity : ndarray, shape (node, component, frequency)

    Raises
    ------
    UserError
        If there is no such frequency.
    """
    if hertz is None:
        return int(np.nan_to_num(np.abs(velocity)).max(axis=(0, 1)).argmax())
    if frequencies is None:
        told = "it knows no frequency"
    else:
        index = int(np.abs(frequencies - hertz).argmin())
        if np.isclose(frequencies[index], hertz, rtol=SIX_DIGITS, atol=0.0):
            return index
        told = f"the nearest is {frequencies[index]}"
    unit = FREQUENCY.units
    raise UserError(f"export={format_name}: the run has nothing at {hertz} {unit}; {told}")


def _cells(mesh: PrismMesh) -> list[IntArray]:
    """Take what is drawn: the triangles of a volume's layer, or what joins points, or these."""
    return [mesh.triangles] if len(mesh.prisms) else mesh.cells


def _strain_here(run: RunData, position: Array, hertz: float | None) -> xr.Dataset | None:
    """Take the largest extension and its bound at a frequency, if they are of this surface."""
    strain = strain_of(run)
    if strain is None or hertz is None or "principal_strain" not in strain:
        return None
    place, known = strain["position"].values, strain["frequency"].values
    if place.shape != position.shape or not np.allclose(place, position) or hertz not in known:
        return None
    return strain.isel(principal=0, frequency=known.tolist().index(hertz))
