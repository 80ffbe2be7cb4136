"""`check=equilibrium`: Newton's law for a plate, patch by patch: forces that its motion asks for.

``D lap lap w - rho h omega^2 w`` is the pressure that acts on a plate (`sldvexp.shell.forces`). It
is nothing, but for damping, where nothing touches the plate; there bending waves are as long as
material, thickness and frequency say. So the residual's map shows where forces act, or where the
plate is none: a stiffener, a mass, an edge.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.on_surface import check_lines, check_patches, surface_field_of
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import xarray as xr
from sldvexp.shell.forces import PatchForces, patch_forces, patch_places, require_plate
from sldvexp.shell.lever import strongest
from sldvexp.statistics import student_factor
from sldvexp.typing import Array

#: Patches without which no common wave length is found.
FEWEST = 4


@register("check", "equilibrium")
@dataclass
class Equilibrium(Check):
    """Pressure on a plate by its own motion, with its bound, at the frequencies of most motion.

    Parameters
    ----------
    patches : list of 2 int
        Into how many the surface is cut along its first and its second direction.
    lines : int
        How many frequencies are examined, those of most motion.
    level : float
        Probability of forces, or of doubt, if there is no reason.
    """

    patches: list[int] = field(default_factory=lambda: [6, 5])
    lines: int = 8
    level: float = 0.01

    def __post_init__(self) -> None:
        checks = Checks()
        check_patches(checks, self.patches)
        check_lines(checks, self.lines, self.level)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find the pressure on every patch, and how long bending waves are.

        Raises
        ------
        UserError
            If the run has no field of a thin shell, or its surface bends.
        """
        found, frequency = surface_field_of(run, "equilibrium")
        require_plate(found, "equilibrium")
        places, sides = patch_places(found.fit, (self.patches[0], self.patches[1]))
        if len(places) < FEWEST:
            raise UserError(
                f"check=equilibrium: {len(places)} of {self.patches[0]} x {self.patches[1]} "
                f"patches lie on the structure as a whole, where {FEWEST} are needed"
            )
        lines = strongest(found.fit, self.lines)
        each = [patch_forces(found, places, sides, line, self.level / len(lines)) for line in lines]
        assert found.material is not None
        unsure = found.material.wave_uncertainty
        std = np.array([f.std for f in each])
        group = dataset.group(
            "examined/equilibrium",
            {
                "patch": np.arange(len(places)),
                "frequency": frequency[lines],
                "part": ["real", "imaginary"],
            },
            place_s=places[:, 0],
            place_t=places[:, 1],
            pressure=np.stack([f.pressure for f in each], axis=-1),
            pressure_std_by_part=np.moveaxis(std, 0, -1),
            acted=np.stack([f.acted for f in each], axis=-1),
            p_value=np.stack([f.p_value for f in each], axis=-1),
            wave_ratio=[f.gamma.real for f in each],
            wave_ratio_std=[np.hypot(f.gamma_std[0], unsure * f.gamma.real) for f in each],
            loss_factor=[-f.gamma.imag / f.gamma.real for f in each],
            loss_factor_std=[f.gamma_std[1] / abs(f.gamma.real) for f in each],
            p_whole=[f.p_whole for f in each],
        )
        return with_findings(group, told(each, frequency[lines], places, unsure, self.level))


def told(
    each: list[PatchForces], frequency: Array, places: Array, unsure: float, level: float
) -> list[Finding]:
    """Say where forces act, and whether bending waves are as long as they should be."""
    sure = float(student_factor(1 - level / len(each), np.inf))
    found = []
    for one, hertz in zip(each, frequency, strict=True):
        std = float(np.hypot(one.gamma_std[0], unsure * one.gamma.real))
        subject = f"{hertz:.6g} Hz"
        if one.acted.any() or one.p_whole < level / len(each):
            found.append(_forced(one, subject, places))
        elif abs(one.gamma.real - 1) > sure * std:
            waves = "shorter" if one.gamma.real > 1 else "longer"
            text = (
                f"at {subject} bending waves are {waves} than material and thickness say: rho h / "
                f"D is {one.gamma.real:.4g} +- {2 * std:.2g} times that, or forces act"
            )
            t = (one.gamma.real - 1) / std
            found.append(Finding("equilibrium", subject, text, Severity.doubtful, t, size=abs(t)))
    if found:
        return found
    ratios = [one.gamma.real for one in each]
    largest = max(ratios, key=lambda r: abs(r - 1))
    text = (
        "the plate moves as one on which nothing acts but damping: no pressure beyond its bound "
        f"on {len(places)} patches, rho h / D within {100 * abs(largest - 1):.2g} % of the "
        "material's"
    )
    return [Finding("equilibrium", "surface", text, Severity.note)]


def _forced(one: PatchForces, subject: str, places: Array) -> Finding:
    """Tell where forces act at one frequency; in most of the patches it is no such plate."""
    worst = int(np.argmin(one.p_value))
    s, t = 1e3 * places[worst]
    p_value = float(min(1.0, len(places) * one.p_value[worst]))
    size, std = float(abs(one.pressure[worst])), float(one.std[:, worst].max())
    if not one.acted.any():
        text = f"at {subject} forces act, or the plate is none, though not in any one patch"
        return Finding("equilibrium", subject, text, Severity.note, p_value=one.p_whole)
    where = f"most around [{s:.3g}, {t:.3g}] mm, with {size:.3g} +- {2 * std:.2g} Pa on average"
    count = int(one.acted.sum())
    if count >= len(places) // 2:
        text = f"at {subject} no plate of this material moves so, {where}"
        return Finding("equilibrium", subject, text, Severity.doubtful, np.nan, p_value, size)
    text = (
        f"at {subject} forces act on {count} of {len(places)} patches, {where}; or it is no plate"
    )
    return Finding("equilibrium", subject, text + " there", Severity.note, np.nan, p_value, size)
