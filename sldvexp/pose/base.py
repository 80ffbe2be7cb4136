"""Contract of pose methods: what each is given, what it returns, and the group ``pose`` it makes.

A pose is six numbers a view: a small rotation vector of the laser frame and the origin, together
the `EXTRINSICS`, with intrinsics of the mirrors if those are adjusted too. Views that share errors
(the object's, or a shared intrinsic) do not err independently, so that the covariance of all views
together is kept beside each view's own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.dataset import Finding
from sldvexp.geometry import euler_from_rotation
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.uncertainty import euler_standard_error, half_width, standard_error
from sldvexp.targets import Target
from sldvexp.typing import Array

#: The six extrinsics: a small rotation vector of the laser frame (rad) and the origin (m).
EXTRINSICS = ("rotation_x", "rotation_y", "rotation_z", "x", "y", "z")

#: Variables of the group ``pose`` that every method gives; later steps rely on them.
PROMISED = (
    "rotation",
    "covariance",
    "dof",
    *(f"{name}{part}" for name in ("origin", "euler") for part in ("", "_std", "_confidence")),
)


@dataclass(frozen=True, eq=False, repr=False)
class PoseResult:
    """Poses of all views, as a method found them.

    Parameters
    ----------
    pose : xarray.Dataset
        The group ``pose`` of a run, as `pose_to_dataset` makes it: the variables `PROMISED` and,
        if the method has them, residuals, adjusted intrinsics and the covariance between views.
        Attributes: ``confidence_level``; ``notes``, one a line, for the reader of a report.
    registration : xarray.Dataset, optional
        The group ``registration``: the points, and the angles they were solved from.
    findings : sequence of Finding
        Where the data disagrees with the method's model.
    conic : xarray.Dataset, optional
        The group ``conic``: what was fitted to the circles' images.
    """

    GROUP: ClassVar[str] = "pose"

    pose: xr.Dataset
    registration: xr.Dataset | None = None
    findings: Sequence[Finding] = ()
    conic: xr.Dataset | None = None

    @property
    def views(self) -> list[str]:
        """Names of the views."""
        return [str(v) for v in self.pose["view"].values]

    @property
    def rotation(self) -> Array:
        """Rotations from world to laser, shape (view, 3, 3)."""
        return np.asarray(self.pose["rotation"].values)

    @property
    def origin(self) -> Array:
        """Origins of the laser frame in the world, shape (view, 3), m."""
        return np.asarray(self.pose["origin"].values)

    @property
    def notes(self) -> list[str]:
        """Sentences on what to mind about the poses."""
        return str(self.pose.attrs.get("notes", "")).splitlines()

    def groups(self) -> dict[str, xr.Dataset]:
        """Name the groups that the method adds to the run."""
        kept = {"registration": self.registration, "conic": self.conic}
        own = {name: group for name, group in kept.items() if group is not None}
        return {**own, "pose": self.pose}

    def to_dataset(self) -> xr.Dataset:
        """Give the group ``pose``."""
        return self.pose

    def __repr__(self) -> str:
        rms = self.pose["residual_rms"].values if "residual_rms" in self.pose else None
        return "\n".join(
            f"view {view}: {describe_pose(origin, std, None if rms is None else rms[k])}"
            for k, (view, origin, std) in enumerate(
                zip(self.views, self.origin, self.pose["origin_std"].values, strict=True)
            )
        )


class Refine(Enum):
    """Further use of the velocity images for the poses.

    Attributes
    ----------
    none
        Poses are those of their method.
    images
        All poses are adjusted together to all velocity images, each with its own bounds as prior.
    """

    none = "none"
    images = "images"


@dataclass
class PoseMethod(ABC):
    """A way to find where the instrument stood.

    A method is a plugin: its fields are its configuration, checked in ``__post_init__``, and
    `estimate` does the work. It needs nothing but its own file and a line in
    `sldvexp.config.experiment`; `tests/pose/test_contract.py` tries every registered one.

    Parameters
    ----------
    refine : Refine
        Whether velocity images, if there are any, refine the poses.
    """

    refine: Refine = field(default=Refine.none, kw_only=True)

    @abstractmethod
    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Find the pose of every view, with bounds.

        The same arguments give the same bits; none of them is changed.

        Parameters
        ----------
        laser : TwoMirror or None
            Mirrors of the run, if it has any.
        target : Target or None
            The calibration object, if there is one.
        tree : mapping of str to xarray.Dataset
            Groups that the run has so far: scanned edges are ``edge/<view>``, points that a person
            pointed at ``registration``.

        Returns
        -------
        PoseResult
            Of all views that the data has, in its order.

        Raises
        ------
        UserError
            If something that the method needs is not there, the data is wrong or cannot determine
            a pose. One sentence that names the file or view and says what to do.
        """

    def inputs(self) -> list[str]:
        """List the files that the method reads, as the configuration names them."""
        return []


def describe_pose(origin: Array, std: Array, residual_rms: float | None) -> str:
    """Say in one line where an instrument stood and how well that is known.

    Parameters
    ----------
    origin, std : ndarray, shape (3,), m
        The origin and its standard errors.
    residual_rms : float, DAC steps, or None
    """
    places = ", ".join(f"{x:.4f}" for x in origin)
    errors = ", ".join(f"{1e3 * x:.2g}" for x in std)
    fit = "" if residual_rms is None else f", residuals {residual_rms:.2g} DAC steps rms"
    return f"origin ({places}) m, std ({errors}) mm{fit}"


def pose_to_dataset(
    views: Sequence[str],
    rotation: ArrayLike,
    origin: ArrayLike,
    covariance: ArrayLike,
    dof: ArrayLike,
    confidence: float,
    adjusted: Sequence[str] = (),
    intrinsic: ArrayLike | None = None,
    joint: JointCovariance | None = None,
    coords: dict[str, Any] | None = None,
    **more: ArrayLike | None,
) -> xr.Dataset:
    """Make the group ``pose`` with its standard errors and intervals.

    Parameters
    ----------
    rotation : array_like, shape (view, 3, 3)
        World to laser.
    origin : array_like, shape (view, 3), m
    covariance : array_like, shape (view, parameter, parameter)
        Of the `EXTRINSICS` and `adjusted`; NaN where nothing is known of the uncertainty.
    dof : array_like, shape (view,)
        Degrees of freedom behind the covariance; infinite if it is known.
    confidence : float
        Level of the intervals.
    adjusted : sequence of str
        Intrinsics that the covariance is of besides the six `EXTRINSICS`.
    intrinsic : array_like, shape (view, adjusted), optional
    joint : JointCovariance, optional
        Of all views; kept if there are several.
    coords, **more
        Further coordinates and variables of the group.

    Examples
    --------
    >>> import numpy as np
    >>> known = np.diag([1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]) ** 2
    >>> pose = pose_to_dataset(
    ...     ["front"], [np.eye(3)], [[0.0, 0.0, -2.0]], [known], [np.inf], 0.95
    ... )
    >>> pose["origin_confidence"].values.round(5)
    array([[0.00196, 0.00196, 0.00196]])
    """
    rotation, covariance = np.asarray(rotation, float), np.asarray(covariance, float)
    euler_std, std = euler_standard_error(rotation, covariance), standard_error(covariance)
    origin_std = std[:, 3:6]
    dof = np.asarray(dof, float)
    parameters = [*EXTRINSICS, *adjusted]
    labels = {"view": list(views), "parameter": parameters, "parameter2": parameters}
    if len(adjusted):
        labels["adjusted"] = list(adjusted)
        more |= {"intrinsic": intrinsic, "intrinsic_std": std[:, 6:]}
        more["intrinsic_confidence"] = half_width(std[:, 6:], dof, confidence)
    if joint is not None and len(views) > 1:
        labels["unknown"] = labels["unknown2"] = joint.unknowns()
        more["joint_covariance"] = joint.matrix
    group = dataset.group(
        "pose",
        labels | (coords or {}),
        rotation=rotation,
        origin=origin,
        euler=euler_from_rotation(rotation),
        covariance=covariance,
        euler_std=euler_std,
        origin_std=origin_std,
        euler_confidence=half_width(euler_std, dof, confidence),
        origin_confidence=half_width(origin_std, dof, confidence),
        dof=dof,
        **more,
    )
    group.attrs["confidence_level"] = confidence
    return group


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariance of the poses of all views and of their intrinsics.

    Parameters
    ----------
    own, shared : sequence of str
        Intrinsics adjusted for each view and for all views.
    matrix : ndarray, shape (unknown, unknown)
        Of every view's `EXTRINSICS` and own intrinsics, view by view, then of the shared ones.
    """

    views: Sequence[str]
    own: Sequence[str]
    shared: Sequence[str]
    matrix: Array

    @property
    def adjusted(self) -> list[str]:
        """All adjusted intrinsics of a view."""
        return [*self.own, *self.shared]

    def unknowns(self) -> list[str]:
        """Name the unknowns: ``view/parameter``, and the shared intrinsics as they are."""
        each = [label(v, p) for v in self.views for p in (*EXTRINSICS, *self.own)]
        return each + list(self.shared)

    def of_views(self) -> Array:
        """Give each view's covariance, that of the shared intrinsics in it, shape (view, p, p).

        The parameters are `EXTRINSICS`, the own and the shared intrinsics.
        """
        size, first = len(EXTRINSICS) + len(self.own), len(self.matrix) - len(self.shared)
        common = np.arange(first, len(self.matrix))
        places = [np.r_[k : k + size, common] for k in range(0, first, size)]
        return np.array([self.matrix[np.ix_(p, p)] for p in places])


def label(view: str, parameter: str) -> str:
    """Name a view's unknown in ``joint_covariance``.

    Examples
    --------
    >>> label("front", "rotation_x")
    'front/rotation_x'
    """
    return f"{view}/{parameter}"


def cross_covariance(pose: xr.Dataset, views: Sequence[str]) -> Array:
    """Take the covariance of some views' poses, between views too, from a group ``pose``.

    Without ``joint_covariance`` in the group its views are independent.

    Returns
    -------
    ndarray, shape (view, 6, view, 6), rad and m
        Of the `EXTRINSICS`.

    Examples
    --------
    >>> import numpy as np
    >>> two = pose_to_dataset(
    ...     ["a", "b"], [np.eye(3)] * 2, np.zeros((2, 3)), [np.eye(6)] * 2, [9, 9], 0.95
    ... )
    >>> cross_covariance(two, ["b", "a"])[0, :, 1].any()
    np.False_
    """
    count, size = len(views), len(EXTRINSICS)
    if "joint_covariance" in pose:
        of = [label(v, p) for v in views for p in EXTRINSICS]
        whole = pose["joint_covariance"].sel(unknown=of, unknown2=of).values
        return np.asarray(whole.reshape(count, size, count, size))
    names = list(EXTRINSICS)
    own = pose["covariance"].sel(view=list(views), parameter=names, parameter2=names).values
    whole = np.zeros((count, size, count, size))
    whole[np.arange(count), :, np.arange(count)] = own
    return whole
