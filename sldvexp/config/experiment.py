"""Root of the configuration: its groups, and which modules bring their plugins.

This is the one place that lists them. A further group is a field of `Experiment` here, its
plugins, and a folder of files in ``conf/``; a further plugin of a group is a line here and its
module.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any

from sldvexp.config.planning import PlanSettings


@dataclass(frozen=True)
class Group:
    """Word of a field of `Experiment` about the plugins that it holds.

    Parameters
    ----------
    name : str
        Folder of the group's files, and what its plugins register for.
    plugins : mapping of str to str
        Built-in plugins and the modules that register them. A module is imported when one of its
        plugins is chosen.
    chosen : str, optional
        File or plugin that is taken where nothing else is chosen.
    several : bool
        Whether the field is a table of plugins by name.
    makes : str
        Parent of the dataset's groups that the entries of the table make.
    """

    name: str
    plugins: Mapping[str, str]
    chosen: str | None = None
    several: bool = False
    makes: str = ""


def one_of(group: str, plugins: Mapping[str, str], chosen: str | None = None) -> Any:
    """Declare a field that holds one plugin; see `Group`."""
    return field(default=None, metadata={"group": Group(group, plugins, chosen)})


def several_of(group: str, plugins: Mapping[str, str] | None = None, makes: str = "") -> Any:
    """Declare a field that is a table of plugins by name; see `Group`."""
    told = Group(group, plugins or {}, several=True, makes=makes)
    return field(default_factory=dict, metadata={"group": told})


class Retry(Enum):
    """Which runs of a sweep that was started before are done again.

    Attributes
    ----------
    unfinished
        What is missing, failed, or would come out otherwise: other settings, inputs or versions.
    missing
        That without what failed.
    failed
        Only what failed or was cut off.
    all
        Everything.
    """

    unfinished = "unfinished"
    missing = "missing"
    failed = "failed"
    all = "all"


class OnDoubt(Enum):
    """What a run does once its verdict is no longer ``trusted``.

    Attributes
    ----------
    tell
        It goes on and says so first.
    stop
        It ends after the step that found something; everything so far is kept, the page is made.
    """

    tell = "tell"
    stop = "stop"


@dataclass
class SweepSettings:
    """How many runs of one command (`-m`) are treated.

    Parameters
    ----------
    rank : str
        Result that runs are ranked by, as in ``field.residual_std``; the smallest is the best, but
        the largest ``rcond``, ``efficiency``, ``passed``, ``covered`` and ``coverage``.
    retry : Retry
    """

    rank: str = ""
    retry: Retry = Retry.unfinished


@dataclass
class Experiment:
    """Root of the configuration: the plugins of one run, in the order in which data flows.

    Parameters
    ----------
    seed : int
        Seed of the run's one random generator.
    target, laser, scene, scan, instrument, signal : plugin
    pose, volume, reconstruction, material, solver, stream, modal, model : plugin
        A stage without a plugin is left out.
    compare_scan : dict of str to scan
        Further scans with the same instrument, for the pose methods of the same names.
    compare_pose : dict of str to pose
        Further pose methods, ``{plugin: edge}``; without a scan of their name they use ``scan``.
    compare : dict of str to reconstruction
        Further reconstructions of the same measurements, ``{plugin: relative, rows: all}``.
    check : dict of str to check
        What is examined after the estimates, ``{plugin: pose_repeats, repeats: 1000}``.
    export : dict of str to export
        Files of the results for other programs, ``{plugin: vtu}``; the name is that of the file.
    expect : dict of str to Expectation
        What the run must reproduce.
    report : plugin
        The page that the run leaves for people.
    on_doubt : OnDoubt
    use_repair : list of str
        Repairs that the verdict of an earlier run proposed, as ``[view_left.sign]``; they are done
        where the data enters. Nothing is repaired that is not named here.
    overwrite : bool
        Whether a finished run in the folder is replaced, once this one is done.
    plan : PlanSettings
        Where ``sldvexp plan`` may put the instrument, and for what.
    """

    seed: int = 0
    target: Any = one_of(
        "target", {"circles": "sldvexp.targets.circles", "points": "sldvexp.targets.points"}
    )
    laser: Any = one_of("laser", {"two_mirror": "sldvexp.laser.two_mirror"}, chosen="ometron")
    scene: Any = one_of(
        "scene",
        {
            "annular_plate": "sldvexp.virtual_lab.annular_plate",
            "calibration": "sldvexp.virtual_lab.calibration_scene",
            "plate": "sldvexp.virtual_lab.plate",
            "tube": "sldvexp.virtual_lab.tube",
        },
    )
    scan: Any = one_of(
        "scan",
        {
            "by_digitizer": "sldvexp.scan.by_digitizer",
            "by_hand": "sldvexp.scan.by_hand",
            "calibration": "sldvexp.scan.calibration",
            "list": "sldvexp.scan.pixel_list",
            "outline": "sldvexp.scan.outline",
            "rectangle": "sldvexp.scan.rectangle",
            "session": "sldvexp.scan.session",
        },
    )
    instrument: Any = one_of(
        "instrument",
        {
            "file": "sldvexp.importers.velocity_file",
            "images": "sldvexp.importers.image_file",
            "replay": "sldvexp.instrument.recording",
            "scan_export": "sldvexp.importers.scan_export",
            "simulated": "sldvexp.virtual_lab.lab",
            "uff": "sldvexp.importers.uff",
            "visa": "sldvexp.instrument.visa",
        },
    )
    signal: Any = one_of(
        "signal", {"sine_fit": "sldvexp.signal.sine_fit", "response": "sldvexp.signal.response"}
    )
    pose: Any = one_of(
        "pose",
        {
            "bitangent": "sldvexp.pose.bitangent",
            "bundle": "sldvexp.pose.bundle",
            "digitizer": "sldvexp.pose.digitizer",
            "edge": "sldvexp.pose.edge",
            "given": "sldvexp.pose.given",
            "manual": "sldvexp.pose.manual",
            "part": "sldvexp.pose.part",
            "registration": "sldvexp.pose.registration",
        },
    )
    volume: Any = one_of(
        "volume",
        {
            "grid": "sldvexp.volume.grid",
            "mesh": "sldvexp.volume.mesh",
            "outline": "sldvexp.volume.outlined",
            "points": "sldvexp.volume.points",
            "revolution": "sldvexp.volume.revolution",
        },
    )
    reconstruction: Any = one_of(
        "reconstruction",
        {
            "absolute": "sldvexp.reconstruction.absolute",
            "combined": "sldvexp.reconstruction.combined",
            "contravariant": "sldvexp.reconstruction.contravariant",
            "relative": "sldvexp.reconstruction.relative",
            "shell": "sldvexp.shell.shell",
            "spline": "sldvexp.shell.spline",
        },
    )
    material: Any = one_of("material", {"isotropic": "sldvexp.shell.material"})
    solver: Any = one_of(
        "solver",
        {
            "cholesky": "sldvexp.field.solvers.cholesky",
            "direct": "sldvexp.field.solvers.direct",
            "iterative": "sldvexp.field.solvers.iterative",
        },
        chosen="iterative",
    )
    stream: Any = one_of("stream", {"dask": "sldvexp.field.streaming.dask"})
    modal: Any = one_of("modal", {"own": "sldvexp.modes.own", "sdypy": "sldvexp.modes.by_sdypy"})
    model: Any = one_of(
        "model", {"file": "sldvexp.models.model_file", "plate": "sldvexp.models.skfem_plate"}
    )
    compare_scan: dict[str, Any] = several_of("scan")
    compare_pose: dict[str, Any] = several_of("pose", makes="compare_pose")
    compare: dict[str, Any] = several_of("reconstruction", makes="compare")
    check: dict[str, Any] = several_of(
        "check",
        {
            "bitangents": "sldvexp.check.bitangents",
            "cross_ratio": "sldvexp.check.cross_ratio",
            "equilibrium": "sldvexp.check.equilibrium",
            "equivalent_methods": "sldvexp.check.equivalent_methods",
            "faces": "sldvexp.check.faces",
            "field_pattern": "sldvexp.check.field_pattern",
            "gages": "sldvexp.check.gages",
            "image_truth": "sldvexp.check.image_truth",
            "kreis": "sldvexp.check.kreis",
            "left_out": "sldvexp.check.left_out",
            "lever_arm": "sldvexp.check.lever_arm",
            "love": "sldvexp.check.love",
            "middle_surface": "sldvexp.check.middle_surface",
            "modal_truth": "sldvexp.check.modal_truth",
            "needed_components": "sldvexp.check.needed_components",
            "phase_image": "sldvexp.check.phase_image",
            "pose_equivalence": "sldvexp.check.pose_equivalence",
            "pose_methods": "sldvexp.check.pose_methods",
            "pose_repeats": "sldvexp.check.pose_repeats",
            "power_flow": "sldvexp.check.power_flow",
            "printed": "sldvexp.check.printed",
            "repeatability": "sldvexp.check.repeatability",
            "strain_truth": "sldvexp.check.strain_truth",
            "surface_depth": "sldvexp.check.surface_depth",
            "truth": "sldvexp.check.truth",
        },
        makes="examined",
    )
    export: dict[str, Any] = several_of(
        "export",
        {
            "csv": "sldvexp.export.csv",
            "gif": "sldvexp.export.gif",
            "glb": "sldvexp.export.glb",
            "mat": "sldvexp.export.mat",
            "mp4": "sldvexp.export.mp4",
            "reg": "sldvexp.export.reg",
            "scanlist": "sldvexp.export.scanlist",
            "uff": "sldvexp.export.uff",
            "ugrid": "sldvexp.export.ugrid",
            "vtu": "sldvexp.export.vtu",
        },
    )
    expect: dict[str, Any] = field(default_factory=dict)
    report: Any = one_of(
        "report", {"html": "sldvexp.report.html.page", "none": "sldvexp.report.base"}, chosen="html"
    )
    on_doubt: OnDoubt = OnDoubt.tell
    use_repair: list[str] = field(default_factory=list)
    overwrite: bool = False
    sweep: SweepSettings = field(default_factory=SweepSettings)
    plan: PlanSettings = field(default_factory=PlanSettings)


#: What each field of `Experiment` says of the plugins that it holds, in the order of the flow.
FIELDS: dict[str, Group] = {
    f.name: f.metadata["group"] for f in fields(Experiment) if "group" in f.metadata
}
#: Fields whose value is one plugin; those of `NAMED_GROUPS` hold several, by name.
SINGLE_GROUPS = tuple(name for name, group in FIELDS.items() if not group.several)
NAMED_GROUPS = {name: group.name for name, group in FIELDS.items() if group.several}
#: Parents of the dataset's groups that entries of a field make.
ENTRIES_OF = {group.makes: name for name, group in FIELDS.items() if group.makes}
