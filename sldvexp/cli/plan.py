"""`sldvexp plan [next | check] [run] [settings]`: where to stand, and which bounds that gives."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import cast

import numpy as np
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException
from rich.console import Console
from rich.table import Table

from sldvexp import config, dataset, planner
from sldvexp.cli.help import COMMAND_HELP
from sldvexp.cli.layout import wrapped
from sldvexp.config import Origins, messages, schema
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import RUN_FILE
from sldvexp.config.planning import PlanCriterion, PlanRoom
from sldvexp.config.refusals import refusal
from sldvexp.dataset import RunData
from sldvexp.errors import UserError, nearest
from sldvexp.planner.images import Stand
from sldvexp.planner.place import OBLIQUE, SETTING_OF, Place, Unseen
from sldvexp.planner.planned import USUAL_NOISE, StandPlan, sampling_of
from sldvexp.plot import save
from sldvexp.plot.catalogue import USUAL
from sldvexp.sweep import recorded_config
from sldvexp.targets import Circles, shaded_circles
from sldvexp.targets.shadows import shade_told

#: Options of this command with what they take.
OPTIONS = COMMAND_HELP["plan"].options
#: What is planned, by the word behind the command.
ACTIONS = ("next", "check")
USUAL_NAME = "planned"
#: How a setting begins that chooses an experiment.
CHOICES = ("experiment=", "+experiment=")
#: Folder of the figures beside the experiments.
FIGURES = "figures"


def run(
    words: list[str], config_dir: str | None, to: str | None = None, name: str | None = None
) -> int:
    """Plan stands, print what they see and which bounds they reach, and write them if asked.

    Raises
    ------
    UserError
        If a word means nothing, there is no object to see, or no stand is feasible.
    """
    gc.enable()
    named = [word for word in words if "=" not in word and not word.startswith("~")]
    settings = [word for word in words if word not in named]
    action = named[0] if named and named[0] in ACTIONS else ""
    folders = named[1:] if action else named
    if named and not action and not Path(named[0]).exists():
        told = nearest(named[0], ACTIONS)
        raise UserError(
            f"command line: there is no plan {named[0]}; {told}; plan alone finds stands, and a "
            "setting is key=value"
        )
    if len(folders) > 1 or (folders and not action):
        raise UserError(
            f"command line: plan takes settings, and behind next or check the folder of one run, "
            f"not {' '.join(folders)}"
        )
    if name is not None and to is None:
        raise UserError("command line: --name is of the files that --to=folder writes")
    name = name or USUAL_NAME
    if folders:
        composed, plugins, choices, done = _of_run(Path(folders[0]), settings)
    else:
        composed, plugins, choices = _composed(settings, config_dir)
        done = None
    experiment = schema.build(_without_lacking_poses(composed, plugins))
    if to is not None:
        planner.files.require_free(Path(to), name, replace=experiment.overwrite)
    found = _planned(action, experiment, done)
    _print(found, action, experiment, of_run=done is not None)
    if to is None:
        return 0
    written = planner.files.write(
        found,
        composed,
        plugins,
        choices,
        Path(to),
        name,
        replace=experiment.overwrite,
        config_dir=config_dir,
        base=next((s.partition("=")[2] for s in settings if s.startswith(CHOICES)), ""),
    )
    drawn = planner.figure.draw(found)
    written += save(drawn, Path(to) / FIGURES / name, formats=USUAL)
    for path in written:
        print(path)
    print(f"sldvexp --config-dir {to} experiment={name} runs it")
    return 0


def _planned(action: str, experiment: Experiment, done: RunData | None) -> StandPlan:
    if action == "next":
        return planner.next_stand(experiment, done)
    if action == "check":
        return planner.check_stands(experiment, done)
    return planner.plan(experiment)


def _composed(
    settings: list[str], config_dir: str | None
) -> tuple[DictConfig, dict[str, str], dict[str, str]]:
    """Compose a configuration, with the plugin and the choice of each of its groups."""
    origins = Origins([*settings, *(["--config-dir", config_dir] if config_dir else [])])
    try:
        if origins.may_have_others:
            config.security.check(origins)
        composed = origins.compose()
        choices = dict(composed.hydra.runtime.choices)
        with open_dict(composed):
            del composed["hydra"]
        plugins = schema.plugin_names(composed)
        schema.build(_without_lacking_poses(composed, plugins))
    except Exception as error:  # Hydra's and OmegaConf's have no common base
        raise UserError(messages.of_composition(error, origins)) from error
    return composed, plugins, {g: choices[g] for g in plugins if choices.get(g)}


def _without_lacking_poses(composed: DictConfig, plugins: dict[str, str]) -> DictConfig:
    """Leave out the pose method ``given`` of no poses, which are what a plan writes."""
    if plugins.get("pose") != "given" or composed.pose.path or composed.pose.views:
        return composed
    left = composed.copy()
    left.pose = None
    return left


def _of_run(
    given: Path, settings: list[str]
) -> tuple[DictConfig, dict[str, str], dict[str, str], RunData]:
    """Take a run with its configuration, and settings of the plan for it."""
    path = given / RUN_FILE if given.is_dir() else given
    with dataset.load(path) as tree:
        recorded = recorded_config.read(path, tree.attrs)
        groups = {n.path.strip("/"): n.to_dataset(inherit=False) for n in tree.subtree}
        kept = {k: g.load() for k, g in groups.items() if k == "pose" or k.startswith("image/")}
        done = RunData(kept, dict(tree.attrs), path.parent)
    composed = recorded.config()
    for override in Origins(settings).overrides:
        if not override.key_or_group.startswith(("plan.", "overwrite")):
            raise UserError(
                f"command line: {override.key_or_group}: with a run only settings of plan are "
                "taken; the others are the run's own"
            )
        try:
            keys = override.key_or_group.split(".")
            nested = reduce(lambda value, key: {key: value}, reversed(keys), override.value())
            composed = cast(DictConfig, OmegaConf.merge(composed, nested))
        except OmegaConfBaseException as error:
            raise UserError(f"command line: {override.key_or_group} {refusal(error)}") from None
    return composed, recorded.plugins, {}, done


def _print(found: StandPlan, action: str, experiment: Experiment, of_run: bool) -> None:
    console = Console()
    console = console if console.is_terminal else Console(width=max(console.width, 132))
    console.print(_stands(found))
    console.print(_bounds(found))
    for line in told(found, action, experiment, of_run):
        console.print("\n".join(wrapped(line)), highlight=False, markup=False)


def _stands(found: StandPlan) -> Table:
    """Make the table of the stands."""
    table = Table(title="Stands", title_justify="left")
    for column in (
        "stand",
        "x, y, z, m",
        "looks at, m",
        "distance, m",
        "incidence where it sees",
        "sees",
    ):
        table.add_column(column)
    nodes, frame = found.place.nodes, found.place.frame
    for k, stand in enumerate(found.stands):
        way = np.linalg.norm(stand.origin - nodes, axis=1)
        cosine = np.einsum("ni,ni->n", found.examined.directions[k], frame[:, 2])
        seen = found.examined.seen[k] | ~found.examined.seen[k].any()
        angle = np.degrees(np.arccos(np.clip(cosine[seen], -1, 1)))
        table.add_row(
            stand.name,
            ", ".join(f"{x:.3f}" for x in stand.origin.round(3) + 0.0),
            ", ".join(f"{x:.3f}" for x in stand.look_at.round(3) + 0.0),  # no -0.000
            f"{way.min():.2f} to {way.max():.2f}",
            f"{angle.min():.0f} to {angle.max():.0f} deg",
            _seen(found, k),
        )
    return table


def _seen(found: StandPlan, k: int) -> str:
    """Say what a stand sees."""
    why, refused = found.examined.why[k], found.examined.refused[k]
    seen = int((why == 0).sum())
    text = "all" if seen == len(why) else f"{seen} of {len(why)} nodes"
    return f"{text}; {Unseen(refused).told}" if refused else text


def _bounds(found: StandPlan) -> Table:
    """Make the table of the bounds that are reached."""
    table = Table(title=f"Bounds ({found.confidence:.0%}), mm/s", title_justify="left")
    table.add_column("over the surface")
    for component in found.expected.components:
        table.add_column(component)
    for name, values in (("r.m.s.", found.mean), ("worst node", found.worst)):
        table.add_row(name, *(f"{1e3 * v:.3g}" for v in values))
    return table


def told(
    found: StandPlan, action: str, experiment: Experiment, of_run: bool = False
) -> Iterator[str]:
    """Yield sentences on what was asked for, what is not seen and what the bounds leave out."""
    yield (
        "an instrument looks at the point that its beam meets with both mirrors at step 0; planned "
        "stands look where the region and the calibration object lie evenly within the mirrors"
    )
    if action != "check" and experiment.plan.room.unsaid:
        yield _usual_room(experiment.plan.room)
    if (wanted := experiment.plan.in_si("wanted")) is not None:
        yield f"wanted, at most: {1e3 * wanted:.3g} mm/s"
    for count, bound in found.by_count.items():
        yield f"{count} stands: about {1e3 * bound:.3g} mm/s"
    of = experiment.plan.of
    of = of if isinstance(of, str) else f"the direction {of}"
    of = "the ends of the gage along it" if found.gage is not None else of
    which = "largest" if found.goal.criterion is PlanCriterion.worst else "r.m.s."
    asked = f"asked for, the {which} bound of {of}: {1e3 * found.asked:.3g} mm/s"
    if found.undetermined:
        are = "is" if found.undetermined == 1 else "are"
        yield (
            f"{found.undetermined} of {len(found.place.nodes)} nodes {are} seen by too few stands "
            "to determine all components there; the table is of the others; more stands help, or a "
            "wider plan.room.incidence"
        )
    else:
        yield asked
    if found.gage is not None:
        hertz = sampling_of(experiment.scan).frequency[0]
        strain = found.gage.strain(found.asked, hertz)
        yield (
            f"strain over the gage of {1e3 * found.gage.length:.3g} mm, at {hertz:g} Hz: "
            f"{1e6 * strain:.3g} microstrain"
        )
    yield from planner.limits.nearly_one(found.stands, found.place)
    if limits := planner.limits.told(found.limits, found.asked):
        yield limits
    if action != "check" and (limited := _circles_limit(found, experiment)):
        yield limited if limits else f"{limited}: try plan.room.incidence={OBLIQUE:g}"
    yield from planner.circle_limits.hidden_told(found.stands, found.place)
    if found.one_more is not None:
        yield found.one_more.told
    if action and not of_run:
        yield from planner.done.boxes_told(found.given, found.place, experiment)
    if action == "check":
        yield from _not_seen(found)
        yield from planner.circle_lines.too_short(found.stands, found.place, experiment.scan)
    yield (
        f"bounds are of the noise, {1e3 * found.noise:.3g} mm/s at a pixel{_noise_of(experiment)}, "
        "of every place by itself; poses and the size of elements add to them, a thin shell "
        "lessens them"
    )


def _circles_limit(found: StandPlan, experiment: Experiment) -> str:
    """Say that circles limit the stands, by places all around that are drawn anew."""
    place = found.place
    place = replace(place, room=place.room.for_new_stands()).thinned()
    return planner.circle_limits.around(place, np.random.default_rng(experiment.seed))


def _noise_of(experiment: Experiment) -> str:
    """Say where the noise is from, if nobody has said it."""
    if experiment.plan.noise is not None:
        return ""
    if experiment.scene is not None:
        return " (of scene.vibrometer, as plan.noise is not set)"
    return f" (of a usual vibrometer, {1e3 * USUAL_NOISE:g} mm/s r.m.s., as plan.noise is not set)"


def _usual_room(said: PlanRoom) -> str:
    """Say within which limits stands were looked for that nobody has said."""
    room, unsaid = said.for_new_stands(), said.unsaid
    limits = {
        "low": "from y = {1:g} m",
        "high": "up to y = {1:g} m",
        "distance": "{:g} to {:g} m away",
    }
    told = [limits[key].format(*getattr(room, key)) for key in unsaid]
    keys = [f"plan.room.{key}" for key in unsaid]
    listed = " and ".join(filter(None, [", ".join(keys[:-1]), keys[-1]]))
    are = "are" if len(keys) > 1 else "is"
    return f"stands were looked for {', '.join(told)}, as {listed} {are} not set"


def _not_seen(found: StandPlan) -> Iterator[str]:
    """Say which nodes each stand does not see, and why."""
    place = found.place
    for k, stand in enumerate(found.stands):
        refusals = place.refusals(stand.origin[None], stand.rotation[None])
        for reason in (reason for reason, refused in refusals.items() if refused[0]):
            yield f"stand {stand.name}: {_why(reason, place, stand)}"
        why = found.examined.why[k]
        for reason in map(Unseen, np.unique(why[why > 0])):
            nodes = np.flatnonzero(why == reason)
            low, high = (getattr(place.nodes[nodes], f)(axis=0) for f in ("min", "max"))
            places = ", ".join(f"{a:.3f} to {b:.3f}" for a, b in zip(low, high, strict=True))
            yield (
                f"stand {stand.name} does not see {len(nodes)} of {len(why)} nodes, within "
                f"({places}) m: {_why(reason, place, stand)}"
            )


def _why(reason: Unseen, place: Place, stand: Stand) -> str:
    """Say a reason with the circles that it is about, or the setting that it comes from."""
    if reason is Unseen.target_hidden and place.marks.circles is not None:
        hidden = shaded_circles(stand.origin, place.marks.circles)
        return "; ".join(shade_told(number, others) for number, others in hidden.items())
    told = reason.told
    if reason is Unseen.target_incidence and place.marks.circles is not None:
        told = f"{told}, {_oblique(place, stand, place.marks.circles)}"
        if place.room.incidence > place.incidence_of_circles:
            return f"{told} (circles are found up to {place.incidence_of_circles:g} deg)"
    name = SETTING_OF[reason].partition(" ")[0].removeprefix("plan.room.")
    value = getattr(place.room, name, None)
    return told if value is None else f"{told} (plan.room.{name}={value})"


def _oblique(place: Place, stand: Stand, target: Circles) -> str:
    """Name the circles that a stand sees too obliquely, with their planes and angles."""
    angles = place.marks.incidences(stand.origin)
    return " and ".join(
        f"circle {number} on the plane {target.circles[number].plane} at {angle:.1f} deg"
        for number, angle in angles.items()
        if angle > place.incidence_of_circles
    )
