"""`check=modal_truth`: modes against those of the virtual lab's structure.

A true mode within the band is found if a mode lies within half the width of its resonance, and of
two that do, the nearer one; the others are false. Shapes are compared on the true surface, each
component by its modal assurance criterion ``|a' b|^2 / (a' a) (b' b)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.truth import Columns
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.virtual_lab.plate import VibratingPlate, VibratingScene


@register("check", "modal_truth")
@dataclass
class ModalTruth(Check):
    """How far modes are from the truth, how many are missed or false, and how often bounds hold."""

    def examine(self, run: Examination) -> xr.Dataset:
        """Find errors and coverage of poles, and of shapes if there are fields of the modes."""
        e = run.experiment
        if not run.has("modes", "natural_frequency") or not isinstance(e.scene, VibratingScene):
            raise UserError(
                "check=modal_truth needs modes and the virtual lab's truth: choose modal=own and "
                "scene=plate"
            )
        modes, plate = run.groups["modes"], VibratingPlate.built(e.scene.plate)
        line = modes["line_frequency"].values
        true = np.flatnonzero(
            (plate.modes.frequency >= line.min()) & (plate.modes.frequency <= line.max())
        )
        natural, damping = plate.modes.frequency[true], plate.modes.damping[true]
        own = _matched(modes["natural_frequency"].values, natural, damping)
        found = own >= 0
        errors, covered = {}, []
        for name, truth in (("natural_frequency", natural), ("damping_ratio", damping)):
            error = np.full(len(true), np.nan)
            error[found] = modes[name].values[own[found]] - truth[found]
            bound = student_factor(0.95, np.inf) * modes[f"{name}_std"].values[own[found]]
            covered += [np.abs(error[found]) <= bound]
            errors[f"{name}_error"] = error / truth
        shapes = {}
        if run.has("modes/field", "velocity") and "volume" in run.groups and found.any():
            shapes = self._shapes(run, plate, true[found], own[found])
        return dataset.group(
            "examined/modal_truth",
            {"true_mode": [plate.mode_names[k] for k in true]},
            found=found,
            false_modes=len(modes["mode"]) - int(found.sum()),
            missed_modes=int((~found).sum()),
            covered=float(np.mean(covered)) if found.any() else np.nan,
            **errors,
            **{name: _all(values, found) for name, values in shapes.items()},
        )

    def _shapes(
        self, run: Examination, plate: VibratingPlate, true: IndexArray, own: IndexArray
    ) -> dict[str, Array]:
        """Compare mode shapes on the true surface, arrays (mode, component)."""
        volume, scan = run.groups["volume"], run.experiment.scan
        points = volume["position"].values
        columns = Columns.from_volume(volume, plate.height(points))
        images = [part for part in scan.parts(scan.view_names()[0]) if part.kind == "image"]
        amplitude = float(np.mean(images[0].sampling.amplitude))
        truth = columns.at_surface(amplitude * plate.modal_velocity(points)[..., true])
        field = run.groups["modes/field"].isel(frequency=own)
        if "n" in field["component"].values:
            truth = np.einsum("nca,nam->ncm", volume["frame"].values[columns.inside], truth)
        seen = columns.at_surface(field["velocity"].values)
        of_parts = field["confidence_by_part"].transpose("part", *field["velocity"].dims).values
        bound = np.stack([columns.at_surface(part) for part in of_parts])
        error = seen - truth
        held = np.abs(np.stack([error.real, error.imag])) <= bound
        size = np.sqrt(np.nanmean(truth**2, axis=0))
        return {
            "mac": _mac(seen, truth).T,
            "shape_error": (np.sqrt(np.nanmean(np.abs(error) ** 2, axis=0)) / size).T,
            "shape_covered": held.mean(axis=(0, 1)).T,
        }


def _matched(found: Array, natural: Array, damping: Array) -> IndexArray:
    """Find the mode of each true one; -1 where there is none."""
    own = np.full(len(natural), -1)
    for mode, hertz in enumerate(found):
        nearest = int(np.abs(natural - hertz).argmin()) if len(natural) else -1
        if nearest < 0 or abs(natural[nearest] - hertz) > damping[nearest] * natural[nearest]:
            continue
        if own[nearest] < 0 or abs(found[own[nearest]] - natural[nearest]) > abs(
            hertz - natural[nearest]
        ):
            own[nearest] = mode
    return own


def _mac(some: NDArray[np.inexact], others: NDArray[np.inexact]) -> Array:
    """Compare shapes (node, component, mode) of two sources, (component, mode)."""
    product = np.abs(np.nansum(some.conj() * others, axis=0)) ** 2
    norms = [np.nansum(np.abs(a) ** 2, axis=0) for a in (some, others)]
    return np.asarray(product / (norms[0] * norms[1]))


def _all(values: Array, found: BoolArray) -> Array:
    """Spread values of the modes that were found over all true ones."""
    whole = np.full((len(found), *values.shape[1:]), np.nan)
    whole[found] = values
    return whole
