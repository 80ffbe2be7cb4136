"""`instrument=uff`: what vibrometers and analysers wrote into universal files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.dataset import Finding
from sldvexp.dataset.references import FURTHER, REFERENCE
from sldvexp.errors import Checks, UserError
from sldvexp.importers.conventions import Conventions, Directions, Quantity, Zeros
from sldvexp.importers.incomplete import then
from sldvexp.importers.pointwise import PointwiseImport
from sldvexp.importers.pointwise_data import PointwiseData, PointwiseView
from sldvexp.importers.questions import SeenPoints, ViewQuestions, close
from sldvexp.importers.uff_choice import ANY, MOTION, FunctionChoice, require_witnesses_agree
from sldvexp.importers.uff_conventions import (
    OF_REFERENCE,
    FunctionKind,
    ask_phase,
    ask_positive,
    decide_conventions,
    length_unit,
)
from sldvexp.importers.uff_estimators import (
    coherence,
    estimate_response,
    find_reference,
    fit_phasors,
    no_estimator,
    no_frequency,
    no_reference,
)
from sldvexp.io.uff import Function, UniversalFile, UniversalGeometry, universal_file
from sldvexp.io.uff.functions import DIRECTIONS, NODAL
from sldvexp.io.uff.geometry import CARTESIAN, WORLD
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.signal import Estimator
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray
from sldvexp.unit_labels import same_unit

COHERENCE = 6
#: How far a wanted frequency may be from a line, in line spacings.
BESIDE = 0.01


class NodalAxes(Enum):
    """Axes that the directions of nodal values are of.

    Attributes
    ----------
    world
        Those of the positions.
    node
        Those of each node's own coordinate system.
    """

    world = "world"
    node = "node"


@register("instrument", "uff")
@dataclass
class UffImport(PointwiseImport):
    """Functions and geometry of universal files (data sets 58, 58b, 15, 2411, 2412, 82, ...).

    What a file does not say, and a setting does not either, is asked for.

    Parameters
    ----------
    geometry : str
        File with the nodes; empty for those in each view's own file.
    function : FunctionKind, optional
        Needed if a file has more than one of frequency response functions, spectra, time records.
        Cross spectra are read if there are no response functions, or as set. Nodal values (data
        set 55) are read if there are no functions, or as set.
    estimator : Estimator, optional
        Of response functions from cross and auto spectra: h1 by the reference's auto spectrum, h2
        by the response's, hv by both.
    noise_ratio : float
        Of hv: noise power of the responses over that of the reference, in the file's units.
    nodal_axes : NodalAxes, optional
        Needed of nodal values with directions=dof if nodes have coordinate systems of their own.
    containing : str
        Text that the identifying lines of a function must have, as ``H1``.
    reference_dof : str
        Of the functions that are read, as ``1+Z``; needed if a file has several references.
        ``any`` if one excitation was behind them all.
    further_references : list of str
        Degrees of freedom of references whose functions are read besides, for modes of all of them
        together (modal=own with a volume).
    averages : int
        Of spectra behind each response function, 2 or more: with it, standard errors come from the
        file's coherence functions, or from cross and both auto spectra. 0 if not known.
    time_reference : str
        Of time records: degree of freedom of the one whose phase is zero, as ``99+Z``, or
        ``trigger`` if all begin at one phase of the excitation.
    """

    geometry: str = ""
    function: FunctionKind | None = None
    estimator: Estimator | None = None
    noise_ratio: float = 1.0
    nodal_axes: NodalAxes | None = None
    containing: str = ""
    reference_dof: str = ""
    further_references: list[str] = field(default_factory=list)
    averages: int = 0
    time_reference: str = ""

    def choice(self, view: PointwiseView) -> FunctionChoice:
        """Choose among the functions of a view's file."""
        return FunctionChoice(
            self.function,
            view.dof,
            self.containing,
            self.reference_dof,
            self.time_reference,
            self.quantity,
        )

    def check(self, checks: Checks) -> None:
        """Note what cannot be."""
        both = self.std is not None and self.averages
        checks.require(not both, "averages", "give either std or averages, not both")
        message = f"must be zero or a positive integer, not {self.averages}"
        checks.require(self.averages >= 0, "averages", message)
        one = "of one spectrum no standard error can be told; leave it out, or set std"
        checks.require(self.averages != 1, "averages", one)
        checks.positive("noise_ratio", self.noise_ratio)
        useless = self.noise_ratio != 1.0 and self.estimator is not Estimator.hv
        checks.require(not useless, "noise_ratio", "has no effect without estimator: hv")

        named = [self.reference_dof, *self.further_references]
        ok = not self.further_references or (all(named) and len(set(named)) == len(named))
        several = "needs reference_dof besides, as 1+Z, and each reference once"
        checks.require(ok and (ANY not in named or len(named) == 1), "further_references", several)

    def read(
        self, tree: Mapping[str, xr.Dataset] | None = None, laser: TwoMirror | None = None
    ) -> xr.Dataset:
        """Read the group ``line_of_sight``, of one reference."""
        if self.further_references:
            raise UserError(
                "instrument.further_references: velocities of points are those of one reference; "
                "modes of several need a volume, whose pixels the points become"
            )
        return super().read(tree, laser)

    def images_of_points(
        self, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
    ) -> dict[str, xr.Dataset]:
        """Read the groups ``image/<view>``, and those of further references."""
        found = super().images_of_points(tree, laser)
        if self.reference_dof not in ("", ANY):
            named = {REFERENCE: self.reference_dof}
            found = {name: group.assign_attrs(named) for name, group in found.items()}
        for reference in self.further_references:
            own = replace(self, reference_dof=reference, further_references=[])
            for name, group in own.images_of_points(tree, laser).items():
                found[f"{FURTHER}{reference}/{name.removeprefix('image/')}"] = group
        return found

    def inputs(self) -> list[str]:
        """Name the universal files."""
        return [*([self.geometry] if self.geometry else []), *super().inputs()]

    def measured(self, questions: ViewQuestions) -> Iterator[PointwiseData]:
        """Read the views' files, one after the other, once no question is open."""
        with ExitStack() as files:
            opened: dict[str, UniversalFile] = {}
            for path in self.inputs():
                if path not in opened:
                    opened[path] = files.enter_context(universal_file(locate(path)))
            chosen = {
                name: _choose(self.of_view(name), view, opened, questions.of(name))
                for name, view in self.views.items()
            }
            sources = {name: source for name, source in chosen.items() if source is not None}
            if not self.reference_dof:
                _ask_reference(sources, questions)
            units = {
                name: rules.reference
                for name, source in sources.items()
                if (rules := source.rules) is not None and rules.reference is not None
            }
            odd = self.check_references(units, questions)
            found = [
                _read(self.of_view(name), name, self.views[name], source, questions.of(name))
                for name, source in sources.items()
            ]
            questions.done()
        for view in filter(None, found):
            view.findings.extend(odd if view is found[0] else [])
            yield view


def _read(
    settings: UffImport,
    name: str,
    view: PointwiseView,
    source: _ViewSource,
    questions: ViewQuestions,
) -> PointwiseData | None:
    """Read one view; None if a question is open, and then no more than what others may be."""
    file, functions = source.file, source.functions
    frequency: Array | None = None
    if not questions and source.rules is not None:
        found = _view(settings, name, view, source, source.rules, questions)
        zero, frequency = found.missing, found.frequency
    else:
        found = None
        zero = np.array([not file.values(function)[1].any() for function in functions])
        if not settings.frequency and functions[0].kind != FunctionKind.time.value:
            abscissa = file.values(functions[0])[0]
            frequency = abscissa if abscissa.all() else None  # 0 Hz is left out of accelerations
    try:
        _check_zeros(settings, file, functions, zero)
    except UserError as error:
        questions.note(error, file.source.path)
    if settings.zeros is not Zeros.missing:
        zero = np.zeros(len(functions), bool)
    node = np.array([f.node for f in functions], np.int64)
    of_time = functions[0].kind == FunctionKind.time.value
    has_std = settings.std is not None or bool(settings.averages) or of_time
    path = str(file.source.path)
    questions.saw(SeenPoints(name, path, node, zero, frequency, has_std=has_std))
    return None if found is None else replace(found, missing=zero)


class _ViewSource(NamedTuple):
    """Functions of a view, and what their numbers mean."""

    file: UniversalFile
    functions: list[Function]
    rules: Conventions | None
    geometry: UniversalGeometry | None
    length: tuple[float, str]
    places: str
    overruled: str


def _choose(
    settings: UffImport,
    view: PointwiseView,
    opened: dict[str, UniversalFile],
    questions: ViewQuestions,
) -> _ViewSource | None:
    """Choose one view's functions and their conventions; None if a question is open."""
    file = opened[view.path]
    places = opened[settings.geometry] if settings.geometry else file
    length = (np.nan, "")
    if places.geometry is not None:
        length = length_unit(settings, places, questions)
    elif not view.direction:
        message = (
            "has no geometry (data set 15 or 2411), which directions need; name a file that has"
        )
        error = UserError(f"{places.source.path}: {message} with instrument.geometry")
        questions.note(error, places.source.path)
    try:
        functions = settings.choice(view).functions(file)
    except UserError as error:
        questions.note(error, file.source.path)
        _ask_of_any(settings, file, questions)
        return None
    rules = decide_conventions(settings, file, functions, questions)
    _ask_more(settings, file, functions[0], questions)
    geometry = places.geometry
    try:
        geometry = _turned(settings, file, functions[0], geometry)
    except UserError as error:
        questions.note(error, file.source.path)
    stated, overruled = "", ""
    if places.geometry is not None and places.units is not None:
        stated, one = str(places.source.path), places.units.length
        if not same_unit(length[0], one):
            overruled = f"data set 164 states a unit of length of {one:g} m"
    return _ViewSource(file, functions, rules, geometry, length, stated, overruled)


def _ask_of_any(settings: UffImport, file: UniversalFile, questions: ViewQuestions) -> None:
    """Ask for what is open of any functions of a file, as it is not known which are read."""
    kinds = {kind.value for kind in FunctionKind}
    of_kind = {f.kind: f for f in file.functions if f.kind in kinds and f.ordinate.kind in MOTION}
    if len(of_kind) == 1:
        with suppress(UserError):  # of this function alone, which may not be read
            decide_conventions(settings, file, list(of_kind.values()), questions)
        _ask_more(settings, file, next(iter(of_kind.values())), questions)
    ask_positive(settings, file, questions)
    if of_kind and FunctionKind.time.value not in of_kind:
        ask_phase(settings, file, questions)


def _ask_reference(sources: dict[str, _ViewSource], questions: ViewQuestions) -> None:
    """Ask whether views of several references had one excitation, as these may not be the same."""
    views: dict[str, list[str]] = {}
    for name, source in sources.items():
        if FunctionKind(source.functions[0].kind) in OF_REFERENCE:
            views.setdefault(source.functions[0].reference_dof, []).append(name)
    if len(views) < 2:
        return
    listed = ", ".join(f"{dof} ({', '.join(names)})" for dof, names in views.items())
    message = (
        f"response functions of the views are of several references: {listed}; give all views "
        "functions of one reference and name it with instrument.reference_dof, or say "
        f"instrument.reference_dof={ANY} if one excitation was behind them all"
    )
    questions.note(UserError(f"instrument.views: {message}"), "instrument.views")


def _ask_more(
    settings: UffImport, file: UniversalFile, function: Function, questions: ViewQuestions
) -> None:
    """Ask for what time records and cross spectra need besides their units."""
    path = file.source.path
    if function.kind == FunctionKind.time.value:
        for missing, error in (
            (not settings.frequency, no_frequency(file)),
            (not settings.time_reference, no_reference(file)),
        ):
            if missing:
                questions.note(error, path)
    if function.kind == FunctionKind.cross.value and settings.estimator is None:
        questions.note(no_estimator(file), path)


def _view(
    settings: UffImport,
    name: str,
    view: PointwiseView,
    source: _ViewSource,
    rules: Conventions,
    questions: ViewQuestions,
) -> PointwiseData:
    """Turn one view's functions into velocities."""
    file, functions, _, geometry, (length, by) = source[:5]
    told = rules.told | settings.choice(view).left_out(file, functions)
    if functions[0].kind == FunctionKind.time.value:
        reference = find_reference(settings.time_reference, file)
        frequency, values, errors = fit_phasors(settings.frequency, file, functions, reference)
        velocity = rules.velocity(values, frequency)
        std: Array | None = errors * abs(rules.velocity(np.ones(len(frequency)), frequency))
        square = None
        if settings.std is not None:
            std = np.full(velocity.shape, settings.std)
    else:
        frequency, lines = _lines(settings, file, functions[0], rules.quantity)
        values = _at_lines(file, functions, frequency, lines)
        require_witnesses_agree(file, functions, rules, frequency, lines, questions)
        if functions[0].kind == FunctionKind.cross.value:
            made_by, ratio, containing = (
                settings.estimator,
                settings.noise_ratio,
                settings.containing,
            )
            values = estimate_response(
                made_by, ratio, containing, file, functions, values, frequency, lines
            )
            told = told | ({"estimator": made_by.name} if made_by else {})
        velocity = rules.velocity(values, frequency)
        square = _coherence(settings, view, file, functions, frequency, lines)
        std = None if square is None else _part(velocity, square, settings.averages)
        if settings.std is not None:
            std = np.full(velocity.shape, settings.std)
    missing = np.asarray(~values.any(axis=1))
    axes = {"nodal_axes": settings.nodal_axes.name} if settings.nodal_axes else {}
    return PointwiseData(
        name,
        str(file.source.path),
        np.array([f.node for f in functions], np.int64),
        np.array([f.direction for f in functions], np.int64),
        frequency,
        velocity,
        std,
        missing,
        geometry,
        length,
        told | axes | ({"length_unit": f"{length:g} m, {by}"} if by else {}),
        _findings(settings, name, source, rules),
        reference=rules.reference,
        places=source.places,
        amplitude=rules.amplitude,
        coherence=square,
        records=settings.averages,
    )


def _findings(
    settings: UffImport, name: str, source: _ViewSource, rules: Conventions
) -> list[Finding]:
    """List what is odd about a view's file but no reason to refuse it."""
    file, functions, subject = source.file, source.functions, f"view {name}"
    found = [
        Finding("unit", subject, text, severity, views=(name,)) for text, severity in rules.odd
    ]
    if source.overruled:
        key = settings.key("length_unit")
        text = f"{source.places}: {key} wins, although {source.overruled}"
        found.append(Finding("unit", subject, text, views=(name,)))
    real = [f for f in functions if not f.complex]
    if real and functions[0].kind != FunctionKind.time.value:
        text = (
            f"{file.source.path}: {len(real)} of {len(functions)} functions of view {name} are of "
            "real numbers, as magnitudes are, whose phase is lost; export complex values"
        )
        found.append(Finding("phase", subject, text, views=(name,)))
    return found


def _at_lines(
    file: UniversalFile, functions: list[Function], frequency: Array, lines: IndexArray
) -> ComplexArray:
    """Read values at some lines of all functions, shape (function, frequency)."""
    found = np.empty((len(functions), len(frequency)), complex)
    for row, function in zip(found, functions, strict=True):
        abscissa, values = file.values(function)
        if len(abscissa) <= lines.max() or not close(abscissa[lines], frequency):
            raise file.wrong(
                function,
                f"has other frequencies than data set {functions[0].entry.number}; all functions "
                "of a view must have the same",
            )
        row[:] = values[lines]
    return found


def _lines(
    settings: UffImport, file: UniversalFile, function: Function, quantity: Quantity
) -> tuple[Array, IndexArray]:
    """Find the frequencies that are read, and their places in the abscissa."""
    abscissa, _ = file.values(function)
    if (abscissa < 0).any() or len(np.unique(abscissa)) != len(abscissa):
        raise file.wrong(function, "has a negative frequency, or one twice")
    if not settings.frequency:
        # An acceleration at 0 Hz is of no finite velocity.
        zero = abscissa == 0 if quantity is Quantity.acceleration else np.zeros(len(abscissa), bool)
        lines = np.flatnonzero(~zero)
        if not len(lines):
            raise file.wrong(function, "has no frequency but 0 Hz, where accelerations say nothing")
        return abscissa[lines], lines
    wanted = np.array(settings.frequency)
    lines = np.abs(abscissa[:, None] - wanted).argmin(axis=0)
    spacing = np.diff(np.sort(abscissa)).min() if len(abscissa) > 1 else abscissa[0]
    for k, frequency in enumerate(wanted):
        near = abscissa[lines[k]]
        if abs(near - frequency) > BESIDE * spacing:
            raise file.wrong(function, f"has no line at {frequency:g} Hz; the nearest is {near:g}")
        if near == 0 and quantity is Quantity.acceleration:
            raise file.wrong(function, "is an acceleration, which at 0 Hz says nothing of velocity")
    if len(np.unique(lines)) != len(lines):
        raise UserError("instrument.frequency: two of its frequencies are the same line")
    return abscissa[lines], lines


def _check_zeros(
    settings: UffImport, file: UniversalFile, functions: list[Function], zero: BoolArray
) -> None:
    """Refuse functions whose values are all zero, unless the settings tell what these are."""
    if settings.zeros is Zeros.refuse and zero.any():
        function = functions[int(np.argmax(zero))]
        raise file.wrong(
            function,
            f"all values of {function.dof} are zero, as programs write where nothing was measured; "
            f"say instrument.zeros=missing{then(settings.incomplete)}, or measured if they are",
        )


def _coherence(
    settings: UffImport,
    view: PointwiseView,
    file: UniversalFile,
    functions: list[Function],
    frequency: Array,
    lines: IndexArray,
) -> Array | None:
    """Find the coherence g^2, of the file's functions or of its spectra; None without averages."""
    if not settings.averages:
        return None
    has_coherences = any(f.kind == COHERENCE for f in file.functions)
    if functions[0].kind == FunctionKind.cross.value and not has_coherences:
        return coherence(settings.containing, file, functions, frequency, lines)
    of_node: dict[int, list[Function]] = {}
    for f in file.functions:
        if f.kind == COHERENCE and (not view.dof or DIRECTIONS[f.direction] == view.dof):
            of_node.setdefault(f.node, []).append(f)
    square = np.empty((len(functions), len(frequency)))
    for i, function in enumerate(functions):
        every = of_node.get(function.node, [])
        own = [f for f in every if f.reference_dof == function.reference_dof]
        if not every:
            raise UserError(
                f"{file.source.path}: has no coherence of node {function.node}, from which "
                "instrument.averages makes standard errors; set instrument.std instead"
            )
        _, values = file.values(of := (own or every)[-1])
        if len(values) <= lines.max() or not ((values > 0) & (values <= 1)).all():
            raise file.wrong(of, "must be a coherence above 0 and up to 1 at every frequency")
        square[i] = np.real(values[lines])
    return square


def _part(velocity: ComplexArray, square: Array, averages: int) -> Array:
    """Turn coherences g^2 to standard errors of real and imaginary part each.

    ``std = |H| sqrt((1 - g^2) / (2 (n - 1) g^2))`` of n averages, as of a regression.
    """
    part = np.abs(velocity) * np.sqrt((1 - square) / (2 * (averages - 1) * square))
    return np.maximum(part, np.finfo(float).tiny)  # a coherence of 1 is no error of 0


def _turned(
    settings: UffImport, file: UniversalFile, function: Function, geometry: UniversalGeometry | None
) -> UniversalGeometry | None:
    """Give the geometry the coordinate systems that the directions of nodal values are of.

    Data set 55 calls them global, but programs also write those of the nodes' own systems.
    """
    if function.kind != NODAL or settings.directions is not Directions.dof or geometry is None:
        return geometry
    own = any(s.kind != CARTESIAN or not np.allclose(s.axes, np.eye(3)) for s in geometry.system)
    if own and settings.nodal_axes is None:
        raise file.wrong(
            function,
            "its directions may be those of the world or of the nodes' own coordinate systems; say "
            "which with instrument.nodal_axes=world or node",
        )
    if settings.nodal_axes is NodalAxes.world:
        return replace(geometry, system=(WORLD,) * len(geometry.system))
    return geometry
