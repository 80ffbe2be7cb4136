"""`sldvexp truth <run> [scene=name]`: how far a run is from what was true in the virtual lab.

A run that was measured with the lab in the instrument's place, also from the console, knows no
scene; here it is told. Nothing is run again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.truth import Truth
from sldvexp.config import Origins, composing, registry, schema
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import RUN_FILE
from sldvexp.errors import UserError
from sldvexp.geometry import vector_from_rotation
from sldvexp.lazy import xarray as xr
from sldvexp.report.key_numbers import MIDDLE, surface_name
from sldvexp.sweep import recorded_config
from sldvexp.virtual_lab.console import with_planned_stands
from sldvexp.virtual_lab.field_truth import middle_truth_of, truth_of

#: Error as a part of what is true from which the truth is nothing but rounding.
NOTHING = 1e6


def run(words: list[str], config_dir: str | None) -> int:
    """Print how far poses and field of a run are from the truth of a scene, a line each.

    Raises
    ------
    UserError
        If there is no finished run, no scene, or nothing of it that the scene knows.
    """
    folders = [word for word in words if "=" not in word]
    settings = [word for word in words if word not in folders]
    if len(folders) != 1:
        raise UserError("command line: truth takes the folder of one run, and scene=name")
    for override in Origins(settings).overrides:
        if override.key_or_group.partition(".")[0] != "scene":
            raise UserError(
                f"command line: {override.key_or_group}: truth takes settings of scene alone; the "
                "others are the run's own"
            )
    path = Path(folders[0])
    file = path / RUN_FILE if path.is_dir() else path
    with dataset.load(file) as tree:
        found = recorded_config.read(file, tree.attrs)
        registry.load_installed()
        e = schema.build(found.config())
        groups = {n.path.strip("/"): n.to_dataset(inherit=False).load() for n in tree.subtree}
    if settings:
        e = replace(e, scene=composing.made_from(["~experiment", *settings], config_dir).scene)
    if e.scene is None:
        raise UserError(
            f"{file}: knows no scene, as one that was measured; say which the lab had, as "
            f"scene=practice behind {path}, with --config-dir and the folder of that scene"
        )
    told = [*_of_poses(e, groups), *_of_field(e, groups)]
    if not told:
        raise UserError(
            f"{file}: has neither poses of views that the scene has, nor a field of a plate"
        )
    print("\n".join(told))
    return 0


def _of_poses(e: Experiment, groups: dict[str, xr.Dataset]) -> Iterator[str]:
    """Yield how far the pose of each view is from where the instrument stood in the lab."""
    if "pose" not in groups:
        return
    scene, _ = with_planned_stands(e)
    for name in groups["pose"]["view"].values:
        if str(name) not in scene.views:
            continue
        one, true = groups["pose"].sel(view=name), scene.views[str(name)]
        away = 1e3 * np.linalg.norm(one["origin"].values - true.place)
        turned = vector_from_rotation(one["rotation"].values @ true.rotation.T)
        std = 1e3 * np.linalg.norm(one["origin_std"].values) if "origin_std" in one else np.nan
        sure = f" (standard error {std:.2g} mm)" if np.isfinite(std) else ""
        yield (
            f"view {name}: its pose is {away:.2g} mm{sure} and "
            f"{np.degrees(np.linalg.norm(turned)):.2g} deg beside the true one"
        )


def _of_field(e: Experiment, groups: dict[str, xr.Dataset]) -> Iterator[str]:
    """Yield how far each component of the velocity is from the plate's, and if its bounds hold."""
    if "field" not in groups or "volume" not in groups:
        return
    if not hasattr(e.scene, "plate"):
        yield "field: the scene has no plate, so that its true velocity is not known"
        return
    truth = truth_of(e, groups)
    yield "on the measured face, which the beam meets:"
    yield from _errors_at(e, groups, truth)
    if surface_name(groups["field"]) == MIDDLE and "depth" in groups["volume"]:
        yield "on the middle surface, which moves along itself only where it is stretched:"
        yield from _errors_at(e, groups, middle_truth_of(e, groups, truth))


def _errors_at(e: Experiment, groups: dict[str, xr.Dataset], truth: xr.Dataset) -> Iterator[str]:
    """Yield how far each component is from the truth where the truth's height is zero."""
    known = {**groups, "truth": truth}
    seen = Examination(known, rng=np.random.default_rng(e.seed), experiment=e)
    with np.errstate(divide="ignore", invalid="ignore"):  # nothing moves along the middle surface
        found = Truth().examine(seen)
    for name in found["component"].values:
        one = found.sel(component=name)
        for hertz in found["frequency"].values:
            at = one.sel(frequency=hertz)
            relative = float(at["relative_error"])
            true = float(at["rms_error"]) / relative if np.isfinite(relative) else 0.0
            part = f", {relative:.2%}" if relative < NOTHING else ""
            yield (
                f"{name} at {hertz:g} Hz: {1e3 * float(at['rms_error']):.2g} mm/s r.m.s. off the "
                f"true {1e3 * true if part else 0.0:.3g} mm/s{part}; bounds of "
                f"± {1e3 * float(at['rms_bound']):.2g} mm/s hold at {float(at['covered']):.0%}"
            )
