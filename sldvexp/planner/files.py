"""Files of a plan: an experiment that a run takes as it is, and the poses alone, as YAML.

``experiment/<name>.yaml`` is built on the user's own experiment where that lies in the same folder
and has nothing that a plan would have to take away, as views of its own; so its lines and comments
stay in one place. Else it says what differs from the choices of the groups, and all that the user's
experiment states. With it come the plan's views: rough poses of the scan, with the region in the
world, or circles and corners in DAC steps where the scan cannot predict them, and in a virtual lab
the true stands. The pose method stays, since nobody stands exactly where a plan says.
``pose/<name>.yaml`` has the stands as they are planned, for ``pose=<name>``. Both are written whole
or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf

from sldvexp.config.experiment import SINGLE_GROUPS
from sldvexp.config.own_files import (
    choice_text,
    own_path,
    require_writable,
    write_own,
    wrong_name,
)
from sldvexp.config.sources import Origins
from sldvexp.errors import UserError
from sldvexp.planner.circle_lines import fit_stride
from sldvexp.planner.images import USUAL_PIXELS, Stand
from sldvexp.planner.planned import StandPlan
from sldvexp.units import LengthUnit

#: Name of the key of a pose for the place that is looked at.
LOOK_AT = "look_at"
#: Groups that a plan is a choice of.
GROUPS = ("experiment", "pose")
#: Settings that a plan does not go on with: they are of other views.
OF_OTHER_VIEWS = ("expect", "overwrite", "use_repair")


#: Advice to who has such a file already.
INSTEAD = "overwrite=true puts this plan in its place"


def require_free(folder: Path, name: str, replace: bool) -> None:
    """Refuse a name whose files cannot be written, before a plan is looked for.

    Raises
    ------
    UserError
        If it is no name, or a file exists and is not to be replaced.
    """
    if wrong := wrong_name(name):
        raise UserError(f"command line: --name={name}: {wrong}")
    require_writable([own_path(folder, group, name) for group in GROUPS], replace, INSTEAD)


def write(
    plan: StandPlan,
    config: DictConfig,
    plugins: Mapping[str, str],
    choices: Mapping[str, str],
    folder: Path,
    name: str,
    replace: bool,
    config_dir: str | None = None,
    base: str = "",
) -> list[Path]:
    """Write the files of a plan.

    Parameters
    ----------
    config : DictConfig
        The composed configuration that was planned for.
    plugins : mapping of str to str
        Plugin of each of its groups.
    choices : mapping of str to str
        What was chosen of each; the plugin is taken for others.
    folder : Path
        For ``--config-dir``.
    name : str
        For ``experiment=`` and ``pose=``.
    replace : bool
        Whether files that exist are replaced.
    config_dir : str, optional
        Folder of the user's that has some of what was chosen.
    base : str
        Experiment that was chosen.

    Raises
    ------
    UserError
        If a file exists and is not to be replaced, or cannot be written.
    """
    require_free(folder, name, replace)
    own = "" if base == name or not own_path(folder, "experiment", base).is_file() else base
    whole = own and built_text(plan, config, plugins, choices, folder, own)
    whole = whole or experiment_text(plan, config, plugins, choices, config_dir, base)
    paths = [own_path(folder, group, name) for group in GROUPS]
    texts = dict(zip(paths, (whole, pose_text(plan)), strict=True))
    write_own(texts, replace, INSTEAD)
    return list(texts)


def built_text(
    plan: StandPlan,
    config: DictConfig,
    plugins: Mapping[str, str],
    choices: Mapping[str, str],
    folder: Path,
    own: str,
) -> str:
    """Write the plan's views as an experiment built on another one; empty if that does not go."""
    origins = Origins([f"experiment={own}", "--config-dir", str(folder)])
    composed = origins.compose()
    chosen = composed.hydra.runtime.choices
    base, values = _as_data(composed), _as_data(config)
    _put_views(values, plan, plugins)
    same = all(chosen.get(group) == choice for group, choice in choices.items())
    more = any(_has_more(base.get(group), values[group]) for group in plugins)
    if not same or more or not set(OF_OTHER_VIEWS).isdisjoint(_stated(folder, own)):
        return ""
    built = f"Built on experiment={own}: its lines hold where nothing else is said here."
    told, defaults = [_told(plan), built], [f"/experiment/{own}", "_self_"]
    return choice_text(told, defaults, _differences(values, base), apart=True)


def experiment_text(
    plan: StandPlan,
    config: DictConfig,
    plugins: Mapping[str, str],
    choices: Mapping[str, str],
    config_dir: str | None = None,
    own: str = "",
) -> str:
    """Write the experiment with the plan's views, and what another one of the user's states."""
    values = _as_data(config)
    _put_views(values, plan, plugins)
    chosen = {g: choices.get(g, f"schema/{plugins[g]}") for g in plugins}
    base = _base(chosen, config_dir)
    wider = [g for g in plugins if _has_more(base.get(g), values[g])]
    if wider:  # an entry of a table that the plan does not have: from the plugin alone
        chosen |= {g: f"schema/{plugins[g]}" for g in wider}
        base = _base(chosen, config_dir)
    stated = _stated(Path(config_dir), own) if config_dir and own else {}
    differing = _differences(values, base, stated)
    overrides = ({f"override /{g}": chosen[g]} for g in SINGLE_GROUPS if g in chosen)
    defaults = ["_self_", *overrides]
    told = [_told(plan)]
    told += [f"Made of experiment={own}, of which it has all lines that it goes on with."] * bool(
        stated
    )
    return choice_text(told, defaults, differing, apart=True)


def _told(plan: StandPlan) -> str:
    """Say what is planned."""
    return (
        f"{len(plan.stands)} planned stands; the {plan.goal.criterion.name} bound asked for is "
        f"{1e3 * plan.asked:.3g} mm/s."
    )


def _stated(folder: Path, name: str) -> dict[str, Any]:
    """Read what an experiment of the user's states, and those of the folder that it is made of."""
    path = own_path(folder, "experiment", name)
    if not path.is_file():
        return {}
    written = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    found: dict[str, Any] = {}
    for made_of in written.pop("defaults", []):
        if isinstance(made_of, str) and made_of != "_self_":
            found |= _stated(folder, made_of.removeprefix("/experiment/"))
    merged: Any = OmegaConf.to_container(OmegaConf.merge(found, written))
    return dict(merged)


def _base(chosen: Mapping[str, str], config_dir: str | None) -> dict[str, Any]:
    """Compose the choices alone, as data."""
    options = ["--config-dir", config_dir] if config_dir else []
    origins = Origins(["~experiment", *(f"{g}={c}" for g, c in chosen.items()), *options])
    return _as_data(origins.compose())


def _as_data(config: DictConfig) -> dict[str, Any]:
    """Turn a configuration into plain values, without Hydra's own and what is of other views."""
    kept = [str(key) for key in config if key not in ("hydra", *OF_OTHER_VIEWS)]
    values: Any = OmegaConf.to_container(
        OmegaConf.masked_copy(config, kept), resolve=True, enum_to_str=True
    )
    return dict(values)


def _has_more(base: Any, values: Any) -> bool:
    """Tell whether a table has an entry that another lacks."""
    if not isinstance(base, dict) or not isinstance(values, dict):
        return False
    return any(k not in values or _has_more(base[k], values[k]) for k in base)


def _differences(
    values: Mapping[str, Any], base: Mapping[str, Any], stated: Any = None
) -> dict[str, Any]:
    """Keep what is not in the base already, or is stated."""
    said = stated if isinstance(stated, dict) else {}
    found: dict[str, Any] = {}
    for key, value in values.items():
        if key in base and value == base[key] and key not in said:
            continue
        nested = isinstance(value, dict) and isinstance(base.get(key), dict)
        found[key] = _differences(value, base[key], said.get(key)) if nested else value
    return found


def _put_views(values: dict[str, Any], plan: StandPlan, plugins: Mapping[str, str]) -> None:
    """Put the plan's views into the scan, the virtual lab, and the poses that are given."""
    stays = len(plan.added) < len(plan.stands)
    poses = {s.name: as_pose(s) for s in plan.added}
    if (scan := values.get("scan")) is not None:
        _put_into_scan(scan, plugins["scan"], plan, stays, poses)
    if plugins.get("scan") in ("session", "calibration"):
        whole = values["scan"]
        fit_stride(whole.get("calibration", whole), plan.added, plan.place)
    if values.get("scene") is not None:
        values["scene"]["views"] = {**(values["scene"]["views"] if stays else {}), **poses}
    if plugins.get("pose") == "given" and not values["pose"]["path"]:
        values["pose"]["views"] = {**(values["pose"]["views"] if stays else {}), **poses}


def _put_into_scan(
    scan: dict[str, Any], plugin: str, plan: StandPlan, stays: bool, poses: dict[str, Any]
) -> None:
    """Put the views into a scan: as rough poses where it can predict from them, else in DAC steps.

    Rough poses predict the circles of a calibration object, and the region whose corners are told
    in the world.
    """
    session = plugin == "session"
    foreseen = bool(scan.get("poses")) or (session and bool(scan["outline"]["path"]))
    foreseen = foreseen or plan.place.marks.circles is not None
    steps = {s.name: {"dac": s.circles.tolist()} for s in plan.added if len(s.circles)}
    corners = {s.name: {"corners": s.corners.tolist()} for s in plan.added}
    of_pose = {name: {"pose": pose} for name, pose in poses.items()}
    if session and foreseen:
        scan["poses"] = {**(scan["poses"] if stays else {}), **poses}
        of_pose = {}
    if session or plugin == "calibration":
        circles = scan["calibration"] if session else scan
        circles["views"] = {
            **(circles["views"] if stays else {}),
            **(of_pose if foreseen else steps),
        }
    if session or plugin == "rectangle":
        image = scan["structure"] if session else scan
        foreseen = _tell_region(image, plan) and (foreseen or not session)
        image["views"] = {**(image["views"] if stays else {}), **(of_pose if foreseen else corners)}


def _tell_region(image: dict[str, Any], plan: StandPlan) -> bool:
    """Tell a scan of images the region that it takes, in the world; false if nobody knows it."""
    if not image["pixels"] and image["stride"] is None:
        image["pixels"] = list(USUAL_PIXELS)
    if not image["corners_at"]:
        unit = LengthUnit[image["unit"]].value
        image["corners_at"] = ((plan.place.region / unit).round(6) + 0.0).tolist()
    return bool(image["corners_at"])


def as_pose(stand: Stand) -> dict[str, Any]:
    """Say a stand as a pose: where it is and what it looks at, upright."""
    return {
        "origin": (stand.origin.round(4) + 0.0).tolist(),  # no -0.0
        LOOK_AT: (stand.look_at.round(4) + 0.0).tolist(),
    }


def pose_text(plan: StandPlan) -> str:
    """Write the stands as poses that are given."""
    views = {stand.name: as_pose(stand) for stand in plan.stands}
    told = f"Poses of {len(views)} stands as they are planned."
    return choice_text([told], ["schema/given@_here_", "_self_"], {"views": views})
