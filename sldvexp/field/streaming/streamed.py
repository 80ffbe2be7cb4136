"""Field of a run whose frequencies do not fit into memory: solved block by block of them.

The equations' matrix, what views see and what noise and poses do to nodal values are the same for
all frequencies and are found once; right-hand sides, solutions and residuals are each frequency's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.field.bounds.advice import advice
from sldvexp.field.bounds.calibration import calibration_changes
from sldvexp.field.bounds.intercept_test import InterceptTest
from sldvexp.field.bounds.pointing import pointing_variance
from sldvexp.field.bounds.pose_uncertainty import ModeEffect, PoseErrors, of_modes, pose_covariance
from sldvexp.field.bounds.residuals_and_bounds import FieldBounds, residuals_only
from sldvexp.field.equations.assembly import Equations, real_columns, right_sides
from sldvexp.field.equations.conditioning import condition_numbers
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.system import Solve, solution
from sldvexp.field.equations.undetermined import Observability
from sldvexp.field.estimate import NO_COVARIANCE, check_views, solved_with
from sldvexp.field.fit import FieldEstimate, FieldSetUp
from sldvexp.field.result import pooled
from sldvexp.field.solvers.base import Solver
from sldvexp.field.streaming.compression import Compressed, FrequencyModes, slices
from sldvexp.field.streaming.dask import Work
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.image import Interpolation
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction import Reconstruction
from sldvexp.typing import Array
from sldvexp.volume import Coordinates, Volume


@dataclass(frozen=True, eq=False)
class Ready:
    """A field with everything that does not depend on the frequency; other processes can have it.

    Attributes
    ----------
    bounds : FieldBounds
        Variances from the noise of each view, and the covariance of the modes from the poses.
    intercepts : InterceptTest, optional
    compressed : Compressed
        Without images.
    """

    method: Reconstruction
    solver: Solver
    parts: RegionIterator
    equations: Equations
    flags: Observability
    bounds: FieldBounds
    intercepts: InterceptTest | None
    compressed: Compressed
    condition: tuple[float, float]
    messages: tuple[str, ...]

    @classmethod
    def from_compressed(
        cls,
        compressed: Compressed,
        visibility: VolumeVisibility,
        method: Reconstruction,
        solver: Solver,
        local: bool,
        errors: PoseErrors | None,
    ) -> Ready:
        """Fit the field to the modes, which gives all that the frequencies have in common."""
        check_views(visibility)
        poses = pose_covariance(visibility.views, None if errors is None else errors.covariance)
        data = [np.where(v.usable[:, None], v.velocity.real, 0.0) for v in visibility.views]
        own = FrequencyModes(np.eye(data[0].shape[1]))
        fit = FieldSetUp.from_images(visibility, method, local, data, modes=own).solved(
            solver, data
        )
        messages, modes = fit.messages, compressed.modes
        effect = None if poses is None else ModeEffect(poses, modes, fit.theta, data)
        if effect is None:
            messages.append(NO_COVARIANCE)
        bounds = fit.with_bounds(np.eye(len(visibility.views)), effect)
        test = fit.intercept_test(bounds, effect)
        others: dict[str, Array] = {}
        solved = solved_with(fit.parts.model, solver)
        if changes := calibration_changes(visibility, errors, solved):
            # Modes have no imaginary part.
            of_modes_alone = np.stack(changes)[..., ::2]
            others["calibration"] = _products(of_modes_alone).sum(axis=0)
            if test is not None and effect is not None:
                test = test.with_changes(of_modes_alone)
        pointing = pointing_variance(fit.parts, fit.equations.system, fit.solve, data)
        if pointing is not None:
            others["pointing"] = pointing
        bounds = replace(bounds, others=others, interpolation=fit.interpolation)
        return cls(
            method,
            solver,
            fit.parts,
            fit.equations,
            fit.flags,
            bounds,
            test,
            replace(compressed, images={}),
            condition_numbers(fit.equations.system, fit.roughly),
            tuple(messages),
        )

    def __getstate__(self) -> dict[str, Any]:
        """Leave out factors, which are made again with little work."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @cached_property
    def solve(self) -> Solve:
        """Solver with its factors."""
        return self.solver.prepare(self.equations.system)

    def block(self, some: slice, *velocity: NDArray[Any]) -> tuple[xr.Dataset, Array]:
        """Make the group ``field`` of some frequencies, and what advice is given by.

        Parameters
        ----------
        some : slice
            Which of all frequencies.
        *velocity : ndarray of complex, shape (pixel, frequency), m/s
            Each view's, at these frequencies.
        """
        visibility, model = self.parts.visibility, self.parts.model
        views = zip(velocity, visibility.views, strict=True)
        data = [real_columns(each, view.usable) for each, view in views]
        right = right_sides(self.parts, data)
        theta = solution(right, self.equations.system, self.solve)
        equations = replace(self.equations, right=right)
        bounds = replace(
            self._bounds_of(some), residuals=residuals_only(self.parts, theta, data).residuals
        )
        modes = None if self.bounds.pose is None else self._modes_of(some)
        factor, test = self.compressed.factor[:, some], None
        if self.intercepts is not None:
            confidence = self.method.confidence
            test = self.intercepts.test(theta, data, bounds, factor, modes, confidence)
        outcome = FieldEstimate(visibility, model, equations, self.flags, theta, bounds, test)
        result = outcome.result(list(self.messages), self.condition)
        result = replace(result, frequency=self.compressed.frequency[some])
        result = result.with_model_errors()
        return result.to_dataset(), result.mean_squares

    def _modes_of(self, some: slice) -> FrequencyModes:
        """Keep the modes of some frequencies' columns."""
        return self.compressed.modes.of_part(slice(2 * some.start, 2 * some.stop))

    def _bounds_of(self, some: slice) -> FieldBounds:
        """Select the bounds of some frequencies."""
        bounds, factor = self.bounds, self.compressed.factor[:, some]
        modes = self._modes_of(some)
        assert bounds.noise is not None
        assert bounds.expected is not None
        error = bounds.interpolation
        return replace(
            bounds,
            noise=bounds.noise @ factor,
            expected=bounds.expected @ factor,
            pose=None if bounds.pose is None else of_modes(modes, bounds.pose),
            others={name: of_modes(modes, kept) for name, kept in bounds.others.items()},
            interpolation=None if error is None else modes.to_columns(error),
        )


def _products(change: Array) -> Array:
    """Multiply all pairs of modes, from (..., mode) to (..., mode * mode)."""
    square = change[..., :, None] * change[..., None, :]
    return square.reshape(*change.shape[:-1], -1)


def stream_field(
    tree: Mapping[str, xr.Dataset],
    compressed: Compressed,
    visibility: VolumeVisibility,
    volume: Volume,
    method: Reconstruction,
    solver: Solver,
    work: Work,
    folder: Path,
) -> xr.Dataset:
    """Make the group ``field`` of a run by one method, as `field.estimate.reconstruct` does.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``, whose velocities are Dask arrays.
    compressed : Compressed
        Of these images.
    visibility : VolumeVisibility
        At its images.
    folder : Path
        For the blocks, which the group is made of as long as it is used.

    Returns
    -------
    xarray.Dataset
        Variables over the frequency are Dask arrays.
    """
    errors = PoseErrors.from_dataset(tree["pose"], visibility.names)
    local = volume.coordinates is Coordinates.local
    ready = Ready.from_compressed(compressed, visibility, method, solver, local, errors)
    shared = work.share(ready)
    images = [tree[f"image/{name}"]["velocity"] for name in visibility.names]
    blocks = slices(images[0], "frequency")
    tasks = ((shared, some, *(image.data[:, some] for image in images)) for some in blocks)
    squares: list[Array] = []

    def groups() -> Iterator[xr.Dataset]:
        for group, square in work.map(Ready.block, tasks):
            squares.append(square * group.sizes["frequency"])
            yield group

    whole = joined_blocks(groups(), folder)
    whole.attrs |= pooled(whole["sse"].values, whole.attrs["samples"])
    mean = np.sum(squares, axis=0) / len(compressed.frequency)
    cubic = visibility.interpolation is Interpolation.cubic
    advised = advice(mean, tuple(map(str, whole["component"].values)), cubic)
    whole.attrs["notes"] = "\n".join([*ready.messages, *advised])
    return dataset.with_findings(whole, visibility.findings)


def joined_blocks(groups: Iterable[xr.Dataset], folder: Path) -> xr.Dataset:
    """Write groups of some frequencies each to files, and join them there.

    Parameters
    ----------
    groups : iterable of xarray.Dataset
        One after the other along the frequency; everything else is that of the first.
    folder : Path
        Made for the files, which the group is made of as long as it is used.
    """
    folder.mkdir()
    paths, moving, still = [], list[Any](), xr.Dataset()
    for k, group in enumerate(groups):
        moving = [n for n, v in group.data_vars.items() if "frequency" in v.dims]
        paths.append(folder / f"{k:05d}.nc")
        dataset.save_table(group[moving].drop_vars(_labels(group[moving])), paths[-1])
        still = still if k else group.drop_vars(moving)
    return _joined(still, paths, moving)


def _labels(group: xr.Dataset) -> list[str]:
    """List coordinates that are the same in all blocks."""
    return [str(name) for name in group.coords if name != "frequency"]


def _joined(first: xr.Dataset, paths: Sequence[Path], moving: Sequence[Any]) -> xr.Dataset:
    """Join all blocks one after the other, in the files where they are."""
    lazily = xr.open_mfdataset(
        paths,
        engine="netcdf4",
        combine="nested",
        concat_dim="frequency",
        auto_complex=True,
        chunks={},
    )
    for name in moving:
        chunks = [sizes[0] for sizes in lazily[name].data.chunks]
        lazily[name].encoding = {"chunksizes": tuple(chunks)}
    return first.drop_vars("frequency", errors="ignore").assign(lazily.data_vars)
