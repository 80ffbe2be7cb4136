"""All views of a session, one after the other, through any instrument that scans."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from sldvexp.config.paths import JOURNAL, locate
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import ConfigError, Problem, UserError
from sldvexp.geometry import KnownPose
from sldvexp.instrument import Instrument
from sldvexp.instrument.person import GuideMaker
from sldvexp.instrument.recording import Replay
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.progress import span
from sldvexp.scan import Scan, ScanPart
from sldvexp.scan.base import PersonPart
from sldvexp.scan.calibration import CalibrationScan
from sldvexp.session.by_person import joined, record_marks, record_spots
from sldvexp.session.camera import Camera, ViewContext, ViewSkipped
from sldvexp.session.circles import circle_lines, scan_calibration
from sldvexp.session.images import image_lines, scan_image
from sldvexp.session.journal import Journal, JournalOrigin, digest_of, require_same
from sldvexp.session.operator import Operator
from sldvexp.session.outline import outline_lines, scan_outline
from sldvexp.session.watching import PartAhead, ViewAhead, Watcher

#: Of the dissertation's instrument (Section 3.2.1).
PIXELS_PER_SECOND = 6.0
#: Fields of an experiment that decide what is measured.
MEASURED_BY = "seed", "target", "laser", "scene", "scan"

#: What becomes of a part of a scan in one view, by the part's `kind`: groups of the dataset.
KINDS: dict[str, Callable[[Any, ViewContext], dict[str, xr.Dataset]]] = {
    "circles": scan_calibration,
    "outline": scan_outline,
    "image": scan_image,
    "marks": record_marks,
    "spots": record_spots,
}

#: Names and pixels of the lines of a part in one view, by the part's `kind`; a person scans none.
LINES: dict[str, Callable[[Any, str], dict[str, int]]] = {
    "circles": circle_lines,
    "outline": outline_lines,
    "image": image_lines,
}


def scan_views(
    experiment: Any,
    journal: Path,
    operator: Operator | None = None,
    keep: Callable[[str, xr.Dataset], xr.Dataset] | None = None,
    watcher: Watcher | None = None,
    guide: GuideMaker | None = None,
) -> dict[str, xr.Dataset]:
    """Scan everything that the configuration says, view by view.

    Parameters
    ----------
    experiment : Experiment
        With ready plugins: scene, laser, target, scan, instrument and signal, and the seed.
    journal : Path
        Folder for finished scan lines; what it has is not scanned again.
    keep : callable
        What becomes of a group, by its name, before the next view: it may go to a file.
    watcher : Watcher, optional
        Told of every view and line.
    guide : callable, optional
        Makes who tells a person at the terminal where the marks of a view lie.

    Returns
    -------
    dict of str to xarray.Dataset
        The groups that the parts' kinds make, as ``edge/<view>``.
    """
    e = experiment
    watcher = watcher or Watcher()
    operator = operator or Operator(watcher)
    require_same(journal, measured_by(e), measured_from(e))
    if not e.scan.view_names():
        raise ConfigError([Problem("scan.views", "needs at least one view")])
    in_steps = e.scan.in_steps(e.laser, e.target)
    print(estimate(in_steps, bool(e.scan.rough_poses())))
    _require_on_board(in_steps, e.laser)
    views = _ahead(e.scan, in_steps, journal)
    watcher.session_begun(views)
    found: dict[str, xr.Dataset] = {}
    told = replayed_scene(e)
    for view in views:
        watcher.view_begun(view)
        arrive = partial(_arrive, e, view.name, operator, journal / view.name)
        kept = Journal(journal / view.name, lasting=e.instrument.real)
        plan = (watcher, view.name, view.lines, kept.left or e.instrument.left(view.name))
        recorded = partial(e.instrument.recorded, view.name)
        with Camera(arrive, e.signal, kept, *plan, recorded) as camera:
            at = ViewContext(view.name, camera, e.laser, e.target, operator, guide=guide)
            groups = _scan_parts(e.scan.parts(view.name), at)
        told += at.findings
        if camera.skipped:
            told.append(_skipped(view, camera.lines_done))
        watcher.view_done(view, groups)
        found |= {name: keep(name, g) if keep else g for name, g in groups.items()}
    if not found:
        raise UserError(
            "scan: the rest of every view was skipped, and nothing is left to go on with"
        )
    watcher.session_done()
    found = joined(found)
    first = next(iter(found))
    if told:
        found[first] = with_findings(found[first], told)
    return found


def measured_by(experiment: Any) -> dict[str, object]:
    """List the parts of an experiment that decide what is measured."""
    parts = {name: getattr(experiment, name) for name in MEASURED_BY}
    return {**parts, "instrument": type(experiment.instrument).__name__}


def measured_from(experiment: Any) -> dict[str, str]:
    """List the settings of an experiment that say whose lines it has."""
    return {f"instrument.{k}": v for k, v in experiment.instrument.source.items()}


def replayed_scene(e: Any) -> list[Finding]:
    """Say what a scene is worth to lines that are played again, which it does not make.

    Raises
    ------
    UserError
        If they were scanned in another scene: what is true there would be told of these lines.
    """
    if e.scene is None or not isinstance(e.instrument, Replay):
        return []
    folder = locate(e.instrument.path)
    then, now = JournalOrigin.read(folder / JOURNAL).parts.get("scene"), digest_of(e.scene)
    if then == now:
        return []
    if then not in (None, digest_of(None)):
        raise UserError(
            f"scene: the lines of {folder} were scanned in a scene with other settings, and "
            "instrument=replay plays them as they were: take scene and scene.* as in that run, or "
            "~scene without any, or scan anew with instrument=simulated"
        )
    text = (
        f"the scene is taken for what is true, and changes nothing of the lines of {folder}, which "
        "do not tell in which scene they were scanned"
    )
    return [Finding("replayed_scene", "scene", text, Severity.note)]


def _skipped(view: ViewAhead, done: int) -> Finding:
    """Say that the rest of a view was skipped."""
    told = f"the rest of view {view.name} was skipped: {done} of {view.lines} lines were scanned"
    return Finding("skipped", f"view {view.name}", told, Severity.note, views=(view.name,))


def _scan_parts(parts: list[ScanPart], at: ViewContext) -> dict[str, xr.Dataset]:
    """Scan all parts of a view, or those before the rest is skipped."""
    found: dict[str, xr.Dataset] = {}
    with suppress(ViewSkipped):
        for part in parts:
            at.camera.kind = part.kind
            found |= KINDS[part.kind](part, at)
            if at.camera.skipped:
                break
    return found


def _ahead(scan: Scan, in_steps: Scan, journal: Path) -> tuple[ViewAhead, ...]:
    """Say what every view takes, and how much of it the journal has."""

    def part_ahead(given: ScanPart, part: ScanPart, view: str) -> PartAhead:
        lines = LINES[part.kind](part, view) if part.kind in LINES else {}
        kept = Journal(journal / view)
        there = sum(pixels for name, pixels in lines.items() if kept.has(name))
        total = sum(lines.values())
        seconds, searches = part.seconds(view), _searches(given, view)
        return PartAhead(part.kind, len(lines), total, there, seconds, searches)

    def parts_ahead(view: str) -> tuple[PartAhead, ...]:
        pairs = zip(scan.parts(view), in_steps.parts(view), strict=True)
        return tuple(part_ahead(given, part, view) for given, part in pairs)

    names = scan.view_names()
    return tuple(ViewAhead(v, k, len(names), parts_ahead(v)) for k, v in enumerate(names, 1))


def _searches(part: ScanPart, view: str) -> bool:
    """Tell whether circles are searched in a view, from its rough pose."""
    return isinstance(part, CalibrationScan) and part.views[view].pose is not None


def estimate(scan: Scan, searches: bool = False) -> str:
    """Estimate how long the session takes at least, and at six pixels a second if that is longer.

    Pixels that search circles from a rough pose are not among those; if it `searches`, it says so.
    """
    views = scan.view_names()
    parts = [(part, view) for view in views for part in scan.parts(view)]
    pixels = sum(part.pixel_count(view) for part, view in parts)
    seconds = sum(part.seconds(view) for part, view in parts)
    if not pixels:
        how = "by digitizer" if any(part.kind == "spots" for part, _ in parts) else "by hand"
        return f"scan: {how}, views {', '.join(views)}"
    told = f"scan: {pixels} pixels in {len(views)} views, {span(seconds)} of samples"
    if seconds <= pixels / PIXELS_PER_SECOND:
        told += f" ({span(pixels / PIXELS_PER_SECOND)} on an instrument of 6 pixels a second)"
    return f"{told}{', besides those that search circles' if searches else ''}"


def takes_samples(scan: Scan) -> bool:
    """Tell whether a scan has pixels to sample; one by a person alone has none."""
    parts = (part for view in scan.view_names() for part in scan.parts(view))
    return any(not isinstance(part, PersonPart) for part in parts)


def _require_on_board(scan: Scan, laser: TwoMirror) -> None:
    """Refuse pixels that the mirrors cannot reach, before anything moves."""
    for view in scan.view_names():
        for part in scan.parts(view):
            try:
                laser.angle_from_dac(part.known_pixels(view))
            except UserError as error:
                raise UserError(f"scan: in the view {view}, {error}") from None


def _arrive(
    e: Any, view: str, operator: Operator, kept: Path
) -> AbstractContextManager[Instrument]:
    """Open the instrument in a view, where the operator must take it if it cannot go by itself."""
    if len(e.scan.view_names()) > 1 and not e.instrument.takes_views_itself:
        rough = e.scan.rough_poses().get(view)
        operator.wait_for(_request(view, any(kept.glob("[!.]*")), rough))
    return e.instrument.open(e.scene, e.laser, e.target, seed=e.seed, view=view)


def _request(view: str, begun: bool, rough: KnownPose | None) -> str:
    """Ask the operator for a view, at its rough pose if there is one."""
    if begun:
        return (
            f"The view {view} is scanned in part: the instrument must stand exactly where it "
            "stood then. Press Enter to go on: "
        )
    place = ""
    if rough is not None:
        x, y, z = rough.origin
        place = f", to about ({x:g}, {y:g}, {z:g}) {rough.unit.name}"
        if rough.look_at:
            x, y, z = rough.look_at
            place += f", looking at ({x:g}, {y:g}, {z:g})"
    return f"Move the instrument to the view {view}{place}, then press Enter: "
