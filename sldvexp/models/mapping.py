"""Mode shapes of a model as pixels see them, and how these change with the pose of the view.

Pixel p of a view looks along ``-d_p`` and meets the surface at x_p: mode r moves there towards the
instrument by ``P_pr = d_p . s_r(x_p)``. A pose that is off moves place and direction; its effect G
is found by following the beams from poses a little to both sides. So is that of the mirrors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.dataset import MODAL_IMAGES, views_without_pose
from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import TwoMirror, rays
from sldvexp.lazy import xarray as xr
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.seen_surface import Met, SeenSurface
from sldvexp.pose import EXTRINSICS, nominal_intrinsics, places, true_angles
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray

#: Steps of pose (rad, m) and mirrors (DAC steps) to both sides of which effects are differences.
STEP, DAC_STEP = 1e-5, 0.5
#: Beams flatter to the surface than this cosine are left out.
STEEPEST = 0.1


@dataclass(frozen=True, eq=False)
class ModalPixels:
    """Pixels of one view, and the modal velocities measured at them.

    Parameters
    ----------
    name : str
        Of the view.
    rotation, origin : ndarray
        Pose: ``P_laser = R (P_world - origin)``, m.
    covariance : ndarray, shape (6, 6), rad and m, optional
        Of a rotation vector of the laser frame, then of the origin. None if it is not known.
    laser : TwoMirror
    intrinsics : ndarray, shape (5,)
    dac : ndarray, shape (pixel, 2)
    pixel : ndarray of int, shape (pixel,)
        Of the view's image.
    velocity : ndarray of complex, shape (pixel, mode), m/s
        Peak modal velocity at resonance, towards the instrument.
    std : ndarray, shape (pixel, mode), m/s
        Of real and imaginary part each.
    pointing : float, DAC steps
        Pointing noise of the mirrors.
    """

    name: str
    rotation: Array
    origin: Array
    covariance: Array | None
    laser: TwoMirror
    intrinsics: Array
    dac: Array
    pixel: IndexArray
    velocity: ComplexArray
    std: Array
    pointing: float = 0.0

    def some(self, kept: IndexArray) -> ModalPixels:
        """Keep some of the pixels."""
        return replace(
            self,
            dac=self.dac[kept],
            pixel=self.pixel[kept],
            velocity=self.velocity[kept],
            std=self.std[kept],
        )

    def beams(self, pose: Array, off: Array) -> tuple[Array, Array]:
        """Compute starts, m, and unit directions of the beams in the world, shape (pixel, 3) each.

        Parameters
        ----------
        pose : ndarray, shape (6,), rad and m
            By which the pose is off, in the order of `covariance`.
        off : ndarray, shape (2,), DAC steps
            By which the mirrors are.
        """
        rotation = rotation_from_vector(pose[:3]) @ self.rotation
        angles = true_angles(self.laser.angle_from_dac(self.dac + off), self.intrinsics)
        start, along = rays(angles, float(self.intrinsics[0]))
        return self.origin + pose[3:] + start @ rotation, along @ rotation


@dataclass(frozen=True, eq=False)
class PredictedPixels:
    """Shapes of a model at the pixels of one view that see it.

    Parameters
    ----------
    pixels : ModalPixels
        Those that see it.
    shape : ndarray, shape (pixel, mode)
        P, the model's modes towards the instrument.
    place : ndarray, shape (pixel, 3), m
    by_pose : ndarray, shape (pixel, mode, 6)
        Derivatives of P by the pose.
    by_dac : ndarray, shape (pixel, mode, 2)
        Derivatives of P by the DAC steps.
    side : int
        1 if the view sees the side that the elements' normals point to, else -1.
    beside : ModalPixels
        Those that look past the model.
    """

    pixels: ModalPixels
    shape: Array
    place: Array
    by_pose: Array
    by_dac: Array
    side: int
    beside: ModalPixels


def modal_pixels(tree: Mapping[str, xr.Dataset], laser: TwoMirror) -> list[ModalPixels]:
    """Collect usable pixels of all modal images that have a pose.

    Raises
    ------
    UserError
        If there are no modal images, or no poses.
    """
    images = {
        k.removeprefix(MODAL_IMAGES): v for k, v in tree.items() if k.startswith(MODAL_IMAGES)
    }
    if not images:
        raise UserError("there are no modes to test a model on; choose modal=own")
    if "pose" not in tree:
        raise UserError(f"the images of {', '.join(images)} have no poses; choose a pose")
    pose, lost = tree["pose"], views_without_pose(tree)
    known = [str(v) for v in pose["view"].values if str(v) not in lost and str(v) in images]
    if not known:
        raise UserError(f"none of the views {', '.join(images)} has a pose")
    nominal = nominal_intrinsics(laser.mirror_offset)
    return [_pixels(name, pose.sel(view=name), images[name], laser, nominal) for name in known]


def _pixels(
    name: str, pose: xr.Dataset, image: xr.Dataset, laser: TwoMirror, nominal: Array
) -> ModalPixels:
    covariance = pose["covariance"].sel(parameter=list(EXTRINSICS), parameter2=list(EXTRINSICS))
    intrinsics = nominal.copy()
    if "adjusted" in pose.coords:
        intrinsics[places(map(str, pose["adjusted"].values))] = pose["intrinsic"].values
    velocity, std = image["velocity"].values, image["velocity_std"].values
    std = np.broadcast_to(std.reshape(len(std), -1), velocity.shape).astype(float)
    usable = (image["flags"].values == 0) & np.isfinite(velocity).all(1) & (std > 0).all(1)
    pixel = np.flatnonzero(usable)
    found = float(np.nan_to_num(pose["pointing_std"])) if "pointing_std" in pose else 0.0
    return ModalPixels(
        name,
        pose["rotation"].values,
        pose["origin"].values,
        covariance.values if np.isfinite(covariance.values).all() else None,
        laser,
        intrinsics,
        image["dac"].values[pixel].astype(float),
        pixel,
        velocity[pixel].astype(complex),
        std[pixel],
        laser.pointing_std or found,
    )


def map_shapes(model: FiniteElementModel, pixels: ModalPixels) -> PredictedPixels:
    """Map a model's shapes on the pixels of one view.

    A pixel is kept if its beam meets the surface not too flat, also from poses a step away.
    """
    begin, way = pixels.beams(np.zeros(6), np.zeros(2))
    side = _side(model, begin, way)
    surface = SeenSurface(model, side * model.thickness / 2)
    pairs = surface.near(begin, way)
    met = surface.meet(begin, way, pairs)
    meets = met.meets & _steep(surface, met, way)
    steps = [*(s * STEP * np.eye(6)[k] for k in range(6) for s in (1, -1))]
    moved = [(pose, np.zeros(2)) for pose in steps]
    moved += [(np.zeros(6), s * DAC_STEP * np.eye(2)[k]) for k in range(2) for s in (1, -1)]
    shifted = []
    for pose, off in moved:
        start, along = pixels.beams(pose, off)
        shifted.append(surface.along(surface.meet(start, along, pairs), along))
    kept = np.flatnonzero(meets & np.isfinite(np.array(shifted)).all(axis=(0, 2)))
    change = np.array([one[kept] for one in shifted])
    by = np.moveaxis(change[::2] - change[1::2], 0, -1)
    own = Met(met.half[kept], met.place[kept], met.shares[kept])
    return PredictedPixels(
        pixels.some(kept),
        surface.along(own, way[kept]),
        met.place[kept],
        by[..., :6] / (2 * STEP),
        by[..., 6:] / (2 * DAC_STEP),
        side,
        pixels.some(np.setdiff1d(np.arange(len(way)), kept)),
    )


def _side(model: FiniteElementModel, begin: Array, way: Array) -> int:
    """Tell which side of the elements a view sees: that of most pixels."""
    middle = SeenSurface(model, 0.0)
    met = middle.meet(begin, way, middle.near(begin, way))
    facing = np.einsum("pi,pi->p", _normals(model, met), -way)[met.meets]
    return -1 if len(facing) and np.median(facing) < 0 else 1


def _steep(surface: SeenSurface, met: Met, way: Array) -> BoolArray:
    cosine = np.abs(np.einsum("pi,pi->p", _normals(surface.model, met), way))
    return np.asarray(np.nan_to_num(cosine) >= STEEPEST)


def _normals(model: FiniteElementModel, met: Met) -> Array:
    """Interpolate normals at the places that beams meet, shape (pixel, 3)."""
    corners = model.normal[model.halves[met.half]]
    return np.asarray(np.einsum("pk,pkd->pd", met.shares, corners))
