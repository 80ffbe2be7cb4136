"""Groups of a run that a smooth field on the surface makes: the field in the volume, and strain.

All nodes of the volume get the velocity that Love's kinematics have at their height, so that every
later step works as with any other field; the nodes of the given surface get strains of the face, of
the middle and of the back, and stresses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp import dataset
from sldvexp.dataset import Finding, with_findings
from sldvexp.errors import UserError
from sldvexp.field.bounds.budget import SOURCES, by_source, not_included
from sldvexp.field.bounds.pose_uncertainty import POSE, PoseErrors, pose_covariance
from sldvexp.field.estimate import NO_COVARIANCE
from sldvexp.field.visibility.view import View, views_of
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.shell.around_holes import HoleFunctions
from sldvexp.shell.beyond_rim import strangers
from sldvexp.shell.calibration import CalibrationError, calibration_errors
from sldvexp.shell.ended import without, without_resting_sides
from sldvexp.shell.least_stretch import wall_stretch
from sldvexp.shell.love import STRAINS, ThinShell
from sldvexp.shell.material import Isotropic
from sldvexp.shell.method import GivenSurface, PoseTreatment, SurfaceReconstruction
from sldvexp.shell.nodal_velocity import NodalVelocity
from sldvexp.shell.nuisances import PriorErrors
from sldvexp.shell.outline import Outline
from sldvexp.shell.principal import PRINCIPAL
from sldvexp.shell.refusals import require_no_crossing, require_thin
from sldvexp.shell.shell import Shell
from sldvexp.shell.splines import TensorSplines
from sldvexp.shell.surface_fit import TYPICAL, SurfaceFit, fit
from sldvexp.shell.surface_strain import SurfaceStrain
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, BoolArray, ComplexArray
from sldvexp.volume import Coordinates, Prisms, Volume

#: Splines reach so far beyond the outermost pixel, over the rectangle's sides.
BEYOND = 1e-6
#: The splines' unit is this part of the longer side.
UNIT = 1 / 3
#: How often pixels beyond the surface are judged anew.
AGAIN = 6
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
    findings : list of Finding
    """

    fit: SurfaceFit
    prisms: Prisms
    volume: Volume
    method: SurfaceReconstruction
    material: Isotropic | None
    frequency: Array | None
    notes: list[str]
    findings: list[Finding] = dataclass_field(default_factory=list)

    @property
    def factor(self) -> float:
        """Half-width of an interval over the standard error."""
        return float(student_factor(self.method.confidence, np.inf))

    def of_lines(self, lines: slice) -> SurfaceField:
        """Keep some of the lines."""
        assert self.frequency is not None
        return replace(self, fit=self.fit.of_lines(lines), frequency=self.frequency[lines])

    def field(self) -> xr.Dataset:
        """Make the group ``field``."""
        local = self.volume.coordinates is Coordinates.local
        nodes = NodalVelocity(self.fit, self.prisms, local, self._hangs_from_face)
        values, variance = nodes.by_source()
        if NO_COVARIANCE in self.notes and not variance["pose"].any():
            del variance["pose"]  # nothing tells them, which is not that they are none
        std = np.sqrt(np.sum(list(variance.values()), axis=0))
        # What may be as large as all motion is not known at all.
        determined = (self.factor * std.max(axis=0) <= self.fit.size).any(axis=-1)
        sources, each = by_source(variance)
        coords = {
            "component": list(("t1", "t2", "n") if local else ("x", "y", "z")),
            "view": [p.view.name for p in self.fit.pixels],
            "part": ["real", "imaginary"],
            "source": sources,
            "equation": ["all components"],
        }
        squares, chi2_ratio = self._residual_squares()
        samples = np.array([len(p.pixel) for p in self.fit.pixels])
        sse, count = squares.sum(axis=0), int(samples.sum())
        with np.errstate(invalid="ignore"):
            by_view = np.sqrt(squares / samples[:, None])
        named = [source for source in ("noise", "pose") if source in variance]
        group = self._group(
            "field",
            coords,
            velocity=values,
            velocity_std=std.max(axis=0),
            confidence=self.factor * std.max(axis=0),
            **{f"velocity_std_{k}": np.sqrt(variance[k]).max(axis=0) for k in named},
            velocity_std_by_part=std,
            confidence_by_part=self.factor * std,
            variance=each,
            sse=sse[None],
            residual_std=np.sqrt(sse / count)[None],
            chi2_ratio=chi2_ratio[None],
            residual_std_by_view=by_view,
            always={
                "position": self.prisms.position,
                "element": self.prisms.element.astype(np.int32),
                "observable": determined,
                "samples_seen": samples,
            },
        )
        untold = [text for text in not_included(variance) if text not in NEVER]
        group.attrs |= {
            "dof": self.fit.shell.coefficients,
            "samples": count,
            "sse": float(sse.sum()),
            "residual_std": float(np.sqrt(sse.mean() / count)),
            "cond": self.fit.posterior.condition,
            "coordinate_system": "local" if local else "world",
            "given_surface": self.method.given.value,
            **self._face,
            "confidence_level": self.method.confidence,
            "not_included": "; ".join([*untold, *self._thickness_taken]),
            "notes": "\n".join(self.notes),
        }
        return with_findings(with_undetermined(group, determined), self.findings)

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
        notes = _vague(found["strain"], found["confidence"])
        group.attrs |= {"confidence_level": self.method.confidence, "notes": "\n".join(notes)}
        if self.method.of_middle and self.material is not None:
            group.attrs["thickness"] = self.material.thickness
            group.attrs["thickness_std"] = self.material.tolerance.thickness
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
    def _thickness_taken(self) -> list[str]:
        """Name the thickness if results rest on it and nothing is said of how well it is known."""
        sheet = self.material
        if sheet is None or not self.method.of_middle or sheet.tolerance.thickness:
            return []
        return [f"thickness of the sheet, taken as {1e3 * sheet.thickness:.4g} mm"]

    @property
    def _face(self) -> dict[str, float]:
        """Depth of the measured face, m, as an attribute of the field, where one knows it."""
        if self.material is None:
            return {}
        face, given = _heights(self.method, self.material)
        return {"face_depth": face - given}

    @property
    def _hangs_from_face(self) -> bool:
        """True if nodes are laid around the face, so that the thickness decides their height."""
        return self.method.of_middle and self.method.given is GivenSurface.face

    def _residual_squares(self) -> tuple[Array, Array]:
        """Add up squared residuals, (view, frequency), and compare them with the stated noise."""
        measured, lines = self.fit.measured, len(self.fit.measured.scale)
        squares, white = np.zeros((len(self.fit.pixels), lines)), np.zeros(lines)
        for k, some, left in self.fit.residuals():
            square = np.abs(left) ** 2
            squares[k] += square.sum(axis=0)
            white += (square / measured.pixel_std[some, None] ** 2).sum(axis=0)
        return squares, white / len(measured.pixel_std) / measured.scale**2 / 2

    def _group(
        self,
        name: str,
        coords: Mapping[str, Any],
        always: Mapping[str, Any],
        **arrays: NDArray[Any] | None,
    ) -> xr.Dataset:
        """Make a group, without a frequency dimension if the run does not know the one there is."""
        known = self.frequency is not None
        coords = {**coords, "frequency": self.frequency} if known else dict(coords)
        given = {key: np.asarray(v) for key, v in arrays.items() if v is not None}
        last = {key: v if known else v[..., 0] for key, v in given.items()}
        return dataset.group(name, coords, **last, **always)


def reconstruct_surface(
    tree: Mapping[str, xr.Dataset],
    laser: TwoMirror,
    volume: Volume,
    method: SurfaceReconstruction,
    material: Isotropic | None,
    reduced: Mapping[str, xr.Dataset] | None = None,
) -> SurfaceField:
    """Estimate a smooth field on the volume's surface from the groups of a run.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``.
    reduced : mapping of str to xarray.Dataset, optional
        Images of few lines to look for pixels in, where those of the tree are Dask arrays, which
        are read some pixels at a time.

    Raises
    ------
    UserError
        See `estimate_surface`.
    """
    views = views_of({**tree, **(reduced or {})}, laser)
    image = tree[f"image/{views[0].name}"]
    frequency = image["frequency"].values if "frequency" in image.coords else None
    known = PoseErrors.from_dataset(tree["pose"], [v.name for v in views])
    if reduced is None:
        images, std = [v.velocity for v in views], [v.std for v in views]
    else:
        own = [tree[f"image/{v.name}"] for v in views]
        images, std = [i["velocity"].data for i in own], [i["velocity_std"].data for i in own]
    joint = None if known is None else known.covariance
    errors = calibration_errors(views, laser, known)
    return _estimate(views, images, std, laser, volume, method, material, frequency, joint, errors)


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
    images, std = [v.velocity for v in views], [v.std for v in views]
    errors = calibration_errors(views, laser, None)
    return _estimate(
        views, images, std, laser, volume, method, material, given_frequency, covariance, errors
    )


def _estimate(
    views: Sequence[View],
    images: Sequence[Any],
    std: Sequence[Any],
    laser: TwoMirror,
    volume: Volume,
    method: SurfaceReconstruction,
    material: Isotropic | None,
    frequency: Array | None,
    covariance: Array | None,
    calibration: list[CalibrationError],
) -> SurfaceField:
    """Do what `estimate_surface` does, with images that need not be in memory."""
    if volume.sight.both_sides and not method.of_middle:
        raise UserError(
            "reconstruction=spline assumes nothing of the inside, so that views from behind tell "
            "it nothing of the face: choose reconstruction=shell, or volume.sight.both_sides=false"
        )
    face, given = _heights(method, material)
    prisms = volume.prisms()
    outline = Outline.of(volume, prisms, given)
    require_no_crossing(outline)
    if material is not None:
        require_thin(outline, material.thickness)
    longest = float((outline.high - outline.low).max())
    length, level = None, 1.0
    if isinstance(method, Shell):
        length, level = method.membrane_length or LENGTH * longest, method.membrane_level
    notes = []
    joint = pose_covariance(views, covariance)
    if joint is None:
        notes.append(NO_COVARIANCE)
        joint = np.zeros((POSE * len(views),) * 2)
    thickness = 0.0 if material is None else material.tolerance.thickness
    errors = PriorErrors.of(
        joint,
        calibration,
        method.height_tolerance,
        thickness,
        method.poses is PoseTreatment.adjust,
    )
    nu = material.nu if method.of_middle and material is not None else None
    shell = _splines(outline, method, longest, nu)

    def fitted(views: Sequence[View]) -> SurfaceFit:
        return fit(views, images, std, laser, outline, shell, face, length, level, errors)

    found, views, ended = without_resting_sides(fitted, views, volume)
    found, told = _without_strangers(fitted, found, views)
    notes += [*_told(found), *told]
    return SurfaceField(found, prisms, volume, method, material, frequency, notes, ended)


def _without_strangers(
    fitted: Callable[[Sequence[View]], SurfaceFit], found: SurfaceFit, views: Sequence[View]
) -> tuple[SurfaceFit, list[str]]:
    """Fit without pixels beyond the surface that are not of the structure, and name these."""
    left = [np.zeros(0, np.intp) for _ in views]
    for _ in range(AGAIN):
        more = strangers(found)
        if not sum(map(len, more)):
            break
        left = [np.concatenate(pair) for pair in zip(left, more, strict=True)]
        found = fitted([without(v, out) for v, out in zip(views, left, strict=True)])
    told = [
        f"{len(out)} {'pixel' if len(out) == 1 else 'pixels'} of view {view.name} beyond the "
        "surface's rim left out, which do not move as the structure does: something stands in the "
        "beam there, or the structure ends before volume.margin does"
        for view, out in zip(views, left, strict=True)
        if len(out)
    ]
    return found, told


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


def _splines(
    outline: Outline, method: SurfaceReconstruction, longest: float, nu: float | None
) -> ThinShell:
    """Lay splines over the structure; those of a closed shell know its stretch, with nu."""
    rim = BEYOND * longest
    low, high, unit = outline.low - rim, outline.high + rim, UNIT * longest
    closed = outline.closed
    if closed:
        low[0], high[0] = outline.low[0], outline.high[0]
    bending = TensorSplines.over(low, high, method.cells, 5, unit, closed)
    membrane = TensorSplines.over(low, high, method.membrane_cells, 3, unit, closed)
    return ThinShell(
        bending,
        membrane,
        outline.chart,
        HoleFunctions.of(outline.holes, longest / method.cells),
        wall_stretch(outline.chart, bending, membrane, nu) if closed and nu is not None else None,
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
    if len(unseen) == len(found.pixels) - 1 and found.face:
        told.append(
            "one view sees the face: it cannot tell the middle's own motion along itself from "
            f"bending; bounds have in them what is typical of it, {TYPICAL:.0%} of the velocities"
        )
    if unseen:
        side = "surface" if found.outline.both_sides else "face"
        told.append(
            f"the views {', '.join(unseen)} do not see the {side}, and have no say"
            if len(unseen) > 1
            else f"the view {unseen[0]} does not see the {side}, and has no say"
        )
    return told


def with_undetermined(field: xr.Dataset, determined: BoolArray) -> xr.Dataset:
    """Tell which components of a field are determined at which nodes, and note where not.

    Parameters
    ----------
    field : xarray.Dataset
        The group ``field``.
    determined : ndarray of bool, shape (node, component)
        Where bounds are smaller than all motion there is.
    """
    notes = [field.attrs["notes"]] if field.attrs["notes"] else []
    for name, column in zip(field["component"].values, determined.T, strict=True):
        if left := int((~column).sum()):
            notes.append(
                f"{name} is not determined at {left} of {len(column)} nodes: its bounds are larger "
                "than all motion there is; too few pixels or views see them"
            )
    values = determined.astype(field["observable"].dtype)
    field = field.assign(observable=field["observable"].copy(data=values))
    return field.assign_attrs(notes="\n".join(notes))


def _vague(strain: ComplexArray, bound: Array) -> Iterator[str]:
    """Name strains whose bounds are larger than the largest strain at every frequency."""
    rms, wide = (np.sqrt(np.mean(np.abs(a) ** 2, axis=0)) for a in (strain, bound))
    vague = (wide > rms.max(axis=0)).all(axis=-1)
    if vague.any():
        names = ", ".join(f"e_{s}" for s, v in zip(STRAINS, vague, strict=True) if v)
        sizes = ", ".join(f"{1e6 * v:.2g}" for v in wide[vague].min(axis=-1))
        yield (
            f"the bounds of {names}, {sizes} microstrain, are larger than all strain: it takes "
            "more views or pixels to tell it"
        )
