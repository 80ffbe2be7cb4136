"""`check=lever_arm`: Love's theory held against the images, through the lever arm of the slopes.

The face of a thin shell that only bends moves along itself by ``-zeta grad w`` with zeta half the
thickness (`sldvexp.shell.lever`). Of zeta at several frequencies

    zeta = h/2 + a - c k^2 h/2

a surface that lies elsewhere, or another thickness, gives a, the same at all wave numbers k; shear
takes a part of the slope, and gives c: ``h^2 / (5 (1 - nu))`` in a solid sheet. Motion of the
middle along itself in phase with the bending shifts zeta of every line by something of its own, and
is tested beside it. Nothing else in the data of one face speaks of Love's theory: with any motion
of the middle allowed it fits whatever the face does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.on_surface import check_lines, surface_field_of
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import Checks
from sldvexp.lazy import xarray as xr
from sldvexp.shell import SurfaceField
from sldvexp.shell.lever import bending_lines, joint_arms, strongest, wave_number
from sldvexp.statistics import chi_square_p_value, student_factor
from sldvexp.typing import Array, IntArray

#: Spread of squared wave numbers, over their mean, from which a trend over them can be seen.
SPREAD = 0.2
#: Motions of the middle in either direction that are let free beside the lever arm.
FREE = 6


@register("check", "lever_arm")
@dataclass
class LeverArm(Check):
    """Lever arm of the slopes, with its bound, at the frequencies of most motion.

    It tests Love's theory on the images of a thin shell; `love` looks at how a field in a volume
    changes through its layers.

    Parameters
    ----------
    lines : int
        How many frequencies are examined, those of most motion.
    level : float
        Probability of doubt about a shell that is as stated.
    """

    lines: int = 8
    level: float = 0.01

    def __post_init__(self) -> None:
        checks = Checks()
        check_lines(checks, self.lines, self.level)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find lever arms, their trend over wave numbers, and what both speak against.

        Raises
        ------
        UserError
            If the run has no field of a thin shell.
        """
        found, frequency = surface_field_of(run, "lever_arm")
        arms = LeverArms.of(found, strongest(found.fit, self.lines))
        std = np.sqrt(np.diag(arms.covariance))
        group = dataset.group(
            "examined/lever_arm",
            {"frequency": frequency[arms.lines], "bending_part": ["in phase", "in quadrature"]},
            lever_arm=arms.stated + arms.change,
            lever_arm_std=std,
            confidence=float(student_factor(found.method.confidence, np.inf)) * std,
            stated=arms.stated,
            stated_std=arms.stated_std,
            wave_number=arms.wave_number,
            beside_membrane=arms.stated + arms.beside[0],
            beside_membrane_std=arms.beside[1],
            chi_square=arms.chi_square,
            p_value=chi_square_p_value(arms.chi_square, arms.freedom),
            offset=arms.trend[0][0],
            offset_std=np.sqrt(arms.trend[1][0, 0]),
            shear=arms.shear[0],
            shear_std=arms.shear[1],
            p_love=arms.p_love,
            p_arm=arms.p_arm,
            p_membrane=arms.p_membrane,
        )
        return with_findings(group, [told(arms, self.level)])


@dataclass(frozen=True, eq=False)
class LeverArms:
    """Lever arms of some lines, and all tests of them.

    Attributes
    ----------
    lines : ndarray of int
    stated, stated_std : float, m
        Half the thickness, and how well it and the surface's height are known.
    change : ndarray, shape (line,), m
        Of the lever arm from the stated one.
    covariance : ndarray, shape (line, line), m^2
        With the poses' common errors.
    beside : tuple of ndarray, shape (line,), m
        Changes and their standard errors with low motions of the middle free.
    wave_number : ndarray, shape (line,), rad/m
    chi_square, freedom : ndarray, shape (part, line)
        Of the score test that the middle does not move along itself, at the stated lever arm.
    free_chi_square, free_freedom : float
        Of all lines in phase together, with their lever arms free.
    solid : float, m^2
        c of a solid sheet.
    """

    lines: IntArray
    stated: float
    stated_std: float
    change: Array
    covariance: Array
    beside: tuple[Array, Array]
    wave_number: Array
    chi_square: Array
    freedom: Array
    free_chi_square: float
    free_freedom: int
    solid: float

    @classmethod
    def of(cls, found: SurfaceField, lines: IntArray) -> LeverArms:
        """Examine some lines of a shell field."""
        fit, sheet = found.fit, found.material
        assert sheet is not None
        both = bending_lines(fit, lines)
        stated_std = float(np.hypot(found.method.height_tolerance, sheet.tolerance.thickness / 2))
        change, covariance = joint_arms([b[0].arm_system() for b in both], 1).estimate()
        freed, freed_covariance = joint_arms([b[0].arm_system(FREE) for b in both], 1).estimate()
        tests = np.array([[line.membrane_test(stated_std) for line in b] for b in both])
        free = np.array([b[0].membrane_test(None) for b in both]).sum(axis=0)
        return cls(
            lines,
            sheet.thickness / 2,
            stated_std,
            change,
            covariance,
            (freed, np.sqrt(np.diag(freed_covariance))),
            wave_number(fit, lines),
            tests[..., 0].T,
            tests[..., 1].T,
            float(free[0]),
            int(free[1]),
            sheet.thickness**2 / (5 * (1 - sheet.nu)),
        )

    @property
    def has_trend(self) -> bool:
        """True if wave numbers differ enough that shear can be told from height."""
        squares = self.wave_number**2
        return bool(np.ptp(squares) > SPREAD * squares.mean())

    @property
    def trend(self) -> tuple[Array, Array]:
        """Offset a, m, and c, m^2, with their covariance; a alone where no trend can be seen."""
        design = np.ones((len(self.lines), 1))
        if self.has_trend:
            design = np.column_stack([design, -self.stated * self.wave_number**2])
        return self._regressed(design)

    @property
    def height(self) -> tuple[float, float]:
        """Offset a, m, if there is no shear, with its standard error."""
        found, covariance = self._regressed(np.ones((len(self.lines), 1)))
        return float(found[0]), float(np.sqrt(covariance[0, 0]))

    def _regressed(self, design: Array) -> tuple[Array, Array]:
        """Regress changes of the lever arm on columns, of which the first is a common one."""
        weighted = np.linalg.solve(self.covariance, design)
        covariance = np.asarray(np.linalg.inv(design.T @ weighted))
        found = covariance @ weighted.T @ self.change
        covariance[0, 0] += self.stated_std**2
        return found, covariance

    @property
    def shear(self) -> tuple[float, float]:
        """Part of the slope that shear takes at the shortest waves, with its standard error."""
        found, covariance = self.trend
        if len(found) == 1:
            return np.nan, np.nan
        most = float(self.wave_number.max() ** 2)
        return float(found[1] * most), float(np.sqrt(covariance[1, 1]) * most)

    @property
    def scatter(self) -> tuple[float, int]:
        """Chi-square of what lever arms of single lines differ from the trend, and its freedom."""
        found, _ = self.trend
        left = self.change - found[0]
        if len(found) == 2:
            left = left + self.stated * self.wave_number**2 * found[1]
        return float(left @ np.linalg.solve(self.covariance, left)), len(left) - len(found)

    @property
    def p_love(self) -> float:
        """Probability of as much motion of the middle, in phase, if there is bending alone."""
        return float(chi_square_p_value(self.chi_square[0].sum(), self.freedom[0].sum()))

    @property
    def p_arm(self) -> float:
        """Probability of such a lever arm, and trend, if it is half the thickness."""
        found, covariance = self.trend
        return float(chi_square_p_value(found @ np.linalg.solve(covariance, found), len(found)))

    @property
    def p_membrane(self) -> float:
        """Probability of such motion of the middle, in phase, whatever the lever arms are.

        That of single lines' lever arms that go with neither height nor shear counts with it.
        """
        scattered, freedom = self.scatter
        return float(
            chi_square_p_value(self.free_chi_square + scattered, self.free_freedom + freedom)
        )


def told(arms: LeverArms, level: float) -> Finding:
    """Say in a sentence what the lever arms tell, and what they cannot."""
    p_value = min(1.0, 2 * min(arms.p_love, arms.p_arm))
    shear, shear_std = arms.shear
    by_shear = shear > float(student_factor(1 - level, np.inf)) * shear_std
    found, covariance = arms.trend
    off, std = (found[0], np.sqrt(covariance[0, 0])) if by_shear else arms.height
    if arms.height[1] > arms.stated:
        text = (
            "the images do not tell the lever arm of the slopes: it is known to "
            f"{2e3 * arms.height[1]:.2g} mm, more than the thickness; views from other sides would"
        )
        return Finding("lever_arm", "surface", text, Severity.note)
    arm = (
        f"the lever arm of the slopes is {1e3 * (arms.stated + off):.4g} +- {2e3 * std:.2g} mm "
        f"{'at long waves ' * by_shear}where half the thickness is {1e3 * arms.stated:.4g} mm"
    )
    severity, remedy = Severity.note, ""
    cause = (
        "nothing speaks against bending by Love's theory, though motion of the middle that goes "
        "with the slopes would look like another height"
    )
    if p_value < level:
        severity = Severity.doubtful
        cause, remedy = _cause(arms, level, float(off), float(std), by_shear)
    return Finding(
        "lever_arm",
        "surface",
        f"{arm}: {cause}",
        severity,
        float(arms.chi_square[0].sum()),
        p_value,
        1e3 * abs(float(off)),
        remedy,
    )


def _cause(
    arms: LeverArms, level: float, off: float, std: float, by_shear: bool
) -> tuple[str, str]:
    """Name what the lever arm speaks for, and the setting that would declare it."""
    if arms.p_membrane < level:
        free, free_std = (float(v[np.argmin(arms.beside[1])]) for v in arms.beside)
        return (
            "in phase with the bending the middle moves along itself too (chi-square "
            f"{arms.free_chi_square:.4g} of {arms.free_freedom}), which shifts it; with low "
            f"motions of the middle free it is {1e3 * (arms.stated + free):.4g} +- "
            f"{2e3 * free_std:.2g} mm, and height or shear cannot be told from such motion",
            "",
        )
    higher = f"{1e3 * abs(off):.2g} mm {'higher' if off < 0 else 'lower'} than given"
    thicker = f"the sheet is {2e3 * abs(off):.2g} mm {'thinner' if off < 0 else 'thicker'}"
    remedy = f"reconstruction.height_tolerance={abs(off):.1g}"
    if not arms.has_trend:
        share = -100 * off / arms.stated
        slides = f"shear takes {share:.2g} % of the slope, " if share > 0 else ""
        return (
            f"the surface lies {higher}, {thicker}, {slides}or the middle moves along itself in "
            "phase; one wave number cannot tell them apart",
            remedy,
        )
    by_height = abs(off) > float(student_factor(1 - level, np.inf)) * std
    lies = f"the surface lies {higher}, or {thicker}"
    if by_shear:
        share, share_std = arms.shear
        slides = (
            f"shear takes {100 * share:.2g} +- {200 * share_std:.2g} % of the slope at the "
            f"shortest waves (a solid sheet's {100 * arms.solid * arms.wave_number.max() ** 2:.2g} "
            "%), as the arm's fall with the square of the wave number says"
        )
        return (f"{slides}; {lies}", remedy) if by_height else (slides, "")
    if by_height:
        not_shear = "it is no shear, which grows with the square of the wave number"
        return f"{lies}; {not_shear}", remedy
    return "neither a height nor shear alone explains it", ""
