"""Groups of a run that a smooth field on the surface makes: the field in the volume, and strain.

All nodes of the volume get the velocity that Love's kinematics have at their height, so that every
later step works as with any other field; the nodes of the given surface get strains of the face, of
the middle and of the back, and stresses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.field.bounds.budget import SOURCES, by_source, not_included
from sldvexp.field.bounds.pose_uncertainty import POSE, PoseErrors, pose_covariance
from sldvexp.field.estimate import NO_COVARIANCE
from sldvexp.field.visibility.view import View, views_of
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.shell.love import STRAINS, ThinShell
from sldvexp.shell.material import Isotropic
from sldvexp.shell.method import GivenSurface, PoseTreatment, SurfaceReconstruction
from sldvexp.shell.outline import Outline
from sldvexp.shell.principal import PRINCIPAL
from sldvexp.shell.shell import Shell
from sldvexp.shell.splines import TensorSplines
from sldvexp.shell.surface_fit import PriorErrors, SurfaceFit, fit
from sldvexp.shell.surface_strain import SurfaceStrain
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, ComplexArray
from sldvexp.volume import Coordinates, Prisms, Volume

#: Splines reach so far beyond the outermost pixel, over the rectangle's sides.
BEYOND = 1e-6
#: The splines' unit is this part of the longer side.
UNIT = 1 / 3
#: Length over which the middle's motion along itself varies, over the longer side.
LENGTH = 2 / 3

#: Results on the surface that have intervals of their own.
WITH_BOUND = (
    *("strain", "middle_strain", "back_strain", "bending_strain", "principal_strain"),
    "von_mises",
)

#: Step of the difference by which strains are differentiated by the height, m.
STEP = 1e-6

#: Sources that other fields have, and splines through the pixels themselves do not.
NEVER = (SOURCES["interpolation"], SOURCES["elements"])


@dataclass(frozen=True, eq=False)
class SurfaceField:
    """Field of one method on a volume's surface.

    Attributes
    ----------
    fit : SurfaceFit
    prisms : Prisms
    volume : Volume
    method : SurfaceReconstruction
    material : Isotropic, optional
    frequency : ndarray, shape (frequency,), Hz, optional
    notes : list of str
    """

    fit: SurfaceFit
    prisms: Prisms
    volume: Volume
    method: SurfaceReconstruction
    material: Isotropic | None
    frequency: Array | None
    notes: list[str]

    @property
    def factor(self) -> float:
        """Half-width of an interval over the standard error."""
        return float(student_factor(self.method.confidence, np.inf))

    def field(self) -> xr.Dataset:
        """Make the group ``field``."""
        local = self.volume.coordinates is Coordinates.local
        rows = self._velocity_rows(local)
        nodes = self.prisms.nodes
        thicker = self._velocity_rows(local, by_height=True) if self._hangs_from_face else None
        values, own, others = self.fit.evaluate(
            np.concatenate(rows), None if thicker is None else np.concatenate(thicker) / 2
        )

        def by_component(array: NDArray[Any]) -> NDArray[Any]:
            return np.moveaxis(array.reshape(*array.shape[:-2], 3, nodes, -1), -3, -2)

        variance = {"noise": by_component(own), "pose": by_component(others)}
        std = np.sqrt(variance["noise"] + variance["pose"])
        sources, each = by_source(variance)
        coords = {
            "component": list(("t1", "t2", "n") if local else ("x", "y", "z")),
            "view": [p.view.name for p in self.fit.pixels],
            "part": ["real", "imaginary"],
            "source": sources,
            "equation": ["all components"],
        }
        left, count = self.fit.residual, len(self.fit.residual)
        squares = np.sum(np.abs(left) ** 2, axis=0)
        ends = np.cumsum([len(p.pixel) for p in self.fit.pixels])[:-1]
        by_view = np.stack([np.sqrt(np.mean(np.abs(v) ** 2, axis=0)) for v in np.split(left, ends)])
        group = self._group(
            "field",
            coords,
            velocity=by_component(values),
            velocity_std=std.max(axis=0),
            confidence=self.factor * std.max(axis=0),
            velocity_std_noise=np.sqrt(variance["noise"]).max(axis=0),
            velocity_std_pose=np.sqrt(variance["pose"]).max(axis=0),
            velocity_std_by_part=std,
            confidence_by_part=self.factor * std,
            variance=each,
            sse=squares[None],
            residual_std=np.sqrt(squares / count)[None],
            chi2_ratio=self._chi_square_ratio()[None],
            residual_std_by_view=by_view,
            always={
                "position": self.prisms.position,
                "element": self.prisms.element.astype(np.int32),
                "observable": np.ones((nodes, 3), bool),
                "samples_seen": [len(p.pixel) for p in self.fit.pixels],
            },
        )
        group.attrs |= {
            "dof": self.fit.shell.coefficients,
            "samples": count,
            "sse": float(squares.sum()),
            "residual_std": float(np.sqrt(squares.mean() / count)),
            "cond": float(np.linalg.cond(self.fit.posterior.factors[0]) ** 2),
            "coordinate_system": "local" if local else "world",
            "confidence_level": self.method.confidence,
            "not_included": "; ".join(t for t in not_included(variance) if t not in NEVER),
            "notes": "\n".join(self.notes),
        }
        return group

    def strain(self) -> xr.Dataset:
        """Make the group ``strain``, at the nodes of the given surface."""
        assert self.frequency is not None
        place, chart = self.fit.outline.corners, self.fit.outline.chart
        results = SurfaceStrain(self.fit, self.frequency, self.material, self.method.of_middle)
        found = results.arrays(place)
        bounded = [n for n in found if n.endswith("_std") and n.removesuffix("_std") in WITH_BOUND]
        for name in bounded:
            # strain_std, middle_strain_std: confidence, middle_confidence
            bound = f"{name.removesuffix('_std')}_confidence".replace("strain_", "")
            found[bound] = self.factor * found[name]
        coords = {
            "strain_component": list(STRAINS),
            "principal": list(PRINCIPAL),
            "part": ["real", "imaginary"],
            "local_axis": ["t1", "t2", "n"],
        }
        always = {
            "position": self.prisms.surface,
            "triangle": self.prisms.triangles,
            "coordinate": place,
            "frame": chart.frames(place),
        }
        group = self._group("strain", coords, always=always, **found)
        group.attrs |= {"confidence_level": self.method.confidence}
        return group

    def strain_of(
        self, rows: Array, row_at: Sequence[Callable[[ThinShell, float], Array]]
    ) -> tuple[ComplexArray, Array]:
        """Compute strains of the face that are linear in the coefficients, with their variances.

        Parameters
        ----------
        rows : ndarray, shape (strain, coefficient), 1/m
            At the height of the face.
        row_at : sequence of callable
            Make each of them at any height, for what the thickness does to it.

        Returns
        -------
        strain : ndarray of complex, shape (strain, frequency)
        variance : ndarray, shape (part, strain, frequency)
        """
        assert self.frequency is not None
        face, omega = self.fit.face, 2 * np.pi * self.frequency
        higher = np.stack([make(self.fit.shell, face + STEP) for make in row_at])
        values, own, others = self.fit.evaluate(rows, (higher - rows) / STEP / 2)
        # (a + ib) / (i omega) = b / omega - i a / omega: the parts change places.
        return values / (1j * omega), (own + others)[::-1] / omega**2

    @property
    def _hangs_from_face(self) -> bool:
        """True if nodes are laid around the face, so that the thickness decides their height."""
        return self.method.of_middle and self.method.given is GivenSurface.face

    def _velocity_rows(self, local: bool, by_height: bool = False) -> list[Array]:
        """Make the rows of every component at all nodes, or their derivatives by the height."""
        place, height = self.fit.outline.chart.place(self.prisms.position)
        shell = self.fit.shell
        own = shell.velocity_by_height(place) if by_height else shell.velocity(place, height)
        frames = self.fit.outline.chart.frames(place)
        if local:
            axes = np.tile(self.prisms.frame, (len(self.prisms.depth), 1, 1))
            turn = np.einsum("nai,nbi->nab", axes, frames)
        else:
            turn = np.swapaxes(frames, 1, 2)
        return [sum(turn[:, a, i, None] * own[i] for i in range(3)) for a in range(3)]

    def _chi_square_ratio(self) -> Array:
        """Compare residuals with the stated noise, of every frequency."""
        measured = self.fit.measured
        white = self.fit.residual / measured.pixel_std[:, None] / measured.scale
        return np.asarray(np.mean(np.abs(white) ** 2, axis=0) / 2)

    def _group(
        self,
        name: str,
        coords: Mapping[str, Any],
        always: Mapping[str, Any],
        **arrays: NDArray[Any],
    ) -> xr.Dataset:
        """Make a group, without a frequency dimension if the run does not know the one there is."""
        known = self.frequency is not None
        coords = {**coords, "frequency": self.frequency} if known else dict(coords)
        last = {key: np.asarray(v) if known else np.asarray(v)[..., 0] for key, v in arrays.items()}
        return dataset.group(name, coords, **last, **always)


def reconstruct_surface(
    tree: Mapping[str, xr.Dataset],
    laser: TwoMirror,
    volume: Volume,
    method: SurfaceReconstruction,
    material: Isotropic | None,
) -> SurfaceField:
    """Estimate a smooth field on the volume's surface from the groups of a run.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``.

    Raises
    ------
    UserError
        See `estimate_surface`.
    """
    views = views_of(tree, laser)
    image = tree[f"image/{views[0].name}"]
    frequency = image["frequency"].values if "frequency" in image.coords else None
    known = PoseErrors.from_dataset(tree["pose"], [v.name for v in views])
    joint = None if known is None else known.whole
    return estimate_surface(
        views, laser, volume, method, material, frequency=frequency, covariance=joint
    )


def estimate_surface(
    views: Sequence[View],
    laser: TwoMirror,
    volume: Volume,
    method: SurfaceReconstruction,
    material: Isotropic | None = None,
    *,
    frequency: ArrayLike | None = None,
    covariance: Array | None = None,
) -> SurfaceField:
    """Estimate a smooth field on the volume's surface from views of it.

    Parameters
    ----------
    views : sequence of View
        Poses and velocity images.
    laser : TwoMirror
        Which all views were taken with.
    volume : Volume
        Around a surface that is flat or bends along one direction.
    method : SurfaceReconstruction
    material : Isotropic, optional
        The sheet's thickness, which `Shell` needs.
    frequency : array_like, shape (frequency,), Hz, optional
        Of the views' images; strains need it.
    covariance : ndarray, shape (6 views, 6 views), optional
        Of all poses together; without it that of each view, by itself.

    Raises
    ------
    UserError
        If a thickness is needed and not given, the surface bends both ways, or too few pixels see
        it.

    Examples
    --------
    A plate that moves as a whole along its normal, seen from three places:

    >>> import numpy as np
    >>> from sldvexp import field, shell, volume
    >>> from sldvexp.laser.model import direction_cosines
    >>> from sldvexp.laser.two_mirror import TwoMirror
    >>> rng, laser, rotation = np.random.default_rng(1), TwoMirror(), np.diag([1.0, -1.0, -1.0])
    >>> step = np.radians(np.linspace(-22, 22, 33))
    >>> angle = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    >>> seen = direction_cosines(angle) @ rotation @ [0, 0, 2e-3]
    >>> views = []
    >>> for name, x, y in ("left", -0.4, -0.3), ("right", 0.4, -0.3), ("top", 0.0, 0.4):
    ...     image, origin = seen + rng.normal(scale=1e-6, size=len(seen)), [x, y, 1.5]
    ...     view = field.View.from_arrays(
    ...         name, rotation, origin, image, 1e-6, angle=angle, laser=laser
    ...     )
    ...     views.append(view)
    >>> plate = volume.Grid(size=[0.2, 0.2], shape=[3, 3], layers=2)
    >>> sheet = shell.Isotropic(thickness=0.002)
    >>> found = shell.estimate_surface(views, laser, plate, shell.Shell(), sheet, frequency=[100.0])
    >>> np.abs(1e3 * found.field()["velocity"].values[0, :, 0]).round(2).tolist()
    [0.0, 0.0, 2.0]
    """
    given_frequency = None if frequency is None else np.asarray(frequency, float)
    face, given = _heights(method, material)
    prisms = volume.prisms()
    outline = Outline.of(volume, prisms, given)
    longest = float((outline.high - outline.low).max())
    length = None
    if isinstance(method, Shell):
        length = method.membrane_length or LENGTH * longest
    notes = []
    joint = pose_covariance(views, covariance)
    if joint is None:
        notes.append(NO_COVARIANCE)
        joint = np.zeros((POSE * len(views),) * 2)
    thickness = 0.0 if material is None else material.tolerance.thickness
    errors = PriorErrors.of(
        joint, method.height_tolerance, thickness, method.poses is PoseTreatment.adjust
    )
    shell = _splines(outline, method, longest)
    found = fit(views, laser, outline, shell, face, length, errors)
    return SurfaceField(
        found, prisms, volume, method, material, given_frequency, [*notes, *_told(found)]
    )


def _heights(method: SurfaceReconstruction, material: Isotropic | None) -> tuple[float, float]:
    """Find the heights of the face and of the volume's surface above the splines' surface, m."""
    if material is None:
        if method.of_middle:
            raise UserError(
                "needs the sheet's thickness: choose material=aluminium material.thickness=0.003 "
                "(m), or reconstruction=spline, which assumes nothing of the inside"
            )
        return 0.0, 0.0
    half = material.thickness / 2
    if method.of_middle:
        return half, half if method.given is GivenSurface.face else 0.0
    return 0.0, 0.0 if method.given is GivenSurface.face else -half


def _splines(outline: Outline, method: SurfaceReconstruction, longest: float) -> ThinShell:
    """Lay splines over the structure."""
    rim = BEYOND * longest
    low, high, unit = outline.low - rim, outline.high + rim, UNIT * longest
    return ThinShell(
        TensorSplines.over(low, high, method.cells, 5, unit),
        TensorSplines.over(low, high, method.membrane_cells, 3, unit),
        outline.chart.curvature,
    )


def _told(found: SurfaceFit) -> list[str]:
    """Say what a user must know of the fit."""
    told = []
    if not found.measured.stated:
        told.append(
            "the pixels' noise is not stated; it is taken from what splines without priors leave "
            f"over: {1e3 * found.measured.pixel_std[0]:.3g} mm/s"
        )
    unseen = [p.view.name for p in found.pixels if not len(p.pixel)]
    if unseen:
        told.append(f"the views {', '.join(unseen)} do not see the face, and have no say")
    return told
