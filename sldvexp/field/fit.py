"""Fit of a field: solved first, then put into a result with residuals and bounds.

`FieldFit` has the equations with their solution theta, `FieldEstimate` all that is known of the
field at the end. The steps are apart since a stream of frequencies fits once and then makes many
results.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.bounds.efficiency import UNKNOWN, LeastVariance, least_variance_model
from sldvexp.field.bounds.intercept_test import INTERCEPT, InterceptTest
from sldvexp.field.bounds.interpolation_error import interpolation_errors
from sldvexp.field.bounds.pose_uncertainty import PoseEffect
from sldvexp.field.bounds.residuals_and_bounds import (
    FieldBounds,
    data_modes,
    variance_factors,
    with_bounds,
)
from sldvexp.field.equations.assembly import Equations, joint_equations
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import Solve, solution
from sldvexp.field.equations.undetermined import (
    Observability,
    constrain_singular,
    describe_undetermined,
    factorise,
    find_undetermined,
)
from sldvexp.field.result import LOCAL, WORLD, FieldResult
from sldvexp.field.solvers.base import Solver
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.field.visibility.coverage import flagged
from sldvexp.field.visibility.holes import nodes_in_holes
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.reconstruction import Reconstruction
from sldvexp.reconstruction.observability import blank
from sldvexp.statistics import FTest
from sldvexp.typing import Array, BoolArray

#: Methods whose equations are kept for the next solver; a small system takes up to 100 MB.
KEPT = 2


@dataclass(frozen=True, eq=False)
class FieldSetUp:
    """Equations of a field by a method, as they are before any solver has a part in it.

    Attributes
    ----------
    loose : Equations
        With the flags `found`, before they were made regular.
    modes : FrequencyModes, optional
        Of the data; None without bounds.
    best : LeastVariance, optional
        What bounds are compared with.
    notes : tuple of str
        What is not known of the fit, in sentences.
    """

    parts: RegionIterator
    loose: Equations
    found: Observability
    equations: Equations
    flags: Observability
    modes: FrequencyModes | None = None
    best: LeastVariance | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def from_images(
        cls,
        visibility: VolumeVisibility,
        method: Reconstruction,
        local: bool,
        data: list[Array],
        *,
        bounds: bool = True,
        modes: FrequencyModes | None = None,
    ) -> FieldSetUp:
        """Go through all samples once.

        Parameters
        ----------
        bounds : bool
            Whether bounds are to come, for which right sides of the interpolation's errors and the
            equations of the least variance are set up as well.
        modes : FrequencyModes, optional
            Of the data, where they are known.
        """
        parts = RegionIterator(visibility, FieldModel.from_method(method, visibility, local))
        model, columns = None, [data]
        if bounds:
            model = least_variance_model(visibility, parts.model)
            factor = variance_factors(visibility.views, parts.model.pixel_std)
            modes = data_modes(parts.model, data, factor) if modes is None else modes
            errors = interpolation_errors(visibility, [modes.of_columns(d) for d in data])
            columns += [] if errors is None else [errors]
        key = "least variance", local
        best: LeastVariance | None = (visibility.common or {}).get(key) if model else None
        if model is None or best is not None:
            (equations,) = joint_equations([parts], [columns])
        else:
            of_best, nothing = parts.with_model(model), [d[:, :0] for d in data]
            equations, others = joint_equations([parts, of_best], [columns, [nothing]])
            best = LeastVariance.from_equations(of_best, others)
            if visibility.common is not None and equations.system.is_small:
                visibility.common[key] = best
        found = find_undetermined(
            equations, nodes_in_holes(visibility.views, visibility.laser, visibility.prisms)
        )
        firm, left = constrain_singular(equations, found) if bounds else (equations, found)
        notes = (UNKNOWN,) if model is not None and best is None else ()
        return cls(parts, equations, found, firm, left, modes, best, notes)

    @classmethod
    def recalled(
        cls,
        visibility: VolumeVisibility,
        method: Reconstruction,
        local: bool,
        data: list[Array],
        *,
        bounds: bool = True,
    ) -> FieldSetUp:
        """Set up equations of the views' own images, or recall those of another solver's fit.

        Small ones are kept, where `VolumeVisibility.common` is there to keep them.
        """
        key, common = ("equations", repr(method), local, bounds), visibility.common
        if common is not None and key in common:
            kept: FieldSetUp = common[key]
            return kept
        made = cls.from_images(visibility, method, local, data, bounds=bounds)
        if common is not None and made.equations.system.is_small:
            for other in [k for k in common if k[0] == key[0]][: 1 - KEPT or None]:
                del common[other]
            common[key] = made
        return made

    def solved(self, solver: Solver, data: list[Array]) -> FieldFit:
        """Solve the equations.

        Raises
        ------
        UserError
            See `sldvexp.field.estimate.solve_field`.
        """
        parts, found = self.parts, self.flags
        if self.found.observable.any() and not found.observable.any():
            factorise(solver, self.loose, self.found)  # which may say why
        if not found.observable.any():
            raise UserError(
                f"field: nothing is determined anywhere by the rows {parts.model.rows}; "
                + "; ".join(_messages(parts, self.equations, found))
            )
        equations, solve = factorise(solver, self.equations, found)
        theta, *errors = (
            solution(right, equations.system, solve)
            for right in (equations.right, *equations.further)
        )
        return FieldFit(
            parts,
            data,
            replace(equations, further=()),
            found,
            solve,
            solver.roughly(equations.system, solve),
            theta,
            self.modes,
            errors[0] if errors else None,
            self.best,
            self.notes,
        )


@dataclass(frozen=True, eq=False)
class FieldFit:
    """Least-squares fit of a field to columns of velocities.

    Attributes
    ----------
    data : list of ndarray, shape (pixel, column), m/s
        Of each view.
    roughly : callable
        As `solve`, for what is told with few digits.
    theta : ndarray, shape (layer, surface_node, parameter, column)
    modes : FrequencyModes, optional
        Of the data; None without bounds.
    interpolation : ndarray, shape (layer, surface_node, parameter, mode), m/s, optional
        Error of the modes' nodal values by interpolation; None if no pixel tells.
    best : LeastVariance, optional
        What bounds are compared with.
    notes : tuple of str
        What is not known of it, in sentences.
    """

    parts: RegionIterator
    data: list[Array]
    equations: Equations
    flags: Observability
    solve: Solve
    roughly: Solve
    theta: Array
    modes: FrequencyModes | None = None
    interpolation: Array | None = None
    best: LeastVariance | None = None
    notes: tuple[str, ...] = ()

    @property
    def messages(self) -> list[str]:
        """About nodes where not all is determined, and what is not known of the fit."""
        return [*_messages(self.parts, self.equations, self.flags), *self.notes]

    def with_bounds(self, factor: Array, pose: PoseEffect | None) -> FieldBounds:
        """Compute residuals and bounds; see `field.bounds.residuals_and_bounds.with_bounds`."""
        system = self.equations.system
        determined = self.flags.determined.reshape(*system.active.shape, -1)
        return with_bounds(
            self.parts,
            system,
            self.roughly,
            self.theta,
            self.data,
            determined,
            factor,
            pose,
            self.best,
        )

    def intercept_test(self, found: FieldBounds, pose: PoseEffect | None) -> InterceptTest | None:
        """Prepare the test of the intercepts; None if there is none.

        Samples that are solved one by one have no residuals that tell their noise.
        """
        model, system = self.parts.model, self.equations.system
        if not model.intercept or model.contravariant or not np.any(found.noise):
            return None
        assert found.noise is not None
        known = self.flags.determined[:, INTERCEPT].reshape(system.active.shape)
        variance = found.noise[:, :, INTERCEPT].mean(axis=-1)
        return InterceptTest.prepare(self.parts, system, self.solve, known, variance, pose)


def _messages(parts: RegionIterator, equations: Equations, found: Observability) -> list[str]:
    axes = LOCAL if parts.model.local else WORLD
    told = describe_undetermined(found, parts.visibility.prisms.position, axes)
    lost = flagged(equations.coverage)
    told = [*told, lost] if told and lost else told
    return [*told, note] if (note := parts.model.rows.note) else told


#: Error of bounds, as far as it was found, above which the user is told.
WORTH_TELLING = 0.05


@dataclass(frozen=True, eq=False)
class FieldEstimate:
    """A solved field.

    Parameters
    ----------
    theta : ndarray, shape (layer, surface_node, parameter, column)
    """

    visibility: VolumeVisibility
    model: FieldModel
    equations: Equations
    flags: Observability
    theta: Array
    bounds: FieldBounds
    intercept_test: FTest | None = None

    @classmethod
    def from_fit(
        cls, fit: FieldFit, bounds: FieldBounds, test: FTest | None = None
    ) -> FieldEstimate:
        """Take over a fit."""
        parts, equations = fit.parts, fit.equations
        return cls(parts.visibility, parts.model, equations, fit.flags, fit.theta, bounds, test)

    def result(
        self, messages: list[str], condition: tuple[float, float] = (np.nan, np.nan)
    ) -> FieldResult:
        """Make the result, without what is not determined."""
        nodal = self._by_node(self.theta).view(complex).copy()
        known, error = self.flags.determined[..., None], self.bounds.error
        blank(nodal, ~self.flags.determined)
        if error > WORTH_TELLING:
            messages.append(
                "standard errors are approximations here: at the few nodes where exact ones were "
                f"computed they differ by up to {error:.0%}"
            )
        return FieldResult(
            components=LOCAL if self.model.local else WORLD,
            velocity=nodal[:, :3],
            observable=self.flags.observable,
            flagged_node=self.flags.node,
            flagged_rank=self.flags.rank,
            flagged_direction=self.flags.direction,
            rows=self.model.rows,
            intercept=nodal[:, 3] if self.model.intercept else None,
            cond=condition[0],
            rcond=condition[1],
            intercept_test=self.intercept_test,
            efficiency=self._efficiency(),
            bounds_error=error,
            coverage=self.equations.coverage,
            messages=tuple(messages),
            visibility=self.visibility,
            method=self.model.method,
            **self._bounds(known),
            **self._statistics(),
        )

    def _by_node(self, values: Array) -> Array:
        """Turn (layer, surface_node, ...) into (node, ...)."""
        return np.ascontiguousarray(values.reshape(-1, *values.shape[2:]))

    def _bounds(self, known: BoolArray) -> dict[str, Any]:
        """Compute variances by source; NaN where nothing is determined."""
        found = self.bounds
        if found.noise is None:
            return {"variance": {}, "intercept_std": None}
        variance = {"noise": self._by_node(found.noise)[None]}
        others = found.others if found.pose is None else {"pose": found.pose, **found.others}
        for name, columns in others.items():
            columns = self._by_node(columns)
            variance[name] = np.stack([columns[..., ::2], columns[..., 1::2]])
        variance = {name: np.where(known, each, np.nan) for name, each in variance.items()}
        std = np.sqrt(sum(variance.values())).max(axis=0)
        error = found.interpolation
        return {
            "variance": {name: each[:, :, :3] for name, each in variance.items()},
            "intercept_std": std[:, 3] if self.model.intercept else None,
            "interpolation_error": None
            if error is None
            else np.where(known[:, :3], self._by_node(error).view(complex)[:, :3], np.nan),
        }

    def _efficiency(self) -> Array | None:
        if self.bounds.efficiency is None:
            return None
        return np.where(self.flags.observable, self._by_node(self.bounds.efficiency), np.nan)

    def _statistics(self) -> dict[str, Any]:
        """Compute what Tables 5.7 and 5.8 state."""
        left, equations, model = self.bounds.residuals, self.equations, self.model
        active = int(equations.system.active.sum())
        unknowns = active * model.block
        real_rows = 2 * (equations.samples if model.contravariant else equations.rows)
        count = real_rows if model.contravariant else equations.rows
        freedom, sse = real_rows - 2 * unknowns, _by_frequency(left.squares)
        by_view, by_row = _by_frequency(left.by_view), _by_frequency(left.by_row)
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = self.bounds.expected
            return {
                "unknowns": unknowns,
                "samples": count,
                "sse": sse,
                "residual_std": np.sqrt(sse / count),
                "s": np.sqrt(sse / freedom) if freedom > 0 else np.full_like(sse, np.nan),
                "residual_std_by_view": np.sqrt(by_view / left.view_count[:, None]),
                "residual_std_by_row": np.sqrt(by_row / left.row_count[:, None]),
                "chi2_ratio": None if expected is None else sse / expected,
            }


def _by_frequency(squares: Array) -> Array:
    """Add up squares of real and imaginary parts, (..., column) to (..., frequency)."""
    return squares[..., ::2] + squares[..., 1::2]
