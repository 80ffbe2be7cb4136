"""Files of a plan: an experiment that a run takes as it is, and the poses alone, as YAML.

``experiment/<name>.yaml`` says what differs from the choices of the groups, with the plan's views:
rough poses of the scan, with the region in the world, or circles and corners in DAC steps where the
scan cannot predict them, and in a virtual lab the true stands. The pose method stays, since nobody
stands exactly where a plan says. ``pose/<name>.yaml`` has the stands as they are planned, for
``pose=<name>``. Both are written whole or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

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

    Raises
    ------
    UserError
        If a file exists and is not to be replaced, or cannot be written.
    """
    require_free(folder, name, replace)
    whole = experiment_text(plan, config, plugins, choices, config_dir)
    paths = [own_path(folder, group, name) for group in GROUPS]
    texts = dict(zip(paths, (whole, pose_text(plan)), strict=True))
    write_own(texts, replace, INSTEAD)
    return list(texts)


def experiment_text(
    plan: StandPlan,
    config: DictConfig,
    plugins: Mapping[str, str],
    choices: Mapping[str, str],
    config_dir: str | None = None,
) -> str:
    """Write the experiment with the plan's views."""
    values = _as_data(config)
    _put_views(values, plan, plugins)
    chosen = {g: choices.get(g, f"schema/{plugins[g]}") for g in plugins}
    base = _base(chosen, config_dir)
    wider = [g for g in plugins if _has_more(base.get(g), values[g])]
    if wider:  # an entry of a table that the plan does not have: from the plugin alone
        chosen |= {g: f"schema/{plugins[g]}" for g in wider}
        base = _base(chosen, config_dir)
    differing = _differences(values, base)
    overrides = ({f"override /{g}": chosen[g]} for g in SINGLE_GROUPS if g in chosen)
    defaults = ["_self_", *overrides]
    told = (
        f"{len(plan.stands)} planned stands; the {plan.goal.criterion.name} bound asked for is "
        f"{1e3 * plan.asked:.3g} mm/s."
    )
    return choice_text([told], defaults, differing, apart=True)


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


def _differences(values: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Keep what is not in the base already."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        if key in base and value == base[key]:
            continue
        nested = isinstance(value, dict) and isinstance(base.get(key), dict)
        found[key] = _differences(value, base[key]) if nested else value
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
