"""View: where the instrument stood, and the velocity image that it took there.

Intrinsics that were adjusted with a view's pose belong to it: true angles are ``gain recorded +
zero``, and its image points are those of a laser of its own. Pixels with a flag have no say in
anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.dataset import views_without_pose
from sldvexp.errors import ConfigError, UserError, nearest
from sldvexp.field.visibility.rest import RestSums
from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import MIRRORS, Mirror, TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose import EXTRINSICS, nominal_intrinsics, places
from sldvexp.session.images import describe_flagged_pixels
from sldvexp.signal import Flag
from sldvexp.typing import Array, BoolArray, ComplexArray
from sldvexp.units import AngleUnit

#: How far ``R R'`` of a rotation may be from the identity.
ORTHOGONAL = 1e-9
#: Frequencies of two views are the same if they differ by less, relatively.
SAME_FREQUENCY = 1e-12
VELOCITY_UNIT = "m/s"
#: Variables of an image that tell of pixels at rest, where its lines are combined.
RESTS = ("rest_size", "breaks_off")


@dataclass(frozen=True, eq=False)
class View:
    """Stand of the instrument and its velocity image.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        World to laser, ``P_laser = R (P_world - origin)``.
    origin : ndarray, shape (3,), m
    covariance : ndarray, shape (6, 6), rad and m, optional
        Of the pose: a small rotation vector of the laser frame, ``R -> exp([w]) R``, then the
        origin along the world's axes. None if nothing is known of it.
    dac : ndarray, shape (pixel, 2), steps
        (up_down, left_right) of each pixel.
    velocity : ndarray of complex, shape (pixel, frequency), m/s
        Positive towards the instrument.
    std : ndarray, shape (pixel,) or (pixel, frequency), m/s
        Its standard error, of real and imaginary part each.
    flags : ndarray, shape (pixel,)
        Not zero where the pixel is not to be trusted; its velocity may then be NaN.
    shape : pair of int, optional
        Rows and columns of a rectangular image, whose pixels go row by row.
    intrinsics : ndarray, shape (5,), optional
        Values of `INTRINSICS` that the pose was solved with, where they are not those configured.
    pointing_std : float, DAC steps
        Pointing noise of the mirrors that the pose was found with; 0 where none was found.
    rest : RestSums, optional
        Of all lines, where the velocities are few combinations of them.

    Raises
    ------
    UserError
        If the arrays do not fit one another, the rotation is none, or a pixel without a flag has
        no finite velocity with a standard error.
    """

    name: str
    rotation: Array
    origin: Array
    covariance: Array | None
    dac: Array
    velocity: ComplexArray
    std: Array
    flags: NDArray[np.integer] | BoolArray
    shape: tuple[int, int] | None = None
    intrinsics: Array | None = None
    pointing_std: float = 0.0
    rest: RestSums | None = None

    def __post_init__(self) -> None:
        self._check_pose()
        self._check_shapes()
        self._check_pixels()

    @classmethod
    def from_arrays(
        cls,
        name: str,
        rotation: ArrayLike,
        origin: ArrayLike,
        velocity: ArrayLike,
        std: ArrayLike,
        *,
        dac: ArrayLike | None = None,
        angle: ArrayLike | None = None,
        laser: TwoMirror | None = None,
        covariance: ArrayLike | None = None,
        flags: ArrayLike | None = None,
        shape: tuple[int, int] | None = None,
        pointing_std: float = 0.0,
    ) -> View:
        """Make a view from what is at hand.

        Parameters
        ----------
        name, rotation, origin, covariance, shape, pointing_std
            As of the class.
        velocity : array_like of complex, shape (pixel[, frequency]), m/s
            Positive towards the instrument.
        std : array_like, shape (), (pixel,) or (pixel, frequency), m/s
            Its standard error, of real and imaginary part each.
        dac : array_like, shape (pixel, 2), steps
            (up_down, left_right) of each pixel.
        angle : array_like, shape (pixel, 2), rad
            Mirror angles instead, which `laser` converts.
        laser : TwoMirror, optional
            Needed for angles only.
        flags : array_like, shape (pixel,), optional
            Not zero where a pixel is not to be trusted. Without them that is so where the velocity
            is not finite.

        Raises
        ------
        UserError
            As of the class; or if there are neither DAC steps nor angles with a laser.

        Examples
        --------
        >>> import numpy as np
        >>> from sldvexp.field import View
        >>> from sldvexp.laser.two_mirror import TwoMirror
        >>> angle = np.radians([[0, 0], [0, 5], [5, 0]])
        >>> velocity = [1e-3j, 2e-3, np.nan]
        >>> view = View.from_arrays(
        ...     "front", np.eye(3), [0, 0, -1.5], velocity, 1e-6, angle=angle, laser=TwoMirror()
        ... )
        >>> view
        View front: from (0, 0, -1.5) m, 3 pixels (2 usable), 1 frequency
        """
        if dac is None:
            if angle is None or laser is None:
                raise UserError(
                    f"view {name}: where its pixels are is not known; give dac, or angle and laser"
                )
            dac = laser.dac_from_angle(angle)
        values = np.asarray(velocity, complex)
        values = values.reshape(len(values), -1)
        if flags is None:
            flags = np.where(np.isfinite(values).all(axis=1), 0, int(Flag.non_finite))
        noise = np.asarray(std, float)
        return cls(
            name,
            np.asarray(rotation, float),
            np.asarray(origin, float),
            None if covariance is None else np.asarray(covariance, float),
            np.asarray(dac, float),
            values,
            noise if noise.ndim else np.full(len(values), noise),
            np.asarray(flags),
            shape,
            pointing_std=pointing_std,
        )

    def __repr__(self) -> str:
        """Say where it stood, and how large its image is."""
        pixels, frequencies = self.velocity.shape
        place = ", ".join(f"{x:.4g}" for x in self.origin)
        return (
            f"View {self.name}: from ({place}) m, {pixels} pixels ({self.usable.sum()} usable), "
            f"{frequencies} frequenc{'y' if frequencies == 1 else 'ies'}"
        )

    @property
    def usable(self) -> BoolArray:
        """Pixels that have no flag, shape (pixel,)."""
        return np.asarray(self.flags == 0)

    @property
    def dropped(self) -> BoolArray:
        """Pixels of which nothing is wrong but that they are unlike those around, (pixel,)."""
        return np.asarray(self.flags == int(Flag.unlike))

    def moved(self, pose: Array) -> View:
        """Move it by a rotation vector of the laser frame and a displacement of the origin.

        Parameters
        ----------
        pose : ndarray, shape (6,), rad and m
            In the order of `covariance`.
        """
        rotation = rotation_from_vector(pose[:3]) @ self.rotation
        return replace(self, rotation=rotation, origin=self.origin + pose[3:])

    def laser(self, configured: TwoMirror) -> TwoMirror:
        """Return the laser that the view's pose belongs to."""
        if self.intrinsics is None:
            return configured
        return adjusted(configured, self.intrinsics, f"view {self.name}")

    def _check_pose(self) -> None:
        where = f"view {self.name}"
        if self.rotation.shape != (3, 3) or self.origin.shape != (3,):
            raise UserError(
                f"{where}: the pose needs a rotation of shape (3, 3) and an origin of shape (3,), "
                f"not {self.rotation.shape} and {self.origin.shape}"
            )
        error = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if not error <= ORTHOGONAL or not np.linalg.det(self.rotation) > 0:
            raise UserError(f"{where}: the rotation of the pose is not a proper rotation matrix")
        if not np.isfinite(self.origin).all():
            raise UserError(f"{where}: the origin of the pose is not three finite numbers")
        if self.covariance is not None and self.covariance.shape != (6, 6):
            raise UserError(
                f"{where}: the covariance of the pose must be (6, 6), not {self.covariance.shape}"
            )

    def _check_shapes(self) -> None:
        pixels, shapes = len(self.dac), (self.velocity.shape, self.std.shape, self.flags.shape)
        fits = (
            self.dac.shape == (pixels, 2)
            and self.velocity.shape == (pixels, *self.velocity.shape[-1:])
            and self.std.shape in ((pixels,), self.velocity.shape)
            and self.flags.shape == (pixels,)
        )
        if not fits:
            raise UserError(
                f"view {self.name}: DAC steps of shape {self.dac.shape} need velocities (pixel, "
                f"frequency), standard errors (pixel,) or (pixel, frequency) and flags (pixel,) "
                f"of as many pixels, not {shapes[0]}, {shapes[1]} and {shapes[2]}"
            )
        if self.shape is not None and self.shape[0] * self.shape[1] != pixels:
            rows, columns = self.shape
            raise UserError(
                f"view {self.name}: an image of {rows} rows and {columns} columns has "
                f"{rows * columns} pixels, but there are {pixels}"
            )

    def _check_pixels(self) -> None:
        if not np.isfinite(self.dac).all():
            first = np.flatnonzero(~np.isfinite(self.dac).all(axis=1))[0]
            raise UserError(f"view {self.name}: the DAC step of pixel {first} is not finite")
        std = self.std.reshape(len(self.std), -1)
        known = np.isfinite(self.velocity).all(axis=1) & (np.isfinite(std) & (std >= 0)).all(axis=1)
        unknown = np.flatnonzero(~known & self.usable)
        if len(unknown):
            raise UserError(
                f"view {self.name}: pixel {unknown[0]} has no finite velocity with a standard "
                "error and no flag; flag it"
            )


def views_of(tree: Mapping[str, xr.Dataset], laser: TwoMirror) -> list[View]:
    """Collect the views of a run, from its groups ``pose`` and ``image/<view>``.

    Views whose pose was not found are left out, as the pose's findings say.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Group path to its dataset.
    laser : TwoMirror
        As configured.

    Returns
    -------
    list of View
        In the order of the poses.

    Raises
    ------
    UserError
        If there is no image, an image has no pose, or units or frequencies differ between views.
    """
    images = {
        k.split("/", 1)[1]: v
        for k, v in tree.items()
        if k.startswith("image/") and not v.attrs.get("left_out")
    }
    if not images:
        raise UserError("field: there are no velocity images; scan the structure from some views")
    if "pose" not in tree:
        raise UserError(f"field: the images of {', '.join(images)} have no poses; choose a pose")
    pose = tree["pose"]
    names = [str(v) for v in pose["view"].values]
    lost = views_without_pose(tree)
    if set(images) <= set(lost):
        raise UserError(
            f"field: of {', '.join(images)} no pose was found, so that no image is left"
        )
    images = {name: image for name, image in images.items() if name not in lost}
    for name in images:
        if name not in names:
            raise UserError(
                f"view {name}: has an image but no pose; {nearest(name, names)}; "
                "find the pose of that view too, or leave its image out"
            )
    require_same(images)
    nominal = nominal_intrinsics(laser.mirror_offset)
    every = _arrays(pose, nominal)
    poses = (dict(zip(every, own, strict=True)) for own in zip(*every.values(), strict=True))
    each = zip(names, poses, strict=True)
    return [_view(name, own, images[name]) for name, own in each if name in images]


def _arrays(pose: xr.Dataset, nominal: Array) -> dict[str, Iterable[Any]]:
    """Read what belongs to the views' poses, a row each: labels are looked up once for all."""
    extrinsics = {key: list(EXTRINSICS) for key in ("parameter", "parameter2")}
    count = pose.sizes["view"]
    pointing = pose["pointing_std"].values if "pointing_std" in pose else np.zeros(count)
    return {
        "rotation": pose["rotation"].values,
        "origin": pose["origin"].values,
        "covariance": pose["covariance"].sel(extrinsics).values,
        "intrinsics": _intrinsics(pose, nominal) or [None] * count,
        "pointing_std": np.nan_to_num(pointing).tolist(),
    }


def _view(name: str, pose: Mapping[str, Any], image: xr.Dataset) -> View:
    """Make one view from what belongs to its pose, and its image."""
    covariance = pose["covariance"]
    velocity = image["velocity"].values.astype(complex)
    return View(
        name,
        pose["rotation"],
        pose["origin"],
        covariance if np.isfinite(covariance).all() else None,
        image["dac"].values.astype(float),
        velocity.reshape(len(velocity), -1),
        image["velocity_std"].values.astype(float),
        image["flags"].values,
        shape_of(image),
        pose["intrinsics"],
        pose["pointing_std"],
        _rest(image),
    )


def shape_of(image: xr.Dataset) -> tuple[int, int] | None:
    """Read how many rows and columns an image's pixels are in, where they are."""
    shape = image.attrs.get("shape")
    return None if shape is None else (int(shape[0]), int(shape[1]))


def _rest(image: xr.Dataset) -> RestSums | None:
    """Read what all lines tell of pixels at rest, where they are combined."""
    if "rest_size" not in image:
        return None
    size = image["rest_size"]
    return RestSums(size.values, float(size.attrs["limit"]), image["breaks_off"].values)


def _intrinsics(pose: xr.Dataset, nominal: Array) -> list[Array] | None:
    """Read values of `INTRINSICS` of every view, if some were adjusted with the poses."""
    if "adjusted" not in pose.coords:
        return None
    found = np.tile(nominal, (pose.sizes["view"], 1))
    found[:, places(map(str, pose["adjusted"].values))] = pose["intrinsic"].values
    return list(found)


def require_same(images: Mapping[str, xr.Dataset]) -> None:
    """Complain unless all images, by their views, are in m/s and at the same frequencies."""
    first, reference = next(iter(images)), None
    for name, image in images.items():
        unit = image["velocity"].attrs.get("units")
        if unit != VELOCITY_UNIT:
            raise UserError(
                f"view {name}: its velocities are in {unit or 'no unit'}; they must be in "
                f"{VELOCITY_UNIT}"
            )
        has = "frequency" in image["velocity"].dims
        frequency = np.asarray(image["frequency"].values if has else [], float)
        if reference is None:
            reference = frequency
        same = frequency.shape == reference.shape
        if not same or not np.allclose(frequency, reference, rtol=SAME_FREQUENCY, atol=0.0):
            raise UserError(
                f"view {name}: its frequencies ({_in_short(frequency)}) are not those of view "
                f"{first} ({_in_short(reference)}); all views must be taken at the same ones"
            )


def _in_short(frequency: Array) -> str:
    """Write frequencies for a message."""
    if not len(frequency):
        return "none stated"
    some = ", ".join(f"{f:.9g}" for f in frequency[:3])
    return f"{some}{', ...' if len(frequency) > 3 else ''} Hz, {len(frequency)} in all"


def adjusted(laser: TwoMirror, intrinsics: Array, where: str) -> TwoMirror:
    """Adjust a laser: true angles are ``gain recorded + zero``, the mirror offset is another.

    Parameters
    ----------
    laser : TwoMirror
        Whose calibration gives the recorded angles.
    intrinsics : ndarray, shape (5,)
        In the order of `sldvexp.pose.least_squares.INTRINSICS`.
    where : str
        Whose intrinsics they are, for the message.

    Raises
    ------
    UserError
        If there is no such laser.
    """
    offset, *others = (float(value) for value in intrinsics)
    gains, zeros = others[::2], others[1::2]
    mirrors = []
    for name, gain, zero in zip(MIRRORS, gains, zeros, strict=True):
        constant, slope, *higher = (gain * c for c in getattr(laser, name).coefficients)
        mirrors.append(Mirror(slope, constant + zero, higher, AngleUnit.rad))
    up_down, left_right = mirrors
    try:
        found = replace(laser, mirror_offset=0.0, up_down=up_down, left_right=left_right)
    except ConfigError as error:
        raise UserError(
            f"{where}: the pose was solved with a laser that there is none of ({error}); give the "
            "adjusted intrinsics what is known of them beforehand, as in "
            "pose.adjust={gain_up_down: 0.002}"
        ) from None
    # An estimate may err below zero, which no configured offset is, and the equations hold there.
    found.mirror_offset = offset
    return found


#: Part of a view's samples that lie at flagged pixels, from which that is worth saying.
NOTABLE = 0.1

#: What may be done, by the flag of most pixels.
REMEDIES = {
    Flag.saturated: "excite less, or choose a wider range of the velocity and of the converter",
    Flag.dropped_out: "focus or treat the surface, or raise signal.flags.dropout_factor",
    Flag.reference_missing: "connect the reference to its channel, or lower "
    "signal.flags.reference_minimum if it really is so small",
    Flag.non_finite: "the instrument gave samples that are no numbers",
    Flag.unlike: "look at the image; reconstruction.robust=off keeps these pixels",
    Flag.resting: "look at the image; reconstruction.robust=off keeps these pixels",
    Flag.poor_fit: "is scan.sampling.frequency the one that is driven, and the reference a sine?",
}


def why(*views: View) -> str:
    """Describe how many pixels of some views are flagged, by which flags, and what to do.

    For example ``9 of 9 pixels are flagged (saturated 9): excite less, or ...``.
    """
    flags = np.concatenate([view.flags for view in views]).astype(int)
    counts = {flag: int(np.sum(flags & flag != 0)) for flag in Flag}
    most = max(counts, key=lambda flag: counts[flag])
    told = describe_flagged_pixels(flags)
    return f"{told}: {REMEDIES[most]}" if counts[most] else told


def require_usable(views: Sequence[View]) -> None:
    """Refuse images whose every pixel is flagged.

    Raises
    ------
    UserError
        If one has none; it says why.
    """
    for view in views:
        if len(view.flags) and not view.usable.any():
            raise UserError(f"view {view.name}: {why(view)}; or leave the view out")
