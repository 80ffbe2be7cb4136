"""What instruments that measured point by point have in common: views, settings, directions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

from sldvexp.dataset import Finding
from sldvexp.errors import Checks, UserError
from sldvexp.files import unusable
from sldvexp.importers.base import PointImporter
from sldvexp.importers.conventions import (
    Amplitude,
    Directions,
    MotionUnit,
    Phase,
    Positive,
    Quantity,
    Zeros,
)
from sldvexp.importers.incomplete import Incomplete, check_incomplete, incomplete_by
from sldvexp.importers.pointwise_data import (
    PointwiseData,
    PointwiseView,
    joined_views,
    to_images,
    to_line_of_sight,
)
from sldvexp.importers.questions import OF_VIEW, ViewQuestions, key_of_view
from sldvexp.importers.reference import ReferenceUnit, ask_unit, reference_of, unknown_units
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.units import LengthUnit


@dataclass
class PointwiseImport(PointImporter):
    """Velocities that were measured point by point. A strategy implements the hook `measured`.

    What a file does not say, and a setting does not either, is asked for. Coordinates are in the
    axes of the world in all views; those in an instrument's own axes, p, are brought there before,
    as ``R^T p + o`` with the rotation R and the origin o of its pose.

    Parameters
    ----------
    views : dict of str to PointwiseView
        Each with its file; with directions=view also with an origin or a direction. Its own
        quantity, unit, length_unit, amplitude and reference win over those of all views.
    directions : Directions
        Where the lines of sight come from: the files' dof, each view, or the run's pose.
    positive : Positive, optional
        Which way a positive velocity points; a dof tells it itself.
    frequency : list of float, Hz
        Lines that are read, empty for all; of a table that states none, its frequency.
    quantity : Quantity, optional
        What moves. It wins over what the file says.
    unit : MotionUnit, optional
        Unit of length in the values' unit. It wins over what the file says.
    length_unit : LengthUnit, optional
        Of coordinates. It wins over what the file says.
    amplitude : Amplitude, optional
        Of spectra. It wins over what the file says.
    phase : Phase, optional
        Sign of i omega t in the analyser's Fourier series, which no file says; a cross spectrum of
        the response and the conjugate reference is exp_plus.
    reference : float or str, optional
        Peak amplitude of the reference, which response functions are multiplied with: with its
        unit, as ``2 N``, or a number in the unit of the files if all have one; 1 gives velocities
        per unit.
    std : float, optional, m/s
        Standard error of every velocity, of real and imaginary part each.
    zeros : Zeros
        What a function is whose values are all zero: refused, missing, or measured.
    incomplete : bool or str
        What becomes of points that not all views have: false refuses them, drop (or true) leaves
        them out, mark keeps them as NaN with a flag and determines them from the other views if
        these are three or more. They are counted in the verdict.
    """

    views: dict[str, PointwiseView] = field(default_factory=dict)
    directions: Directions = Directions.dof
    positive: Positive | None = None
    frequency: list[float] = field(default_factory=list)
    quantity: Quantity | None = None
    unit: MotionUnit | None = None
    length_unit: LengthUnit | None = None
    amplitude: Amplitude | None = None
    phase: Phase | None = None
    reference: int | float | str | None = None
    std: float | None = None
    zeros: Zeros = Zeros.refuse
    incomplete: bool | str = False

    def __post_init__(self) -> None:
        checks = Checks()
        message = "must name at least one view, as {front: {path: front.uff}}"
        checks.require(bool(self.views), "views", message)
        for name, view in self.views.items():
            wrong = unusable(name)
            checks.require(not wrong, "views", f"the name of the view {name!r} {wrong}")
            self._check_view(checks, f"views.{name}", view)
        for i, frequency in enumerate(self.frequency):
            checks.non_negative(f"frequency[{i}]", frequency)
        if self.std is not None:
            checks.positive("std", self.std)
        for key, reference in self._references().items():
            try:
                reference_of(reference)
            except UserError as error:
                checks.require(False, key.removeprefix("instrument."), str(error))
        check_incomplete(checks, self.incomplete)
        self.check(checks)
        checks.done()

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the strategy's own settings."""

    @abstractmethod
    def measured(self, questions: ViewQuestions) -> Iterator[PointwiseData]:
        """Read the views, one after the other.

        Parameters
        ----------
        questions : ViewQuestions
            To which all is added that files leave open, and the points of each view; it is asked
            with its `done` before the first view is given.

        Raises
        ------
        UserError
            If a file is missing or broken, or says too little or contradicts itself.
        """

    def of_view(self, name: str) -> Self:
        """Give the settings of one view alone: its own win over those of all."""
        view = self.views[name]
        own: dict[str, Any] = {k: value for k in OF_VIEW if (value := getattr(view, k)) is not None}
        return replace(self, views={name: view}, **own)

    def key(self, setting: str, view: str = "") -> str:
        """Name a setting that a view is read with; of the first view if none is named."""
        view = view or next(iter(self.views))
        own = getattr(self.views[view], setting) is not None
        return key_of_view(view, setting) if own else f"instrument.{setting}"

    def _references(self) -> dict[str, float | str]:
        """List the amplitudes of references that are set, by the setting."""
        found: dict[str, float | str | None] = {"instrument.reference": self.reference}
        found |= {key_of_view(n, "reference"): view.reference for n, view in self.views.items()}
        return {key: value for key, value in found.items() if value is not None}

    def check_references(
        self, units: Mapping[str, ReferenceUnit], questions: ViewQuestions
    ) -> list[Finding]:
        """Ask in which unit bare amplitudes of references are, and find units nobody knows.

        Parameters
        ----------
        units : mapping of str to ReferenceUnit
            Of each view whose functions have a reference.
        """
        found = []
        for key, reference in self._references().items():
            of_key = {n: u for n, u in units.items() if self.key("reference", n) == key}
            if open_ := ask_unit(key, reference, of_key):
                questions.note(open_, "instrument.reference")
            found += unknown_units(key, reference, of_key)
        return found

    def _check_view(self, checks: Checks, key: str, view: PointwiseView) -> None:
        for name in ("origin", "direction"):
            values = getattr(view, name)
            message = f"must be three numbers, not {len(values)}"
            checks.require(len(values) in (0, 3), f"{key}.{name}", message)
            checks.finite(f"{key}.{name}", *values)
        zero = bool(view.direction) and not any(view.direction)
        checks.require(not zero, f"{key}.direction", "must be a direction, not zero")
        given = bool(view.origin) + bool(view.direction)
        if self.directions is Directions.view:
            message = "give either origin or direction, because directions=view"
            checks.require(given == 1, key, message)
        else:
            message = f"origin and direction need directions=view, not {self.directions.name}"
            checks.require(given == 0, key, message)
        dofs = [sign + axis for axis in "XYZ" for sign in "+-"]
        message = f"must be one of {', '.join(dofs)}, not {view.dof}"
        checks.require(not view.dof or view.dof in dofs, f"{key}.dof", message)

    def inputs(self) -> list[str]:
        """Name the views' files."""
        return [view.path for view in self.views.values()]

    def read(
        self, tree: Mapping[str, xr.Dataset] | None = None, laser: TwoMirror | None = None
    ) -> xr.Dataset:
        """Read the group ``line_of_sight``, with the points' positions if the files have them."""
        incomplete = incomplete_by(self.incomplete)
        joined = joined_views(self.views, self.directions, tree or {})
        refused = joined if incomplete is Incomplete.refuse else []
        views = list(self.measured(ViewQuestions(self.views, refused)))
        return to_line_of_sight(views, self.views, self.directions, incomplete, tree or {}, laser)

    def images_of_points(
        self, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
    ) -> dict[str, xr.Dataset]:
        """Read the groups ``image/<view>``: a pixel a point, where the mirrors send the beam.

        Parameters
        ----------
        tree : mapping of str to Dataset
            With the group ``pose``.
        laser : TwoMirror, optional
            Needed for it.

        Raises
        ------
        UserError
            As `read`, or if there is no pose or standard error.
        """
        questions = ViewQuestions(self.views, for_field=True)
        return to_images(list(self.measured(questions)), tree, laser)
