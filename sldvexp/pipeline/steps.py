"""Steps of a run, in the order in which data flows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, count

from sldvexp import field as velocity_field
from sldvexp import importers, instrument, models, modes, pose, session, shell, verdict, virtual_lab
from sldvexp.check import Examination, evaluate
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import JOURNAL
from sldvexp.dataset import (
    COMPARED_STRAIN,
    MODAL_IMAGES,
    VERDICT,
    Finding,
    Severity,
    findings_to_dataset,
    take_findings,
)
from sldvexp.dataset.references import FURTHER, further_references
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.pipeline.step import Run, Step, check_contracts
from sldvexp.reconstruction import Reconstruction
from sldvexp.reconstruction.system import Robust
from sldvexp.session.interruption import ended_scan
from sldvexp.stopping import stopping_once

#: Where the scans lie, in the dataset and in the journal, that pose methods are compared on.
COMPARED_SCANS = "compare_scan"
#: Where the flags lie of images that stay in another file.
FLAGGED = "flagged/"

#: Make a field by a method: its group, or that of splines on the surface and of their strain.
Way = Callable[[Reconstruction], xr.Dataset]
SurfaceWay = Callable[[shell.SurfaceReconstruction], Sequence[xr.Dataset]]


def _target(run: Run) -> None:
    """Add the calibration object's points."""
    run.tree["target"] = run.experiment.target.to_dataset()


def _scan(run: Run) -> None:
    """Scan what the instrument sees in every view: edges of circles, images."""
    e = run.experiment
    if not isinstance(e.instrument, instrument.ScanningPlugin):
        raise UserError(
            "scan: needs an instrument that scans, for example instrument=simulated with "
            "scene=calibration"
        )
    scans = {"": e.scan} if e.scan else {}
    scans |= {f"{COMPARED_SCANS}/{name}/": scan for name, scan in e.compare_scan.items()}
    if e.laser is None or (
        e.signal is None and any(map(session.session.takes_samples, scans.values()))
    ):
        raise UserError("scan: needs signal=sine_fit and a laser to make pixels of samples")
    run.inputs += [*chain(*(scan.inputs() for scan in scans.values())), *e.instrument.inputs()]
    skipped: list[Finding] = []
    try:
        with stopping_once():
            for prefix, scan in scans.items():
                journal = run.folder / JOURNAL / prefix
                found = session.session.scan_views(
                    replace(e, scan=scan),
                    journal,
                    run.operator,
                    run.keep,
                    run.watcher,
                    partial(pose.aiming.aiming_at_marks, e.laser, e.pose),
                )
                skipped += take_findings(found)
                run.tree |= {f"{prefix}{name}": group for name, group in found.items()}
    except session.NobodyThereError as error:
        raise ended_scan(str(error), run.folder) from error
    except instrument.InstrumentError as error:
        raise ended_scan(error.why, run.folder, error.not_home) from error
    if skipped:
        run.tree[f"{VERDICT}/scan"] = findings_to_dataset(skipped)


def _pose(run: Run) -> None:
    """Find where the instrument stood, by the chosen method and those it is compared with."""
    e = run.experiment
    told: list[Finding] = []
    if e.pose is not None:
        run.inputs += e.pose.inputs()
        chosen = e.pose.estimate(e.laser, e.target, run.tree)
        told += chosen.findings
        run.tree |= chosen.groups()
    for name, method in e.compare_pose.items():
        run.inputs += method.inputs()
        own = f"{COMPARED_SCANS}/{name}/"
        scanned = {k.removeprefix(own): g for k, g in run.tree.items() if k.startswith(own)}
        try:
            found = method.estimate(e.laser, e.target, scanned or run.tree)
        except UserError as error:
            raise UserError(f"compare_pose.{name}: {error}") from None
        run.tree[f"compare_pose/{name}"] = found.pose
        told += [_of_compared(name, finding) for finding in found.findings]
    if told:
        run.tree[f"{VERDICT}/pose"] = findings_to_dataset(told)


def _of_compared(name: str, finding: Finding) -> Finding:
    """Say which of the compared methods found it; no result of the run rests on these."""
    return replace(
        finding,
        subject=f"compare_pose.{name}, {finding.subject}",
        text=f"compare_pose.{name}: {finding.text}",
        severity=Severity.note,
    )


def _images(run: Run) -> None:
    """Read velocity images that were made before."""
    e = run.experiment
    run.inputs += e.instrument.inputs()
    found = e.instrument.images(e.stream.chunks if e.stream else None)
    run.tree |= found
    if e.stream:
        run.elsewhere |= set(found)


def _volume(run: Run) -> None:
    """Add surfaces around the real one, and where between them velocities are sampled."""
    _leaves_pixels_out(run.experiment)  # nor should a setting that is refused after it
    run.inputs += run.experiment.volume.inputs()
    try:
        run.tree["volume"] = run.experiment.volume.group()
    except UserError as error:
        raise UserError(f"volume: {error}") from None


def _leaves_pixels_out(e: Experiment) -> bool:
    """Tell whether pixels that dropped out are left out, on which all methods must agree."""
    methods = {"reconstruction": e.reconstruction} if e.reconstruction else {}
    methods |= {f"compare.{name}": method for name, method in e.compare.items()}
    if not methods:
        return False
    first, robust = next((name, method.robust) for name, method in methods.items())
    for name, method in methods.items():
        if method.robust is not robust:
            raise UserError(
                f"{name}.robust: must be that of {first}, {robust.name}, not {method.robust.name}: "
                "pixels are left out before any field is made"
            )
    return robust is Robust.auto


def _views(run: Run) -> None:
    """Compare the views with one another, before a field is made of them."""
    e = run.experiment
    robust = _leaves_pixels_out(e)
    refined = e.pose is not None and e.pose.refine is pose.base.Refine.images
    examined = verdict.examine_views(
        run.tree, e.laser, e.volume, robust, e.use_repair, refined, e.target
    )
    run.tree |= examined.groups
    for name in run.elsewhere & examined.groups.keys():
        own = name.replace("image/", FLAGGED)  # all that the run's own file has of it
        run.tree[own] = examined.groups[name][["flags"]]
    run.tree[f"{VERDICT}/views"] = findings_to_dataset(examined.findings)


def _views_of_points(run: Run) -> None:
    """Compare the views of single points with one another."""
    if "line_of_sight" not in run.tree:
        return  # the reconstruction says what is missing
    points, findings = verdict.examine_points(run.tree["line_of_sight"], run.experiment.use_repair)
    run.tree["line_of_sight"] = points
    run.tree[f"{VERDICT}/views"] = findings_to_dataset(findings)


def _line_of_sight(run: Run) -> None:
    """Read velocities along the lines of sight."""
    e = run.experiment
    run.inputs += e.instrument.inputs()
    _take_in(run, {"line_of_sight": e.instrument.read(run.tree, e.laser)})


def _images_of_points(run: Run) -> None:
    """Read velocities of points that were measured one by one, as the images that a field needs."""
    e = run.experiment
    run.inputs += e.instrument.inputs()
    _take_in(run, e.instrument.images_of_points(run.tree, e.laser))


def _take_in(run: Run, groups: dict[str, xr.Dataset]) -> None:
    """Add what an importer read, and what it found."""
    findings = take_findings(groups)
    run.tree |= groups
    if findings:
        run.tree[f"{VERDICT}/import"] = findings_to_dataset(findings)


def _modes(run: Run) -> None:
    """Find modes in the lines of all images, and how every view sees them."""
    e = run.experiment
    images = {
        k.removeprefix("image/"): group
        for k, group in run.tree.items()
        if k.startswith("image/") and not group.attrs.get("left_out")
    }
    try:
        further = {
            reference: {view: group for view, group in own.items() if view in images}
            for reference, own in further_references(run.tree).items()
        }
        found = modes.estimate_modes(images, e.modal, further)
    except UserError as error:
        raise UserError(f"modal: {error}") from None
    run.tree |= found.groups()
    run.tree[f"{VERDICT}/modes"] = findings_to_dataset(found.findings)


def _model_in_place(run: Run) -> None:
    """Read a finite element model, and see whether it is where the structure is."""
    e = run.experiment
    run.inputs += e.model.inputs()
    if e.modal is None:
        raise UserError("model: needs the modes of the structure to be tested; choose modal=own")
    if e.laser is None:
        raise UserError("model: needs a laser, whose beams tell where pixels meet it")
    try:
        model = e.model.model()
        models.placing.check_place(model, run.tree)
        e.model.check_further(model)
        if e.model.drive.known:
            models.modal_mass.motion_at(model, e.model.drive)
    except UserError as error:
        raise UserError(f"model: {error}") from None


def _model(run: Run) -> None:
    """Put a finite element model to the test by the measured modes."""
    e = run.experiment
    images = {k.removeprefix("image/"): v for k, v in run.tree.items() if k.startswith("image/")}
    try:
        found = models.estimate.examine_model(run.tree, e.laser, e.model)
    except UserError as error:
        raise UserError(f"model: {error}") from None
    run.tree |= models.result.model_to_datasets(found, images)
    run.tree[f"{VERDICT}/model"] = findings_to_dataset(models.wording.findings_about(found))


def _point(run: Run) -> None:
    """Reconstruct velocity vectors at points, by the chosen method and the others."""
    if "line_of_sight" not in run.tree:
        raise UserError(
            "reconstruction: there are no velocities to reconstruct from; "
            "name a file with instrument=file instrument.path=..., or choose a volume and scan "
            "images of the structure"
        )
    velocities = run.tree["line_of_sight"]
    e = run.experiment
    methods = {"point": e.reconstruction} if e.reconstruction else {}
    _reconstruct(run, "point", methods | _compared(e), lambda method: method.group(velocities))


def _field(run: Run) -> None:
    """Reconstruct the velocity over the volume, by the chosen method."""
    _require_solver(run.experiment)
    _reconstruct(run, "field", {"field": run.experiment.reconstruction}, *_ways(run))


def _compared_fields(run: Run) -> None:
    """Do so by the methods that the chosen one meets, which runs by other ones share."""
    _require_solver(run.experiment)
    _reconstruct(run, "compared", _compared(run.experiment), *_ways(run))


def _require_solver(e: Experiment) -> None:
    if e.laser is None or e.solver is None:
        raise UserError("field: needs a laser and a solver, for example solver=iterative")


def _compared(e: Experiment) -> dict[str, Reconstruction]:
    return {f"compare/{name}": method for name, method in e.compare.items()}


def _ways(run: Run) -> tuple[Way, SurfaceWay]:
    """Say how fields are made of the images: in the volume, and on its surface."""
    e = run.experiment
    return partial(_in_volume, e, run.tree), partial(_on_surface, e, run.tree)


def _in_volume(e: Experiment, tree: Mapping[str, xr.Dataset], method: Reconstruction) -> xr.Dataset:
    """Make the field of the images of a tree."""
    visibility = velocity_field.estimate.volume_visibility(tree, e.laser, e.volume)
    return velocity_field.estimate.reconstruct(tree, visibility, e.volume, method, e.solver)


def _on_surface(
    e: Experiment, tree: Mapping[str, xr.Dataset], method: shell.SurfaceReconstruction
) -> list[xr.Dataset]:
    """Make the splines' field of the images of a tree and, if lines are known, its strain."""
    found = shell.estimate.reconstruct_surface(tree, e.laser, e.volume, method, e.material)
    return [found.field()] if found.frequency is None else [found.field(), found.strain()]


def _fields_of_modes(run: Run) -> None:
    """Make fields of the modal images as of any others, and with splines their strains."""
    e = run.experiment
    own = {k: v for k, v in run.tree.items() if not k.startswith("image/")}
    tree = own | {
        k.removeprefix("modes/"): image
        for k, image in run.tree.items()
        if k.startswith(MODAL_IMAGES)
    }
    try:
        if isinstance(e.reconstruction, shell.SurfaceReconstruction):
            found = _on_surface(e, tree, e.reconstruction)
        else:
            found = [_in_volume(e, tree, e.reconstruction)]
    except UserError as error:
        raise UserError(f"modal: {error}") from None
    wider = (modes.with_pole_errors(each, run.tree["modes"]) for each in found)
    run.tree |= dict(zip(("modes/field", "modes/strain"), wider, strict=False))


def _streamed_fields(run: Run) -> None:
    """Reconstruct the velocity by all methods, with some frequencies in memory at a time."""
    e = run.experiment
    _require_solver(e)
    chunks = e.stream.chunks
    images = {
        k: importers.image_file.in_chunks(v, chunks)
        for k, v in run.tree.items()
        if k.startswith("image/")
    }
    with e.stream.at_work() as work:
        tree = velocity_field.streaming.tell_rest(run.tree | images, e.laser, e.volume, work)
        small = velocity_field.streaming.compress(tree, work)
        seen = tree | small.images
        visibility = velocity_field.estimate.volume_visibility(seen, e.laser, e.volume)
        folders = (run.blocks / f"field{k}" for k in count())

        def streamed(method: Reconstruction) -> xr.Dataset:
            args = (tree, small, visibility, e.volume, method, e.solver, work, next(folders))
            return velocity_field.streaming.stream_field(*args)

        def on_surface(method: shell.SurfaceReconstruction) -> tuple[xr.Dataset, ...]:
            found = shell.estimate.reconstruct_surface(
                tree, e.laser, e.volume, method, e.material, small.images
            )
            first = next(iter(images.values()))
            lines = velocity_field.streaming.slices(first["velocity"], "frequency")
            return shell.streamed.stream_surface(found, lines, next(folders))

        methods = {"field": e.reconstruction} if e.reconstruction else {}
        _reconstruct(run, "field", methods | _compared(e), streamed, on_surface)


def _reconstruct(
    run: Run,
    stage: str,
    methods: Mapping[str, Reconstruction],
    work: Way,
    on_surface: SurfaceWay | None = None,
) -> None:
    """Add the groups of some methods.

    Parameters
    ----------
    stage : str
        That findings are of.
    methods : mapping of str to Reconstruction
        By the names of their groups; those of compared methods are below ``compare/``.
    work : callable
        From a method to its group.
    on_surface : callable, optional
        From splines on the volume's surface to their field and, if they have one, its strain.
    """
    e = run.experiment
    for name, method in methods.items():
        try:
            if not isinstance(method, shell.SurfaceReconstruction):
                run.tree[name] = work(method)
                continue
            if on_surface is None or e.volume is None or e.laser is None:
                raise UserError(
                    "needs a surface and images of it: choose a volume and a laser, or "
                    "reconstruction=absolute for single points"
                )
            run.tree[name], *strain = on_surface(method)
            compared = name.removeprefix("compare/")
            for found in strain:
                run.tree["strain" if name == "field" else f"{COMPARED_STRAIN}/{compared}"] = found
        except UserError as error:
            where = name.replace("/", ".") if "/" in name else "reconstruction"
            raise UserError(f"{where}: {error}") from None
    if findings := take_findings(run.tree):
        run.tree[f"{VERDICT}/{stage}"] = findings_to_dataset(findings)


def _truth(run: Run) -> None:
    """Add what truly happens at the field's nodes, which only a virtual lab can tell."""
    run.tree["truth"] = virtual_lab.field_truth.truth_of(run.experiment, run.tree)


def _checks(run: Run) -> None:
    """Examine what the configuration wants examined."""
    seen = Examination(run.tree, rng=run.rng, experiment=run.experiment)
    for name, check in run.experiment.check.items():
        run.inputs += check.inputs()
        run.tree[f"examined/{name}"] = check.examine(seen)
    if findings := take_findings(run.tree):
        run.tree[f"{VERDICT}/checks"] = findings_to_dataset(findings)


def _expectations(run: Run) -> None:
    """Compare published numbers with this run's."""
    e = run.experiment
    found = evaluate(e.expect, run.tree, repaired=bool(e.use_repair))
    if found is not None:
        run.tree["check"] = found


def _reconstructs(e: Experiment) -> bool:
    return bool(e.reconstruction or e.compare)


def _has_pixels(e: Experiment) -> bool:
    """Tell whether points of files become pixels of images, because there is a volume."""
    return e.volume is not None and hasattr(e.instrument, "images_of_points")


def _has_truth(e: Experiment) -> bool:
    """Tell whether the images are those of a plate in the virtual lab."""
    return bool(e.volume and e.reconstruction and e.scan and hasattr(e.scene, "plate"))


EVERYTHING = ("/",)
TARGET, SCAN, POSE, VOLUME = "calibration object", "scan", "pose", "volume"
IMAGES, PIXELS = "velocity images", "images of points"
#: Of the configuration, what decides a measurement, a pose and a field.
MEASURING = (
    *("seed", "target", "laser", "scene", "scan", "compare_scan", "instrument", "signal"),
    "stream",  # which decides where images are kept
)
POSING = ("target", "laser", "pose", "compare_pose")
SOLVING = ("laser", "volume", "material", "solver", "stream")
ROBUST = ("reconstruction.robust", "compare.*.robust", "compare.*.plugin")  # and its default
FIELDS_NEED = ("pose", "volume", "image/")
SCANNED = ("edge/", "image/", "registration", f"{COMPARED_SCANS}/")

STEPS: tuple[Step, ...] = (
    Step(TARGET, lambda e: e.target is not None, _target, makes=("target",)),
    # Before anything is measured: an unsound volume should not cost a morning's scan.
    Step(
        VOLUME,
        lambda e: e.volume is not None,
        _volume,
        makes=("volume",),
        reads=("volume", *ROBUST),
    ),
    Step(
        "place of the model",
        lambda e: e.model is not None,
        _model_in_place,
        makes=(),
        needs=("volume",),
    ),
    Step(
        SCAN,
        lambda e: bool(e.scan or e.compare_scan),
        _scan,
        makes=(*SCANNED, f"{VERDICT}/scan"),
        needs=("target",),
        reads=MEASURING,
    ),
    Step(
        POSE,
        lambda e: bool(e.pose or e.compare_pose),
        _pose,
        makes=("pose", "registration", "conic", "compare_pose/", f"{VERDICT}/pose"),
        needs=("target", *SCANNED),
        reads=POSING,
    ),
    Step(IMAGES, lambda e: hasattr(e.instrument, "images"), _images, makes=("image/", FURTHER)),
    Step(
        "line-of-sight velocities",
        lambda e: hasattr(e.instrument, "read") and not _has_pixels(e),
        _line_of_sight,
        makes=("line_of_sight", f"{VERDICT}/import"),
        needs=("pose",),
    ),
    Step(
        PIXELS,
        lambda e: _has_pixels(e),
        _images_of_points,
        makes=("image/", FURTHER, f"{VERDICT}/import"),
        needs=("pose",),
        reads=("laser", "instrument"),
    ),
    Step(
        "comparison of the views",
        lambda e: _reconstructs(e) and e.volume is not None and bool(e.laser),
        _views,
        makes=(f"{VERDICT}/views", "image/", "pose", FLAGGED),
        needs=("pose", "volume", "image/"),
        reads=("laser", "volume", "pose", *ROBUST, "use_repair", "stream", "target"),
    ),
    Step(
        "comparison of the views of points",
        lambda e: _reconstructs(e) and e.volume is None,
        _views_of_points,
        makes=(f"{VERDICT}/views", "line_of_sight"),
        needs=("line_of_sight",),
    ),
    Step(
        "modes",
        lambda e: e.modal is not None,
        _modes,
        makes=("modes", MODAL_IMAGES, f"{VERDICT}/modes"),
        needs=("image/", FURTHER),
        reads=("modal",),
    ),
    Step(
        "finite element model",
        lambda e: e.model is not None,
        _model,
        makes=("model", "model/", f"{VERDICT}/model"),
        needs=("modes", MODAL_IMAGES, "pose", "volume", "image/"),
    ),
    Step(
        "shapes of the modes",
        lambda e: bool(e.modal and e.reconstruction and e.volume and e.laser and e.solver),
        _fields_of_modes,
        makes=("modes/field", "modes/strain"),
        needs=("modes", "pose", "volume", MODAL_IMAGES),
        reads=(*SOLVING, "reconstruction"),
    ),
    Step(
        "velocity at points",
        lambda e: _reconstructs(e) and e.volume is None,
        _point,
        makes=("point", "compare/"),
        needs=("line_of_sight",),
    ),
    Step(
        "velocity field",
        lambda e: bool(e.reconstruction) and e.volume is not None and e.stream is None,
        _field,
        makes=("field", "strain", f"{VERDICT}/field"),
        needs=FIELDS_NEED,
        reads=(*SOLVING, "reconstruction"),
    ),
    Step(
        "compared fields",
        lambda e: bool(e.compare) and e.volume is not None and e.stream is None,
        _compared_fields,
        makes=("compare/", f"{COMPARED_STRAIN}/", f"{VERDICT}/compared"),
        needs=FIELDS_NEED,
        reads=(*SOLVING, "compare"),
    ),
    Step(
        "streamed fields",
        lambda e: _reconstructs(e) and e.volume is not None and e.stream is not None,
        _streamed_fields,
        makes=("field", "strain", "compare/", f"{COMPARED_STRAIN}/", f"{VERDICT}/field"),
        needs=FIELDS_NEED,
        reads=(*SOLVING, "reconstruction", "compare"),
    ),
    Step(
        "truth of the virtual lab",
        lambda e: _reconstructs(e) and _has_truth(e),
        _truth,
        makes=("truth",),
        needs=("field", "strain", f"{COMPARED_STRAIN}/"),
    ),
    Step(
        "checks",
        lambda e: bool(e.check),
        _checks,
        makes=("examined/", f"{VERDICT}/checks"),
        needs=EVERYTHING,
    ),
    Step("expectations", lambda e: bool(e.expect), _expectations, ("check",), needs=EVERYTHING),
)


check_contracts(STEPS)
