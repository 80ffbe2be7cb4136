"""Pages of `sldvexp --help` and of `sldvexp <command> --help`, which fit the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

from sldvexp.cli.answers import keep
from sldvexp.cli.layout import columns, wrapped
from sldvexp.cli.list import EXPERIMENT, files
from sldvexp.cli.list import folders as folders_of
from sldvexp.config import registry

USES = (
    ("sldvexp", "the default experiment, a whole session in the virtual lab"),
    ("sldvexp handbook first_hour", "where to begin; sldvexp handbook lists the pages"),
    ("sldvexp experiment=pose pose.path=mine.reg", "one of the experiments, on your data"),
    ("sldvexp experiment=pose --cfg job", "what would be run"),
    ("sldvexp -m experiment=pose laser.mirror_offset=0,0.02", "one run for each value"),
    ("sldvexp --config-dir lab experiment=mine", "with experiments and choices of your own"),
    ("sldvexp ~experiment instrument=file ...", "from nothing: each choice is yours"),
    ("sldvexp resume=<run>", "a session that was cut off, to its end"),
    ("sldvexp --hydra-help", "all options"),
)

NAMED = (
    ("compare: {differences: {plugin: relative}}", "further reconstructions of the same data"),
    ("check: {repeats: {plugin: pose_repeats}}", "what is examined after the estimates"),
    ("export: {paraview: {plugin: vtu}}", "files for other programs, paraview.pvd"),
)


@dataclass(frozen=True)
class CommandHelp:
    """Words about one command.

    Parameters
    ----------
    takes : str
        Words after its name.
    does : str
        In the list of commands.
    told : tuple of str
        Paragraphs of its own page.
    examples : tuple of (str, str)
        Calls without the program's name, and what each does.
    options : mapping of str to str
        Names of options of its own, and what each takes.
    """

    takes: str
    does: str
    told: tuple[str, ...]
    examples: tuple[tuple[str, str], ...]
    options: Mapping[str, str] = field(default_factory=dict)


RUN = "outputs/<day>/<time>"

#: In the order of the page.
COMMAND_HELP = {
    "list": CommandHelp(
        "[group or part of a name]",
        "plugins and experiments, one line each",
        (
            "Lists what can be chosen: a plugin, what it is, and below it the files that set it "
            "up. A word that is no group is looked for in names and descriptions of all groups.",
        ),
        (
            ("list", "everything"),
            ("list pose", "the pose methods"),
            ("list strain", "all whose name or description has strain in it"),
            ("list --config-dir lab experiment", "with experiments of your own"),
        ),
    ),
    "show": CommandHelp(
        "group=name, part of a name, a run or a sweep",
        "what can be set of a choice, and all that a run found",
        (
            "Shows the page of one choice: every setting with its value, type, unit and meaning; "
            "of an experiment what it chooses, sets and expects. Part of a name is enough; if it "
            "fits several, they are listed.",
            "Of a run, given by its folder, it shows every number, finding and note, where the run "
            "itself ends in five lines; of one that failed or was cut off, why, what it has and "
            "how it goes on; of a sweep, the table of its runs.",
        ),
        (
            ("show pose=edge", "every setting of that method"),
            ("show bitangent", "found by its name: pose=bitangent and others"),
            ("show experiment=plate", "what the default experiment does"),
            (f"show {RUN}", "all that this run found"),
        ),
    ),
    "handbook": CommandHelp(
        "[page, word or site=folder]",
        "pages that explain the program, conventions, words, and how a result is read",
        (
            "Shows a page of the handbook in the terminal, lists all pages, or finds a word in "
            "them. With site= the whole handbook becomes a folder of pages for a browser, offline; "
            "that needs sldvexp[docs].",
        ),
        (
            ("handbook", "the pages with a line each"),
            ("handbook first_hour", "where to begin"),
            ("handbook bitangent", "pages and sections that have this word"),
            ("handbook site=manual", "all of it, to open in a browser"),
        ),
    ),
    "aim": CommandHelp(
        "<run or settings> [view=name] [at=x,y,z] [dac=up_down,left_right]",
        "where a point of the world is in DAC steps, and the other way round",
        (
            "Says which DAC steps, and mirror angles, bring the beam to points of the world, and "
            "where the beam of DAC steps goes: its ray, and where that meets the calibration "
            "object's planes and the volume's surface. With neither at= nor dac= it lists the "
            "circles or marks and the corners of the region. at= and dac= may be there more than "
            "once; unit=mm says the unit of points, which is m without it.",
            "The pose is the one that a run has found, with what its bound means in steps; of "
            "settings, as sldvexp itself takes them, it is the scan's rough pose, the one of "
            "pose=given, or that of a scene. Without view= all views are told.",
        ),
        (
            (f"aim {RUN} view=1 at=0.42,0.14,0", "a point, as the run's view 1 sees it"),
            (f"aim {RUN} view=1 dac=-120,300", "where that beam goes"),
            ("aim --config-dir lab experiment=mine", "circles and corners of every view"),
            ("aim experiment=plate view=1 unit=mm at=300,20,0 at=570,20,0", "two points in mm"),
        ),
    ),
    "plan": CommandHelp(
        "[next | check] [run] [key=value]",
        "where to stand, and which bounds that gives, before anything is measured",
        (
            "Finds stands for the object, laser and noise of an experiment, within the limits of "
            "plan.room, that make the mean or worst bound of a component or direction small, and "
            "tells the bounds that they reach. plan next finds the one stand that helps most "
            "after those of a run or of the configuration; plan check tells what given stands do "
            "not see, and why.",
            "With --to the plan becomes an experiment in a folder of yours, with the circles and "
            "regions of every view in DAC steps. Settings of plan: sldvexp handbook planning.",
        ),
        (
            ("plan", "five stands for the default experiment"),
            ("plan plan.stands=4 plan.of=in_plane plan.criterion=worst", "four for one purpose"),
            ("plan plan.wanted=6e-5", "as many as a bound of 0.06 mm/s needs"),
            ("plan --to lab --name monday", "written as lab/experiment/monday.yaml"),
            (f"plan next {RUN}", "the stand that helps most after those of a run"),
            ("plan check experiment=curved_panel", "what its stands see"),
        ),
        {
            "to": "folder that the plan is written to, for --config-dir",
            "name": "name of the experiment there; planned without it",
        },
    ),
    "check": CommandHelp(
        "<experiments, matrices or folders>",
        "whether experiments, or all of a folder, work as they expect",
        (
            "Runs each and says in one line whether it works and meets what it expects. Exit "
            "status 2 if one does not. What needs a real instrument is looked at and not run.",
        ),
        (
            ("check plate", "the default experiment"),
            ("check lab", "all experiments and matrices of your folder lab"),
            ("--config-dir lab check monday plate", "one of yours and one of the program's"),
        ),
    ),
    "console": CommandHelp(
        "[settings] [--port number]",
        "a page in the browser to aim, scan and watch a session",
        (
            "Serves a page on this machine alone and prints its address, in which the key to it "
            "is. There the beam is aimed, the places are written as an experiment of your folder, "
            "the scan is watched and steered, and its report is opened. One browser steers, others "
            "watch. Settings are those of a run. Needs sldvexp[console]; sldvexp handbook console "
            "explains the page.",
        ),
        (
            ("console experiment=plate", "practise in the virtual lab"),
            ("console --config-dir lab experiment=first", "with an instrument of yours"),
        ),
        {"port": "port of the page on this machine; without it a free one"},
    ),
    "report": CommandHelp(
        "<run or sweep>",
        "its page, report.html, anew",
        ("Makes the page of a run or sweep again, as if it had been run with this version.",),
        ((f"report {RUN}", "the page of one run"),),
    ),
    "plot": CommandHelp(
        "<run or sweep> [figures]",
        "figures as PNG and SVG",
        (
            "Writes all figures that the run can show, or the named ones, into the folder "
            "figures beside it; the same bytes from the same data.",
        ),
        (
            (f"plot {RUN}", "all that the run can show"),
            (f"plot {RUN} field nodal", "these two"),
            (f"plot {RUN} field --width 85mm --format pdf", "for a column of a journal"),
        ),
        {
            "width": "width of the printed figure, such as 85mm",
            "format": "formats of the files, of png, svg and pdf",
            "dpi": "dots per inch of what is painted",
            "style": "a file of matplotlib's settings, or the name of one of its styles",
        },
    ),
    "export": CommandHelp(
        "<run> <formats> [format.setting=value]",
        "its velocities for other programs",
        (
            "Writes the velocities and bounds of a finished run in each format, into its folder. "
            "sldvexp list export tells the formats, sldvexp show export=vtu the settings of one.",
        ),
        (
            (f"export {RUN} vtu uff", "for ParaView and for modal analysis"),
            (f"export {RUN} vtu vtu.phases=36", "with 36 phases of a period to play"),
        ),
    ),
    "compare": CommandHelp(
        "<runs or sweeps> [sweep.rank=result]",
        "one table and dataset of runs that exist",
        (
            "Collects finished runs into one dataset and table, by the settings that set them "
            "apart, and ranks them. It leaves a folder of its own in outputs.",
        ),
        (
            (f"compare {RUN} outputs/<day>/<later>", "two runs"),
            ("compare <run> <other> sweep.rank=field.residual_std", "ranked by it"),
        ),
    ),
    "rerun": CommandHelp(
        "<run>",
        "the run once more; what is not bit-identical, and why",
        (
            "Repeats a run from its file alone into a new folder and compares the two, quantity "
            "by quantity. Exit status 2 if one is different.",
        ),
        ((f"rerun {RUN}", "the same run again"),),
    ),
    "truth": CommandHelp(
        "<run> [scene=name]",
        "how far a run in the virtual lab is from what was true there",
        (
            "Says of each view how far its pose is from where the instrument stood, and of each "
            "component of the velocity how far it is from that of the plate, and how often its "
            "bounds hold. A run that was measured with sldvexp-lab, also from the console, does "
            "not know the scene that the lab had: scene= and --config-dir say it. Nothing is run "
            "again.",
        ),
        (
            (f"truth {RUN}", "of a run with instrument=simulated"),
            (f"truth --config-dir lab {RUN} scene=practice", "of one measured with sldvexp-lab"),
        ),
    ),
}


def text(folders: list[Path]) -> str:
    """Write the help page.

    Parameters
    ----------
    folders : list of Path
        Of configuration files, the first wins.
    """
    commands = [(f"{name} {one.takes}", one.does) for name, one in COMMAND_HELP.items()]
    return "\n".join(
        [
            *wrapped(
                "sldvexp finds where a scanning laser Doppler vibrometer stood and what moved, "
                "with bounds."
            ),
            "",
            *wrapped("usage: sldvexp [group=choice | key=value ...] [options]", 0, 7),
            *wrapped("sldvexp [--config-dir lab] command ...", 7),
            "",
            *columns(USES),
            "",
            "Commands; <run> is the folder of a run, or its run.nc:",
            *columns(commands),
            *wrapped("sldvexp <command> --help has the page of a command, with examples."),
            "",
            *wrapped(
                "Groups and their choices; sldvexp list <group> says what each is, sldvexp show "
                "<group>=<choice> what can be set:"
            ),
            *columns([(group, ", ".join(names)) for group, names in _choices(folders)]),
            "",
            "compare, check and export hold plugins by name, for example",
            *columns(NAMED),
        ]
    )


def first(asked: str) -> str | None:
    """Write the help page before anything of Hydra is loaded, and keep it as an answer.

    Parameters
    ----------
    asked : str
        Name of the question, see `sldvexp.cli.answers`.

    Returns
    -------
    str or None
        None where packages of others bring plugins, which may be anything.
    """
    if metadata.entry_points(group=registry.ENTRY_POINTS):
        return None
    page = f"{text(folders_of(None))}\n"
    keep(asked, page)
    return page


def of_command(name: str) -> str:
    """Write the page of one command."""
    one = COMMAND_HELP[name]
    lines = wrapped(f"usage: sldvexp {name} {one.takes}", 0, 7)
    for paragraph in one.told:
        lines += ["", *wrapped(paragraph)]
    if one.options:
        options = [(f"--{option}", told) for option, told in one.options.items()]
        lines += ["", "Options:", *columns(options)]
    calls = [(f"sldvexp {call}", does) for call, does in one.examples]
    return "\n".join([*lines, "", "Examples:", *columns(calls)])


def _choices(folders: list[Path]) -> Iterator[tuple[str, list[str]]]:
    """Yield groups with the names of all that can be chosen: files, and plugins without one."""
    for group in (EXPERIMENT, *registry.GROUPS):
        found = files(group, folders)
        others = [p for p in registry.names(group) if p not in found and _by_name(group, p)]
        if found or others:
            yield group, [*found, *others]


def _by_name(group: str, name: str) -> bool:
    """Tell whether a plugin without a file can be chosen: by name, or of another package."""
    return group in ("check", "export") or name not in registry.BUILT_IN[group]
