"""`check=strain_truth`: strains of a surface against those of the virtual lab's plate.

Beside all places it examines the peak: the strain along its own direction at the place where the
truth's largest principal strain of a cycle is highest, and the concentration, which is that peak
over the r.m.s. of the largest principal strain of all places. The bound of the peak adds those of
the components, as if they went together in the least favourable way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.truth import errors_and_coverage
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, ComplexArray


@register("check", "strain_truth")
@dataclass
class StrainTruth(Check):
    """How far strains of the measured face are from the truth, and how often their bounds hold.

    The highest strain is examined by itself, as it is at the edge of a hole.
    """

    def examine(self, run: Examination) -> xr.Dataset:
        """Find errors and coverage of each strain at each frequency, and in all of them."""
        own = [run.groups["strain"]] if "strain" in run.groups else []
        strains = own or list(run.below(dataset.COMPARED_STRAIN, "strain").values())
        if not strains or not run.has("truth", "strain"):
            raise UserError(
                "check=strain_truth needs strains and the virtual lab's truth: choose "
                "reconstruction=shell and scene=plate"
            )
        strain, truth = strains[0], run.groups["truth"]["strain"].values
        level = float(student_factor(strain.attrs["confidence_level"], np.inf))
        bound = level * strain["strain_std_by_part"].values
        return dataset.group(
            "examined/strain_truth",
            {name: strain[name].values for name in ("strain_component", "frequency")},
            **errors_and_coverage(strain["strain"].values - truth, truth, bound),
            **_peak(strain["strain"].values, truth, bound.max(axis=0)),
        )


def _peak(found: ComplexArray, truth: ComplexArray, bound: Array) -> dict[str, Array]:
    """Compare the highest strain, by frequency; all shapes (place, strain component, frequency)."""
    largest, direction = largest_principal(truth)
    place = np.nanargmax(largest, axis=0)
    lines = np.arange(truth.shape[2])
    c, s = np.moveaxis(direction[place, lines], -1, 0)
    weight = np.stack([c * c, s * s, 2 * c * s])
    true, ours = (np.einsum("cf,fcf->f", weight, a[place]) for a in (truth, found))
    most = np.einsum("cf,fcf->f", np.abs(weight), bound[place])
    error = ours - true
    everywhere, _ = largest_principal(found)
    return {
        "peak": np.abs(ours),
        "peak_confidence": most,
        "true_peak": np.abs(true),
        "peak_covered": (np.maximum(np.abs(error.real), np.abs(error.imag)) <= most).astype(float),
        "concentration": np.abs(ours) / _size(everywhere),
        "true_concentration": np.abs(true) / _size(largest),
    }


def _size(strain: Array) -> Array:
    """Average strains, shape (place, frequency), over the places where they are known."""
    return np.asarray(np.sqrt(np.nanmean(strain**2, axis=0)))


def largest_principal(strain: ComplexArray) -> tuple[Array, Array]:
    """Find the largest principal strain of a cycle, and its direction.

    Of motion in one phase, which that of a resonance is: the phase is that of the sum of the
    squared components.

    Parameters
    ----------
    strain : ndarray of complex, shape (place, 3, frequency)
        e_ss, e_tt, e_st.

    Returns
    -------
    size : ndarray, shape (place, frequency)
    direction : ndarray, shape (place, frequency, 2)
        Unit vectors along s and t.
    """
    phase = np.exp(-0.5j * np.angle((strain**2).sum(axis=1, keepdims=True)))
    ss, tt, st = np.moveaxis((phase * strain).real, 1, 0)
    middle, radius = (ss + tt) / 2, np.hypot((ss - tt) / 2, st)
    angle = np.arctan2(st, (ss - tt) / 2) / 2 + np.where(middle < 0, np.pi / 2, 0)
    size = np.abs(middle) + radius
    return size, np.stack([np.cos(angle), np.sin(angle)], axis=-1)
