"""`check=power_flow`: energy in a plate: where power enters, where it goes, and whether it adds up.

The intensity of bending waves (`sldvexp.shell.power`) shows the way that power takes from where
forces put it in to where damping takes it. What leaves a window around a force, and what damping
takes inside of it, is what the force puts in, ``1/2 Re(F V*)``: a balance of the motion's third
derivatives against a force that was measured. Splines spread a point force over the length that
their noise leaves them; `SPREAD` of its power is in the bound for that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.on_surface import check_lines, check_patches, surface_field_of
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.shell import SurfaceField
from sldvexp.shell.forces import patch_places, require_plate
from sldvexp.shell.lever import strongest
from sldvexp.shell.power import dissipated, fed, intensity, leaving
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, IntArray

#: Standard uncertainty of the power that leaves a point force's window, over what it puts in.
SPREAD = 0.15


@dataclass
class PointForce:
    """A force along the normal that acts at one place, as it was measured.

    Parameters
    ----------
    place : list of 2 float, m
        Along the surface's first and second direction, from where both are 0.
    amplitude : list of float, N
        Peak, at every frequency of the run.
    phase : list of float, deg
        To the reference channel.
    side : float, m
        Of the window around it, which ends before the surface does.
    """

    place: list[float] = field(default_factory=list)
    amplitude: list[float] = field(default_factory=list)
    phase: list[float] = field(default_factory=list)
    side: float = 0.2

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no force can be."""
        message = f"must be 2 numbers in m, as in [0.02, -0.03], not {self.place}"
        checks.require(len(self.place) == 2, f"{name}.place", message)
        checks.finite(f"{name}.place", *self.place)
        checks.positive(f"{name}.side", self.side)
        checks.require(bool(self.amplitude), f"{name}.amplitude", "must be given, in N")
        count, given = len(self.amplitude), len(self.phase)
        message = f"must have as many numbers as amplitude, {count}, not {given}"
        checks.require(given == count, f"{name}.phase", message)


@register("check", "power_flow")
@dataclass
class PowerFlowCheck(Check):
    """Power that flows in a plate and leaves its patches, against what forces put in.

    Parameters
    ----------
    patches : list of 2 int
        Into how many the surface is cut along its first and its second direction.
    lines : int
        How many frequencies are examined, those of most motion.
    loss_factor : float
        Of the material; damping takes power everywhere.
    forces : dict of str to PointForce
        Measured ones, whose power is compared.
    level : float
        Probability of power that enters or leaves, or of doubt, if there is no reason.
    """

    patches: list[int] = field(default_factory=lambda: [6, 5])
    lines: int = 8
    loss_factor: float = 0.0
    forces: dict[str, PointForce] = field(default_factory=dict)
    level: float = 0.01

    def __post_init__(self) -> None:
        checks = Checks()
        check_patches(checks, self.patches)
        check_lines(checks, self.lines, self.level)
        checks.non_negative("loss_factor", self.loss_factor)
        for name, force in self.forces.items():
            force.check(checks, f"forces.{name}")
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Map the intensity and what leaves every patch; compare forces.

        Raises
        ------
        UserError
            If the run has no field of a thin shell, its surface bends, or a force is beside it.
        """
        found, frequency = surface_field_of(run, "power_flow")
        require_plate(found, "power_flow")
        places, sides = patch_places(found.fit, (self.patches[0], self.patches[1]))
        if not len(places):
            raise UserError("check=power_flow: no patch lies on the structure as a whole")
        lines, loss = strongest(found.fit, self.lines), self.loss_factor
        flows = [intensity(found, places, line, loss) for line in lines]
        out = [leaving(found, places, sides, line, loss) for line in lines]
        lost = np.stack([dissipated(found, places, sides, line, loss) for line in lines], axis=-1)
        power = np.stack([one.power for one in out], axis=-1)
        std = np.stack([one.std for one in out], axis=-1)
        balance = self._balance(found, lines)
        group = dataset.group(
            "examined/power_flow",
            {
                "patch": np.arange(len(places)),
                "frequency": frequency[lines],
                "direction": ["s", "t"],
                "force": list(self.forces),
            },
            place_s=places[:, 0],
            place_t=places[:, 1],
            intensity=np.stack([one.power for one in flows], axis=-1),
            intensity_std=np.stack([one.std for one in flows], axis=-1),
            leaves=power,
            leaves_std=std,
            dissipated=lost,
            **balance,
        )
        findings = _entering(power + lost, std, frequency[lines], places, self.level)
        findings += _balanced(list(self.forces), balance, frequency[lines], self.level)
        return with_findings(group, findings)

    def _balance(self, found: SurfaceField, lines: IntArray) -> dict[str, Array]:
        """Compare the power of every force with what leaves its window, (force, frequency) each."""
        if not self.forces:
            return {}
        count = len(found.fit.measured.scale)
        rows = []
        for name, force in self.forces.items():
            sides = _window_of(found, name, force)
            if len(force.amplitude) != count:
                raise UserError(
                    f"check.power_flow: {name}.amplitude must have {count} numbers, one for each "
                    f"frequency of the run, not {len(force.amplitude)}"
                )
            newton = np.array(force.amplitude) * np.exp(1j * np.radians(force.phase))
            place = np.array([force.place])
            for line in lines:
                put_in = fed(found, place, newton[[line]], line)
                goes = leaving(found, place, sides, line, self.loss_factor)
                lost = dissipated(found, place, sides, line, self.loss_factor)
                rows.append([put_in.power[0], put_in.std[0], goes.power[0], goes.std[0], lost[0]])
        values = np.array(rows).reshape(len(self.forces), len(lines), 5)
        power, power_std, goes_out, out_std, lost_there = np.moveaxis(values, -1, 0)
        spread = SPREAD * np.abs(power)
        return {
            "fed": power,
            "fed_std": power_std,
            "found": goes_out + lost_there,
            "found_std": np.sqrt(out_std**2 + spread**2),
        }


def _window_of(found: SurfaceField, name: str, force: PointForce) -> Array:
    """Find the sides of a force's window that ends on the structure, shape (2,), m."""
    outline, place = found.fit.outline, np.array(force.place)
    room = 2 * np.minimum(place - outline.low, outline.high - place)
    sides = np.minimum(force.side, room)
    tried = np.linspace(-0.5, 0.5, 9) * (1 - 1e-6)
    if (sides <= 0).any() or not outline.holds(
        place + np.stack(np.meshgrid(tried, tried), axis=-1).reshape(-1, 2) * sides
    ).all():
        (a, b), (c, d) = outline.low, outline.high
        raise UserError(
            f"check.power_flow: the window of {name} is not on the surface as a whole: place is "
            f"within [{a:.4g} .. {c:.4g}, {b:.4g} .. {d:.4g}] m, or its side smaller"
        )
    return sides


def _entering(
    power: Array, std: Array, frequency: Array, places: Array, level: float
) -> list[Finding]:
    """Say where power enters, beyond what damping takes there, at every frequency that shows it."""
    sure = float(student_factor(1 - level / power.size, np.inf))
    found = []
    for i, hertz in enumerate(frequency):
        z = power[:, i] / std[:, i]
        most = int(np.argmax(z))
        if z[most] < sure:
            continue
        s, t = 1e3 * places[most]
        text = (
            f"at {hertz:.6g} Hz power enters the plate around [{s:.3g}, {t:.3g}] mm: "
            f"{1e3 * power[most, i]:.3g} +- {2e3 * std[most, i]:.2g} mW"
        )
        p_value = float(min(1.0, power.size * scipy.special.ndtr(-z[most])))
        subject, size = f"{hertz:.6g} Hz", 1e3 * float(power[most, i])
        note = Severity.note
        found.append(Finding("power_flow", subject, text, note, float(z[most]), p_value, size))
    if found:
        return found
    text = f"no power beyond its bound enters any of {len(places)} patches"
    return [Finding("power_flow", "surface", text, Severity.note)]


def _balanced(
    names: list[str], balance: Mapping[str, Any], frequency: Array, level: float
) -> list[Finding]:
    """Say whether forces put in what leaves, one sentence a force."""
    found = []
    for k, name in enumerate(names):
        power, goes = balance["fed"][k], balance["found"][k]
        std = np.hypot(balance["fed_std"][k], balance["found_std"][k])
        z = (goes - power) / std
        worst = int(np.argmax(np.abs(z)))
        p_value = float(min(1.0, len(z) * 2 * scipy.special.ndtr(-abs(z[worst]))))
        doubt = p_value < level
        text = (
            f"at {frequency[worst]:.6g} Hz the force {name} puts in {1e3 * power[worst]:.3g} mW, "
            f"and {1e3 * goes[worst]:.3g} +- {2e3 * std[worst]:.2g} mW leave or are lost around it"
            f"{': the balance of energy does not hold' if doubt else ''}"
        )
        severity = Severity.doubtful if doubt else Severity.note
        size = 1e3 * float(abs(goes[worst] - power[worst]))
        found.append(
            Finding("power_flow", f"force {name}", text, severity, float(z[worst]), p_value, size)
        )
    return found
